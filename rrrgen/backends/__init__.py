"""Backends print programs: twin rooms behind one protocol. Backends never import each other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel

Real = Literal["double", "float"]
"""The floating-point type of emitted code."""


@dataclass(frozen=True)
class Identity:
    """What ties emitted code to its model: hash of the normalised robot description, and who wrote the code."""

    model_hash: str
    tool_version: str


class Backend(Protocol):
    """Turns a derived model into source files; pure, deterministic, and silent: writing is the business of emit."""

    name: str

    def files(self, model: DerivedModel, identity: Identity, real: Real) -> dict[str, str]:
        """The emitted files, relative path -> text with LF line ends."""
        ...
