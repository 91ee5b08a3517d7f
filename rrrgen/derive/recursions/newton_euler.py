"""Inverse dynamics by the Newton-Euler recursion with pseudo-inertias (14.6), (14.10).

The inertial wrench of link k about its origin, for the pseudo-inertia (S, h, m), is

    F = m a + U h,    N = vex(U S - (U S)') + h x a,    vex(A) = (A32, A13, A21).

Wrenches are summed from the tip to the base; the torque of joint k is the z component of N (of F if it is prismatic).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rrrgen.derive.recursions.linear_algebra import Vector, add, cross, is_number, rotate_z, scale, times
from rrrgen.derive.recursions.link_frames import Chain, ChainJoint
from rrrgen.derive.recursions.pseudo_inertia import PseudoInertia
from rrrgen.derive.recursions.velocities_and_accelerations import LinkMotion, forward

Wrench = tuple[Vector, Vector]

NO_WRENCH: Wrench = ([0, 0, 0], [0, 0, 0])
"""The wrench of a link without mass and inertia, recognised by its identity."""


def inverse_dynamics(
    chain: Chain,
    dq: Sequence[Any],
    ddq: Sequence[Any],
    inertias: Sequence[PseudoInertia],
    in_link_frame: Sequence[bool],
) -> list[Any]:
    """The joint torques (n,), N m or N, without drive inertia and friction; on a floating base behind its wrench (6,).

    ``dq``, ``ddq`` (n,) are joint velocities and accelerations; ``inertias`` are given in the canonical link frames;
    ``in_link_frame`` (n,) chooses the frame in which each link is computed.
    """
    return pass_down(chain, in_link_frame, link_wrenches(chain, forward(chain, dq, ddq, in_link_frame), inertias))


def link_wrenches(chain: Chain, motions: Sequence[LinkMotion], inertias: Sequence[PseudoInertia]) -> list[Wrench]:
    """The inertial wrenches of all links, each in the frame in which the link is expressed."""
    return [
        link_wrench(
            motion, inertia if motion.in_link_frame else inertia.rotated_z(joint.c, joint.s), inertia.Jxx + inertia.Jyy
        )
        for joint, motion, inertia in zip(chain.joints, motions, inertias, strict=True)
    ]


def link_wrench(motion: LinkMotion, inertia: PseudoInertia, polar: Any) -> Wrench:
    """Inertial force and moment of a link about its origin; ``polar`` is Jxx + Jyy.

    ``polar`` is invariant under rotation about z. If omega_x or omega_y is zero, it replaces two products, since
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


def pass_down(chain: Chain, in_link_frame: Sequence[bool], wrenches: Sequence[Wrench]) -> list[Any]:
    """The joint torques (n,) from the wrenches of all links, each about its origin, in the frame of that link.

    On a floating base they stand behind the force and the moment (6,) on it, about its origin, in base axes.
    """
    totals = composite_wrenches(chain, in_link_frame, wrenches)
    torques = [N[2] if joint.revolute else F[2] for joint, (F, N) in zip(chain.joints, totals, strict=True)]
    on_base = [] if chain.base is None else [*totals[0][0], *totals[0][1]]
    return on_base + chain.forces(torques)


def composite_wrenches(chain: Chain, in_link_frame: Sequence[bool], wrenches: Sequence[Wrench]) -> list[Wrench]:
    """For each joint, the sum of the inertial wrenches of its link and all links beyond, at the joint's origin.

    Each sum is about the origin of the joint's link, in the frame in which that link is expressed.
    """
    totals: list[Wrench] = [NO_WRENCH] * chain.n
    for i in reversed(range(chain.n)):
        totals[i] = _sum(totals[i], wrenches[i])
        before = chain.joints[i].parent
        if before >= 0 and totals[i] is not NO_WRENCH:  # of a column of the regressor, beyond its own link
            totals[before] = _sum(totals[before], _to_previous(chain, i, in_link_frame, *totals[i]))
    return totals


def _sum(one: Wrench, other: Wrench) -> Wrench:
    if one is NO_WRENCH or other is NO_WRENCH:
        return other if one is NO_WRENCH else one
    return add(one[0], other[0]), add(one[1], other[1])


def _to_previous(chain: Chain, i: int, in_link_frame: Sequence[bool], F: Vector, N: Vector) -> Wrench:
    """The wrench ``F, N`` about the origin of link i, moved to the origin and frame of the link before."""
    joint = chain.joints[i]
    before = chain.joints[joint.parent]
    if in_link_frame[i]:
        F, N = rotate_z(joint.c, joint.s, F), rotate_z(joint.c, joint.s, N)
    if not joint.revolute:
        N = add(N, cross([0, 0, joint.slide], F))
    if joint.parallel:
        return _within_block(joint, before, in_link_frame[joint.parent], F, N)
    F, N = times(joint.R, F), times(joint.R, N)
    return F, add(N, cross(joint.p, F))


def _within_block(joint: ChainJoint, before: ChainJoint, before_in_link_frame: bool, F: Vector, N: Vector) -> Wrench:
    if before_in_link_frame:
        F, N = rotate_z(before.c, -before.s, F), rotate_z(before.c, -before.s, N)
        return F, add(N, cross(joint.p, F))
    return F, add(N, cross(rotate_z(before.c, before.s, joint.p), F))
