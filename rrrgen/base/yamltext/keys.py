"""Tables of the keys of a file format, one per section; readers, messages, schema and pages are derived from them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

Kind = Literal[
    "text",
    "name",
    "choice",
    "choices",
    "transforms",
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
    """One key of a section: the kind of value it takes and what it means.

    - ``quantity``: the physical quantity of a value or vector (for a revolute joint); ``prismatic``: the quantity for a
      prismatic joint where it differs.
    - ``section``: the section that describes a mapping, or each row of a list.
    - ``file_units``: bare numbers are in the units that the file declares, otherwise in SI.
    - ``choices``: the allowed words; ``length``: the number of elements of a vector.
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
        """The physical quantity of this key for a joint of type ``joint_type`` ("revolute" or "prismatic")."""
        return self.prismatic if joint_type == "prismatic" and self.prismatic else self.quantity


class Entry(NamedTuple):
    """What one key of a mapping, experiment, controller or response file means, and the unit of its bare numbers.

    ``meaning`` is Markdown for the reference page; messages show it without the marks.
    """

    meaning: str
    unit: str = ""
    required: bool = False


Entries = Mapping[str, Entry]
"""The keys of one section of such a file."""


def words(choices: Collection[str]) -> str:
    """The allowed words for a meaning, in Markdown."""
    return ", ".join(f"`{choice}`" for choice in choices)


@dataclass(frozen=True)
class Format:
    """One file format: the keys of each of its ``sections``, by name.

    ``aliases`` maps words that other formats use to these keys, for suggestions.
    """

    sections: Mapping[str, tuple[Key, ...]]
    aliases: Mapping[str, str]
