"""First and second harmonics of one angle, and polynomials of one displacement, with scalar coefficients.

A point that turns about the joint's axis, ``v(x) = v0 + vc cos x + vs sin x``, or moves along it, ``v(x) = v0 + v1 x``,
is a triple of such forms; the equations of the position kernel are sums and products of them.
"""

from __future__ import annotations

from dataclasses import dataclass

from rrrgen.ik.geometry.chain import Joint
from rrrgen.ik.geometry.rigid import (
    Rigid,
    S,
    Vector,
    column,
    dot,
    is_zero,
    plus,
    product,
    rotate,
    square,
    total,
    transposed,
)
from rrrgen.ik.recording.builder import Builder, Label, Turn


@dataclass(frozen=True)
class Form:
    """``k[0] + k[1] cos x + k[2] sin x + k[3] cos 2x + k[4] sin 2x``, or the polynomial with coefficients ``k``."""

    turning: bool
    k: tuple[S, ...]

    def __add__(self, other: Form) -> Form:
        size = max(len(self.k), len(other.k))
        pads = [(*form.k, *(0 for _ in range(size - len(form.k)))) for form in (self, other)]
        return Form(self.turning, tuple(total(x, y) for x, y in zip(*pads, strict=True)))

    def __sub__(self, other: Form) -> Form:
        return self + other.times(-1)

    def times(self, factor: S) -> Form:
        """The form times a number."""
        return Form(self.turning, tuple(product(factor, x) for x in self.k))

    def plus(self, constant: S) -> Form:
        """The form plus a number."""
        return Form(self.turning, (total(self.k[0], constant), *self.k[1:]))

    def squared(self) -> Form:
        """The square of a first harmonic, or of a polynomial."""
        k = self.k
        if self.turning:
            k0, kc, ks = k
            return Form(
                True,
                (
                    total(product(k0, k0), product(0.5, total(product(kc, kc), product(ks, ks)))),
                    product(2, k0, kc),
                    product(2, k0, ks),
                    product(0.5, total(product(kc, kc), -product(ks, ks))),
                    product(kc, ks),
                ),
            )
        size = len(k)
        return Form(
            False,
            tuple(
                total(*(product(k[i], k[j - i]) for i in range(size) if 0 <= j - i < size)) for j in range(2 * size - 1)
            ),
        )

    def at(self, x: Turn | S) -> S:
        """The value of a first harmonic or of a polynomial."""
        if isinstance(x, Turn):
            return total(self.k[0], product(self.k[1], x.c), product(self.k[2], x.s))
        value: S = self.k[-1]
        for coefficient in reversed(self.k[:-1]):
            value = total(product(value, x), coefficient)
        return value

    def trimmed(self) -> Form:
        """Without the highest terms that are zero by construction."""
        k = list(self.k)
        if self.turning:
            if len(k) == 5 and is_zero(k[3]) and is_zero(k[4]):
                k = k[:3]
        else:
            while len(k) > 1 and is_zero(k[-1]):
                k.pop()
        return Form(self.turning, tuple(k))

    @property
    def constant(self) -> bool:
        """Whether the form does not depend on the joint, by construction."""
        return all(is_zero(x) for x in self.k[1:])

    def root(self, builder: Builder, joint: Joint, label: Label, unit: float) -> Turn | S:
        """The joint values at which the form vanishes."""
        form = self.trimmed()
        if not form.turning:
            return builder.polynomial(joint, form.k, label=label, unit=unit)
        if len(form.k) == 3:
            k0, kc, ks = form.k
            return builder.pair(joint, kc, ks, -k0, label=label, unit=unit)
        k = form.k
        return builder.quartic(joint, (k[0], k[1], k[2], k[3], k[4]), label=label)


@dataclass(frozen=True)
class Moving:
    """A point carried by one joint and then by a fixed transform ``M``: its coordinates as forms."""

    x: Form
    y: Form
    z: Form
    length2: Form
    """The squared distance from the origin."""

    @staticmethod
    def of(joint: Joint, M: Rigid, c: Vector) -> Moving:
        """``M J(x) c``."""
        fixed = total(square(c), square(M.t))
        back = rotate(transposed(M.R), M.t)
        if joint.revolute:
            v0 = plus(tuple(product(e, c[2]) for e in column(M.R, 2)), M.t)
            vc = tuple(total(product(M.R[i][0], c[0]), product(M.R[i][1], c[1])) for i in range(3))
            vs = tuple(total(product(M.R[i][1], c[0]), -product(M.R[i][0], c[1])) for i in range(3))
            forms = [Form(True, (v0[i], vc[i], vs[i])) for i in range(3)]
            length2 = Form(
                True,
                (
                    total(fixed, product(2, c[2], back[2])),
                    product(2, total(product(c[0], back[0]), product(c[1], back[1]))),
                    product(2, total(product(c[0], back[1]), -product(c[1], back[0]))),
                ),
            )
        else:
            v0 = plus(rotate(M.R, c), M.t)
            forms = [Form(False, (v0[i], M.R[i][2])) for i in range(3)]
            length2 = Form(False, (total(fixed, product(2, dot(c, back))), product(2, total(c[2], back[2])), 1))
        return Moving(forms[0], forms[1], forms[2], length2)

    def at(self, x: Turn | S) -> Vector:
        """The point."""
        return (self.x.at(x), self.y.at(x), self.z.at(x))
