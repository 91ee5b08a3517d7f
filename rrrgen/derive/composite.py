"""Mass matrix, Coriolis matrix and gravity from composite bodies (14.6).

The composite body of joint j is everything beyond it, taken as rigid. A unit acceleration of joint j exerts on it a
wrench whose moment about joint i is M_ij. All quantities of a joint are expressed in the frame B of its block and
about the joint's origin.

The Coriolis matrix is the one of the Christoffel symbols, written as an integral over the mass:

    C_ij = integral of J_i(r)' dJ_j(r)/dt dm,   J_j(r) = z_j x (r - o_j),

from which dM/dt = C + C' at once, so dM/dt - 2 C is skew. With the momentum dyad of the composite body,
``A = integral of r' (r - o)' dm`` (r' the velocity) and momentum ``P``, both sides of the diagonal follow from two
wrenches per joint (upper: of column j; lower: of the unit acceleration, with the vector W = tr(A) z - A' z).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from rrrgen.derive.chain import Chain, Placement
from rrrgen.derive.inertia import PseudoInertia
from rrrgen.derive.vectors import (
    Matrix,
    Vector,
    add,
    cross,
    product,
    times,
    transpose,
    transposed_times,
    turn,
    turn_back,
)


def offset(chain: Chain, i: int) -> Vector:
    """From the origin of joint i-1 to that of joint i within one block, in the block's frame."""
    before, joint = chain.joints[i - 1], chain.joints[i]
    return add(turn(before.c, before.s, joint.p), [0, 0, joint.slide])


def composites(chain: Chain, inertias: Sequence[PseudoInertia]) -> list[PseudoInertia]:
    """Composite pseudo-inertia beyond each joint, in its block's frame and about its origin."""
    result: list[PseudoInertia] = [PseudoInertia()] * chain.n
    carried = PseudoInertia()
    for i in reversed(range(chain.n)):
        joint = chain.joints[i]
        continues = i + 1 < chain.n and chain.joints[i + 1].parallel
        if continues:
            moved = result[i + 1].moved(Placement([[1, 0, 0], [0, 1, 0], [0, 0, 1]], offset(chain, i + 1)))
            result[i] = inertias[i].turned(joint.c, joint.s).plus(moved)
        else:
            result[i] = _turned(inertias[i].plus(carried), joint.c, joint.s)
        if not joint.parallel:
            slide = Placement([[1, 0, 0], [0, 1, 0], [0, 0, 1]], [0, 0, joint.slide])
            at_foot = result[i] if joint.revolute else result[i].moved(slide)
            carried = at_foot.moved(Placement(joint.R, joint.p))
    return result


def _turned(J: PseudoInertia, c: Any, s: Any) -> PseudoInertia:
    """``J.turned``, with Jyy written so that the polar sum Jxx + Jyy, which never turns, is found unchanged."""
    turned = J.turned(c, s)
    return replace(turned, Jyy=(J.Jxx + J.Jyy) - turned.Jxx)


def unit_wrench(revolute: bool, J: PseudoInertia) -> tuple[Vector, Vector]:
    """Force and moment on a composite body that a unit acceleration of its joint takes."""
    if revolute:
        return [-J.hy, J.hx, 0], [-J.Jxz, -J.Jyz, J.Jxx + J.Jyy]
    return [0, 0, J.m], [J.hy, -J.hx, 0]


def step_down(chain: Chain, i: int, F: Vector, N: Vector) -> tuple[Vector, Vector]:
    """A wrench about joint i in its block's frame, about joint i-1 in the frame of that joint's block."""
    joint, before = chain.joints[i], chain.joints[i - 1]
    if joint.parallel:
        return F, add(N, cross(offset(chain, i), F))
    if not joint.revolute:
        N = add(N, cross([0, 0, joint.slide], F))
    F, N = times(joint.R, F), times(joint.R, N)
    N = add(N, cross(joint.p, F))
    return turn(before.c, before.s, F), turn(before.c, before.s, N)


def mass_matrix(chain: Chain, inertias: Sequence[PseudoInertia]) -> Matrix:
    """M, n x n."""
    M: Matrix = [[0] * chain.n for _ in range(chain.n)]
    for j, J in enumerate(composites(chain, inertias)):
        F, N = unit_wrench(chain.joints[j].revolute, J)
        for i in range(j, -1, -1):
            M[i][j] = M[j][i] = N[2] if chain.joints[i].revolute else F[2]
            if i:
                F, N = step_down(chain, i, F, N)
    return M


