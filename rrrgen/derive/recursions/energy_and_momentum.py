"""Energy and the product C' dq, from the momentum of composite bodies.

``(C' dq)_i = integral of r' . dJ_i/dt dm`` depends only on the momentum P and angular momentum L of each composite
body:

    (C' dq)_i = zdot_i . L_i - z_i . (v_i x P_i)   (revolute),   zdot_i . P_i   (prismatic),

and equals the gradient of the kinetic energy with respect to q.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from rrrgen.derive.recursions.linear_algebra import Vector, add, cross, dot, scale, times
from rrrgen.derive.recursions.link_frames import Chain
from rrrgen.derive.recursions.mass_matrix_and_gravity import BlockVelocity, composites, step_down, velocities
from rrrgen.derive.recursions.pseudo_inertia import PseudoInertia


def link_momentum(J: PseudoInertia, velocity: BlockVelocity) -> tuple[Vector, Vector]:
    """Momentum and angular momentum of one link about its origin, in the frame of its block."""
    h = [J.hx, J.hy, J.hz]
    x, y, z = velocity.omega
    L = [
        (J.Jyy + J.Jzz) * x - J.Jxy * y - J.Jxz * z,
        (J.Jxx + J.Jzz) * y - J.Jxy * x - J.Jyz * z,
        (J.Jxx + J.Jyy) * z - J.Jxz * x - J.Jyz * y,
    ]
    return add(scale(J.m, velocity.v), cross(velocity.omega, h)), add(L, cross(h, velocity.v))


def coriolis_transpose(chain: Chain, dq: Sequence[Any], inertias: Sequence[PseudoInertia]) -> list[Any]:
    """C(q, dq)' dq, shape (n,), N m or N: the gradient of the kinetic energy with respect to q."""
    return momentum_and_coriolis_transpose(chain, dq, inertias)[1]


def momentum_and_coriolis_transpose(
    chain: Chain, dq: Sequence[Any], inertias: Sequence[PseudoInertia]
) -> tuple[list[Any], list[Any]]:
    """The generalized momentum M dq without drive inertia, and C' dq, (n,) each, from one recursion.

    The momentum of joint i is the component of L_i (revolute) or P_i (prismatic) along its axis.
    """
    motion = velocities(chain, dq)
    momentum: list[Any] = [0] * chain.n
    result: list[Any] = [0] * chain.n
    beyond: list[tuple[Vector, Vector]] = [([0, 0, 0], [0, 0, 0])] * chain.n
    for i in reversed(range(chain.n)):
        joint = chain.joints[i]
        link = link_momentum(inertias[i].rotated_z(joint.c, joint.s), motion[i])
        P, L = add(beyond[i][0], link[0]), add(beyond[i][1], link[1])
        x, y, v = motion[i].block_omega[0], motion[i].block_omega[1], motion[i].v
        if joint.revolute:
            result[i] = (y * L[0] - x * L[1]) - (v[0] * P[1] - v[1] * P[0])
        else:
            result[i] = y * P[0] - x * P[1]
        momentum[i] = L[2] if joint.revolute else P[2]
        if joint.parent >= 0:
            P, L = step_down(chain, i, P, L)
            before = beyond[joint.parent]
            beyond[joint.parent] = add(before[0], P), add(before[1], L)
    gradient = chain.forces(result)
    if chain.loops is not None:  # the gradient of the kinetic energy through dW/dq
        turning = (chain.joint_second_rates(dq, [int(j == k) for j in range(len(dq))]) for k in range(len(dq)))
        gradient = [value + dot(momentum, rates) for value, rates in zip(gradient, turning, strict=True)]
    return chain.forces(momentum), gradient


def floating_momentum(
    chain: Chain, dq: Sequence[Any], twist: tuple[Vector, Vector], inertias: Sequence[PseudoInertia]
) -> list[Any]:
    """Linear and angular momentum (6,) of the whole robot about the origin of its floating base, in base axes.

    ``twist`` holds the linear and the angular velocity (3,) of the base, whose body is the first link.
    """
    beyond: list[tuple[Vector, Vector]] = [([0, 0, 0], [0, 0, 0])] * chain.n
    motion = velocities(chain, dq, twist)
    for i in reversed(range(chain.n)):
        joint = chain.joints[i]
        link = link_momentum(inertias[i].rotated_z(joint.c, joint.s), motion[i])
        P, L = beyond[i] = add(beyond[i][0], link[0]), add(beyond[i][1], link[1])
        if joint.parent >= 0:
            P, L = step_down(chain, i, P, L)
            before = beyond[joint.parent]
            beyond[joint.parent] = add(before[0], P), add(before[1], L)
    return [*beyond[0][0], *beyond[0][1]]


def kinetic_energy(chain: Chain, dq: Sequence[Any], inertias: Sequence[PseudoInertia]) -> Any:
    """The kinetic energy T = sum over links of (v . P + omega . L)/2 in J, without drive inertia."""
    total: Any = 0
    for joint, J, velocity in zip(chain.joints, inertias, velocities(chain, dq), strict=True):
        P, L = link_momentum(J.rotated_z(joint.c, joint.s), velocity)
        total = total + dot(velocity.v, P) + dot(velocity.omega, L)
    return total * Fraction(1, 2)


def potential_energy(chain: Chain, inertias: Sequence[PseudoInertia]) -> Any:
    """The potential energy U = -g . (sum of m r) in J, defined up to a constant.

    Base parameters determine it up to that constant only, since regrouping moves mass along joint axes.
    """
    lightened = [PseudoInertia(hx=J.hx, hy=J.hy, hz=J.hz, m=J.m) for J in inertias]
    total: Any = 0
    for first, whole in zip(chain.joints, composites(chain, lightened), strict=True):
        if first.parent < 0:
            h = times(first.R, [whole.hx, whole.hy, whole.hz + whole.m * first.slide])
            total = total - dot(chain.gravity, add(h, scale(whole.m, first.p)))
    return total
