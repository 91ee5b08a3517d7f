"""What readers of mapping, experiment and response files share: values of located nodes, and faults that do not stop.

A reader takes a value from a node; where the node holds something else, the fault is recorded with its place and a
stand-in is returned, so that one pass finds every fault of a file.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TypeVar

from rrrgen.yamltext.document import FaultList, Node, Scalar, Sequence
from rrrgen.yamltext.sections import describe, read_entries
from rrrgen.yamltext.signal_units import read_quantity
from rrrgen.yamltext.suggest import did_you_mean

Default = TypeVar("Default")

PLAIN = {"one": 1.0}
"""The table of units of a number without one."""


class Reader:
    """Reads one file; ``faults`` collects what is wrong with it.

    ``elsewhere`` says of keys that do not belong to this format where they belong.
    """

    def __init__(self, faults: FaultList, elsewhere: Mapping[str, str] | None = None) -> None:
        self.faults = faults
        self.elsewhere = elsewhere or {}

    def values(
        self, node: Node, what: str, allowed: Collection[str], required: Collection[str] = ()
    ) -> dict[str, Node] | None:
        """The values of a mapping by key; unknown, empty and missing keys are faults. None where it is no mapping."""
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
        missing = [name for name in required if name not in entries]
        if missing:
            plural = "s" if len(missing) > 1 else ""
            names = ", ".join(f"'{name}'" for name in missing)
            self.faults.error(node, f"{what} needs the key{plural} {names}")
        return found

    def text(self, node: Node, what: str) -> str:
        """Text; empty where the node holds none."""
        if isinstance(node, Scalar) and not node.is_null:
            return node.text
        self.faults.error(node, f"{what} is {describe(node)}, not a text")
        return ""

    def choice(self, node: Node, what: str, allowed: Collection[str]) -> str:
        """One of the words ``allowed``; the word as it stands where it is another."""
        value = self.text(node, what)
        if value and value not in allowed:
            self.faults.error(node, f"{what} is '{value}'", hint_for(value, allowed))
        return value

    def whole(self, node: Node | None, what: str, default: Default) -> int | Default:
        """A whole number that is not negative; ``default`` where the key is absent or holds something else."""
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
        """A value in SI with a unit of ``table``, or a bare one in the unit ``bare``; None where it cannot be read."""
        if node is None:
            return None
        value = read_quantity(node, what, table, bare, self.faults)
        if value is not None and positive and value <= 0.0:
            self.faults.error(node, f"{what} must be positive")
            return None
        return value

    def number(self, node: Node | None, what: str) -> float | None:
        """A number without unit."""
        return self.quantity(node, what, PLAIN, "one")

    def numbers(self, node: Node | None, what: str, length: int) -> list[float]:
        """A list of ``length`` numbers; empty where one of them cannot be read."""
        if not isinstance(node, Sequence) or len(node.items) != length:
            self.faults.error(node, f"{what} needs a list of {length} numbers")
            return []
        values = [self.number(item, f"{what}[{i}]") for i, item in enumerate(node.items)]
        return [value for value in values if value is not None] if None not in values else []

    def per_joint(
        self, node: Node, what: str, joints: int, table: Mapping[str, float], bare: str
    ) -> tuple[float | None, ...]:
        """One value for each joint, from a list of them or from one value that stands for all."""
        items = node.items if isinstance(node, Sequence) else [node] * joints
        if len(items) != joints:
            self.faults.error(node, f"{what} has {len(items)} entries for {joints} joints")
        return tuple(read_quantity(item, what, table, bare, self.faults) for item in items)


def hint_for(word: str, allowed: Collection[str]) -> str:
    """What may have been meant, and what is allowed."""
    return f"{did_you_mean(word, tuple(allowed))} allowed are {', '.join(allowed)}".strip()
