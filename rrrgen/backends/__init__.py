"""Backends print programs; here is what all of them need. Backends never import each other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Real = Literal["double", "float"]
"""The floating-point type of emitted code."""


Language = Literal["rust"]
"""Languages that are printed when asked for, beside C and CasADi."""


@dataclass(frozen=True)
class Identity:
    """What ties emitted code to its model: hash of the normalised robot description, and who wrote the code."""

    model_hash: str
    tool_version: str
