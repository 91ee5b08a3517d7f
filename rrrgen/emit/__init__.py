"""Everything that writes files from a model: C, CasADi, LaTeX, HTML, and the targets in other languages and formats."""

from __future__ import annotations

from typing import Literal

Real = Literal["double", "float"]
"""The floating-point type of emitted code."""
