"""Angles of emitted C: cosines and sines are collected between the loops, their arcs computed together behind them.

An arc tangent costs as much as all the rest of an answer. Nothing inside the loops needs the angle of a joint once its
cosine and sine are known, so every distinct angle gets a *slot*, written at the loop level at which it is known first;
behind the loops one loop over all slots, which compilers vectorise, takes the arcs, and rows pick theirs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rrrgen.backends.c.solver.statements import Loop, opening, position

LANES = 4
"""The number of arcs is a multiple of this: whole vectors on most processors."""

RESERVED = frozenset({"sine", "cosine", "angle", "i"})
"""Names that the emitted lines use."""


@dataclass
class Slot:
    """Where the angles of one joint stand: ``first`` plus an index over the loops around it."""

    first: int
    count: int
    index: tuple[str, ...]
    choice: str = ""
    """Loop variable that tells the angle (0) from its other one (1), whose slots are ``step`` further on."""
    step: int = 0

    def text(self) -> str:
        """The C expression of the slot."""
        other = [f"{self.step} * {self.choice}"] if self.choice else []
        first = [str(self.first)] if self.first or not (self.index or other) else []
        return " + ".join([*first, *self.index, *other])


class Arcs:
    """The slots of one branch function."""

    def __init__(self) -> None:
        self.joints: dict[int, Slot] = {}
        self._taken = 0
        self._copies: list[tuple[Slot, str]] = []

    def slot(self, loops: Sequence[Loop]) -> Slot:
        """Slots for an angle that differs between the turns of ``loops``."""
        terms, count = position(loops)
        slot = Slot(self._taken, count, tuple(terms))
        self._taken += count
        return slot

    def copy(self, slot: Slot, choice: str, formula: str) -> None:
        """Loop variable ``choice`` tells the angle of ``slot`` from ``formula`` of it."""
        slot.choice = choice
        self._copies.append((slot, formula))

    @property
    def calls(self) -> list[str]:
        """The arc tangents and the half turns, one name for each (:mod:`rrrgen.backends.c.solver.counting`)."""
        copied = [slot.count for slot, formula in self._copies if formula.startswith("ik_opposite")]
        return ["arc"] * self._taken + ["opposite"] * sum(copied)

    def finished(self, loops: Sequence[Loop]) -> tuple[list[str], list[str]]:
        """Lines before and behind the loops; none without angles.

        Rows are walked once more in their order. Counts that change inside outer loops were kept for that.
        """
        if not self.joints:
            return [], []
        taken = arcs = -(-self._taken // LANES) * LANES
        behind = [f"ik_arcs({arcs}, sine, cosine, angle);"]
        for slot, formula in self._copies:
            slot.step = taken - slot.first
            taken += slot.count
            copied = formula.format(f"angle[{slot.first} + i]")
            behind.append(f"for (i = 0; i < {slot.count}; ++i) {{ angle[{slot.first + slot.step} + i] = {copied}; }}")
        before = [
            f"REAL sine[{arcs}] = {{(REAL)0}}, cosine[{arcs}] = {{(REAL)0}}, angle[{taken}];",
            *(f"int {kept_count(loop)}[{position(loops[: loop.level])[1]}] = {{0}};" for loop in loops if loop.level),
            "int i;",
        ]
        behind.append("i = 0;")
        for depth, loop in enumerate(loops):
            kept = f"{kept_count(loop)}[{' + '.join(position(loops[: loop.level])[0])}]" if loop.level else ""
            behind.append("    " * depth + opening(loop, kept))
        row = [f"found->q[i][{joint}] = angle[{slot.text()}];" for joint, slot in sorted(self.joints.items())]
        behind += ["    " * len(loops) + line for line in [*row, "++i;"]]
        behind += ["    " * depth + "}" for depth in reversed(range(len(loops)))]
        return before, behind


def kept_count(loop: Loop) -> str:
    """Name of the array that keeps the counts of an inner loop."""
    return f"m{loop.variable[1:]}"
