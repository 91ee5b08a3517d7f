"""Mass matrix and gravity torques of (14.6) by the composite rigid body algorithm.

The composite body of joint j consists of all links beyond it, taken as one rigid body. A unit acceleration of joint j
requires a wrench on that body, and the component of the wrench along the axis of joint i is M_ij. All quantities of a
joint are expressed in the frame B of its block of parallel axes, about the origin of the joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement
from typing import Any

from rrrgen.derive.recursions.linear_algebra import (
    Matrix,
    Vector,
    add,
    cross,
    is_number,
    rotate_z,
    rotate_z_back,
    times,
    transposed_times,
)
from rrrgen.derive.recursions.link_frames import Chain, ChainJoint, Placement
from rrrgen.derive.recursions.pseudo_inertia import PseudoInertia


def offset(chain: Chain, i: int) -> Vector:
    """The vector (3,), m, from the origin of the previous joint to that of joint i, in the frame of their block.

    Both joints must belong to one block of parallel axes.
    """
    joint = chain.joints[i]
    before = chain.joints[joint.parent]
    return add(rotate_z(before.c, before.s, joint.p), [0, 0, joint.slide])


def composites(chain: Chain, inertias: Sequence[PseudoInertia]) -> list[PseudoInertia]:
    """The composite pseudo-inertia of each joint, in the frame of its block and about its origin."""
    result: list[PseudoInertia] = [PseudoInertia()] * chain.n
    for i in reversed(range(chain.n)):
        joint, inertia = chain.joints[i], inertias[i]
        in_block = [k for k in chain.children[i] if chain.joints[k].parallel]
        for k in chain.children[i]:
            if k not in in_block:
                inertia = inertia.plus(_at_joint_before(chain.joints[k], result[k]))
        beyond = [result[k].transform(Placement([[1, 0, 0], [0, 1, 0], [0, 0, 1]], offset(chain, k))) for k in in_block]
        result[i] = inertia.rotated_z(joint.c, joint.s) if in_block else _rotated_z(inertia, joint.c, joint.s)
        for moved in beyond:
            result[i] = result[i].plus(moved)
    return result


def _at_joint_before(joint: ChainJoint, J: PseudoInertia) -> PseudoInertia:
    """The composite ``J`` of the first joint of a block, moved to the origin and frame of the previous link."""
    slide = Placement([[1, 0, 0], [0, 1, 0], [0, 0, 1]], [0, 0, joint.slide])
    at_foot = J if joint.revolute else J.transform(slide)
    return at_foot.transform(Placement(joint.R, joint.p))


def _rotated_z(J: PseudoInertia, c: Any, s: Any) -> PseudoInertia:
    """Rotate the pseudo-inertia ``J`` about z by the angle with cosine ``c`` and sine ``s``.

    A rotation about z keeps the sum Jxx + Jyy, so the new Jyy is written as that sum minus the new Jxx. Where the sum
    is needed again, it then simplifies to its known value.
    """
    turned = J.rotated_z(c, s)
    return replace(turned, Jyy=(J.Jxx + J.Jyy) - turned.Jxx)


def moved_to_joint_before(chain: Chain, k: int, J: PseudoInertia) -> PseudoInertia:
    """The body ``J`` at joint k, taken at the origin of the joint before and in the frame of its block."""
    joint = chain.joints[k]
    if joint.parallel:
        return J.transform(Placement([[1, 0, 0], [0, 1, 0], [0, 0, 1]], offset(chain, k)))
    before = chain.joints[joint.parent]
    return _rotated_z(_at_joint_before(joint, J), before.c, before.s)


def unit_wrench(revolute: bool, J: PseudoInertia) -> tuple[Vector, Vector]:
    """Force and moment (3,) about the joint's origin that give the composite body ``J`` unit joint acceleration."""
    if revolute:
        return [-J.hy, J.hx, 0], [-J.Jxz, -J.Jyz, J.Jxx + J.Jyy]
    return [0, 0, J.m], [J.hy, -J.hx, 0]


