"""Forward kinematics (14.5), the geometric Jacobian, and its time derivative times the joint velocities."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from rrrgen.derive.recursions.linear_algebra import (
    Matrix,
    Vector,
    add,
    cross,
    product,
    rotate_z,
    rotate_z_back,
    subtract,
    times,
)
from rrrgen.derive.recursions.link_frames import BaseMotion, Chain, ChainJoint, Placement
from rrrgen.derive.recursions.velocities_and_accelerations import forward

IDENTITY: Matrix = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]


def joint_frames(chain: Chain) -> list[Placement]:
    """The poses of the canonical frames P_1..P_n in the base frame, computed from the base outwards."""
    frames: list[Placement] = []
    blocks: list[Matrix] = []
    for joint in chain.joints:
        last = frames[joint.parent] if joint.parent >= 0 else Placement(IDENTITY, [0, 0, 0])
        if joint.parallel:
            block_R, before = blocks[joint.parent], chain.joints[joint.parent]
            offset = rotate_z(before.c, before.s, joint.p)
            origin = add(last.p, times(block_R, add(offset, [0, 0, joint.slide])))
        else:
            origin = add(last.p, times(last.R, joint.p))
            block_R = product(last.R, joint.R)
            origin = add(origin, [row[2] * joint.slide for row in block_R])
        blocks.append(block_R)
        frames.append(Placement(_rotated_z(block_R, joint.c, joint.s), origin))
    return frames


def _rotated_z(R: Matrix, c: Any, s: Any) -> Matrix:
    """``R Rz``: R times the rotation about z with cosine ``c`` and sine ``s``."""
    return [[c * x + s * y, c * y - s * x, z] for x, y, z in R]


def compose(frame: Placement, constant: Placement) -> Placement:
    """The product of two poses, ``frame * constant``."""
    return Placement(product(frame.R, constant.R), add(frame.p, times(frame.R, constant.p)))


def homogeneous(frame: Placement) -> Matrix:
    """The homogeneous transform (4, 4) of a pose."""
    return [[*row, p] for row, p in zip(frame.R, frame.p, strict=True)] + [[0, 0, 0, 1]]


def link_frames(chain: Chain) -> list[Matrix]:
    """The user's link frames D_1..D_n in the base frame, as n homogeneous transforms (4, 4)."""
    return [
        homogeneous(compose(frame, constant))
        for frame, constant in zip(joint_frames(chain), chain.link_frames, strict=True)
    ]


def forward_kinematics(chain: Chain) -> Matrix:
    """The pose (4, 4) of the tip in the base frame, computed from the base outwards."""
    return homogeneous(compose(joint_frames(chain)[chain.tip_link], chain.tip))


def forward_kinematics_inwards(chain: Chain) -> Matrix:
    """The pose (4, 4) of the tip in the base frame, computed column by column from the tip to the base.

    Two axes and the position are moved through every joint (four products each); the third axis is their cross product.
    For long chains this is cheaper than products of rotation matrices.
    """
    x, y = (carry_to_base(chain, [row[k] for row in chain.tip.R]) for k in range(2))
    z = cross(x, y)
    p = position_to_base(chain, chain.tip.p)
    return [[x[r], y[r], z[r], p[r]] for r in range(3)] + [[0, 0, 0, 1]]


def carry_to_base(chain: Chain, vector: Vector) -> Vector:
    """Express a free vector of the tip's link frame in base axes."""
    path = chain.paths[chain.tip_link]
    for i, after in reversed(list(zip(path, (*path[1:], None), strict=True))):
        vector = _out_of_joint(chain, i, after, vector)
    return vector


