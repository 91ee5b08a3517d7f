"""The Coriolis matrix, from the motion of composite bodies relative to their joints; also used for derivatives.

The Coriolis matrix of the Christoffel symbols is an integral over the mass,

    C_ij = integral of J_i . dJ_j/dt dm,   J_j = z_j x rho_j,   rho_j = r - o_j,

with o_j the origin of joint j. Hence dM/dt = C + C', and dM/dt - 2 C is skew-symmetric. The composite body of joint j
enters through S, h, m (the integrals of rho rho', rho and 1), the dyad ``A = integral of (d rho/dt) rho' dm`` and the
relative momentum ``P = integral of d rho/dt dm``. Entries above the diagonal are the components at joint i of the
wrench of the field ``dJ_j/dt = zdot x rho + z x d rho/dt`` on the composite body,

    F = zdot x h + z x P,    N = (tr S - S) zdot + (tr A - A) z.

Entries below the diagonal, for the joints i before j, follow from the unit wrench F, N of joint j and a vector W, both
moved to joint i:

    C_ji = zdot_i . N + z_i . W,   W = integral of (d rho_i/dt) x J_j dm,  which is (tr A - A') z at joint j itself.

For a prismatic joint J_j = z_j. Quantities of a joint are in the frame of its block, about its origin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from rrrgen.derive.recursions.linear_algebra import (
    ZERO3,
    Matrix,
    Vector,
    add,
    cross,
    dot,
    product,
    rotate_z,
    rotate_z_back,
    scale,
    times,
    transpose,
)
from rrrgen.derive.recursions.link_frames import Chain, ChainJoint
from rrrgen.derive.recursions.mass_matrix_and_gravity import (
    BlockVelocity,
    composites,
    offset,
    step_down,
    unit_wrench,
    velocities,
)
from rrrgen.derive.recursions.pseudo_inertia import PseudoInertia


@dataclass(frozen=True)
class JointOffset:
    """The vector ``p`` (3,), m, from the origin of the previous joint to that of a joint, and its velocity ``rate``.

    Both are in the frame of the previous link, or in that of the block if both joints belong to one block. The
    displacement ``slide`` (3,) of a prismatic joint that begins a block, and its velocity ``slide_rate``, are kept
    apart, in the frame of that block.
    """

    p: Vector
    rate: Vector
    slide: Vector
    slide_rate: Vector


@dataclass(frozen=True)
class BodyDyad:
    """First moments of the relative velocity of a body: the dyad ``A`` (3, 3) and the relative momentum ``P`` (3,).

    With rho the vector from the origin to a point of the body, ``A = integral of (d rho/dt) rho' dm``, kg m^2/s, and
    ``P = integral of d rho/dt dm``, kg m/s. ``h`` (3,) is the integral of rho dm, kg m, and ``m`` the mass, kg.
    """

    A: Matrix
    P: Vector
    h: Vector
    m: Any

    def shift(self, p: Vector, rate: Vector) -> BodyDyad:
        """The dyad about a new origin; ``p`` is the vector from there to the present one, ``rate`` its velocity."""
        h = add(self.h, scale(self.m, p))
        A = [[self.A[r][c] + self.P[r] * p[c] + rate[r] * h[c] for c in range(3)] for r in range(3)]
        return BodyDyad(A, add(self.P, scale(self.m, rate)), h, self.m)

    def rotate(self, R: Matrix) -> BodyDyad:
        """The dyad in another frame; ``R`` (3, 3) is the orientation of the present frame in that one."""
        return BodyDyad(product(product(R, self.A), transpose(R)), times(R, self.P), times(R, self.h), self.m)

    def rotated_z(self, c: Any, s: Any) -> BodyDyad:
        """The dyad rotated about z by the angle with cosine ``c`` and sine ``s``.

        The upper left 2x2 block takes four products; its trace, which a rotation does not change, is reused.
        """
        A = self.A
        u = (A[0][0] - A[1][1]) * c - (A[0][1] + A[1][0]) * s
        xx = A[1][1] + c * u
        shear = s * u
        xz, yz, _ = rotate_z(c, s, [A[0][2], A[1][2], 0])
        zx, zy, _ = rotate_z(c, s, [A[2][0], A[2][1], 0])
        plane = [[xx, A[0][1] + shear, xz], [A[1][0] + shear, (A[0][0] + A[1][1]) - xx, yz]]
        return BodyDyad([*plane, [zx, zy, A[2][2]]], rotate_z(c, s, self.P), rotate_z(c, s, self.h), self.m)

    def plus(self, other: BodyDyad) -> BodyDyad:
        """The dyad of two bodies together, about the same origin and in the same frame."""
        A = [add(x, y) for x, y in zip(self.A, other.A, strict=True)]
        return BodyDyad(A, add(self.P, other.P), add(self.h, other.h), self.m + other.m)


@dataclass(frozen=True)
class CompositeBody:
    """The composite body of a joint: pseudo-inertia ``J``, ``dyad``, and ``zdot`` (3,), the rate of the joint axis."""

    J: PseudoInertia
    dyad: BodyDyad
    zdot: Vector


@dataclass(frozen=True)
class ShiftedWrench:
    """The unit wrench of a joint (force ``F``, moment ``N``) and its vector ``W``, taken at this or an earlier joint.

    The unit wrench gives the composite body of the joint a unit acceleration about its axis; W is defined in the
    docstring of the module. All three have shape (3,).
    """

    F: Vector
    N: Vector
    W: Vector


@dataclass(frozen=True)
class Composition:
    """The composite bodies of a moving chain and their unit wrenches, from which M and C are assembled.

    The composite body of joint j is all links beyond it, taken as one rigid body. ``bodies[j]`` holds it;
    ``shifted_wrenches[j][i]`` is the wrench that gives it a unit acceleration of joint j, moved to joint i, where i is
    j or a joint between j and the base. The matrices have one row and column for each entry of q (n,), also in a
    mechanism whose chain has further joints that follow those of q.

    The chain moves at joint velocities ``dq`` (n,). If it was composed with a ``factor`` (:func:`compose`), every
    velocity in it is that multiple of the true one.
    """

    chain: Chain
    dq: Sequence[Any]
    factor: int
    bodies: tuple[CompositeBody, ...]
    shifted_wrenches: tuple[dict[int, ShiftedWrench], ...]

    def mass_matrix(self) -> Matrix:
        """The mass matrix M(q), shape (n, n), kg m^2 (kg, kg m for prismatic joints), without drive inertia."""
        return self.chain.form(self._over_joints())

    def _over_joints(self) -> Matrix:
        """The mass matrix over the rates of all joints, those that follow others included."""
        n = self.chain.n
        M: Matrix = [[0] * n for _ in range(n)]
        for j, row in enumerate(self.shifted_wrenches):
            for i, shifted in row.items():
                M[i][j] = M[j][i] = joint_force(self.chain, i, shifted.F, shifted.N)
        return M

    def coriolis_matrix(self) -> Matrix:
        """The Coriolis matrix C(q, dq), shape (n, n), from the Christoffel symbols, N m s (N s for prismatic joints).

        It satisfies c = C dq for the Coriolis and centrifugal torques c, and dM/dt - 2 C is skew-symmetric. C is linear
        in the velocities: a chain that was composed with a ``factor`` gives ``factor`` times C.
        """
        reduced = self.chain.form(self.forces_of_rates()[0])
        return reduced if self.chain.loops is None else self._with_loops(reduced)

    def forces_of_rates(self) -> tuple[Matrix, list[Vector]]:
        """C over all joints (n, n), and the wrench (6,) of the field dJ_j/dt of each joint j on the base.

        The wrench, force first, is about the origin of the first joint of the branch, in the frame of its block.
        """
        chain, n = self.chain, self.chain.n
        C: Matrix = [[0] * n for _ in range(n)]
        on_base = []
        for j, body in enumerate(self.bodies):
            forces, at_base = passed_down(chain, j, *_rate_wrench(chain.joints[j].revolute, body))
            on_base.append(at_base)
            for i, value in forces.items():
                C[i][j] = value
            for i, shifted in self.shifted_wrenches[j].items():
                if i == j:
                    continue
                x, y, _ = self.bodies[i].zdot
                if chain.joints[i].revolute:
                    C[j][i] = (x * shifted.N[0] + y * shifted.N[1]) + shifted.W[2]
                else:
                    C[j][i] = x * shifted.F[0] + y * shifted.F[1]
        return C, on_base

    def _with_loops(self, C: Matrix) -> Matrix:
        """The Coriolis matrix ``C`` (n, n) over q, with the part ``W' M dW/dt`` that closed loops add."""
        M, columns = self._over_joints(), range(len(C))
        rates = [
            scale(self.factor, self.chain.joint_second_rates(self.dq, [int(j == k) for j in columns])) for k in columns
        ]
        added = [self.chain.forces([dot(row, rate) for row in M]) for rate in rates]
        return [[C[i][k] + added[k][i] for k in columns] for i in columns]