def step_down(chain: Chain, i: int, F: Vector, N: Vector) -> tuple[Vector, Vector]:
    """Move the wrench ``F, N`` from the origin of joint i to that of the joint before, and express it in that frame.

    The frame of a joint is that of its block of parallel axes.
    """
    joint = chain.joints[i]
    before = chain.joints[joint.parent]
    if joint.parallel:
        return F, add(N, cross(offset(chain, i), F))
    if not joint.revolute:
        N = add(N, cross([0, 0, joint.slide], F))
    F, N = times(joint.R, F), times(joint.R, N)
    N = add(N, cross(joint.p, F))
    return rotate_z(before.c, before.s, F), rotate_z(before.c, before.s, N)


def mass_matrix(chain: Chain, inertias: Sequence[PseudoInertia]) -> Matrix:
    """M(q), shape (n, n), without drive inertia, kg m^2 (kg, kg m for prismatic joints)."""
    return chain.form(_unit_accelerations(chain, composites(chain, inertias))[0])


def _unit_accelerations(chain: Chain, bodies: Sequence[PseudoInertia]) -> tuple[Matrix, list[Vector]]:
    """The mass matrix over all joints (n, n), and the wrench (6,) of each at the first joint of its branch.

    ``bodies`` are the composites; the wrench, force first, is that of unit acceleration of the joint.
    """
    M: Matrix = [[0] * chain.n for _ in range(chain.n)]
    at_base = []
    for j, J in enumerate(bodies):
        F, N = unit_wrench(chain.joints[j].revolute, J)
        for i in reversed(chain.paths[j]):
            M[i][j] = M[j][i] = N[2] if chain.joints[i].revolute else F[2]
            if chain.joints[i].parent >= 0:
                F, N = step_down(chain, i, F, N)
        at_base.append([*F, *N])
    return M, at_base


def floating_mass_matrix(chain: Chain, inertias: Sequence[PseudoInertia]) -> Matrix:
    """M (6 + n, 6 + n) over the twist of the base, linear part first, in base axes, and the joint velocities.

    The body of the base is the first link, whose frame is that of the base.
    """
    bodies = composites(chain, inertias)
    over_rows, wrenches = _unit_accelerations(chain, bodies)
    J = _whole_body(chain, inertias[0], bodies)
    hx = [[0, -J.hz, J.hy], [J.hz, 0, -J.hx], [-J.hy, J.hx, 0]]
    tensor = [
        [J.Jyy + J.Jzz, -J.Jxy, -J.Jxz],
        [-J.Jxy, J.Jxx + J.Jzz, -J.Jyz],
        [-J.Jxz, -J.Jyz, J.Jxx + J.Jyy],
    ]
    mass = [[J.m if r == c else 0 for c in range(3)] for r in range(3)]
    body = [[*mass[r], *(-v for v in hx[r])] for r in range(3)] + [[*hx[r], *tensor[r]] for r in range(3)]
    across = [chain.forces(row) for row in zip(*wrenches, strict=True)]
    joints = chain.form(over_rows)
    upper = [[*body_row, *beside] for body_row, beside in zip(body, across, strict=True)]
    lower = [[*(row[k] for row in across), *joints[k]] for k in range(len(joints))]
    return upper + lower


def _whole_body(chain: Chain, base_body: PseudoInertia, bodies: Sequence[PseudoInertia]) -> PseudoInertia:
    """The composite of the whole robot: ``base_body``, and ``bodies[k]`` of the joints that it carries.

    Moving a body to the base adds products ``p h`` of an offset and a first moment. Most of them stand in the columns
    of M as well. Those that do not are summed over all joints before they are multiplied, as the legs of many robots
    stand at offsets of equal magnitude.
    """
    J = base_body.matrix()
    sums: dict[tuple[int, int, Any], Any] = {}
    for k in chain.children[0]:
        joint = chain.joints[k]
        axis = next((i for i in range(3) if is_number(joint.R[i][2], 1, -1)), None)
        if joint.parallel or not joint.revolute or axis is None:
            J = _add_matrices(J, _moved_to_base(chain, k, bodies[k]).matrix())
            continue
        turned = bodies[k].transform(Placement(joint.R, [0, 0, 0]))
        T, h, p = turned.matrix(), [turned.hx, turned.hy, turned.hz], joint.p
        for r, c in combinations_with_replacement(range(3), 2):
            twice = 2 if r == c else 1
            for a, b in dict.fromkeys(((r, c), (c, r))):
                if b != axis and a in (axis, b):  # the moment p x F of the force F = axis x h has this product
                    for _ in range(twice):
                        T[r][c] = T[r][c] + p[a] * h[b]
                else:
                    size = twice * abs(p[a])
                    sums[r, c, size] = sums.get((r, c, size), 0) + (h[b] if p[a] > 0 else -h[b])
            T[r][c] = T[r][c] + turned.m * (p[r] * p[c])
        for r in range(3):
            T[r][3] = T[r][3] + turned.m * p[r]
        J = _add_matrices(J, T)
    for (r, c, size), total in sums.items():
        J[r][c] = J[r][c] + size * total
    return PseudoInertia.of_matrix([[J[min(r, c)][max(r, c)] for c in range(4)] for r in range(4)])


