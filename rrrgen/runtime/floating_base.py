"""States of a floating base in the conventions of other programs.

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
    return _joined(s.position, s.orientation, s.q), _joined(s.twist, s.dq), _joined(s.twist_rate, s.ddq)


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
        _joined(s.position, np.roll(s.orientation, 1, axis=-1), s.q),
        _joined(_turned(R, v), omega, s.dq),
        _joined(_turned(R, acceleration), s.twist_rate[..., 3:], s.ddq),
    )


def from_mujoco(qpos: ArrayLike, qvel: ArrayLike, qacc: ArrayLike) -> FloatingState:
    """Unpack positions (..., 7 + n), velocities and accelerations (..., 6 + n) of MuJoCo."""
    x, u, w = (np.asarray(part, dtype=float) for part in (qpos, qvel, qacc))
    orientation = np.roll(x[..., 3:7], -1, axis=-1)
    back = np.swapaxes(rotation(orientation), -1, -2)
    v, omega = _turned(back, u[..., :3]), u[..., 3:6]
    rate = _turned(back, w[..., :3]) - np.cross(omega, v)
    twist, twist_rate = _joined(v, omega), _joined(rate, w[..., 3:6])
    return FloatingState(x[..., :3], orientation, twist, twist_rate, x[..., 7:], u[..., 6:], w[..., 6:])


def _turned(R: Array, vector: Array) -> Array:
    return np.asarray(np.einsum("...ij,...j->...i", R, vector))


def _joined(*parts: Any) -> Array:
    return np.concatenate(parts, axis=-1)
