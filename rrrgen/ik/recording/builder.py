"""The builder interface: the operations from which the derivation of a closed form is composed.

A derivation computes the joints from the target by calling a :class:`DerivationBuilder`. The same derivation serves
several builders: it is printed as C, evaluated in CasADi or in floats, or written as text. Where an equation has
several roots the builder decides how to treat them: C code loops over all roots, CasADi takes the root from its branch
argument.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin
from typing import NamedTuple, Protocol

from rrrgen.ik.geometry.chain import Joint
from rrrgen.ik.geometry.rigid_transforms import Rigid, S, Vector, product, total
from rrrgen.ik.tolerances import QUARTER


class Turn(NamedTuple):
    """Cosine ``c`` and sine ``s`` of the raw angle of a joint, that is ``sign * user's angle + offset``."""

    c: S
    s: S


class Feasible(NamedTuple):
    """A condition on a free angle x: ``lower <= mean + cosine cos(x) + sine sin(x) <= upper``."""

    mean: S
    cosine: S
    sine: S
    lower: S
    upper: S


@dataclass(frozen=True)
class Label:
    """Name of a choice between roots, such as "elbow"; ``positive`` is the sign of the root that is labelled plus."""

    name: str
    positive: int = 1


def between(v: Vector, u: Vector) -> Turn:
    """Cosine and sine of the angle about z from ``v`` to ``u``, not normalized.

    Both are multiplied by the product of the lengths of the projections of ``v`` and ``u`` on the plane z = 0.
    """
    return Turn(
        total(product(u[0], v[0]), product(u[1], v[1])),
        total(product(u[1], v[0]), -product(u[0], v[1])),
    )


def users_turn(joint: Joint, raw: Turn) -> Turn:
    """Cosine and sine of the user's angle ``sign (raw - offset)``; atan2 then gives it in (-pi, pi] for any offset."""
    c, s = raw
    if joint.offset:
        co, so = (_whole(function(float(joint.offset))) for function in (cos, sin))
        c, s = total(product(co, c), product(so, s)), total(product(co, s), -product(so, c))
    return Turn(c, s if joint.sign > 0 else -s)


def _whole(x: float) -> float:
    return float(round(x)) if abs(x - round(x)) < QUARTER else x


class DerivationBuilder(Protocol):
    """The operations of a derivation, which every interpreter implements: recorder, float evaluation, printers.

    Lengths and angles are in the units of the chain. ``unit`` is the natural size of a quantity, relative to which it
    may count as zero. The *reference* is the joint value that the caller supplies where the target leaves a joint free.
    """

    def pose(self) -> Rigid:
        """The target pose of the tip in the base frame."""

    def point(self) -> Vector:
        """The target position of the tip in the base frame."""

    def tool(self) -> Vector:
        """The position of the tool in the frame of the last link, where it is an input."""

    def name(self, hint: str, x: S) -> S:
        """Store ``x`` under the readable name ``hint`` and return it."""

    def names(self, hint: str, v: Vector) -> Vector:
        """Store the coordinates of ``v`` under the names hint + x, y, z and return them."""

    def sqrt(self, x: S) -> S:
        """The square root of a quantity that cannot be negative."""

    def pair(self, joint: Joint, A: S, B: S, C: S, *, label: Label, unit: float, radicand: S | None = None) -> Turn:
        """Solve ``A cos(x) + B sin(x) = C`` for both angles x; the reference where A, B and C vanish and x is free.

        x = atan2(B, A) + sign atan2(w, C), w = sqrt(A^2 + B^2 - C^2). ``radicand`` is an equivalent expression for w^2
        that does not lose digits where |C| is close to sqrt(A^2 + B^2).
        """

    def signed_root(self, hint: str, radicand: S, *, size: S, joint: Joint, label: Label, unit: float) -> S:
        """Both square roots of ``radicand``; they count as a double root where it is small relative to ``size``."""

    def quartic(self, joint: Joint, k: tuple[S, S, S, S, S], *, label: Label) -> Turn:
        """Solve ``k0 + k1 cos x + k2 sin x + k3 cos 2x + k4 sin 2x = 0`` for up to four angles x."""

    def polynomial(self, joint: Joint, k: tuple[S, ...], *, label: Label, unit: float) -> S:
        """Solve ``k0 + k1 x + k2 x^2 + ... = 0`` (degree 1, 2 or 4) for up to four displacements x."""

    def turn(self, joint: Joint, s: S, c: S) -> Turn:
        """The angle ``atan2(s, c)`` of ``joint``, or its reference value where ``s`` and ``c`` are both zero.

        ``s`` and ``c`` must be scaled such that values far below 1 are rounding errors.
        """

    def onto(self, joint: Joint, v: Vector, u: Vector, *, unit: float, feasible: Feasible | None = None) -> Turn:
        """The angle about z that rotates ``v``, a vector of the size of ``unit``, onto ``u``.

        Where one of them lies along z the angle is free: it is the reference, moved to the nearest value that satisfies
        ``feasible``, if given. A solution is kept only if the rotated ``v`` equals ``u``.
        """

    def slide(self, joint: Joint, x: S) -> S:
        """Set ``joint`` to the value ``x``: a displacement, or an angle that follows from others."""

    def redundancy_parameter(self, joint: Joint) -> Turn | S:
        """The value of the prescribed joint (the redundancy parameter), as cosine and sine or as a displacement."""

    def wrist(
        self, joints: tuple[Joint, Joint, Joint], M: tuple[Vector, Vector, Vector], signs: tuple[int, int]
    ) -> tuple[Turn, Turn, Turn]:
        """Solve ``Rz(x4) Rx(e4 pi/2) Rz(x5) Rx(e5 pi/2) Rz(x6) = M`` with (e4, e5) = ``signs``: two solutions.

        The difference between the two sides is added to the residual. The second column of M is not used.
        """

    def residual(self, lengths: tuple[S, ...] = (), cosines: tuple[S, ...] = ()) -> None:
        """Record quantities that are zero at a solution; a candidate is kept only if they are zero.

        ``lengths`` are in m, ``cosines`` are cosines, sines or differences of them.
        """
