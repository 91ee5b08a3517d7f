"""Backends: printers that write programs as source files of a language. This module has the types that they share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Real = Literal["double", "float"]
"""The floating-point type of emitted code."""


@dataclass(frozen=True)
class Identity:
    """The origin of emitted code: SHA-256 of the normalized robot description, and the version of rrrgen."""

    model_hash: str
    tool_version: str
