"""Derivatives of the mass matrix with respect to the positions of the joints, from composite bodies and unit twists.

For joints i and j of one branch, i before j or equal to it, M_ij is the power of the unit wrench of joint j (that gives
its composite body a unit acceleration of joint j) in the twist of joint i (the velocity of a body for a unit rate of
joint i). A joint k turns or moves everything beyond it, so

    dM_ij/dq_k = 0                                   (k <= i: both move with it, or k on another branch),
    dM_ij/dq_k = twist_i(k) . (z_k x wrench_j(k))    (i < k <= j),
    dM_ij/dq_k = twist_i(j) . (unit wrench of joint j on dJ_k)    (j < k),

with ``dJ_k`` the change of the composite body of joint k as it turns about its axis or moves along it. Turned about z,

    dJxx = -2 Jxy,  dJyy = 2 Jxy,  dJxy = Jxx - Jyy,  dJxz = -Jyz,  dJyz = Jxz,  dhx = -hy,  dhy = hx,

and all else stays. Wrenches and twists are taken at the origin of a joint, in the frame of its block.
"""

from __future__ import annotations

from dataclasses import replace

from rrrgen.derive.recursions.linear_algebra import Matrix, Vector, dot
from rrrgen.derive.recursions.link_frames import Chain
from rrrgen.derive.recursions.mass_matrix_and_gravity import (
    BlockVelocity,
    composites,
    moved_to_joint_before,
    step_down,
    unit_wrench,
    velocities,
)
from rrrgen.derive.recursions.newton_euler import Wrench
from rrrgen.derive.recursions.pseudo_inertia import PseudoInertia


def mass_matrix_derivatives(chain: Chain, inertias: list[PseudoInertia]) -> list[Matrix]:
    """The matrices dM/dq_k (n, n), one for each entry of q, in SI units. Closed loops are not covered."""
    assert chain.loops is None
    over_joints = _over_joints(replace(chain, coupling=None), inertias)
    if chain.coupling is None:
        return over_joints
    derivatives = []
    for factors in zip(*chain.coupling, strict=True):
        entries = [[dot(factors, [D[i][j] for D in over_joints]) for j in range(chain.n)] for i in range(chain.n)]
        derivatives.append(chain.form(entries))
    return derivatives


def _over_joints(chain: Chain, inertias: list[PseudoInertia]) -> list[Matrix]:
    """The derivatives over the displacements of all joints, those that follow others included."""
    n, bodies = chain.n, composites(chain, inertias)
    twists = [velocities(chain, [int(i == k) for k in range(n)]) for i in range(n)]
    derivatives: list[Matrix] = [[[0] * n for _ in range(n)] for _ in range(n)]

    def enter(k: int, joints: tuple[int, ...], j: int, at: int, wrench: Wrench) -> None:
        for i in joints:
            derivatives[k][i][j] = derivatives[k][j][i] = _power(twists[i][at], wrench)

    for j, path in enumerate(chain.paths):
        F, N = unit_wrench(chain.joints[j].revolute, bodies[j])
        for place, k in reversed(list(enumerate(path))):
            enter(k, path[:place], j, k, _wrench_derivative(chain.joints[k].revolute, F, N))
            if place:
                F, N = step_down(chain, k, F, N)
    for k, path in enumerate(chain.paths):
        J = _change(chain.joints[k].revolute, bodies[k])
        for place in reversed(range(1, len(path))):
            J, j = moved_to_joint_before(chain, path[place], J), path[place - 1]
            enter(k, path[:place], j, j, unit_wrench(chain.joints[j].revolute, J))
    return derivatives


def _wrench_derivative(revolute: bool, F: Vector, N: Vector) -> Wrench:
    """The change of a wrench that turns about z with a joint, or whose point of action moves along z with it."""
    turned: Vector = [-F[1], F[0], 0]
    return (turned, [-N[1], N[0], 0]) if revolute else ([0, 0, 0], turned)


def _power(twist: BlockVelocity, wrench: Wrench) -> object:
    F, N = wrench
    return dot(twist.v, F) + dot(twist.omega, N)


def _change(revolute: bool, J: PseudoInertia) -> PseudoInertia:
    """The change of the pseudo-inertia ``J`` as the body turns about z, or moves along z."""
    if not revolute:
        return PseudoInertia(Jxz=J.hx, Jyz=J.hy, Jzz=2 * J.hz, hz=J.m)
    twice = 2 * J.Jxy
    return PseudoInertia(Jxx=-twice, Jyy=twice, Jxy=J.Jxx - J.Jyy, Jxz=-J.Jyz, Jyz=J.Jxz, hx=-J.hy, hy=J.hx)