def _add_matrices(one: Matrix, other: Matrix) -> Matrix:
    return [add(row, beside) for row, beside in zip(one, other, strict=True)]


def _moved_to_base(chain: Chain, k: int, body: PseudoInertia) -> PseudoInertia:
    """The composite ``body`` of joint k, which stands on the base, moved to the frame of the base."""
    if chain.joints[k].parallel:
        return body.transform(Placement([[1, 0, 0], [0, 1, 0], [0, 0, 1]], offset(chain, k)))
    return _at_joint_before(chain.joints[k], body)


def gravity(chain: Chain, inertias: Sequence[PseudoInertia]) -> list[Any]:
    """Gravity torques (n,), N m or N: minus the weight of each composite body along or about its joint axis."""
    lightened = [PseudoInertia(hx=J.hx, hy=J.hy, hz=J.hz, m=J.m) for J in inertias]
    down = block_vectors(chain, chain.gravity)
    torques = []
    for joint, J, g in zip(chain.joints, composites(chain, lightened), down, strict=True):
        torques.append(J.hy * g[0] - J.hx * g[1] if joint.revolute else -(J.m * g[2]))
    return chain.forces(torques)


def block_vectors(chain: Chain, vector: Vector) -> list[Vector]:
    """Express a vector (3,) of the base frame in the frame of each joint's block; one vector per joint."""
    result: list[Vector] = []
    for joint in chain.joints:
        if joint.parallel:
            result.append(result[joint.parent])
            continue
        components = vector
        if joint.parent >= 0:
            before = chain.joints[joint.parent]
            components = rotate_z_back(before.c, before.s, result[joint.parent])
        result.append(transposed_times(joint.R, components))
    return result


@dataclass(frozen=True)
class BlockVelocity:
    """Velocity of a link: its angular velocity ``omega`` (rad/s) and the velocity ``v`` of its origin (m/s).

    ``block_omega`` (rad/s) is the angular velocity of the frame B of its block. All are (3,) and expressed in B.
    """

    block_omega: Vector
    omega: Vector
    v: Vector


def velocities(
    chain: Chain, dq: Sequence[Any], twist: tuple[Vector, Vector] = ([0, 0, 0], [0, 0, 0])
) -> list[BlockVelocity]:
    """The velocities of all links for joint velocities ``dq`` (n,) and the linear and angular velocity of the base."""
    rates = chain.joint_rates(dq)
    result: list[BlockVelocity] = []
    base = BlockVelocity(twist[1], twist[1], twist[0])
    for i, joint in enumerate(chain.joints):
        last = result[joint.parent] if joint.parent >= 0 else base
        block_omega, omega, v = last.block_omega, last.omega, last.v
        if joint.parallel:
            v = add(v, cross(omega, offset(chain, i)))
        else:
            if joint.parent >= 0:
                before = chain.joints[joint.parent]
                omega, v = rotate_z_back(before.c, before.s, omega), rotate_z_back(before.c, before.s, v)
            v = transposed_times(joint.R, add(v, cross(omega, joint.p)))
            omega = block_omega = transposed_times(joint.R, omega)
            v = add(v, cross(omega, [0, 0, joint.slide]))
        if joint.revolute:
            omega = [omega[0], omega[1], omega[2] + rates[i]]
        else:
            v = [v[0], v[1], v[2] + rates[i]]
        result.append(BlockVelocity(block_omega, omega, v))
    return result