def compose(chain: Chain, dq: Sequence[Any], inertias: Sequence[PseudoInertia], factor: int = 1) -> Composition:
    """The composite bodies of ``chain`` at joint velocities ``dq`` (n,), rad/s (m/s), scaled by ``factor``.

    ``inertias`` are the pseudo-inertias of the links in their canonical frames. Every velocity in the result is
    multiplied by ``factor``; the derivatives of the torques need 2. A floating base turns as the chain says; its linear
    velocity has no effect, since all velocities in the result are relative.
    """
    motion = velocities(chain, dq, turning(chain))
    rates = chain.joint_rates(dq)
    joint_offsets = [
        _joint_offset(chain, rates, motion, i, factor) if joint.parent >= 0 else JointOffset(ZERO3, ZERO3, ZERO3, ZERO3)
        for i, joint in enumerate(chain.joints)
    ]
    dyads = _dyads(chain, inertias, motion, joint_offsets, factor)
    bodies = tuple(
        CompositeBody(J, dyad, scale(factor, [velocity.block_omega[1], -velocity.block_omega[0], 0]))
        for J, dyad, velocity in zip(composites(chain, inertias), dyads, motion, strict=True)
    )
    wrenches = tuple(_shifted_wrenches(chain, j, body, joint_offsets) for j, body in enumerate(bodies))
    return Composition(chain, dq, factor, bodies, wrenches)