def gravity(chain: Chain, inertias: Sequence[PseudoInertia]) -> list[Any]:
    """Gravity torques: the weight of each composite body about its joint."""
    lightened = [PseudoInertia(hx=J.hx, hy=J.hy, hz=J.hz, m=J.m) for J in inertias]
    down = block_vectors(chain, chain.gravity)
    torques = []
    for joint, J, g in zip(chain.joints, composites(chain, lightened), down, strict=True):
        torques.append(J.hy * g[0] - J.hx * g[1] if joint.revolute else -(J.m * g[2]))
    return torques


def block_vectors(chain: Chain, vector: Vector) -> list[Vector]:
    """A vector of the base frame, in the frame of each joint's block."""
    result: list[Vector] = []
    for i, joint in enumerate(chain.joints):
        if not joint.parallel:
            if i:
                before = chain.joints[i - 1]
                vector = turn_back(before.c, before.s, vector)
            vector = transposed_times(joint.R, vector)
        result.append(vector)
    return result


@dataclass(frozen=True)
class BlockVelocity:
    """Angular velocity of link k and velocity of its origin, in the block's frame; ``carrier`` is that of B."""

    carrier: Vector
    omega: Vector
    v: Vector


def velocities(chain: Chain, dq: Sequence[Any]) -> list[BlockVelocity]:
    """Velocities of all links for joint rates ``dq``."""
    result: list[BlockVelocity] = []
    omega: Vector = [0, 0, 0]
    v: Vector = [0, 0, 0]
    carrier: Vector = [0, 0, 0]
    for i, joint in enumerate(chain.joints):
        if joint.parallel:
            v = add(v, cross(omega, offset(chain, i)))
        else:
            if i:
                before = chain.joints[i - 1]
                omega, v = turn_back(before.c, before.s, omega), turn_back(before.c, before.s, v)
            v = transposed_times(joint.R, add(v, cross(omega, joint.p)))
            omega = carrier = transposed_times(joint.R, omega)
            v = add(v, cross(omega, [0, 0, joint.slide]))
        if joint.revolute:
            omega = [omega[0], omega[1], omega[2] + dq[i]]
        else:
            v = [v[0], v[1], v[2] + dq[i]]
        result.append(BlockVelocity(carrier, omega, v))
    return result


@dataclass(frozen=True)
class Dyad:
    """``A = integral of r' (r - o)' dm`` and momentum ``P = integral of r' dm``."""

    A: Matrix
    P: Vector

    def shifted(self, p: Vector) -> Dyad:
        """About the origin from which ``p`` leads to the present one."""
        return Dyad([[self.A[r][c] + self.P[r] * p[c] for c in range(3)] for r in range(3)], self.P)

    def plus(self, other: Dyad) -> Dyad:
        """Both bodies together."""
        return Dyad([add(x, y) for x, y in zip(self.A, other.A, strict=True)], add(self.P, other.P))


NO_MOMENTUM = Dyad([[0] * 3 for _ in range(3)], [0, 0, 0])


def link_dyad(J: PseudoInertia, velocity: BlockVelocity) -> Dyad:
    """Momentum dyad of one link about its origin, all in the block's frame."""
    S = [[J.Jxx, J.Jxy, J.Jxz], [J.Jxy, J.Jyy, J.Jyz], [J.Jxz, J.Jyz, J.Jzz]]
    h = [J.hx, J.hy, J.hz]
    columns = [cross(velocity.omega, [row[c] for row in S]) for c in range(3)]
    A = [[columns[c][r] + velocity.v[r] * h[c] for c in range(3)] for r in range(3)]
    return Dyad(A, add([J.m * x for x in velocity.v], cross(velocity.omega, h)))


def dyads(chain: Chain, inertias: Sequence[PseudoInertia], motion: Sequence[BlockVelocity]) -> list[Dyad]:
    """Momentum dyad of the composite body beyond each joint, in its block's frame and about its origin."""
    result: list[Dyad] = [NO_MOMENTUM] * chain.n
    for i in reversed(range(chain.n)):
        joint = chain.joints[i]
        result[i] = link_dyad(inertias[i].turned(joint.c, joint.s), motion[i])
        if i + 1 < chain.n:
            following = chain.joints[i + 1]
            if following.parallel:
                result[i] = result[i].plus(result[i + 1].shifted(offset(chain, i + 1)))
            else:
                result[i] = result[i].plus(_dyad_down(chain, i + 1, result[i + 1]))
    return result


