"""Joint angles of the emitted inverse kinematics: all arc tangents are taken together, after the loops over roots.

An arc tangent costs as much as all other operations of a solution together. Nothing inside the loops needs the angle of
a joint once its cosine and sine are known, so every distinct angle gets a *slot* in an array, written at the outermost
loop level at which it is known. After the loops, one loop over all slots, which compilers vectorise, takes the arc
tangents, and each solution copies its angles from their slots.
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
    """The place of one joint's angles in the array of angles: ``first``, plus an index over the loops around it."""

    first: int
    count: int
    index: tuple[str, ...]
    choice: str = ""
    """Loop variable that tells the angle (0) from its other one (1), whose slots are ``step`` further on."""
    step: int = 0

    def text(self) -> str:
        """The C expression of the array index."""
        other = [f"{self.step} * {self.choice}"] if self.choice else []
        first = [str(self.first)] if self.first or not (self.index or other) else []
        return " + ".join([*first, *self.index, *other])


class Arcs:
    """Assigns array slots to the joint angles of one branch function and prints the code that computes the angles."""

    def __init__(self) -> None:
        self.joints: dict[int, Slot] = {}
        self._taken = 0
        self._copies: list[tuple[Slot, str]] = []

    def slot(self, loops: Sequence[Loop]) -> Slot:
        """Reserve slots for an angle that has one value for every pass through ``loops``."""
        terms, count = position(loops)
        slot = Slot(self._taken, count, tuple(terms))
        self._taken += count
        return slot

    def copy(self, slot: Slot, choice: str, formula: str) -> None:
        """Add a second angle to a slot, ``formula`` of the first; it is taken where loop variable ``choice`` is 1."""
        slot.choice = choice
        self._copies.append((slot, formula))

    @property
    def calls(self) -> list[str]:
        """Names of the operations after the loops: "arc" per arc tangent, "opposite" per angle turned by pi."""
        copied = [slot.count for slot, formula in self._copies if formula.startswith("ik_opposite")]
        return ["arc"] * self._taken + ["opposite"] * sum(copied)

    def finished(self, loops: Sequence[Loop]) -> tuple[list[str], list[str]]:
        """The C lines before the loops (declarations) and after them (arc tangents, angles of each solution).

        Both are empty if there are no angles. The loops are repeated after the arc tangents to visit the solutions in
        the same order; root counts that vary between passes were stored for this.
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
    """Name of the C array that stores how many roots an inner loop had in each pass of the outer loops."""
    return f"m{loop.variable[1:]}"