def position_to_base(chain: Chain, point: Vector) -> Vector:
    """Express a point given in the tip's link frame in the base frame."""
    path = chain.paths[chain.tip_link]
    for i, after in reversed(list(zip(path, (*path[1:], None), strict=True))):
        joint = chain.joints[i]
        if after is None or not chain.joints[after].parallel:
            point = rotate_z(joint.c, joint.s, point)
        if not joint.revolute:
            point = add(point, [0, 0, joint.slide])
        if joint.parallel:
            before = chain.joints[joint.parent]
            point = add(point, rotate_z(before.c, before.s, joint.p))
        else:
            point = add(times(joint.R, point), joint.p)
    return point


def _out_of_joint(chain: Chain, i: int, after: int | None, vector: Vector) -> Vector:
    """Express a vector of link i in the frame of the previous link, or of the block if that link shares it.

    ``after`` is the next joint on the way to the tip. The rotation of a block is applied once, at its last joint.
    """
    joint = chain.joints[i]
    if after is None or not chain.joints[after].parallel:
        vector = rotate_z(joint.c, joint.s, vector)
    return vector if joint.parallel else times(joint.R, vector)


def jacobian(chain: Chain) -> Matrix:
    """The geometric Jacobian (6, n) at the tip, in base axes: rows 1-3 linear, rows 4-6 angular velocity."""
    return point_jacobian(chain, joint_frames(chain), chain.tip_link, chain.tip.p)


def point_jacobian(chain: Chain, frames: Sequence[Placement], link: int, point: Vector) -> Matrix:
    """The Jacobian (6, n), in base axes, of a point fixed to one link and given in its canonical frame.

    Columns of joints that do not move the link are zero.
    """
    p = add(frames[link].p, times(frames[link].R, point))
    columns: list[Vector] = [[0] * 6] * chain.n
    for i in chain.paths[link]:
        axis = [row[2] for row in frames[i].R]
        if chain.joints[i].revolute:
            columns[i] = cross(axis, subtract(p, frames[i].p)) + axis
        else:
            columns[i] = [*axis, 0, 0, 0]
    return [chain.forces([column[r] for column in columns]) for r in range(6)]


def jacobian_dot_dq(chain: Chain, dq: Sequence[Any]) -> Vector:
    """(dJ/dt) dq, shape (6,): the acceleration of the tip for ddq = 0, linear part first, in base axes."""
    return _drift(replace(chain, gravity=[0, 0, 0]), dq)


def _drift(chain: Chain, dq: Sequence[Any]) -> Vector:
    """The acceleration (6,) of the tip for ddq = 0 and the motion of the base of ``chain``, in base axes."""
    last = forward(chain, dq, [0] * len(dq), [True] * chain.n)[chain.tip_link]
    linear = add(last.a, times(last.U, chain.tip.p))
    return carry_to_base(chain, linear) + carry_to_base(chain, last.alpha)


def floating_jacobian(chain: Chain) -> Matrix:
    """The Jacobian (6, 6 + n) of the tip over the twist of a floating base and dq, linear rows first, in base axes."""
    frames = joint_frames(chain)
    x, y, z = add(frames[chain.tip_link].p, times(frames[chain.tip_link].R, chain.tip.p))
    arm = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
    on_base = [[*one, *across] for one, across in zip(IDENTITY, arm, strict=True)] + [
        [0, 0, 0, *one] for one in IDENTITY
    ]
    return [base + joints for base, joints in zip(on_base, jacobian(chain), strict=True)]


def floating_jacobian_dot_dq(chain: Chain, dq: Sequence[Any], v: Vector, omega: Vector) -> Vector:
    """The acceleration (6,) of the tip, linear part first, in base axes, where neither dq nor the twist changes.

    ``v`` and ``omega`` (3,) are the twist of the floating base: that its components are constant accelerates its origin
    by ``omega x v``.
    """
    return _drift(replace(chain, base=BaseMotion(omega, [0, 0, 0], cross(omega, v))), dq)


def to_link_frame(joint: ChainJoint, vector: Vector) -> Vector:
    """Express a vector given in the frame of a joint's block in the frame of the link that the joint moves."""
    return rotate_z_back(joint.c, joint.s, vector)
