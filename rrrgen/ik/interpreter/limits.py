"""Joint limits in the inverse kinematics: choice of the full turns of every angle, and excess over the limits."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, pi
from typing import TYPE_CHECKING

from rrrgen.ik.interpreter.kernels import TOLERANCE

if TYPE_CHECKING:
    from rrrgen.ik.geometry.chain import Chain

NONE = 1e30
"""The limit of a joint that has none."""


class Limits:
    """Position limits of the joints of a chain: ``lower`` and ``upper``, rad or m; +-NONE if unlimited."""

    def __init__(self, chain: Chain) -> None:
        joints = chain.joints
        self.any = any(joint.lower is not None or joint.upper is not None for joint in joints)
        self.lower = [-NONE if joint.lower is None else float(joint.lower) for joint in joints]
        self.upper = [NONE if joint.upper is None else float(joint.upper) for joint in joints]
        self._revolute = [joint.revolute for joint in joints]

    def placed(self, q: Sequence[float], reference: Sequence[float] | None) -> tuple[list[float], bool]:
        """Move the angles of ``q`` by full turns: next to the reference, then within the limits if possible.

        Returns the configuration, and whether all joints are within their limits.
        """
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
        """Largest excess of a joint over its limits widened by ``margin``, rad or m; 0 if all are inside.

        Angles may be moved by full turns.
        """
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
        """The value nearest to ``x`` within the limits of ``joint``, rad or m."""
        return min(max(x, self.lower[joint]), self.upper[joint])


def angle(x: float) -> float:
    """The angle ``x`` (rad) moved by full turns into (-pi, pi]."""
    if -pi < x <= pi:
        return x
    wrapped = x % (2 * pi)
    return wrapped - 2 * pi if wrapped > pi else wrapped
