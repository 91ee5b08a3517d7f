"""How composite bodies move about their joints: the Coriolis matrix, and what derivatives of the dynamics need.

The Coriolis matrix is the one of the Christoffel symbols, written as an integral over the mass:

    C_ij = integral of J_i . dJ_j/dt dm,   J_j = z_j x rho_j,   rho_j = r - o_j,

from which dM/dt = C + C' at once, so dM/dt - 2 C is skew. All it takes of the composite body of joint j is how that
body moves relative to the joint's origin: besides S, h, m (the integrals of rho rho', rho and 1) the dyad
``A = integral of (d rho/dt) rho' dm`` and the momentum ``P = integral of d rho/dt dm``. Above the diagonal stands the
wrench of the field ``dJ_j/dt = zdot x rho + z x d rho/dt`` on the composite body, passed down to joint i:

    F = zdot x h + z x P,    N = (tr S - S) zdot + (tr A - A) z;

below it, for the joints i before j, the unit wrench F, N of joint j and a vector W:

    C_ji = zdot_i . N + z_i . W,   W = integral of (d rho_i/dt) x J_j dm = (tr A - A') z  at joint j itself.

A prismatic joint has J_j = z_j. Quantities of a joint are in the frame of its block, about its origin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rrrgen.derive.algebra.vectors import (
    ZERO3,
    Matrix,
    Vector,
    add,
    cross,
    product,
    scale,
    times,
    transpose,
    turn,
    turn_back,
)
from rrrgen.derive.recursions.chain import Chain
from rrrgen.derive.recursions.composite import BlockVelocity, composites, offset, step_down, unit_wrench, velocities
from rrrgen.derive.recursions.inertia import PseudoInertia


@dataclass(frozen=True)
class Leg:
    """From the origin of joint i-1 to that of joint i: offsets and the velocities they make.

    ``p`` is in the frame of link i-1 (its own; the block's frame where joint i is of the same block). A slide that
    opens a block comes before it, in the frame of that block.
    """

    p: Vector
    rate: Vector
    slide: Vector
    slide_rate: Vector


@dataclass(frozen=True)
class Dyad:
    """``A`` and ``P`` as above, with ``h`` and ``m`` of the same body."""

    A: Matrix
    P: Vector
    h: Vector
    m: Any

    def shifted(self, p: Vector, rate: Vector) -> Dyad:
        """About and relative to the origin from which ``p`` leads to the present one, at relative velocity ``rate``."""
        h = add(self.h, scale(self.m, p))
        A = [[self.A[r][c] + self.P[r] * p[c] + rate[r] * h[c] for c in range(3)] for r in range(3)]
        return Dyad(A, add(self.P, scale(self.m, rate)), h, self.m)

    def rotated(self, R: Matrix) -> Dyad:
        """In the frame in which the present one has the orientation ``R``."""
        return Dyad(product(product(R, self.A), transpose(R)), times(R, self.P), times(R, self.h), self.m)

    def turned(self, c: Any, s: Any) -> Dyad:
        """In the frame turned back about z: four products for the plane part, whose trace is found unchanged."""
        A = self.A
        u = (A[0][0] - A[1][1]) * c - (A[0][1] + A[1][0]) * s
        xx = A[1][1] + c * u
        shear = s * u
        xz, yz, _ = turn(c, s, [A[0][2], A[1][2], 0])
        zx, zy, _ = turn(c, s, [A[2][0], A[2][1], 0])
        plane = [[xx, A[0][1] + shear, xz], [A[1][0] + shear, (A[0][0] + A[1][1]) - xx, yz]]
        return Dyad([*plane, [zx, zy, A[2][2]]], turn(c, s, self.P), turn(c, s, self.h), self.m)

    def plus(self, other: Dyad) -> Dyad:
        """Both bodies together."""
        A = [add(x, y) for x, y in zip(self.A, other.A, strict=True)]
        return Dyad(A, add(self.P, other.P), add(self.h, other.h), self.m + other.m)


@dataclass(frozen=True)
class Body:
    """The composite body of one joint: pseudo-inertia, dyad, and the rate of the joint's axis."""

    J: PseudoInertia
    dyad: Dyad
    zdot: Vector


@dataclass(frozen=True)
class Reach:
    """The unit wrench ``F, N`` of a joint and its ``W``, at a joint before it."""

    F: Vector
    N: Vector
    W: Vector


@dataclass(frozen=True)
class Composition:
    """The composite bodies of a moving chain; ``reaches[j][i]`` leads from joint j to joint i <= j."""

    chain: Chain
    bodies: tuple[Body, ...]
    reaches: tuple[tuple[Reach, ...], ...]

    def mass_matrix(self) -> Matrix:
        """M, n x n."""
        n = self.chain.n
        M: Matrix = [[0] * n for _ in range(n)]
        for j, row in enumerate(self.reaches):
            for i, reach in enumerate(row):
                M[i][j] = M[j][i] = along_axis(self.chain, i, reach.F, reach.N)
        return M

    def coriolis_matrix(self) -> Matrix:
        """C(q, dq), n x n, with dM/dt - 2 C skew and c = C dq; times the factor of the velocities."""
        chain, n = self.chain, self.chain.n
        C: Matrix = [[0] * n for _ in range(n)]
        for j, body in enumerate(self.bodies):
            for i, value in enumerate(passed_down(chain, j, *_rate_wrench(chain.joints[j].revolute, body))):
                C[i][j] = value
            for i, reach in enumerate(self.reaches[j][:-1]):
                x, y, _ = self.bodies[i].zdot
                if chain.joints[i].revolute:
                    C[j][i] = (x * reach.N[0] + y * reach.N[1]) + reach.W[2]
                else:
                    C[j][i] = x * reach.F[0] + y * reach.F[1]
        return C


def compose(chain: Chain, dq: Sequence[Any], inertias: Sequence[PseudoInertia], factor: int = 1) -> Composition:
    """The composite bodies, with all velocities multiplied by ``factor``."""
    motion = velocities(chain, dq)
    legs = [_leg(chain, dq, motion, i, factor) if i else Leg(ZERO3, ZERO3, ZERO3, ZERO3) for i in range(chain.n)]
    dyads = _dyads(chain, inertias, motion, legs, factor)
    bodies = tuple(
        Body(J, dyad, scale(factor, [velocity.carrier[1], -velocity.carrier[0], 0]))
        for J, dyad, velocity in zip(composites(chain, inertias), dyads, motion, strict=True)
    )
    return Composition(chain, bodies, tuple(_reaches(chain, j, body, legs) for j, body in enumerate(bodies)))


def along_axis(chain: Chain, i: int, F: Vector, N: Vector) -> Any:
    """What a wrench about the origin of joint i asks of that joint."""
    return N[2] if chain.joints[i].revolute else F[2]


def passed_down(chain: Chain, j: int, F: Vector, N: Vector) -> list[Any]:
    """What a wrench about the origin of joint j asks of the joints 0..j."""
    values: list[Any] = [0] * (j + 1)
    for i in range(j, -1, -1):
        values[i] = along_axis(chain, i, F, N)
        if i:
            F, N = step_down(chain, i, F, N)
    return values


def _leg(chain: Chain, dq: Sequence[Any], motion: Sequence[BlockVelocity], i: int, factor: int) -> Leg:
    joint, before = chain.joints[i], chain.joints[i - 1]
    sliding = [0, 0, 0 if joint.revolute else factor * dq[i]]
    omega = motion[i - 1].omega
    if joint.parallel:
        p = offset(chain, i)
        return Leg(p, add(cross(scale(factor, omega), p), sliding), ZERO3, ZERO3)
    slide = [0, 0, joint.slide]
    own = scale(factor, turn_back(before.c, before.s, omega))
    return Leg(joint.p, cross(own, joint.p), slide, add(cross(scale(factor, motion[i].carrier), slide), sliding))


def _dyads(
    chain: Chain,
    inertias: Sequence[PseudoInertia],
    motion: Sequence[BlockVelocity],
    legs: Sequence[Leg],
    factor: int,
) -> list[Dyad]:
    """Dyads of the composite bodies; a link that leads on to another block is added in its own frame."""
    result: list[Dyad] = []
    for i in reversed(range(chain.n)):
        joint, J = chain.joints[i], inertias[i]
        omega = scale(factor, motion[i].omega)
        if i + 1 < chain.n and not chain.joints[i + 1].parallel:
            leg, after = legs[i + 1], chain.joints[i + 1]
            at_foot = result[-1] if after.revolute else result[-1].shifted(leg.slide, leg.slide_rate)
            carried = at_foot.rotated(after.R).shifted(leg.p, leg.rate)
            own = scale(factor, turn_back(joint.c, joint.s, motion[i].omega))
            result.append(_link_dyad(J, own).plus(carried).turned(joint.c, joint.s))
        else:
            link = _link_dyad(J.turned(joint.c, joint.s), omega)
            carried_on = i + 1 < chain.n
            result.append(link.plus(result[-1].shifted(legs[i + 1].p, legs[i + 1].rate)) if carried_on else link)
    return result[::-1]


def _link_dyad(J: PseudoInertia, omega: Vector) -> Dyad:
    S = [[J.Jxx, J.Jxy, J.Jxz], [J.Jxy, J.Jyy, J.Jyz], [J.Jxz, J.Jyz, J.Jzz]]
    h = [J.hx, J.hy, J.hz]
    return Dyad(transpose([cross(omega, column) for column in S]), cross(omega, h), h, J.m)


def _reaches(chain: Chain, j: int, body: Body, legs: Sequence[Leg]) -> tuple[Reach, ...]:
    F, N = unit_wrench(chain.joints[j].revolute, body.J)
    A, P = body.dyad.A, body.dyad.P
    W = [-A[2][0], -A[2][1], A[0][0] + A[1][1]] if chain.joints[j].revolute else [P[1], -P[0], 0]
    result = [Reach(F, N, W)]
    for i in range(j, 0, -1):
        result.append(_reach_down(chain, i, legs[i], result[-1]))
    return tuple(reversed(result))


def _reach_down(chain: Chain, i: int, leg: Leg, reach: Reach) -> Reach:
    joint, before = chain.joints[i], chain.joints[i - 1]
    F, N = step_down(chain, i, reach.F, reach.N)
    W = reach.W
    if joint.parallel:
        return Reach(F, N, add(W, cross(leg.rate, F)))
    if not joint.revolute:
        W = add(W, cross(leg.slide_rate, reach.F))
    W = add(times(joint.R, W), cross(leg.rate, times(joint.R, reach.F)))
    return Reach(F, N, turn(before.c, before.s, W))


def _rate_wrench(revolute: bool, body: Body) -> tuple[Vector, Vector]:
    """Wrench on the composite body of the field dJ_j/dt."""
    J, (A, P), zdot = body.J, (body.dyad.A, body.dyad.P), body.zdot
    h = [J.hx, J.hy, J.hz]
    if not revolute:
        return scale(J.m, zdot), cross(h, zdot)
    x, y, _ = zdot
    bending = [(J.Jyy + J.Jzz) * x - J.Jxy * y, (J.Jxx + J.Jzz) * y - J.Jxy * x, -(J.Jxz * x + J.Jyz * y)]
    return add(cross(zdot, h), [-P[1], P[0], 0]), add(bending, [-A[0][2], -A[1][2], A[0][0] + A[1][1]])
