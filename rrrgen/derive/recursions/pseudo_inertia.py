"""The pseudo-inertia of a link: its ten inertial parameters in one symmetric 4x4 matrix (14.9),

    J = integral of [x y z 1]' [x y z 1] dm = [[S, h], [h', m]],

with the second moments S (kg m^2, positive products), the first moments h (kg m) and the mass m (kg), in the axes of a
frame and about its origin. Under a change of frame T it becomes ``T J T'``. The inertia tensor in the same frame is
``I = tr(S) 1 - S``, hence ``Ixx = Syy + Szz`` and ``Sxx = (-Ixx + Iyy + Izz)/2``.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from rrrgen.derive.recursions.linear_algebra import Matrix, is_number, product, transpose
from rrrgen.derive.recursions.link_frames import Placement

ENTRIES = ("Jxx", "Jxy", "Jxz", "Jyy", "Jyz", "Jzz", "hx", "hy", "hz", "m")
"""The ten entries, in the order in which links are parametrized in canonical frames."""

PLACES = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2), (0, 3), (1, 3), (2, 3), (3, 3))
"""Row and column of each entry in the 4x4 matrix."""


@dataclass(frozen=True)
class PseudoInertia:
    """The ten entries of a pseudo-inertia, in scalars of any kind; structural zeros are the number 0."""

    Jxx: Any = 0
    Jxy: Any = 0
    Jxz: Any = 0
    Jyy: Any = 0
    Jyz: Any = 0
    Jzz: Any = 0
    hx: Any = 0
    hy: Any = 0
    hz: Any = 0
    m: Any = 0

    def entries(self) -> tuple[Any, ...]:
        """The ten entries in the order of :data:`ENTRIES`."""
        return tuple(getattr(self, name) for name in ENTRIES)

    def matrix(self) -> Matrix:
        """The pseudo-inertia as the symmetric 4x4 matrix J: second moments (3, 3), bordered by h (3,) and the mass."""
        J: Matrix = [[0] * 4 for _ in range(4)]
        for (r, c), value in zip(PLACES, self.entries(), strict=True):
            J[r][c] = J[c][r] = value
        return J

    @staticmethod
    def of_matrix(J: Matrix) -> PseudoInertia:
        """The pseudo-inertia with the symmetric 4x4 matrix ``J``."""
        return PseudoInertia(*(J[r][c] for r, c in PLACES))

    def transform(self, placement: Placement) -> PseudoInertia:
        """Express the body in another frame, ``T J T'``, where T is the pose of the present frame in that frame."""
        T = [[*row, p] for row, p in zip(placement.R, placement.p, strict=True)] + [[0, 0, 0, 1]]
        return PseudoInertia.of_matrix(product(product(T, self.matrix()), transpose(T)))

    def plus(self, other: PseudoInertia) -> PseudoInertia:
        """The pseudo-inertia of two rigidly connected bodies, both given in one frame."""
        return PseudoInertia(*(x + y for x, y in zip(self.entries(), other.entries(), strict=True)))

    def rotated_z(self, c: Any, s: Any) -> PseudoInertia:
        """``Rz J Rz'``: the body rotated about z by the angle with cosine ``c`` and sine ``s``."""
        if is_number(s, 0) and is_number(c, 1):  # the body of a floating base
            return self
        # u = (Jxx - Jyy) c - 2 Jxy s: the planar part takes four products
        u = (self.Jxx - self.Jyy) * c - 2 * self.Jxy * s
        shift = c * u
        return PseudoInertia(
            Jxx=self.Jyy + shift,
            Jxy=self.Jxy + s * u,
            Jxz=c * self.Jxz - s * self.Jyz,
            Jyy=self.Jxx - shift,
            Jyz=s * self.Jxz + c * self.Jyz,
            Jzz=self.Jzz,
            hx=c * self.hx - s * self.hy,
            hy=s * self.hx + c * self.hy,
            hz=self.hz,
            m=self.m,
        )


def from_standard(phi: tuple[Any, ...] | list[Any]) -> PseudoInertia:
    """The pseudo-inertia of a link with the standard parameters ``phi`` (10,), in the order of ``STANDARD``.

    Both are in the axes of one frame and about its origin.
    """
    m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz = phi
    half = Fraction(1, 2)
    return PseudoInertia(
        Jxx=(Iyy + Izz - Ixx) * half,
        Jxy=-Ixy,
        Jxz=-Ixz,
        Jyy=(Ixx + Izz - Iyy) * half,
        Jyz=-Iyz,
        Jzz=(Ixx + Iyy - Izz) * half,
        hx=mx,
        hy=my,
        hz=mz,
        m=m,
    )