def _dyad_down(chain: Chain, i: int, dyad: Dyad) -> Dyad:
    """From the first joint of a block to the last joint of the block before."""
    joint, before = chain.joints[i], chain.joints[i - 1]
    if not joint.revolute:
        dyad = dyad.shifted([0, 0, joint.slide])
    turned = Dyad(product(product(joint.R, dyad.A), transpose(joint.R)), times(joint.R, dyad.P)).shifted(joint.p)
    return Dyad(_turn_matrix(before.c, before.s, turned.A), turn(before.c, before.s, turned.P))


def _turn_matrix(c: Any, s: Any, A: Matrix) -> Matrix:
    """Rz A Rz', with four products for the plane part."""
    u = (A[0][0] - A[1][1]) * c - (A[0][1] + A[1][0]) * s
    shift, shear = c * u, s * u
    xz, yz, _ = turn(c, s, [A[0][2], A[1][2], 0])
    zx, zy, _ = turn(c, s, [A[2][0], A[2][1], 0])
    return [[A[1][1] + shift, A[0][1] + shear, xz], [A[1][0] + shear, A[0][0] - shift, yz], [zx, zy, A[2][2]]]


def coriolis_matrix(chain: Chain, dq: Sequence[Any], inertias: Sequence[PseudoInertia]) -> Matrix:
    """C(q, dq), n x n, with dM/dt - 2 C skew and c = C dq."""
    n = chain.n
    motion = velocities(chain, dq)
    C: Matrix = [[0] * n for _ in range(n)]
    bodies = composites(chain, inertias)
    momenta = dyads(chain, inertias, motion)
    for j in range(n):
        F, N = _rate_wrench(chain, j, bodies[j], momenta[j], motion[j])
        for i in range(j, -1, -1):
            C[i][j] = N[2] if chain.joints[i].revolute else F[2]
            if i:
                F, N = step_down(chain, i, F, N)
        _lower_row(chain, j, bodies[j], momenta[j], motion, C)
    return C


def _rate_wrench(chain: Chain, j: int, J: PseudoInertia, dyad: Dyad, velocity: BlockVelocity) -> tuple[Vector, Vector]:
    """Wrench on the composite body of the field dJ_j(r)/dt."""
    A, P, v = dyad.A, dyad.P, velocity.v
    zdot = [velocity.carrier[1], -velocity.carrier[0], 0]
    h = [J.hx, J.hy, J.hz]
    if not chain.joints[j].revolute:  # J_j = z, so dJ_j/dt = zdot for every point
        return [J.m * x for x in zdot], cross(h, zdot)
    relative = [v[1], -v[0], 0]  # -(z x v)
    trace = J.Jxx + J.Jyy + J.Jzz
    S = [[J.Jxx, J.Jxy, J.Jxz], [J.Jxy, J.Jyy, J.Jyz], [J.Jxz, J.Jyz, J.Jzz]]
    turning = [trace * zdot[r] - (S[r][0] * zdot[0] + S[r][1] * zdot[1]) for r in range(3)]
    F = add(add(cross(zdot, h), [-P[1], P[0], 0]), [J.m * x for x in relative])
    N = add(add(turning, [-A[0][2], -A[1][2], A[0][0] + A[1][1]]), cross(h, relative))
    return F, N


def _lower_row(chain: Chain, i: int, J: PseudoInertia, dyad: Dyad, motion: Sequence[BlockVelocity], C: Matrix) -> None:
    """C_ij for j < i: the unit wrench of joint i against the rates of the axes before it."""
    F, N = unit_wrench(chain.joints[i].revolute, J)
    if chain.joints[i].revolute:
        W: Vector = [-dyad.A[2][0], -dyad.A[2][1], dyad.A[0][0] + dyad.A[1][1]]
    else:
        W = [dyad.P[1], -dyad.P[0], 0]
    for j in range(i - 1, -1, -1):
        F, N = step_down(chain, j + 1, F, N)
        if not chain.joints[j + 1].parallel:
            before = chain.joints[j]
            W = turn(before.c, before.s, times(chain.joints[j + 1].R, W))
        x, y = motion[j].carrier[0], motion[j].carrier[1]
        v = motion[j].v
        if chain.joints[j].revolute:
            C[i][j] = (y * N[0] - x * N[1]) + (W[2] - (v[0] * F[1] - v[1] * F[0]))
        else:
            C[i][j] = y * F[0] - x * F[1]
