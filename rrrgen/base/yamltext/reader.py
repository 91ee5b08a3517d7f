"""Base reader of mapping, experiment and response files: typed values from located nodes.

Where a node does not hold what is asked for, the reader records the fault with its place and returns a neutral value,
so that one pass finds every fault of a file.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TypeVar

from rrrgen.base.yamltext.document import FaultList, Node, Scalar, Sequence
from rrrgen.base.yamltext.keys import Entries
from rrrgen.base.yamltext.sections import describe, read_entries
from rrrgen.base.yamltext.signal_units import read_quantity
from rrrgen.base.yamltext.suggest import did_you_mean

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
        found: dict[str, Node] = {}
        for name, (key, value) in entries.items():
            if name not in allowed:
                hint = self.elsewhere.get(name) or hint_for(name, allowed)
                self.faults.error(key, f"unknown key '{name}' in {what}", hint)
            elif isinstance(value, Scalar) and value.is_null:
                self.faults.error(key, f"'{name}' has no value")
            else:
                found[name] = value
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
        return found

    def text(self, node: Node, what: str) -> str:
        """The text of a scalar; a fault and an empty string otherwise."""
        if isinstance(node, Scalar) and not node.is_null:
            return node.text
        self.faults.error(node, f"{what} is {describe(node)}, not a text")
        return ""

    def choice(self, node: Node, what: str, allowed: Collection[str]) -> str:
        """The word in ``node``; one outside ``allowed`` is a fault and returned unchanged."""
        value = self.text(node, what)
        if value and value not in allowed:
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
        if not isinstance(node, Sequence) or len(node.items) != length:
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
        items = node.items if isinstance(node, Sequence) else [node] * joints
        if len(items) != joints:
            self.faults.error(node, f"{what} has {len(items)} entries for {joints} joints")
        return tuple(read_quantity(item, what, table, bare, self.faults) for item in items)


def hint_for(word: str, allowed: Collection[str]) -> str:
    """Hint for an unknown ``word``: the nearest allowed word, if any, and the list of all allowed ones."""
    return f"{did_you_mean(word, tuple(allowed))} allowed are {', '.join(allowed)}".strip()
