"""Mappings of located YAML: key tables, readers of values with units, and faults about unknown or missing keys."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, NamedTuple, TypeVar

from rrrgen.base.yamltext.document import FaultList, MappingNode, Node, ScalarNode, SequenceNode, describe, shorten
from rrrgen.base.yamltext.suggestions import comma_advice, did_you_mean, key_cut_by_comma, nearest, number_cut_by_comma

# ------------------------------------------------------------------------------------------------------------------
# Tables of the keys of a file format, one per section; readers, messages, schema and pages are derived from them.
# ------------------------------------------------------------------------------------------------------------------

Kind = Literal[
    "text",
    "name",
    "choice",
    "choices",
    "transforms",
    "pair",
    "points",
    "displacements",
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


# ------------------------------------------------------------------------------------------------------------------
# Checks the mappings of a file against their key tables: unknown, duplicate, missing and empty keys.
# ------------------------------------------------------------------------------------------------------------------


def read_entries(node: Node, what: str, faults: FaultList) -> dict[str, tuple[ScalarNode, Node]] | None:
    """The entries of a mapping as key text -> (key node, value node); a fault and None if ``node`` is not a mapping.

    Duplicate keys and keys that are not plain words are faults; the first of several equal keys is kept.
    """
    if not isinstance(node, MappingNode):
        faults.error(
            node, f"{what} is {describe(node)}, not a mapping", "write {key: value, ...} or indented key: value"
        )
        return None
    entries: dict[str, tuple[ScalarNode, Node]] = {}
    for place, (key, value) in enumerate(node.entries):
        if not isinstance(key, ScalarNode):
            faults.error(key, f"{describe(key)} as a key of {what}", "keys are plain words")
        elif number := key_cut_by_comma(node, place):
            faults.error(key, f"unknown key '{shorten(key.text)}' in {what}", comma_advice(number))
        elif key.text in entries:
            first = entries[key.text][0].place
            faults.error(key, f"duplicate key '{shorten(key.text)}'", f"first given at line {first.line}")
        else:
            entries[key.text] = (key, value)
    return entries


def read_section(node: Node, section: str, what: str, faults: FaultList, form: Format) -> dict[str, Node] | None:
    """The values of a mapping by key, checked against the key table ``section`` of the file format ``form``.

    Unknown, missing and empty keys are faults; keys without a value are left out. None if ``node`` is not a mapping. A
    misspelt key that is required is one fault, not two: its value is read as that of the key that was meant.
    """
    entries = read_entries(node, what, faults)
    if entries is None:
        return None
    table = {key.name: key for key in form.sections[section]}
    values: dict[str, Node] = {}
    for name, (key, value) in list(entries.items()):
        if name not in table:
            faults.error(key, f"unknown key '{shorten(name)}' in {what}", _unknown_hint(name, table, form))
            meant = nearest(name, table, _synonyms(table, form))
            if meant is not None and table[meant].required and meant not in entries:
                entries[meant] = (key, value)
                values[meant] = value
        elif isinstance(value, ScalarNode) and value.is_null and table[name].kind != "mapping":
            faults.error(key, f"'{name}' has no value", table[name].meaning)
        else:
            values[name] = value
    for name, required in table.items():
        if required.required and name not in entries:
            faults.error(node, f"{what} needs the key '{name}'", _required_hint(required, form))
    return values


def _unknown_hint(name: str, table: dict[str, Key], form: Format) -> str:
    if name == "<<":
        return "merge keys are not supported; write the keys out"
    allowed = f"allowed are {', '.join(table)}"
    suggestion = did_you_mean(name, table, _synonyms(table, form))
    return f"{suggestion} {allowed}" if suggestion else allowed


def _synonyms(table: dict[str, Key], form: Format) -> dict[str, str]:
    """Words of other formats for the keys of ``table``."""
    return {word: key for word, key in form.aliases.items() if key in table}


def _required_hint(key: Key, form: Format) -> str:
    if key.choices:
        return f"{key.name}: {' | '.join(key.choices)} ({key.meaning})"
    if key.kind == "mapping":
        parts = [
            f"{inner.name}: {' | '.join(inner.choices) or '...'}"
            for inner in form.sections[key.section]
            if inner.required
        ]
        return f"{key.name}: {{{', '.join(parts)}}} ({key.meaning})"
    return f"{key.name}: {key.meaning}"


def read_text(node: Node, what: str, faults: FaultList) -> str:
    """The stripped text of a scalar; a fault and an empty string for a list or mapping."""
    if isinstance(node, ScalarNode):
        return "" if node.is_null else node.text.strip()
    faults.error(node, f"{what} is {describe(node)}, not text", "put the text in quotes")
    return ""


def read_choice(node: Node, key: Key, faults: FaultList) -> str | None:
    """One of the words in ``key.choices``; a fault and None for anything else."""
    if isinstance(node, ScalarNode) and node.text in key.choices:
        return node.text
    word = node.text if isinstance(node, ScalarNode) else ""
    hint = did_you_mean(word, key.choices) if word else ""
    allowed = "allowed is " if len(key.choices) == 1 else "allowed are "
    hint = f"{hint} {allowed}{', '.join(key.choices)}".strip()
    faults.error(node, f"{key.name}: {describe(node)} is not allowed", hint)
    return None


def read_choices(node: Node, key: Key, faults: FaultList) -> tuple[str, ...]:
    """Read a list of different words, each one of ``key.choices``; other words are faults and left out."""
    chosen: dict[str, None] = {}
    for item in read_list(node, key.name, None, faults) or ():
        word = read_choice(item, key, faults)
        if word in chosen:
            faults.error(item, f"{key.name}: '{word}' stands twice", "name each once")
        elif word is not None:
            chosen[word] = None
    return tuple(chosen)


def read_list(node: Node, what: str, length: int | None, faults: FaultList) -> list[Node] | None:
    """The items of a list, which must have ``length`` entries unless that is None; a fault and None otherwise."""
    if not isinstance(node, SequenceNode):
        faults.error(node, f"{what} is {describe(node)}, not a list", f"write [{', '.join('...' for _ in range(3))}]")
        return None
    if length is not None and len(node.items) != length:
        hint = f"{what} takes {length} values"
        if len(node.items) > length:
            hint += _decimal_commas(node.items, len(node.items) - length)
        faults.error(node, f"{what} has {len(node.items)} values instead of {length}", hint)
        return None
    return node.items


def _decimal_commas(items: list[Node], surplus: int) -> str:
    """Hint for a list that has ``surplus`` entries too many because its numbers were written with decimal commas."""
    pairs = list(pairwise(items))
    cut = [number_cut_by_comma(*pair) for pair in pairs]
    tight = [
        number if right.place.column == left.place.column + len(left.text) + 1 else None
        for number, (left, right) in zip(cut, pairs, strict=True)
        if isinstance(left, ScalarNode)
    ]
    meant = [number for number in tight if number]
    if len(meant) == surplus:
        return "; " + (comma_advice(meant[0]) if surplus == 1 else f"decimal comma? write {' and '.join(meant)}")
    return "; decimal comma? numbers are written with a point" if any(cut) else ""


# ------------------------------------------------------------------------------------------------------------------
# Base reader of mapping, experiment and response files: typed values from located nodes.
#
# Where a node does not hold what is asked for, the reader records the fault with its place and returns a neutral
# value, so that one pass finds every fault of a file.
# ------------------------------------------------------------------------------------------------------------------

Default = TypeVar("Default")

UNITLESS = {"one": 1.0}
"""The unit table of a dimensionless number."""


class Reader:
    """Reads the values of one file; everything wrong with it is collected in ``faults``.

    ``elsewhere`` maps keys that belong to another file format to a hint that says where they belong.
    """

    def __init__(self, faults: FaultList, elsewhere: Mapping[str, str] | None = None) -> None:
        self.faults = faults
        self.elsewhere = elsewhere or {}

    def values(self, node: Node, what: str, allowed: Entries) -> dict[str, Node] | None:
        """The values of a mapping by key, or None if ``node`` is not a mapping.

        ``what`` names the mapping in messages. Keys outside ``allowed``, keys without a value and absent ones that are
        required are faults.
        """
        entries = read_entries(node, what, self.faults)
        if entries is None:
            return None
        values: dict[str, Node] = {}
        for name, (key, value) in entries.items():
            if name not in allowed:
                hint = self.elsewhere.get(name) or hint_for(name, allowed)
                self.faults.error(key, f"unknown key '{name}' in {what}", hint)
            elif isinstance(value, ScalarNode) and value.is_null:
                self.faults.error(key, f"'{name}' has no value")
            else:
                values[name] = value
        missing = {
            name: entry.meaning.replace("`", "")
            for name, entry in allowed.items()
            if entry.required and name not in entries
        }
        if missing:
            plural = "s" if len(missing) > 1 else ""
            names = ", ".join(f"'{name}'" for name in missing)
            hint = "; ".join(f"{name}: {meaning}" for name, meaning in missing.items())
            self.faults.error(node, f"{what} needs the key{plural} {names}", hint)
        return values

    def text(self, node: Node, what: str) -> str:
        """The text of a scalar; a fault and an empty string otherwise."""
        if isinstance(node, ScalarNode) and not node.is_null:
            return node.text
        self.faults.error(node, f"{what} is {describe(node)}, not a text")
        return ""

    def choice(self, node: Node, what: str, allowed: Collection[str]) -> str:
        """The word in ``node``; one outside ``allowed`` is a fault and returned unchanged."""
        value = self.text(node, what)
        is_text = isinstance(node, ScalarNode) and not node.is_null  # anything else is a fault already
        if is_text and value not in allowed:
            self.faults.error(node, f"{what} is '{value}'", hint_for(value, allowed))
        return value

    def whole(self, node: Node | None, what: str, default: Default) -> int | Default:
        """Read a non-negative integer; ``default`` if ``node`` is None, or (with a fault) if it is something else."""
        if node is None:
            return default
        text = self.text(node, what)
        if text.isdecimal():
            return int(text)
        self.faults.error(node, f"{what} is '{text}', not a whole number")
        return default

    def quantity(
        self, node: Node | None, what: str, table: Mapping[str, float], bare: str, positive: bool = False
    ) -> float | None:
        """Read a value and convert it to SI; None if ``node`` is None or cannot be read.

        ``table`` maps the allowed units to their factors; a number without a unit is in ``bare``. With ``positive``,
        zero and negative values are faults.
        """
        if node is None:
            return None
        from rrrgen.base.yamltext.signal_units import read_quantity

        value = read_quantity(node, what, table, bare, self.faults)
        if value is not None and positive and value <= 0.0:
            self.faults.error(node, f"{what} must be positive")
            return None
        return value

    def number(self, node: Node | None, what: str) -> float | None:
        """Read a dimensionless number; None if ``node`` is None or cannot be read."""
        return self.quantity(node, what, UNITLESS, "one")

    def numbers(self, node: Node | None, what: str, length: int) -> list[float]:
        """Read a list of ``length`` dimensionless numbers; empty if any of them cannot be read."""
        if not isinstance(node, SequenceNode) or len(node.items) != length:
            self.faults.error(node, f"{what} needs a list of {length} numbers")
            return []
        values = [self.number(item, f"{what}[{i}]") for i, item in enumerate(node.items)]
        return [value for value in values if value is not None] if None not in values else []

    def per_joint(
        self, node: Node, what: str, joints: int, table: Mapping[str, float], bare: str
    ) -> tuple[float | None, ...]:
        """One SI value per joint, from a list with one entry per joint or from one value that applies to all joints.

        ``table`` and ``bare`` are those of :meth:`quantity`; a value that cannot be read is None.
        """
        from rrrgen.base.yamltext.signal_units import read_quantity

        items = node.items if isinstance(node, SequenceNode) else [node] * joints
        if len(items) != joints:
            self.faults.error(node, f"{what} has {len(items)} entries for {joints} joints")
        return tuple(read_quantity(item, what, table, bare, self.faults) for item in items)


def hint_for(word: str, allowed: Collection[str]) -> str:
    """Hint for an unknown ``word``: the nearest allowed word, if any, and the list of all allowed ones."""
    return f"{did_you_mean(word, tuple(allowed))} allowed are {', '.join(allowed)}".strip()
