"""The forward recursion: velocities and accelerations of all links.

The acceleration of a point r of link k, minus gravity, is ``a_k + U_k r`` with

    U_k = [alpha_k]x + [omega_k]x [omega_k]x,    [a]x the matrix of the vector product: [a]x r = a x r.

The links of a block of parallel axes share the frame B of the block, which is fixed to the link before it. They differ
only by the absolute rate W and acceleration A about the common z axis:

    U_k = U_B + [[-2 z W - W^2, -A, 0], [A, -2 z W - W^2, 0], [2 x W, 2 y W, 0]],   omega_B = (x, y, z)

so ``U13, U23, U33`` are the same for all of them. A link can be expressed in B or in its link frame, whichever is
cheaper; the last link of a block with a successor uses its link frame, from which the next block starts.
"""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import dataclass
from typing import Any

from rrrgen.derive.recursions.linear_algebra import (
    Matrix,
    Vector,
    add,
    is_number,
    product,
    rotate_z,
    rotate_z_back,
    times,
    transpose,
    transposed_times,
)
from rrrgen.derive.recursions.link_frames import Chain, ChainJoint


@dataclass(frozen=True)
class LinkMotion:
    """Motion of one link, expressed in its link frame (``in_link_frame``) or in the frame of its block.

    ``U = [alpha]x + [omega]x [omega]x`` (3, 3) takes a vector fixed to the link to its acceleration, ``D = (U33 - U22,
    U11 - U33, U22 - U11)``; ``a`` is the acceleration of the origin minus gravity, ``omega`` and ``alpha`` are the
    angular velocity and acceleration. Always in the frame of the block: ``a_block``,
    the same acceleration, and ``axis``, the second time derivative of the joint axis.
    """

    in_link_frame: bool
    U: Matrix
    D: Vector
    a: Vector
    omega: Vector
    alpha: Vector
    a_block: Vector
    axis: Vector


@dataclass(frozen=True)
class _BlockEntry:
    """Motion of the frame B of a block: angular velocity ``omega`` and acceleration ``alpha``, and the matrix ``U``.

    ``x2`` and ``y2`` are the squares of the x and y components of ``omega``.
    """

    omega: Vector
    alpha: Vector
    x2: Any
    y2: Any
    U: Matrix


def choose_frames(chain: Chain, keep_in_block: Container[int] = ()) -> list[bool]:
    """Choose for each link whether it is expressed in its link frame (True) or in the frame of its block (False).

    Links in ``keep_in_block`` get the frame of the block unless another block starts from them.
    """
    in_link_frame = []
    for i in range(chain.n):
        leads_on = any(not chain.joints[k].parallel for k in chain.children[i])
        in_link_frame.append(leads_on or i not in keep_in_block)
    return in_link_frame


def forward(chain: Chain, dq: Sequence[Any], ddq: Sequence[Any], in_link_frame: Sequence[bool]) -> list[LinkMotion]:
    """The motion of all links for joint velocities ``dq`` (n,) and accelerations ``ddq`` (n,).

    ``in_link_frame`` (n,) chooses the frame of each link (:func:`choose_frames`).
    """
    rates, accelerations = chain.joint_rates(dq), chain.joint_accelerations(dq, ddq)
    motions: list[LinkMotion] = []
    absolute: list[tuple[_BlockEntry, Any, Any]] = []
    base = _base_motion(chain)
    alpha_is_used = [chain.base is None or used for used in _alpha_is_used(chain, in_link_frame)]
    for i, joint in enumerate(chain.joints):
        before = motions[joint.parent] if joint.parent >= 0 else base
        if not joint.parallel:
            entry, W, A = _enter(joint, before), 0, 0
            a_block = transposed_times(joint.R, add(before.a, times(before.U, joint.p)))
        else:
            entry, W, A = absolute[joint.parent]
            a_block = add(before.a_block, _offset_acceleration(chain.joints[joint.parent], before, joint.p))
        if joint.revolute:
            W, A = W + rates[i], A + accelerations[i]
        else:
            a_block = add(a_block, _sliding(entry, W, A, joint.slide, rates[i], accelerations[i]))
        if in_link_frame[i]:
            motion = _in_link_frame(joint, entry, W, A, a_block, alpha_is_used[i])
        else:
            motion = _in_block_frame(entry, W, A, a_block)
            if not is_number(entry.omega[2], 0):
                # the next joint adds its rates to this motion; if z is 0, Z is the sum W itself, which costs less
                entry, W, A = _BlockEntry(motion.omega, motion.alpha, entry.x2, entry.y2, motion.U), 0, 0
        absolute.append((entry, W, A))
        motions.append(motion)
    return motions


def _alpha_is_used(chain: Chain, in_link_frame: Sequence[bool]) -> list[bool]:
    """Whether the angular acceleration of each link is used: by the blocks behind it, or, at a tip, by the caller.

    A block needs no more than U of the link before it if it begins with quarter turns and all its links are expressed
    in the frame of the block.
    """
    turned = list(in_link_frame)  # whether this link, or one behind it in its block, is in its link frame
    used = [True] * chain.n
    for i in reversed(range(chain.n)):
        within = [k for k in chain.children[i] if chain.joints[k].parallel]
        beyond = [k for k in chain.children[i] if not chain.joints[k].parallel]
        turned[i] = turned[i] or any(turned[k] for k in within)
        used[i] = not beyond or any(turned[k] or not _is_quarter_turn(chain.joints[k].R) for k in beyond)
    return used


