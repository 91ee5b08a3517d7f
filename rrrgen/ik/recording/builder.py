"""What a derivation needs of its interpreter: one derivation, printed as C, evaluated in CasADi, or written as text.

A derivation walks from the target to the joints. Wherever an equation has two roots it asks for a *signed root*; the
interpreter decides what that means: C opens a loop over both signs, CasADi takes the sign from its branch argument,
text writes a plus-minus.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin
from typing import NamedTuple, Protocol

from rrrgen.ik.geometry.chain import Joint
from rrrgen.ik.geometry.rigid import Rigid, S, Vector, product, total
from rrrgen.ik.tolerances import QUARTER


class Turn(NamedTuple):
    """Cosine and sine of a raw joint angle."""

    c: S
    s: S


class Feasible(NamedTuple):
    """The free angle x must satisfy ``lower <= mean + cosine cos(x) + sine sin(x) <= upper``."""

    mean: S
    cosine: S
    sine: S
    lower: S
    upper: S


@dataclass(frozen=True)
class Label:
    """Name of a branch choice. ``positive`` is the sign of the root that counts as plus."""

    name: str
    positive: int = 1


def between(v: Vector, u: Vector) -> Turn:
    """Cosine and sine of the angle about z from ``v`` to ``u``, both times the lengths of the two across z."""
    return Turn(
        total(product(u[0], v[0]), product(u[1], v[1])),
        total(product(u[1], v[0]), -product(u[0], v[1])),
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


class Builder(Protocol):
    """The interpreter. Lengths and angles are in the units of the chain; ``unit`` is the natural size of a quantity."""

    def pose(self) -> Rigid:
        """The target pose of the tip in the base frame."""

    def point(self) -> Vector:
        """The target position of the tip in the base frame."""

    def name(self, hint: str, x: S) -> S:
        """``x``, kept under a readable name."""

    def names(self, hint: str, v: Vector) -> Vector:
        """A vector, kept under the names hint + x, y, z."""

    def sqrt(self, x: S) -> S:
        """The square root of a quantity that cannot be negative."""

    def pair(self, joint: Joint, A: S, B: S, C: S, *, label: Label, unit: float, radicand: S | None = None) -> Turn:
        """Both angles with ``A cos(x) + B sin(x) = C``; all angles (the reference) where A, B and C vanish.

        x = atan2(B, A) + sign atan2(w, C), w = sqrt(A^2 + B^2 - C^2); ``radicand`` is an equal expression of w^2 that
        keeps its digits where C comes near sqrt(A^2 + B^2).
        """

    def signed_root(self, hint: str, radicand: S, *, size: S, joint: Joint, label: Label, unit: float) -> S:
        """Both square roots of ``radicand``; ``size`` is what it is small against when the two merge."""

    def quartic(self, joint: Joint, k: tuple[S, S, S, S, S], *, label: Label) -> Turn:
        """Up to four angles with ``k0 + k1 cos x + k2 sin x + k3 cos 2x + k4 sin 2x = 0``."""

    def polynomial(self, joint: Joint, k: tuple[S, ...], *, label: Label, unit: float) -> S:
        """Up to four displacements with ``k0 + k1 x + k2 x^2 + ... = 0`` (degree 1, 2 or 4)."""

    def turn(self, joint: Joint, s: S, c: S) -> Turn:
        """The one angle ``atan2(s, c)``; the reference where both, which are of the size of 1, vanish."""

    def onto(self, joint: Joint, v: Vector, u: Vector, *, unit: float, feasible: Feasible | None = None) -> Turn:
        """The one angle about z that turns ``v``, a vector of the size of ``unit``, onto ``u``; see :func:`between`.

        The reference (made feasible if so asked) where one of them lies along z. A row is kept only if the two agree.
        """

    def slide(self, joint: Joint, x: S) -> S:
        """The displacement of a prismatic joint, or an angle that follows from others."""

    def given(self, joint: Joint) -> Turn | S:
        """A joint that the caller prescribes: the redundancy parameter."""

    def wrist(
        self, joints: tuple[Joint, Joint, Joint], M: tuple[Vector, Vector, Vector], signs: tuple[int, int]
    ) -> tuple[Turn, Turn, Turn]:
        """``Rz(x4) Rx(e4 pi/2) Rz(x5) Rx(e5 pi/2) Rz(x6) = M`` with e = ``signs``: both solutions and their residual.

        The second column of M is not used.
        """

    def residual(self, lengths: tuple[S, ...] = (), cosines: tuple[S, ...] = ()) -> None:
        """Quantities that vanish at a solution; a row is kept only if they do."""
