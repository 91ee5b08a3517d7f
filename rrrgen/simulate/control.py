"""Sampled controllers of the virtual robot: PD (14.25), (14.33) and computed torque (14.34), with their observers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rrrgen.errors import InputError
from rrrgen.signals.kalman import kalman_step
from rrrgen.simulate.friction import FrictionLike
from rrrgen.simulate.plant import RigidBody

Array = NDArray[Any]


@dataclass(frozen=True)
class Reference:
    """What the controller is to follow at one instant: position, velocity, acceleration, (n,) each."""

    q: Array
    dq: Array
    ddq: Array


class Observer(Protocol):
    """Turns encoder readings into positions and velocities, sample by sample."""

    def start(self, reading: Array, reference: Reference) -> None:
        """Begin at the first sample."""
        ...

    def update(self, reading: Array, reference: Reference) -> tuple[Array, Array]:
        """Position and velocity (n,) at this sample from its reading."""
        ...


class BackwardDifference:
    """Velocity as the last difference of the readings; noisy at fine sampling, half a sample late."""

    def __init__(self, period: float) -> None:
        self.period = period
        self._last: Array = np.zeros(0)
        self._speed: Array = np.zeros(0)

    def start(self, reading: Array, reference: Reference) -> None:
        """See :class:`Observer`."""
        self._last = reading - self.period * reference.dq

    def update(self, reading: Array, reference: Reference) -> tuple[Array, Array]:
        """See :class:`Observer`."""
        speed = (reading - self._last) / self.period
        self._last = reading
        return reading, speed


class DeviationFilter:
    """A steady-state filter on the deviation from the reference, one joint like the other: (14.30), (14.31).

    ``transition`` E (3, 3) and ``gain`` k (3,) or one of each per joint, for the state ``[e, de, nu]``:
    ``x_bar = x_hat + k (y - q_r - e_hat)``, ``x_hat(k+1) = E x_bar``.
    """

    def __init__(self, transition: ArrayLike, gain: ArrayLike) -> None:
        self.E, self.k = np.asarray(transition, dtype=float), np.asarray(gain, dtype=float)
        self._predicted: Array = np.zeros((0, 3))

    def start(self, reading: Array, reference: Reference) -> None:
        """See :class:`Observer`."""
        self._predicted = np.zeros((reading.size, 3))
        self._predicted[:, 0] = reading - reference.q

    def update(self, reading: Array, reference: Reference) -> tuple[Array, Array]:
        """See :class:`Observer`."""
        wanted = np.stack([reference.q, reference.dq, reference.ddq], axis=-1)
        self._predicted, motion = kalman_step(self.E, self.k, self._predicted, reading, wanted)
        return motion[:, 0], motion[:, 1]


class Controller(Protocol):
    """Turns the observed motion and the reference into torque commands."""

    def torque(self, q: Array, dq: Array, reference: Reference, disturbance: Array) -> Array:
        """Joint torques (n,); ``disturbance`` (n,) is the injected noise n of (14.36)."""
        ...


@dataclass(frozen=True)
class PD:
    """``tau = -Kp (q - q_r) - Kd (dq - dq_r) + n`` with diagonal gains. Source: (14.25), (14.33)."""

    kp: tuple[float, ...]
    kd: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.kp) != len(self.kd) or min(self.kp) <= 0.0 or min(self.kd) < 0.0:
            raise InputError("PD control: as many kd as kp, kp positive, kd not negative")

    def torque(self, q: Array, dq: Array, reference: Reference, disturbance: Array) -> Array:
        """See :class:`Controller`."""
        kp, kd = np.asarray(self.kp), np.asarray(self.kd)
        return np.asarray(-kp * (q - reference.q) - kd * (dq - reference.dq) + disturbance)


@dataclass(frozen=True)
class ComputedTorque:
    """``tau = M u + c + g + tau_f`` with ``u = ddq_r - Kp e - Kd de + n``. Source: (14.34), (14.36).

    ``kp`` in 1/s^2, ``kd`` in 1/s. With ``along_reference`` the model is evaluated at q_r, dq_r, which keeps sensor
    noise out; ``friction`` is the controller's own model of it.
    """

    body: RigidBody
    kp: tuple[float, ...]
    kd: tuple[float, ...]
    friction: FrictionLike | None = None
    along_reference: bool = False
    feedforward: bool = True
    _gains: tuple[Array, Array] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_gains", (np.asarray(self.kp, dtype=float), np.asarray(self.kd, dtype=float)))

    def torque(self, q: Array, dq: Array, reference: Reference, disturbance: Array) -> Array:
        """See :class:`Controller`."""
        kp, kd = self._gains
        u = -kp * (q - reference.q) - kd * (dq - reference.dq) + disturbance
        if self.feedforward:
            u = u + reference.ddq
        at, speed = (reference.q, reference.dq) if self.along_reference else (q, dq)
        tau = self.body.mass(at) @ u + self.body.bias(at, speed)
        return np.asarray(tau if self.friction is None else tau + self.friction.torque(speed))


def pd_gains(inertia: ArrayLike, bandwidth: float | Sequence[float], damping: float = 1.0) -> PD:
    """Gains that place the poles of ``J s^2 + kd s + kp`` at ``bandwidth`` (Hz) with ``damping``, joint by joint.

    ``inertia`` (n,): the largest or typical moment of inertia each joint sees, kg m^2 (kg).
    """
    J = np.asarray(inertia, dtype=float)
    omega = 2.0 * np.pi * np.broadcast_to(np.asarray(bandwidth, dtype=float), J.shape)
    return PD(tuple((J * omega**2).tolist()), tuple((2.0 * damping * J * omega).tolist()))