def joint_force(chain: Chain, i: int, F: Vector, N: Vector) -> Any:
    """The generalized force at joint i of a wrench about its origin: moment about z, or force along z."""
    return N[2] if chain.joints[i].revolute else F[2]


def turning(chain: Chain) -> tuple[Vector, Vector]:
    """Linear and angular velocity (3,) of a base that turns as ``chain`` says, about its origin at rest."""
    return ZERO3, ZERO3 if chain.base is None else chain.base.omega


def passed_down(chain: Chain, j: int, F: Vector, N: Vector) -> tuple[dict[int, Any], Vector]:
    """The generalized forces, by joint index from j to the base, of the wrench ``F, N`` at the origin of joint j.

    The second result is this wrench (6,), force first, at the first joint of the branch, in the frame of its block.
    """
    values: dict[int, Any] = {}
    for i in reversed(chain.paths[j]):
        values[i] = joint_force(chain, i, F, N)
        if chain.joints[i].parent >= 0:
            F, N = step_down(chain, i, F, N)
    return values, [*F, *N]


def _joint_offset(
    chain: Chain, rates: Sequence[Any], motion: Sequence[BlockVelocity], i: int, factor: int
) -> JointOffset:
    joint = chain.joints[i]
    before = chain.joints[joint.parent]
    sliding = [0, 0, 0 if joint.revolute else factor * rates[i]]
    omega = motion[joint.parent].omega
    if joint.parallel:
        p = offset(chain, i)
        return JointOffset(p, add(cross(scale(factor, omega), p), sliding), ZERO3, ZERO3)
    slide = [0, 0, joint.slide]
    omega_link = scale(factor, rotate_z_back(before.c, before.s, omega))
    return JointOffset(
        joint.p, cross(omega_link, joint.p), slide, add(cross(scale(factor, motion[i].block_omega), slide), sliding)
    )


