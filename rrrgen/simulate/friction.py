"""What the virtual robot asks of a friction model; :class:`rrrgen.friction.models.FrictionModel` fits."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

SMOOTH_WIDTH = 1e-3
"""rad/s (m/s): sgn(x) becomes tanh(x/width) where a stiff solver integrates through it."""


class FrictionLike(Protocol):
    """A friction model of n joints, see (14.11)-(14.14)."""

    @property
    def has_state(self) -> bool:
        """Whether there is a bristle deflection z per joint."""
        ...

    def torque(self, dq: Array, width: Any = 0.0) -> Array:
        """Torque at the speeds ``dq``, sgn smoothed over ``width``, a number or one per joint."""
        ...

    def directed(self, dq: Array, direction: Array) -> Array:
        """Torque with sgn(dq) replaced by ``direction``."""
        ...

    def rate(self, z: Array, dq: Array) -> Array:
        """dz/dt."""
        ...

    def state_torque(self, z: Array, dq: Array) -> Array:
        """Torque in the state z."""
        ...


class Friction:
    """Friction as the integrators use it."""

    def __init__(self, model: FrictionLike, width: float = SMOOTH_WIDTH) -> None:
        self.model = model
        self.width = width
        self.has_state = model.has_state
        self.couples_joints = isinstance(model, MotorFriction)
        self.directed = model.directed
        self.rate = model.rate
        self.state_torque = model.state_torque

    def smooth_torque(self, dq: Array) -> Array:
        """The torque with sgn(x) replaced by tanh(x/width)."""
        return self.model.torque(dq, self.width)


class MotorFriction:
    """Friction of the joints together with that of coupled motors, which slide at ``W dq``: ``tau = tau_j + W' tau_m``.

    ``joints`` and ``motors`` are models of n joints and m motors, ``W`` (m, n) is the matrix ``motor_from_joint``.
    Where several motors hold one joint, which of them slides does not follow from the joint speeds: in integration the
    signs of the motors' speeds are smooth, over ``width`` at the joints. The motors' law has no state.
    """

    def __init__(
        self, joints: FrictionLike | None, motors: FrictionLike, W: Array, width: float = SMOOTH_WIDTH
    ) -> None:
        self.joints: FrictionLike = joints if joints is not None else _Frictionless(W.shape[1])
        self.motors, self.W, self.width = motors, W, width
        self.has_state = self.joints.has_state
        self.rate = self.joints.rate

    def torque(self, dq: Array, width: float = 0.0) -> Array:
        """See :class:`FrictionLike`."""
        speeds = np.asarray(dq) @ self.W.T
        at_motors = self.motors.torque(speeds, width * np.linalg.norm(self.W, axis=1) if width else 0.0)
        return np.asarray(self.joints.torque(dq, width) + at_motors @ self.W)

    def directed(self, dq: Array, direction: Array) -> Array:
        """See :class:`FrictionLike`; the motors' signs are smooth."""
        return np.asarray(self.joints.directed(dq, direction) + self._motors(dq))

    def state_torque(self, z: Array, dq: Array) -> Array:
        """See :class:`FrictionLike`; the motors' signs are smooth."""
        return np.asarray(self.joints.state_torque(z, dq) + self._motors(dq))

    def _motors(self, dq: Array) -> Array:
        widths = self.width * np.linalg.norm(self.W, axis=1)
        return np.asarray(self.motors.torque(np.asarray(dq) @ self.W.T, widths) @ self.W)


class NoFriction(Friction):
    """None at all."""

    def __init__(self, n: int) -> None:
        super().__init__(_Frictionless(n))


class _Frictionless:
    has_state = False

    def __init__(self, n: int) -> None:
        self.zero = np.zeros(n)

    def torque(self, dq: Array, width: float = 0.0) -> Array:
        return self.zero

    def directed(self, dq: Array, direction: Array) -> Array:
        return self.zero

    def rate(self, z: Array, dq: Array) -> Array:
        return self.zero

    def state_torque(self, z: Array, dq: Array) -> Array:
        return self.zero