def _is_quarter_turn(R: Matrix) -> bool:
    """Whether ``R`` only exchanges axes and their signs."""
    return all(is_number(entry, -1, 0, 1) for row in R for entry in row)


def _base_motion(chain: Chain) -> LinkMotion:
    """The motion of the base: of a floating one that of the chain, otherwise rest in the field of gravity."""
    nothing = [0] * 3
    if chain.base is None:
        U = [[0] * 3 for _ in range(3)]
        return LinkMotion(True, U, nothing, [-g for g in chain.gravity], nothing, nothing, nothing, nothing)
    omega, alpha, a = chain.base.omega, chain.base.alpha, chain.base.a
    return LinkMotion(True, _spin(omega, alpha), nothing, a, omega, alpha, nothing, nothing)


def _enter(joint: ChainJoint, before: LinkMotion) -> _BlockEntry:
    """Compute the motion of the frame of the block that begins at ``joint`` from that of the link before it.

    Where the rotation between the two is by quarter turns, it only permutes the entries of U.
    """
    R = joint.R
    omega, alpha = transposed_times(R, before.omega), transposed_times(R, before.alpha)
    x, y, _ = omega
    U = product(product(transpose(R), before.U), R) if _is_quarter_turn(R) else _spin(omega, alpha)
    return _BlockEntry(omega, alpha, x * x, y * y, U)


def _spin(omega: Vector, alpha: Vector) -> Matrix:
    """The matrix ``[alpha]x + [omega]x [omega]x`` that takes a vector of the body to its acceleration."""
    x, y, z = omega
    a, b, c = alpha
    x2, y2, z2, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
    return [[-(y2 + z2), xy - c, xz + b], [xy + c, -(x2 + z2), yz - a], [xz - b, yz + a, -(x2 + y2)]]


def _offset_acceleration(joint: ChainJoint, motion: LinkMotion, p: Vector) -> Vector:
    """The acceleration ``U p`` of an offset ``p`` fixed to the link that ``joint`` moves, in the frame of the block."""
    if motion.in_link_frame:
        return rotate_z(joint.c, joint.s, times(motion.U, p))
    return times(motion.U, rotate_z(joint.c, joint.s, p))


def _sliding(entry: _BlockEntry, W: Any, A: Any, slide: Any, rate: Any, acceleration: Any) -> Vector:
    """The acceleration (3,) that the displacement d of a prismatic joint adds: ``U z d + 2 (omega x z) d' + z d''``.

    ``slide``, ``rate`` and ``acceleration`` are d, d' and d'' along the z axis of the block.
    """
    x, y, _ = entry.omega
    twice = 2 * rate
    return [
        entry.U[0][2] * slide + y * twice,
        entry.U[1][2] * slide - x * twice,
        acceleration + entry.U[2][2] * slide,
    ]


def _in_block_frame(entry: _BlockEntry, W: Any, A: Any, a: Vector) -> LinkMotion:
    x, y, z = entry.omega
    B = entry.U
    Z = z + W
    Z2 = Z * Z
    U = [
        [-(entry.y2 + Z2), B[0][1] - A, B[0][2]],
        [B[1][0] + A, -(entry.x2 + Z2), B[1][2]],
        [B[2][0] + 2 * x * W, B[2][1] + 2 * y * W, B[2][2]],
    ]
    D = [Z2 - entry.y2, entry.x2 - Z2, entry.y2 - entry.x2]
    alpha = [entry.alpha[0] + y * W, entry.alpha[1] - x * W, entry.alpha[2] + A]
    return LinkMotion(False, U, D, a, [x, y, Z], alpha, a, [B[0][2], B[1][2], B[2][2]])


def _in_link_frame(joint: ChainJoint, entry: _BlockEntry, W: Any, A: Any, a: Vector, alpha_is_used: bool) -> LinkMotion:
    B = entry.U
    X, Y, z = rotate_z_back(joint.c, joint.s, entry.omega)
    U13, U23, _ = rotate_z_back(joint.c, joint.s, [B[0][2], B[1][2], 0])
    Z, Az = z + W, entry.alpha[2] + A
    XZ, YZ, XY = X * Z, Y * Z, X * Y
    X2, Y2, Z2 = X * X, Y * Y, Z * Z
    alpha_y, alpha_x = U13 - XZ, YZ - U23
    U = [
        [-(Y2 + Z2), XY - Az, U13],
        [XY + Az, -(X2 + Z2), U23],
        [*((XZ - alpha_y, YZ + alpha_x) if alpha_is_used else (2 * Z * X - U13, 2 * Z * Y - U23)), B[2][2]],
    ]
    D = [Z2 - Y2, X2 - Z2, Y2 - X2]
    axis = [B[0][2], B[1][2], B[2][2]]
    return LinkMotion(True, U, D, rotate_z_back(joint.c, joint.s, a), [X, Y, Z], [alpha_x, alpha_y, Az], a, axis)
