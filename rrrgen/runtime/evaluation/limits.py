"""Joint limits: the full turns of every angle, and how far a configuration is outside."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, pi
from typing import TYPE_CHECKING

from rrrgen.runtime.evaluation.kernels import TOLERANCE

if TYPE_CHECKING:
    from rrrgen.ik.geometry.chain import Chain

NONE = 1e30
"""The limit of a joint that has none."""


class Limits:
    """The limits of a chain, rad or m."""

    def __init__(self, chain: Chain) -> None:
        joints = chain.joints
        self.any = any(joint.lower is not None or joint.upper is not None for joint in joints)
        self.lower = [-NONE if joint.lower is None else float(joint.lower) for joint in joints]
        self.upper = [NONE if joint.upper is None else float(joint.upper) for joint in joints]
        self._revolute = [joint.revolute for joint in joints]

    def placed(self, q: Sequence[float], reference: Sequence[float] | None) -> tuple[list[float], bool]:
        """Angles moved by full turns next to the reference, inside the limits if possible; and whether all are."""
        row, inside = list(q), True
        for i, turning in enumerate(self._revolute):
            if reference is not None and turning:
                row[i] = reference[i] + angle(row[i] - reference[i])
            if not self.any:
                continue
            low, high = self.lower[i] - TOLERANCE["limit"], self.upper[i] + TOLERANCE["limit"]
            turns = ceil(max(low - row[i], 0.0) / (2 * pi)) - ceil(max(row[i] - high, 0.0) / (2 * pi)) if turning else 0
            x = row[i] + 2 * pi * turns
            if low <= x <= high:
                row[i] = x
            else:
                inside = False
        return row, inside

    def outside(self, q: Sequence[float], margin: float) -> float:
        """How far the worst joint is outside its limits and a margin at the best turn; 0 if all are inside."""
        worst = 0.0
        for i, turning in enumerate(self._revolute):
            low, high = self.lower[i] - margin, self.upper[i] + margin
            out = max(low - q[i], q[i] - high)
            if turning:
                over = (q[i] - low) % (2 * pi)
                out = 0.0 if over <= high - low else min(over - (high - low), 2 * pi - over)
            worst = max(worst, out)
        return worst

    def clamped(self, x: float, joint: int) -> float:
        """``x`` inside the limits of the joint."""
        return min(max(x, self.lower[joint]), self.upper[joint])


def angle(x: float) -> float:
    """``x`` in (-pi, pi]."""
    if -pi < x <= pi:
        return x
    wrapped = x % (2 * pi)
    return wrapped - 2 * pi if wrapped > pi else wrapped
