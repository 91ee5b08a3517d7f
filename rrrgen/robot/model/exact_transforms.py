"""Constant homogeneous transforms with exact entries, and the joints of a robot between them."""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp

IDENTITY = sp.eye(3)


@dataclass(frozen=True)
class RigidTransform:
    """A constant homogeneous transform with exact entries: rotation ``R`` (3, 3) and translation ``p`` (3, 1) in m."""

    R: sp.ImmutableMatrix
    p: sp.ImmutableMatrix

    def __matmul__(self, other: RigidTransform) -> RigidTransform:
        return RigidTransform(
            sp.ImmutableMatrix((self.R * other.R).applyfunc(normal_form)),
            sp.ImmutableMatrix((self.R * other.p + self.p).applyfunc(normal_form)),
        )

    @staticmethod
    def of(R: sp.MatrixBase = IDENTITY, p: tuple[sp.Expr, ...] = (0, 0, 0)) -> RigidTransform:
        """The transform with rotation ``R`` and translation ``p`` (m); identity by default."""
        return RigidTransform(sp.ImmutableMatrix(R), sp.ImmutableMatrix(3, 1, list(p)))


def normal_form(expression: sp.Expr) -> sp.Expr:
    """Expand ``expression`` and write even powers of sines by cosines, so that terms which cancel vanish."""
    expanded = sp.expand(expression)
    powers = {
        power: (1 - sp.cos(power.base.args[0]) ** 2) ** (power.exp // 2) * power.base ** (power.exp % 2)
        for power in expanded.atoms(sp.Pow)
        if isinstance(power.base, sp.sin) and power.exp.is_Integer and power.exp > 1
    }
    return sp.expand(expanded.xreplace(powers)) if powers else expanded


def cosine_sine(angle: sp.Expr) -> tuple[sp.Expr, sp.Expr]:
    """The exact cosine and sine of ``angle`` (rad).

    Values with at most one square root are evaluated, as for 45 degrees; others stay cos(angle) and sin(angle).
    """
    c, s = sp.cos(angle), sp.sin(angle)
    # the square of a cosine may be a sum itself: that of 22.5 degrees is sqrt(2)/4 + 1/2
    squares = [(value**2).as_base_exp()[0] for value in (c, s)]
    if all(square.is_Rational or square.func in (sp.cos, sp.sin) for square in squares):
        return c, s
    held = sp.UnevaluatedExpr(angle)
    return sp.cos(held), sp.sin(held)


def rotation_x(angle: sp.Expr) -> sp.Matrix:
    """The rotation matrix Rx(angle), angle in rad."""
    c, s = cosine_sine(angle)
    return sp.Matrix([[1, 0, 0], [0, c, -s], [0, s, c]])


def rotation_z(angle: sp.Expr) -> sp.Matrix:
    """The rotation matrix Rz(angle), angle in rad."""
    c, s = cosine_sine(angle)
    return sp.Matrix([[c, -s, 0], [s, c, 0], [0, 0, 1]])


@dataclass(frozen=True)
class JointModel:
    """Joint i: the constant transform X_i ``before`` it, its type, and the constant ``theta`` (rad) of its angle."""

    name: str
    revolute: bool
    before: RigidTransform
    theta: sp.Expr
    parallel: bool
    """Whether the axis has the same direction as that of the joint before, so that R_i = 1."""
    parent: int
    """The number of the joint before (from 0), whose link carries this one; -1 for the base."""
