"""Angles of emitted C: cosines and sines are collected between the loops, their arcs computed together behind them.

An arc tangent costs as much as all the rest of an answer. Nothing inside the loops needs the angle of a joint once its
cosine and sine are known, so every distinct angle gets a *slot*, written at the loop level at which it is known first;
behind the loops one loop over all slots, which compilers vectorise, takes the arcs, and rows pick theirs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, sin

from rrrgen.ik.builder import Turn
from rrrgen.ik.chain import Joint
from rrrgen.ik.rigid import product, total

QUARTER = 2e-16
"""An offset whose cosine or sine is this close to a whole number is a multiple of a quarter turn."""

LANES = 4
"""The number of arcs is a multiple of this: whole vectors on most processors."""

Loop = tuple[str, str, int]
"""Variable, count and most turns."""

RESERVED = frozenset({"sine", "cosine", "angle", "at", "i"})
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
        index: list[str] = []
        stride = 1
        for variable, _, most in reversed(loops):
            index.insert(0, variable if stride == 1 else f"{stride} * {variable}")
            stride *= most
        slot = Slot(self._taken, stride, tuple(index))
        self._taken += stride
        return slot

    def copy(self, slot: Slot, choice: str, formula: str) -> None:
        """Loop variable ``choice`` tells the angle of ``slot`` from ``formula`` of it."""
        slot.choice = choice
        self._copies.append((slot, formula))

    def finished(self, rows: int) -> tuple[list[str], list[str], list[str]]:
        """Lines before the loops, for each row, and behind the loops; none without angles."""
        if not self.joints:
            return [], [], []
        taken = arcs = -(-self._taken // LANES) * LANES
        behind = [f"ARCS({arcs}, sine, cosine, angle);"]
        for slot, formula in self._copies:
            slot.step = taken - slot.first
            taken += slot.count
            copied = formula.format(f"angle[{slot.first} + i]")
            behind.append(f"for (i = 0; i < {slot.count}; ++i) {{ angle[{slot.first + slot.step} + i] = {copied}; }}")
        order = sorted(self.joints)
        picked = " ".join(f"found->q[i][{joint}] = *at[i][{k}];" for k, joint in enumerate(order))
        behind.append(f"for (i = 0; i < rows; ++i) {{ {picked} }}")
        before = [
            f"REAL sine[{arcs}] = {{(REAL)0}}, cosine[{arcs}] = {{(REAL)0}}, angle[{taken}];",
            f"const REAL *at[{rows}][{len(order)}]; /* where the angles of a row stand */",
            "int i;",
        ]
        return (
            before,
            [f"at[rows][{k}] = &angle[{self.joints[joint].text()}];" for k, joint in enumerate(order)],
            behind,
        )


def users_turn(joint: Joint, raw: Turn) -> Turn:
    """Cosine and sine of the user's angle ``sign (raw - offset)``: its arc lies in (-pi, pi] whatever the offset."""
    c, s = raw
    if joint.offset:
        co, so = (_whole(function(float(joint.offset))) for function in (cos, sin))
        c, s = total(product(co, c), product(so, s)), total(product(co, s), -product(so, c))
    return Turn(c, s if joint.sign > 0 else -s)


def _whole(x: float) -> float:
    return float(round(x)) if abs(x - round(x)) < QUARTER else x
