"""Friction in the simulation: the interface of a friction model, and the friction of coupled motors.

:class:`rrrgen.robot.friction.models.FrictionModel` and :class:`rrrgen.robot.friction.models.MixedFriction` implement
the interface.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

SMOOTH_WIDTH = 1e-3
"""Width (rad/s or m/s) over which sgn(x) is smoothed to tanh(x/width) for a stiff solver."""
MOST_ROUNDS, SETTLED = 100, 1e-13
"""Largest number of iterations that find the load of coupled motors, and its relative change at which they end."""


class FrictionLike(Protocol):
    """Interface of a friction model of n joints, (14.11)-(14.14); torques in N m (N), speeds in rad/s (m/s).

    ``load`` (..., n) are the torques without friction, on which load-dependent laws depend.
    """

    @property
    def has_state(self) -> bool:
        """Whether the model has a state: the bristle deflection z of each joint."""
        ...

    @property
    def has_load(self) -> bool:
        """Whether the friction depends on the load torques."""
        ...

    def torque(self, dq: Array, width: Any = 0.0, load: Any = 0.0) -> Array:
        """Friction torque at the speeds ``dq`` (..., n).

        ``width`` > 0, a number or one for each joint (n,), replaces sgn(x) by the smooth tanh(x/width).
        """
        ...

    def torque_in_direction(self, dq: Array, direction: Array, load: Any = 0.0) -> Array:
        """Friction torque at ``dq`` (n,) with sgn(dq) replaced by ``direction`` (n,) of -1, 0 or 1."""
        ...

    def rate(self, z: Array, dq: Array) -> Array:
        """Time derivative ``dz/dt`` (n,) of the state ``z`` (n,) at the speeds ``dq`` (n,)."""
        ...

    def state_torque(self, z: Array, dq: Array, load: Any = 0.0, width: Any = 0.0) -> Array:
        """Friction torque (n,) in the state ``z`` (n,) at the speeds ``dq`` (n,).

        ``width`` > 0 replaces sgn(x) by tanh(x/width) at joints whose law has no state.
        """
        ...


class Friction:
    """Adapter of a friction model for the integrators, with the ``width`` (rad/s or m/s) over which sgn is smoothed.

    Friction is computed from the torques ``tau`` (n,) of the drives; the load is ``tau`` less the friction.
    """

    def __init__(self, model: FrictionLike, width: float = SMOOTH_WIDTH) -> None:
        self.model = model
        self.width = width
        self.has_state = model.has_state
        self.couples_joints = isinstance(model, MotorFriction)
        self.rate = model.rate

    def smooth_torque(self, dq: Array, tau: Array) -> Array:
        """Friction torque (n,) at the speeds ``dq`` (n,) with sgn(x) smoothed to tanh(x/width)."""
        return self._under(tau, lambda load: self.model.torque(dq, self.width, load))

    def torque_in_direction(self, dq: Array, direction: Array, tau: Array) -> Array:
        """Friction torque (n,) at ``dq`` (n,) with sgn(dq) replaced by ``direction`` (n,) of -1, 0 or 1."""
        return self._under(tau, lambda load: self.model.torque_in_direction(dq, direction, load))

    def state_torque(self, z: Array, dq: Array, tau: Array) -> Array:
        """Friction torque (n,) in the state ``z`` (n,) at the speeds ``dq`` (n,).

        At joints whose law has no state sgn(x) is smoothed to tanh(x/width): the solver fails where friction jumps.
        """
        return self._under(tau, lambda load: self.model.state_torque(z, dq, load, self.width))

    def _under(self, tau: Array, friction: Callable[[Any], Array]) -> Array:
        """Friction torques (n,) that depend on the transmitted load: solves ``load + friction(load) = tau`` for load.

        ``tau`` (n,) are the drive torques; returns ``friction(load)``.
        """
        free = friction(np.zeros_like(tau))
        if not self.model.has_load:
            return free
        if self.couples_joints:
            return _solve_fixed_point(tau, free, friction)
        share = friction(np.ones_like(tau)) - free
        net = tau - free
        return np.asarray(tau - net / (1.0 + share * np.sign(net)))


def _solve_fixed_point(tau: Array, torques: Array, friction: Callable[[Any], Array]) -> Array:
    """Friction torques ``f = friction(tau - f)`` by fixed-point iteration, for joints coupled by their loads."""
    for _ in range(MOST_ROUNDS):
        before, torques = torques, friction(tau - torques)
        if np.abs(torques - before).max() <= SETTLED * (1.0 + np.abs(tau).max()):
            break
    return torques


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
        self.carried = np.linalg.pinv(W)  # tau_m = carried' tau
        self.has_state = self.joints.has_state
        self.has_load = self.joints.has_load or motors.has_load
        self.rate = self.joints.rate

    def torque(self, dq: Array, width: float = 0.0, load: Any = 0.0) -> Array:
        """Friction torque (..., n) of joints and motors at the joint speeds ``dq`` (..., n).

        sgn is smoothed over ``width``.
        """
        return np.asarray(self.joints.torque(dq, width, load) + self._motors(dq, width, load))

    def torque_in_direction(self, dq: Array, direction: Array, load: Any = 0.0) -> Array:
        """Friction torque (n,) with the joints' sgn(dq) replaced by ``direction`` (n,); motor signs are smoothed."""
        return np.asarray(self.joints.torque_in_direction(dq, direction, load) + self._motors(dq, self.width, load))

    def state_torque(self, z: Array, dq: Array, load: Any = 0.0, width: Any = 0.0) -> Array:
        """Friction torque (n,) with the joint model in the state ``z`` (n,); the motors' signs are smoothed."""
        return np.asarray(self.joints.state_torque(z, dq, load, width) + self._motors(dq, self.width, load))

    def _motors(self, dq: Array, width: float, load: Any) -> Array:
        widths = width * np.linalg.norm(self.W, axis=1)
        loads = np.broadcast_to(load, np.shape(dq)) @ self.carried
        return np.asarray(self.motors.torque(np.asarray(dq) @ self.W.T, widths, loads) @ self.W)


class NoFriction(Friction):
    """Friction model of ``n`` joints without friction: all torques are zero."""

    def __init__(self, n: int) -> None:
        super().__init__(_Frictionless(n))


class _Frictionless:
    has_state = False
    has_load = False

    def __init__(self, n: int) -> None:
        self.zero = np.zeros(n)

    def torque(self, dq: Array, width: float = 0.0, load: Any = 0.0) -> Array:
        return self.zero

    def torque_in_direction(self, dq: Array, direction: Array, load: Any = 0.0) -> Array:
        return self.zero

    def rate(self, z: Array, dq: Array) -> Array:
        return self.zero

    def state_torque(self, z: Array, dq: Array, load: Any = 0.0, width: Any = 0.0) -> Array:
        return self.zero
