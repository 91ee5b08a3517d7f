"""Inverse dynamics in pseudo-inertia form (14.6), (14.10).

The inertial wrench of link k about its origin, with pseudo-inertia (S, h, m):

    F = m a + U h,    N = vex(U S - (U S)') + h x a,

passed down the chain; the torque of joint k is the z component of N (of F for a prismatic joint).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rrrgen.derive.algebra.vectors import Vector, add, cross, is_number, scale, times, turn
from rrrgen.derive.recursions.chain import Chain, ChainJoint
from rrrgen.derive.recursions.inertia import PseudoInertia
from rrrgen.derive.recursions.motion import LinkMotion, forward

Wrench = tuple[Vector, Vector]


def inverse_dynamics(
    chain: Chain,
    dq: Sequence[Any],
    ddq: Sequence[Any],
    inertias: Sequence[PseudoInertia],
    own: Sequence[bool],
) -> list[Any]:
    """Joint torques of the rigid body; ``inertias`` are in the links' own canonical frames."""
    return pass_down(chain, own, link_wrenches(chain, forward(chain, dq, ddq, own), inertias))


def link_wrenches(chain: Chain, motions: Sequence[LinkMotion], inertias: Sequence[PseudoInertia]) -> list[Wrench]:
    """Inertial wrenches of all links, each in its frame of expression."""
    return [
        link_wrench(motion, inertia if motion.own else inertia.turned(joint.c, joint.s), inertia.Jxx + inertia.Jyy)
        for joint, motion, inertia in zip(chain.joints, motions, inertias, strict=True)
    ]


def link_wrench(motion: LinkMotion, inertia: PseudoInertia, polar: Any) -> Wrench:
    """Inertial force and moment about the origin, in the link's frame of expression; ``polar`` is Jxx + Jyy.

    Turning about z leaves ``polar`` as it is, and where omega has no part along x or y it is all that spins:
    ``U21 Jxx - U12 Jyy = alpha_z (Jxx + Jyy) + omega_x omega_y (Jxx - Jyy)``.
    """
    U, D, J = motion.U, motion.D, inertia
    h = [J.hx, J.hy, J.hz]
    planar = any(is_number(rate, 0) for rate in motion.omega[:2])
    spin = motion.alpha[2] * polar if planar else U[1][0] * J.Jxx - U[0][1] * J.Jyy
    moment = [
        U[2][0] * J.Jxy + U[2][1] * J.Jyy + D[0] * J.Jyz - U[1][0] * J.Jxz - U[1][2] * J.Jzz,
        D[1] * J.Jxz + U[0][1] * J.Jyz + U[0][2] * J.Jzz - U[2][0] * J.Jxx - U[2][1] * J.Jxy,
        spin + D[2] * J.Jxy + U[1][2] * J.Jxz - U[0][2] * J.Jyz,
    ]
    return add(scale(J.m, motion.a), times(U, h)), add(moment, cross(h, motion.a))


def pass_down(chain: Chain, own: Sequence[bool], wrenches: Sequence[Wrench]) -> list[Any]:
    """Torques from the wrenches of all links, each in its frame of expression and about its origin."""
    totals = composite_wrenches(chain, own, wrenches)
    return [N[2] if joint.revolute else F[2] for joint, (F, N) in zip(chain.joints, totals, strict=True)]


def composite_wrenches(chain: Chain, own: Sequence[bool], wrenches: Sequence[Wrench]) -> list[Wrench]:
    """The wrench on everything beyond each joint, in the link's frame of expression and about its origin."""
    totals: list[Wrench] = []
    F: Vector = [0, 0, 0]
    N: Vector = [0, 0, 0]
    for i in reversed(range(chain.n)):
        F, N = add(F, wrenches[i][0]), add(N, wrenches[i][1])
        totals.append((F, N))
        if i:
            F, N = _to_previous(chain, i, own, F, N)
    return totals[::-1]


def _to_previous(chain: Chain, i: int, own: Sequence[bool], F: Vector, N: Vector) -> Wrench:
    """The wrench of link i about the origin of link i-1, in the frame of expression of link i-1."""
    joint, before = chain.joints[i], chain.joints[i - 1]
    if own[i]:
        F, N = turn(joint.c, joint.s, F), turn(joint.c, joint.s, N)
    if not joint.revolute:
        N = add(N, cross([0, 0, joint.slide], F))
    if joint.parallel:
        return _within_block(joint, before, own[i - 1], F, N)
    F, N = times(joint.R, F), times(joint.R, N)
    return F, add(N, cross(joint.p, F))


def _within_block(joint: ChainJoint, before: ChainJoint, own_before: bool, F: Vector, N: Vector) -> Wrench:
    if own_before:
        F, N = turn(before.c, -before.s, F), turn(before.c, -before.s, N)
        return F, add(N, cross(joint.p, F))
    return F, add(N, cross(turn(before.c, before.s, joint.p), F))
