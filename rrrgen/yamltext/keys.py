"""Keys of a file format: one table per section, used to read, to report faults and to make the JSON Schema."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Kind = Literal[
    "text",
    "name",
    "choice",
    "value",
    "vector",
    "matrix",
    "square",
    "mapping",
    "rows",
    "names",
    "basis",
    "count",
    "texts",
]


@dataclass(frozen=True)
class Key:
    """One key: its kind of value, and what it means.

    ``quantity`` is the quantity of a value or vector of a revolute joint, ``prismatic`` that of a prismatic one
    where it differs. ``section`` is the table of a mapping or of the rows of a list. ``file_units`` tells that bare
    numbers are in the units of the file, not in SI.
    """

    name: str
    kind: Kind
    meaning: str
    required: bool = False
    choices: tuple[str, ...] = ()
    quantity: str = "number"
    prismatic: str = ""
    section: str = ""
    file_units: bool = False
    length: int = 3

    def quantity_for(self, joint_type: str) -> str:
        """The quantity of this key for a joint of this type."""
        return self.prismatic if joint_type == "prismatic" and self.prismatic else self.quantity


@dataclass(frozen=True)
class Format:
    """The tables of one file format: its keys by section, and words that users bring along from other formats."""

    sections: Mapping[str, tuple[Key, ...]]
    aliases: Mapping[str, str]
