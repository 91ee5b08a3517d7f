"""Vectors, rotations and rigid transforms over any scalar: emitted code, CasADi, SymPy or floats.

Zeros by construction (of the geometry, not of a single pose) are skipped before a product is formed, so that the same
formula gives short code for a simple robot.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from rrrgen.ik.geometry.chain import Link, Matrix
from rrrgen.ik.recording.scalar import SolverScalar

S = Any
"""A number that has + - * /: a recorded :class:`SolverScalar`, a float, a SymPy expression or a CasADi SX."""

Vector = tuple[S, S, S]
Rotation = tuple[Vector, Vector, Vector]  # rows


def is_zero(x: S) -> bool:
    """Whether ``x`` is zero by construction (not merely at some pose)."""
    if isinstance(x, SolverScalar):
        return x.is_const and bool(x.value == 0)
    if hasattr(x, "is_zero"):
        return bool(x.is_zero() if callable(x.is_zero) else x.is_zero)
    return bool(x == 0)


def is_one(x: S) -> bool:
    """Whether ``x`` is one by construction (not merely at some pose)."""
    if isinstance(x, SolverScalar):
        return x.is_const and bool(x.value == 1)
    if hasattr(x, "is_one"):
        return bool(x.is_one())
    return bool(x == 1)


def total(*terms: S) -> S:
    """The sum of the terms that are not zero by construction."""
    result: S = 0.0
    empty = True
    for term in terms:
        if not is_zero(term):
            result = term if empty else result + term
            empty = False
    return 0 if empty else result


def product(*factors: S) -> S:
    """The product of the factors, simplified: 0 if a factor is zero by construction, factors of one omitted."""
    if any(is_zero(factor) for factor in factors):
        return 0
    kept = [factor for factor in factors if not is_one(factor)]
    if not kept:
        return 1
    result = kept[0]
    for factor in kept[1:]:
        result = result * factor
    return result


def dot(a: Vector, b: Vector) -> S:
    """The scalar product."""
    return total(*(product(x, y) for x, y in zip(a, b, strict=True)))


def square(a: Vector) -> S:
    """The squared length."""
    return dot(a, a)


def cross(a: Vector, b: Vector) -> Vector:
    """The vector product."""
    return (
        total(product(a[1], b[2]), -product(a[2], b[1])),
        total(product(a[2], b[0]), -product(a[0], b[2])),
        total(product(a[0], b[1]), -product(a[1], b[0])),
    )


def plus(a: Vector, b: Vector) -> Vector:
    """a + b."""
    return (total(a[0], b[0]), total(a[1], b[1]), total(a[2], b[2]))


def minus(a: Vector, b: Vector) -> Vector:
    """a - b."""
    return (total(a[0], -b[0]), total(a[1], -b[1]), total(a[2], -b[2]))


def column(R: Rotation, j: int) -> Vector:
    """Column ``j`` (0 to 2) of the matrix ``R``."""
    return (R[0][j], R[1][j], R[2][j])


def transpose(R: Rotation) -> Rotation:
    """The transpose of ``R``, which is the inverse rotation."""
    return (column(R, 0), column(R, 1), column(R, 2))


def rotate(R: Rotation, v: Vector) -> Vector:
    """The rotated vector ``R v``."""
    return (dot(R[0], v), dot(R[1], v), dot(R[2], v))


def rotate_z(c: S, s: S, v: Vector) -> Vector:
    """The vector ``v`` turned about z by the angle with cosine ``c`` and sine ``s``."""
    return (
        total(product(c, v[0]), -product(s, v[1])),
        total(product(s, v[0]), product(c, v[1])),
        v[2],
    )


def rotate_x(c: S, s: S, v: Vector) -> Vector:
    """The vector ``v`` turned about x by the angle with cosine ``c`` and sine ``s``."""
    return (
        v[0],
        total(product(c, v[1]), -product(s, v[2])),
        total(product(s, v[1]), product(c, v[2])),
    )


@dataclass(frozen=True)
class Rigid:
    """A rigid transform x -> R x + t with rotation matrix ``R`` (rows) and translation ``t``."""

    R: Rotation
    t: Vector
    undo: Rigid | None = field(default=None, compare=False, repr=False)
    """The transform of which this one is the inverse, if any; inverting again returns it without computation."""

    def apply(self, v: Vector) -> Vector:
        """The image of the point ``v``."""
        return plus(rotate(self.R, v), self.t)

    def __matmul__(self, other: Rigid) -> Rigid:
        columns = [rotate(self.R, column(other.R, j)) for j in range(3)]
        return Rigid(transpose((columns[0], columns[1], columns[2])), self.apply(other.t))

    def inverse(self) -> Rigid:
        """The inverse transform."""
        if self.undo is not None:
            return self.undo
        R = transpose(self.R)
        moved = rotate(R, self.t)
        return Rigid(R, (-moved[0], -moved[1], -moved[2]), self)


def rigid(matrix: Matrix) -> Rigid:
    """Convert a 3 x 4 matrix to a transform."""
    R = tuple(tuple(row[:3]) for row in matrix)
    return Rigid((R[0], R[1], R[2]), (matrix[0][3], matrix[1][3], matrix[2][3]))


def screw(c: S, s: S, d: S = 0) -> Rigid:
    """The transform Rz Tz: rotation about z (cosine ``c``, sine ``s``) and translation ``d`` along z."""
    return Rigid(((c, -s, 0), (s, c, 0), (0, 0, 1)), (0, 0, d))


@dataclass(frozen=True)
class Crossing:
    """A constant link in the symmetric form ``Rz Tz . Tx(a) Rx(alpha) . Tz Rz``, whose inverse has the same form.

    ``Tx(a) Rx(alpha)`` leads from one joint axis to the next along their common normal; ``ca`` and ``sa`` are the
    cosine and sine of alpha. ``near`` = (cos, sin, d) is the rotation about and the translation along the first axis,
    before that step; ``far`` is the same for the second axis, after it.
    """

    near: tuple[S, S, S]
    a: S
    ca: S
    sa: S
    far: tuple[S, S, S]

    @staticmethod
    def of(link: Link) -> Crossing:
        """Convert a link ``Rz(theta) Tz(d) Tx(a) Rx(alpha)`` of the chain."""
        return Crossing((link.ct, link.st, link.d), link.a, link.ca, link.sa, (1, 0, 0))

    @staticmethod
    def planar(T: Rigid) -> Crossing | None:
        """Convert a constant transform between parallel axes; None where the axes are not parallel."""
        if not (is_zero(T.R[0][2]) and is_zero(T.R[1][2])):
            return None
        flip = 1 if T.R[2][2] > 0 else -1
        a, c, s = T.t[0], 1, 0
        if not is_zero(T.t[1]):
            a = (T.t[0] ** 2 + T.t[1] ** 2) ** 0.5
            c, s = T.t[0] / a, T.t[1] / a
        # Rz(near) Rx(0 or pi) Rz(far) has the first column (c, s) of near +- far
        ct, st = T.R[0][0], T.R[1][0]
        far = (c * ct + s * st, flip * (c * st - s * ct), 0)
        return Crossing((c, s, T.t[2]), a, flip, 0, far)

    def inverse(self) -> Crossing:
        """The inverse of the link."""

        def undo(end: tuple[S, S, S]) -> tuple[S, S, S]:
            return (end[0], -end[1], -end[2])

        return Crossing(undo(self.far), -self.a, self.ca, -self.sa, undo(self.near))

    def core(self) -> Rigid:
        """The transform ``Tx(a) Rx(alpha)`` along the common normal of the axes, without the two ends."""
        return Rigid(((1, 0, 0), (0, self.ca, -self.sa), (0, self.sa, self.ca)), (self.a, 0, 0))

    def rigid(self) -> Rigid:
        """The whole transform."""
        c, s, d = self.near
        sa, ca = self.sa, self.ca
        # Rz Tz Tx Rx written out, then the far end
        rows = (
            (c, -product(s, ca), product(s, sa)),
            (s, product(c, ca), -product(c, sa)),
            (0, sa, ca),
        )
        first = Rigid(rows, (product(c, self.a), product(s, self.a), d))
        cf, sf, df = self.far
        return first if is_one(cf) and is_zero(sf) and is_zero(df) else first @ screw(cf, sf, df)
