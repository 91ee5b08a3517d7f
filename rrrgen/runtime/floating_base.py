"""States of a floating base: steps and differences of its pose, and the conventions of other programs.

The functions of rrrgen take the orientation (x, y, z, w), the twist [v; omega] of the base origin in base axes, and
the rates of its components. With the position p of the origin in the world:

=========  ================  =============================================  ==========================================
program    positions         velocities                                     accelerations
=========  ================  =============================================  ==========================================
Pinocchio  p, x y z w, q     v and omega in base axes, dq                   rates of the components, ddq
MuJoCo     p, w x y z, q     v in *world* axes, omega in base axes, dq      of the origin itself, in world axes; ddq
=========  ================  =============================================  ==========================================

Forces on the base follow the same axes: of Pinocchio those of the wrench here, of MuJoCo the force in world axes. Every
array may have leading axes of a batch.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


class FloatingState(NamedTuple):
    """A state: position of the base (..., 3), m, and what the functions of a floating base take, in their units."""

    position: Array
    orientation: Array
    twist: Array
    twist_rate: Array
    q: Array
    dq: Array
    ddq: Array


class BasePose(NamedTuple):
    """A pose of the base in the world: ``position`` (..., 3), m, unit quaternion ``orientation`` (..., 4), x y z w."""

    position: Array
    orientation: Array


def integrate(position: ArrayLike, orientation: ArrayLike, displacement: ArrayLike) -> BasePose:
    """The pose of the base after a motion with constant twist, which is the exponential of SE(3).

    Pinocchio's ``integrate`` of a free flyer does the same. MuJoCo's ``mj_integratePos`` moves the origin along a
    straight line instead, by the linear velocity in world axes.

    Args:
        position: of the base origin in the world, (..., 3), m.
        orientation: of the base, (..., 4): the unit quaternion x, y, z, w.
        displacement: twist times duration, (..., 6): linear part, m, then rotation, rad, in base axes.

    Returns:
        The pose after the motion.
    """
    start, quaternion = np.asarray(position, dtype=float), np.asarray(orientation, dtype=float)
    step = np.asarray(displacement, dtype=float)
    v, angle, axis = step[..., :3], *_angle_and_axis(step[..., 3:])
    across = np.cross(axis, v)
    half = np.sin(angle / 2)
    moved = v + half * np.sinc(angle / (2 * np.pi)) * across + (1 - np.sinc(angle / np.pi)) * np.cross(axis, across)
    turned = _product(quaternion, _join(axis * half, np.cos(angle / 2)))
    return BasePose(
        start + _rotate(rotation(quaternion), moved), turned / np.linalg.norm(turned, axis=-1, keepdims=True)
    )


def difference(position: ArrayLike, orientation: ArrayLike, position_1: ArrayLike, orientation_1: ArrayLike) -> Array:
    """The displacement that :func:`integrate` takes from one pose of the base to another, by at most half a turn.

    Args:
        position: of the base origin in the world at the start, (..., 3), m.
        orientation: of the base at the start, (..., 4): the unit quaternion x, y, z, w.
        position_1: of the base origin at the end, (..., 3), m.
        orientation_1: of the base at the end, (..., 4). The quaternions p and -p are the same orientation.

    Returns:
        The displacement, (..., 6): linear part, m, then rotation, rad, in base axes.
    """
    start, end = (np.asarray(part, dtype=float) for part in (orientation, orientation_1))
    turn = _product(start * [-1.0, -1.0, -1.0, 1.0], end)
    turn = np.where(turn[..., 3:] < 0, -turn, turn)
    sine, axis = _angle_and_axis(turn[..., :3])
    half = np.arctan2(sine, turn[..., 3:])
    back = np.swapaxes(rotation(start), -1, -2)
    moved = _rotate(back, np.asarray(position_1, dtype=float) - np.asarray(position, dtype=float))
    across = np.cross(axis, moved)
    bend = 1 - np.divide(half, np.tan(half), out=np.ones_like(half), where=half > 0)
    return _join(moved - half * across + bend * np.cross(axis, across), 2 * half * axis)


def _angle_and_axis(vector: Array) -> tuple[Array, Array]:
    """The length (..., 1) of vectors (..., 3) and their directions; zero for a vector of length zero."""
    length = np.linalg.norm(vector, axis=-1, keepdims=True)
    return length, _over(vector, length)


def _over(vector: Array, length: Array) -> Array:
    """``vector / length``, zero where the length is."""
    return np.divide(vector, length, out=np.zeros_like(vector), where=length > 0)


def _product(one: Array, other: Array) -> Array:
    """The product (..., 4) of two quaternions x, y, z, w: the rotation ``other`` first."""
    u, a, v, b = one[..., :3], one[..., 3:], other[..., :3], other[..., 3:]
    return _join(a * v + b * u + np.cross(u, v), a * b - np.sum(u * v, axis=-1, keepdims=True))


def rotation(orientation: ArrayLike) -> Array:
    """The rotation matrix (..., 3, 3) from base to world axes of a unit quaternion x, y, z, w (..., 4)."""
    x, y, z, w = np.moveaxis(np.asarray(orientation, dtype=float), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def to_pinocchio(state: FloatingState) -> tuple[Array, Array, Array]:
    """Pack ``state`` into q (..., 7 + n), v and a (..., 6 + n) of a Pinocchio model with a free-flyer root."""
    s = state
    return _join(s.position, s.orientation, s.q), _join(s.twist, s.dq), _join(s.twist_rate, s.ddq)


def from_pinocchio(q: ArrayLike, v: ArrayLike, a: ArrayLike) -> FloatingState:
    """Unpack positions (..., 7 + n), velocities and accelerations (..., 6 + n) of Pinocchio."""
    x, u, w = (np.asarray(part, dtype=float) for part in (q, v, a))
    return FloatingState(x[..., :3], x[..., 3:7], u[..., :6], w[..., :6], x[..., 7:], u[..., 6:], w[..., 6:])


def to_mujoco(state: FloatingState) -> tuple[Array, Array, Array]:
    """Pack ``state`` into qpos (..., 7 + n), qvel and qacc (..., 6 + n) of a MuJoCo model with a free joint."""
    s, R = state, rotation(state.orientation)
    v, omega = s.twist[..., :3], s.twist[..., 3:]
    acceleration = s.twist_rate[..., :3] + np.cross(omega, v)
    return (
        _join(s.position, np.roll(s.orientation, 1, axis=-1), s.q),
        _join(_rotate(R, v), omega, s.dq),
        _join(_rotate(R, acceleration), s.twist_rate[..., 3:], s.ddq),
    )


def from_mujoco(qpos: ArrayLike, qvel: ArrayLike, qacc: ArrayLike) -> FloatingState:
    """Unpack positions (..., 7 + n), velocities and accelerations (..., 6 + n) of MuJoCo."""
    x, u, w = (np.asarray(part, dtype=float) for part in (qpos, qvel, qacc))
    orientation = np.roll(x[..., 3:7], -1, axis=-1)
    back = np.swapaxes(rotation(orientation), -1, -2)
    v, omega = _rotate(back, u[..., :3]), u[..., 3:6]
    rate = _rotate(back, w[..., :3]) - np.cross(omega, v)
    twist, twist_rate = _join(v, omega), _join(rate, w[..., 3:6])
    return FloatingState(x[..., :3], orientation, twist, twist_rate, x[..., 7:], u[..., 6:], w[..., 6:])


def _rotate(R: Array, vector: Array) -> Array:
    return np.asarray(np.einsum("...ij,...j->...i", R, vector))


def _join(*parts: Any) -> Array:
    return np.concatenate(parts, axis=-1)