def _dyads(
    chain: Chain,
    inertias: Sequence[PseudoInertia],
    motion: Sequence[BlockVelocity],
    joint_offsets: Sequence[JointOffset],
    factor: int,
) -> list[BodyDyad]:
    """The dyads of the composite bodies, one per joint, computed from the tip to the base.

    The last link of a block is added in its own link frame, because the next block begins there. ``motion`` are the
    velocities of the links, ``factor`` is the multiple of them that is used.
    """
    result: dict[int, BodyDyad] = {}
    for i in reversed(range(chain.n)):
        joint, J = chain.joints[i], inertias[i]
        omega = scale(factor, motion[i].omega)
        new_blocks = [k for k in chain.children[i] if not chain.joints[k].parallel]
        carried = [_at_link_before(chain.joints[k], result[k], joint_offsets[k]) for k in new_blocks]
        if carried:
            total = _link_dyad(J, scale(factor, rotate_z_back(joint.c, joint.s, motion[i].omega)))
            for dyad in carried:
                total = total.plus(dyad)
            total = total.rotated_z(joint.c, joint.s)
        else:
            total = _link_dyad(J.rotated_z(joint.c, joint.s), omega)
        for k in chain.children[i]:
            if k not in new_blocks:
                total = total.plus(result[k].shift(joint_offsets[k].p, joint_offsets[k].rate))
        result[i] = total
    return [result[i] for i in range(chain.n)]


def _at_link_before(joint: ChainJoint, dyad: BodyDyad, joint_offset: JointOffset) -> BodyDyad:
    """The dyad of the first joint of a block, moved to the origin and frame of the previous link."""
    at_foot = dyad if joint.revolute else dyad.shift(joint_offset.slide, joint_offset.slide_rate)
    return at_foot.rotate(joint.R).shift(joint_offset.p, joint_offset.rate)


def _link_dyad(J: PseudoInertia, omega: Vector) -> BodyDyad:
    S = [[J.Jxx, J.Jxy, J.Jxz], [J.Jxy, J.Jyy, J.Jyz], [J.Jxz, J.Jyz, J.Jzz]]
    h = [J.hx, J.hy, J.hz]
    return BodyDyad(transpose([cross(omega, column) for column in S]), cross(omega, h), h, J.m)


def _shifted_wrenches(
    chain: Chain, j: int, body: CompositeBody, joint_offsets: Sequence[JointOffset]
) -> dict[int, ShiftedWrench]:
    F, N = unit_wrench(chain.joints[j].revolute, body.J)
    A, P = body.dyad.A, body.dyad.P
    W = [-A[2][0], -A[2][1], A[0][0] + A[1][1]] if chain.joints[j].revolute else [P[1], -P[0], 0]
    result = {j: ShiftedWrench(F, N, W)}
    for before, i in reversed(list(pairwise(chain.paths[j]))):
        result[before] = _shifted_to_previous(chain, i, joint_offsets[i], result[i])
    return dict(reversed(result.items()))


def _shifted_to_previous(chain: Chain, i: int, joint_offset: JointOffset, shifted: ShiftedWrench) -> ShiftedWrench:
    joint = chain.joints[i]
    before = chain.joints[joint.parent]
    F, N = step_down(chain, i, shifted.F, shifted.N)
    W = shifted.W
    if joint.parallel:
        return ShiftedWrench(F, N, add(W, cross(joint_offset.rate, F)))
    if not joint.revolute:
        W = add(W, cross(joint_offset.slide_rate, shifted.F))
    W = add(times(joint.R, W), cross(joint_offset.rate, times(joint.R, shifted.F)))
    return ShiftedWrench(F, N, rotate_z(before.c, before.s, W))


def _rate_wrench(revolute: bool, body: CompositeBody) -> tuple[Vector, Vector]:
    """Force and moment (3,) about the origin of joint j of the field dJ_j/dt on the composite body of joint j."""
    J, (A, P), zdot = body.J, (body.dyad.A, body.dyad.P), body.zdot
    h = [J.hx, J.hy, J.hz]
    if not revolute:
        return scale(J.m, zdot), cross(h, zdot)
    x, y, _ = zdot
    bending = [(J.Jyy + J.Jzz) * x - J.Jxy * y, (J.Jxx + J.Jzz) * y - J.Jxy * x, -(J.Jxz * x + J.Jyz * y)]
    return add(cross(zdot, h), [-P[1], P[0], 0]), add(bending, [-A[0][2], -A[1][2], A[0][0] + A[1][1]])
