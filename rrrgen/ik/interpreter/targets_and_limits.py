"""Joint limits in the inverse kinematics: choice of the full turns of every angle, and excess over the limits."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, pi
from typing import TYPE_CHECKING

from rrrgen.ik.interpreter.branches import TOLERANCE
from rrrgen.ik.tolerances import ROUNDINGS

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


# ------------------------------------------------------------------------------------------------------------------
# Checks target poses of the inverse kinematics, and corrects rotation matrices that are nearly orthonormal.
# ------------------------------------------------------------------------------------------------------------------


def repaired(target: Sequence[float]) -> list[float] | None:
    """The row-major pose ``target`` with an orthonormal rotation matrix; None if it is too far from a rotation."""
    T = list(target)
    xx, yy, xy = _products(T)
    defect = _defect(T)
    if not defect <= TOLERANCE["orthonormal"]:
        return None
    if defect > ROUNDINGS * TOLERANCE["eps"]:
        for i in range(3):
            x, y = T[4 * i], T[4 * i + 1]
            T[4 * i] = x * (1.0 - 0.5 * xx) - 0.5 * xy * y
            T[4 * i + 1] = y * (1.0 - 0.5 * yy) - 0.5 * xy * x
        T[2], T[6], T[10] = _third(T)
    return T


def accuracy_of(target: Sequence[float], chain: Chain) -> float:
    """Assumed accuracy of a ``target``: the error by which its rotation is not orthonormal, but at least round-off."""
    rounding = ROUNDINGS * chain.scale / chain.reach * TOLERANCE["eps"]
    return max(rounding, _defect(target)) if len(target) == 16 else rounding


def _defect(T: Sequence[float]) -> float:
    zx, zy, zz = _third(T)
    return sum(map(abs, (*_products(T), zx - T[2], zy - T[6], zz - T[10])))


def _products(T: Sequence[float]) -> tuple[float, float, float]:
    """Scalar products ``x.x - 1``, ``y.y - 1`` and ``x.y`` of the first two columns x, y of a row-major rotation."""
    xx = T[0] ** 2 + T[4] ** 2 + T[8] ** 2 - 1.0
    yy = T[1] ** 2 + T[5] ** 2 + T[9] ** 2 - 1.0
    return xx, yy, T[0] * T[1] + T[4] * T[5] + T[8] * T[9]


def _third(T: Sequence[float]) -> tuple[float, float, float]:
    """Vector product ``x x y`` of the first two columns x, y of a row-major rotation, which should be its third."""
    return T[4] * T[9] - T[8] * T[5], T[8] * T[1] - T[0] * T[9], T[0] * T[5] - T[4] * T[1]
