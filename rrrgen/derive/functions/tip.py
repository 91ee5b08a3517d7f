"""Parts shared by control laws for the tip: the error of a pose, and the limitation of torques."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from rrrgen.derive.recursions.vectors import Matrix, Vector, add, cross, scale
from rrrgen.program import Builder


def rotation_error(R: Matrix, R_d: Matrix) -> Vector:
    """The rotation error from the orientation ``R`` to ``R_d``, (3, 3) each, as the vector sin(angle) axis (3,).

    It is half the sum over k of c_k x c_dk, with c_k and c_dk the columns of the matrices. The direction is exact below
    90 degrees; for larger angles the length decreases again.
    """
    total: Vector = [0, 0, 0]
    for k in range(3):
        total = add(total, cross([row[k] for row in R], [row[k] for row in R_d]))
    return scale(Fraction(1, 2), total)


def limited(b: Builder, tau: Sequence[Any], tau_max: Sequence[Any]) -> tuple[Vector, Vector]:
    """Limit ``tau`` (n,) to +- ``tau_max`` (n,); also returns 1 for every joint that was beyond its limit, else 0."""
    above = [b.sub(b.abs(t), limit) for t, limit in zip(tau, tau_max, strict=True)]
    held = [b.select(over, b.mul(b.sign(t), limit), t) for over, t, limit in zip(above, tau, tau_max, strict=True)]
    return held, [b.select(over, 1, 0) for over in above]
