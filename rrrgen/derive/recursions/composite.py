"""Mass matrix and gravity from composite bodies (14.6).

The composite body of joint j is everything beyond it, taken as rigid. A unit acceleration of joint j exerts on it a
wrench whose moment about joint i is M_ij. All quantities of a joint are expressed in the frame B of its block and
about the joint's origin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from rrrgen.derive.algebra.vectors import Matrix, Vector, add, cross, times, transposed_times, turn, turn_back
from rrrgen.derive.recursions.chain import Chain, Placement
from rrrgen.derive.recursions.inertia import PseudoInertia


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
