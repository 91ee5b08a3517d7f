"""Functions of one joint variable: trigonometric polynomials of an angle, or polynomials of a displacement.

The coordinates of a point carried by a revolute joint are ``v(x) = v0 + vc cos x + vs sin x``, those of a point
carried by a prismatic joint ``v(x) = v0 + v1 x``. The equations of the position problem are sums and products of such
functions.
"""

from __future__ import annotations

from dataclasses import dataclass

from rrrgen.ik.geometry.chain import Joint
from rrrgen.ik.geometry.rigid_transforms import (
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
    transpose,
)
from rrrgen.ik.recording.builder import DerivationBuilder, Label, Turn


@dataclass(frozen=True)
class JointFunction:
    """A function of one joint variable x, given by its coefficients ``k``.

    Revolute joint (``turning``): ``k[0] + k[1] cos x + k[2] sin x``, and with five coefficients also
    ``+ k[3] cos 2x + k[4] sin 2x``. Prismatic joint: the polynomial ``k[0] + k[1] x + k[2] x^2 + ...``.
    """

    turning: bool
    k: tuple[S, ...]

    def __add__(self, other: JointFunction) -> JointFunction:
        size = max(len(self.k), len(other.k))
        pads = [(*form.k, *(0 for _ in range(size - len(form.k)))) for form in (self, other)]
        return JointFunction(self.turning, tuple(total(x, y) for x, y in zip(*pads, strict=True)))

    def __sub__(self, other: JointFunction) -> JointFunction:
        return self + other.times(-1)

    def times(self, factor: S) -> JointFunction:
        """Multiply the function by the constant ``factor``."""
        return JointFunction(self.turning, tuple(product(factor, x) for x in self.k))

    def plus(self, constant: S) -> JointFunction:
        """Add the number ``constant`` to the function."""
        return JointFunction(self.turning, (total(self.k[0], constant), *self.k[1:]))

    def times_itself(self) -> JointFunction:
        """Square the function; a trigonometric one must have degree 1 (three coefficients)."""
        k = self.k
        if self.turning:
            k0, kc, ks = k
            return JointFunction(
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
        return JointFunction(
            False,
            tuple(
                total(*(product(k[i], k[j - i]) for i in range(size) if 0 <= j - i < size)) for j in range(2 * size - 1)
            ),
        )

    def at(self, x: Turn | S) -> S:
        """Evaluate at the joint variable ``x``; a trigonometric function must have degree 1 (three coefficients)."""
        if isinstance(x, Turn):
            return total(self.k[0], product(self.k[1], x.c), product(self.k[2], x.s))
        value: S = self.k[-1]
        for coefficient in reversed(self.k[:-1]):
            value = total(product(value, x), coefficient)
        return value

    def trim(self) -> JointFunction:
        """Drop the highest terms whose coefficients are exactly zero."""
        k = list(self.k)
        if self.turning:
            if len(k) == 5 and is_zero(k[3]) and is_zero(k[4]):
                k = k[:3]
        else:
            while len(k) > 1 and is_zero(k[-1]):
                k.pop()
        return JointFunction(self.turning, tuple(k))

    @property
    def constant(self) -> bool:
        """Whether the function does not depend on the joint: all coefficients but the first are exactly zero."""
        return all(is_zero(x) for x in self.k[1:])

    def root(self, builder: DerivationBuilder, joint: Joint, label: Label, unit: float) -> Turn | S:
        """Solve ``form(x) = 0`` for ``joint``; ``unit`` is the natural size of the coefficients of the equation."""
        form = self.trim()
        if not form.turning:
            return builder.polynomial(joint, form.k, label=label, unit=unit)
        if len(form.k) == 3:
            k0, kc, ks = form.k
            return builder.pair(joint, kc, ks, -k0, label=label, unit=unit)
        k = form.k
        return builder.quartic(joint, (k[0], k[1], k[2], k[3], k[4]), label=label)


@dataclass(frozen=True)
class Moving:
    """Coordinates of a point carried by a joint, ``M J(x) c``, as functions of the joint variable x.

    ``c`` is the point in the frame after the joint, ``M`` a constant transform, and ``J`` the motion of the joint.
    """

    x: JointFunction
    y: JointFunction
    z: JointFunction
    length2: JointFunction
    """The squared distance from the origin."""

    @staticmethod
    def of(joint: Joint, M: Rigid, c: Vector) -> Moving:
        """The point ``M J(x) c``: ``c`` carried by ``joint``, then by the constant transform ``M``."""
        fixed = total(square(c), square(M.t))
        back = rotate(transpose(M.R), M.t)
        if joint.revolute:
            v0 = plus(tuple(product(e, c[2]) for e in column(M.R, 2)), M.t)
            vc = tuple(total(product(M.R[i][0], c[0]), product(M.R[i][1], c[1])) for i in range(3))
            vs = tuple(total(product(M.R[i][1], c[0]), -product(M.R[i][0], c[1])) for i in range(3))
            forms = [JointFunction(True, (v0[i], vc[i], vs[i])) for i in range(3)]
            length2 = JointFunction(
                True,
                (
                    total(fixed, product(2, c[2], back[2])),
                    product(2, total(product(c[0], back[0]), product(c[1], back[1]))),
                    product(2, total(product(c[0], back[1]), -product(c[1], back[0]))),
                ),
            )
        else:
            v0 = plus(rotate(M.R, c), M.t)
            forms = [JointFunction(False, (v0[i], M.R[i][2])) for i in range(3)]
            length2 = JointFunction(
                False, (total(fixed, product(2, dot(c, back))), product(2, total(c[2], back[2])), 1)
            )
        return Moving(forms[0], forms[1], forms[2], length2)

    def at(self, x: Turn | S) -> Vector:
        """Coordinates of the point at the joint variable ``x``."""
        return (self.x.at(x), self.y.at(x), self.z.at(x))
