"""Friction in the simulation: the interface of a friction model, and the friction of coupled motors.

:class:`rrrgen.friction.models.FrictionModel` and :class:`rrrgen.friction.stated.MixedFriction` implement the interface.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

SMOOTH_WIDTH = 1e-3
"""Width (rad/s or m/s) over which sgn(x) is smoothed to tanh(x/width) for a stiff solver."""


class FrictionLike(Protocol):
    """Interface of a friction model of n joints, (14.11)-(14.14); torques in N m (N), speeds in rad/s (m/s)."""

    @property
    def has_state(self) -> bool:
        """Whether the model has a state: the bristle deflection z of each joint."""
        ...

    def torque(self, dq: Array, width: Any = 0.0) -> Array:
        """Friction torque at the speeds ``dq`` (..., n), with tanh(x/width) for sgn(x) if ``width`` (or (n,)) > 0."""
        ...

    def directed(self, dq: Array, direction: Array) -> Array:
        """Friction torque at ``dq`` (n,) with sgn(dq) replaced by ``direction`` (n,) of -1, 0 or 1."""
        ...

    def rate(self, z: Array, dq: Array) -> Array:
        """Time derivative ``dz/dt`` (n,) of the state ``z`` (n,) at the speeds ``dq`` (n,)."""
        ...

    def state_torque(self, z: Array, dq: Array) -> Array:
        """Friction torque (n,) in the state ``z`` (n,) at the speeds ``dq`` (n,)."""
        ...


class Friction:
    """Adapter of a friction model for the integrators, with the ``width`` (rad/s or m/s) over which sgn is smoothed."""

    def __init__(self, model: FrictionLike, width: float = SMOOTH_WIDTH) -> None:
        self.model = model
        self.width = width
        self.has_state = model.has_state
        self.couples_joints = isinstance(model, MotorFriction)
        self.directed = model.directed
        self.rate = model.rate
        self.state_torque = model.state_torque

    def smooth_torque(self, dq: Array) -> Array:
        """Friction torque (n,) at the speeds ``dq`` (n,) with sgn(x) smoothed to tanh(x/width)."""
        return self.model.torque(dq, self.width)


class MotorFriction:
    """Friction of the joints together with that of coupled motors, which slide at ``W dq``: ``tau = tau_j + W' tau_m``.

    ``joints`` and ``motors`` are models of n joints and m motors, ``W`` (m, n) is the matrix ``motor_from_joint``. If
    several motors act on one joint at rest, the joint speeds do not determine which of them slides. In integration the
    signs of the motor speeds are therefore smoothed over ``width`` (rad/s or m/s at the joints). A motor friction law
    with a state is taken in sliding.
    """

    def __init__(
        self, joints: FrictionLike | None, motors: FrictionLike, W: Array, width: float = SMOOTH_WIDTH
    ) -> None:
        self.joints: FrictionLike = joints if joints is not None else _Frictionless(W.shape[1])
        self.motors, self.W, self.width = motors, W, width
        self.has_state = self.joints.has_state
        self.rate = self.joints.rate

    def torque(self, dq: Array, width: float = 0.0) -> Array:
        """Friction torque (..., n) of joints and motors at the joint speeds ``dq`` (..., n), sgn smoothed over
        ``width``.
        """
        speeds = np.asarray(dq) @ self.W.T
        at_motors = self.motors.torque(speeds, width * np.linalg.norm(self.W, axis=1) if width else 0.0)
        return np.asarray(self.joints.torque(dq, width) + at_motors @ self.W)

    def directed(self, dq: Array, direction: Array) -> Array:
        """Friction torque (n,) with the joints' sgn(dq) replaced by ``direction`` (n,); motor signs are smoothed."""
        return np.asarray(self.joints.directed(dq, direction) + self._motors(dq))

    def state_torque(self, z: Array, dq: Array) -> Array:
        """Friction torque (n,) with the joint model in the state ``z`` (n,); the motors' signs are smoothed."""
        return np.asarray(self.joints.state_torque(z, dq) + self._motors(dq))

    def _motors(self, dq: Array) -> Array:
        widths = self.width * np.linalg.norm(self.W, axis=1)
        return np.asarray(self.motors.torque(np.asarray(dq) @ self.W.T, widths) @ self.W)


class NoFriction(Friction):
    """A robot of ``n`` joints without friction."""

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
