"""Checks target poses of the inverse kinematics, and corrects rotation matrices that are nearly orthonormal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rrrgen.ik.interpreter.kernels import TOLERANCE
from rrrgen.ik.tolerances import ROUNDINGS

if TYPE_CHECKING:
    from rrrgen.ik.geometry.chain import Chain


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
