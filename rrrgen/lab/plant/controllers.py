"""Sampled controllers of the virtual robot: PD (14.25), (14.33) and computed torque (14.34), with their observers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rrrgen.base.errors import InputError
from rrrgen.emit.controller.state_space import StateSpace
from rrrgen.lab.data.kalman import kalman_step
from rrrgen.lab.plant.friction import FrictionLike
from rrrgen.lab.plant.plant import RigidBody

Array = NDArray[Any]


@dataclass(frozen=True)
class ReferenceMotion:
    """Reference motion at one time: position, velocity, acceleration, (n,) each, in rad (m) and seconds."""

    q: Array
    dq: Array
    ddq: Array


class Observer(Protocol):
    """Interface of an observer: estimates positions and velocities from encoder readings, sample by sample."""

    def start(self, reading: Array, reference: ReferenceMotion) -> None:
        """Initialise the state at the first sample, whose ``reading`` has shape (n,)."""
        ...

    def update(self, reading: Array, reference: ReferenceMotion) -> tuple[Array, Array]:
        """Estimate position and velocity, (n,) each, at the sample with this ``reading`` (n,)."""
        ...

    def feedback(self, kp: ArrayLike, kd: ArrayLike) -> list[StateSpace]:
        """The sampled models from the deviation e of a reading to ``kp e + kd de`` as estimated, one per joint."""
        ...


class BackwardDifference:
    """Observer that differentiates the readings backward; noisy at high sampling rates, half a sample late."""

    def __init__(self, period: float) -> None:
        self.period = period
        self._last: Array = np.zeros(0)
        self._speed: Array = np.zeros(0)

    def start(self, reading: Array, reference: ReferenceMotion) -> None:
        """Choose the previous reading such that the first velocity is that of the reference."""
        self._last = reading - self.period * reference.dq

    def update(self, reading: Array, reference: ReferenceMotion) -> tuple[Array, Array]:
        """Return the reading and its backward difference, (n,) each."""
        speed = (reading - self._last) / self.period
        self._last = reading
        return reading, speed

    def feedback(self, kp: ArrayLike, kd: ArrayLike) -> list[StateSpace]:
        """The sampled models ``kp + kd (1 - 1/z)/Ts`` of the joints; their state is the reading before."""
        rates = zip(np.asarray(kp, dtype=float), np.asarray(kd, dtype=float) / self.period, strict=True)
        return [StateSpace(np.zeros((1, 1)), np.ones(1), np.array([-r]), float(p + r)) for p, r in rates]


class DeviationFilter:
    """Observer that filters the deviation from the reference with a steady-state Kalman filter, (14.30), (14.31).

    The state x of every joint is the deviation e and its first two derivatives. A reading y corrects the prediction
    x_hat, ``x_bar = x_hat + k (y - q_r - e_hat)``, and the next prediction is ``E x_bar``. ``transition`` is E (3, 3)
    and ``gain`` is k (3,), for all joints alike; with a leading axis (n, ...) each joint has its own.
    """

    def __init__(self, transition: ArrayLike, gain: ArrayLike) -> None:
        self.E, self.k = np.asarray(transition, dtype=float), np.asarray(gain, dtype=float)
        self._predicted: Array = np.zeros((0, 3))

    def start(self, reading: Array, reference: ReferenceMotion) -> None:
        """Start with the measured deviation and the velocity of the reference."""
        self._predicted = np.zeros((reading.size, 3))
        self._predicted[:, 0] = reading - reference.q

    def update(self, reading: Array, reference: ReferenceMotion) -> tuple[Array, Array]:
        """Update the filter with a reading (n,); returns filtered position and velocity, (n,) each."""
        wanted = np.stack([reference.q, reference.dq, reference.ddq], axis=-1)
        self._predicted, motion = kalman_step(self.E, self.k, self._predicted, reading, wanted)
        return motion[:, 0], motion[:, 1]

    def feedback(self, kp: ArrayLike, kd: ArrayLike) -> list[StateSpace]:
        """The sampled models of the joints, with the filtered state x_bar of the sample before as their state.

        ``x_bar = (I - k c) E x_bar(before) + k e`` with c = [1, 0, 0], and the output is ``[kp, kd, 0] x_bar``.
        """
        p, d = np.asarray(kp, dtype=float), np.asarray(kd, dtype=float)
        E, k = np.broadcast_to(self.E, (len(p), 3, 3)), np.broadcast_to(self.k, (len(p), 3))
        systems = []
        for i, row in enumerate(np.column_stack([p, d, np.zeros(len(p))])):
            A = (np.eye(3) - np.outer(k[i], [1.0, 0.0, 0.0])) @ E[i]
            systems.append(StateSpace(A, k[i], row @ A, float(row @ k[i])))
        return systems


class ControlLaw(Protocol):
    """Interface of a controller: computes torque commands from the observed motion and the reference."""

    def torque(self, q: Array, dq: Array, reference: ReferenceMotion, disturbance: Array) -> Array:
        """Torque command (n,), N m (N), at the observed ``q``, ``dq`` (n,).

        ``disturbance`` (n,) is the excitation n of (14.36), which the control law adds.
        """
        ...


@dataclass(frozen=True)
class PD:
    """PD control ``tau = -Kp (q - q_r) - Kd (dq - dq_r) + n`` with diagonal gains. Source: (14.25), (14.33).

    ``kp`` (n,) in N m/rad (N/m), ``kd`` (n,) in N m s/rad (N s/m).
    """

    kp: tuple[float, ...]
    kd: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.kp) != len(self.kd) or min(self.kp) <= 0.0 or min(self.kd) < 0.0:
            raise InputError("PD control: as many kd as kp, kp positive, kd not negative")

    def torque(self, q: Array, dq: Array, reference: ReferenceMotion, disturbance: Array) -> Array:
        """Torque command (n,) of the PD law; ``disturbance`` (n,), N m (N), is added to it."""
        kp, kd = np.asarray(self.kp), np.asarray(self.kd)
        return np.asarray(-kp * (q - reference.q) - kd * (dq - reference.dq) + disturbance)


@dataclass(frozen=True)
class ComputedTorque:
    """Computed torque ``tau = M u + c + g + tau_f`` with ``u = ddq_r - Kp e - Kd de + n``. Source: (14.34), (14.36).

    M, c and g are those of the model ``body``; ``kp`` (n,) is in 1/s^2, ``kd`` (n,) in 1/s. ``friction`` is the
    friction model that the controller compensates, None for no compensation. With ``along_reference``, the model is
    evaluated at ``q_r``, ``dq_r``, which keeps sensor noise out of it; without ``feedforward``, ``ddq_r`` is left out
    of u.
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

    def input(self, q: Array, dq: Array, reference: ReferenceMotion, disturbance: Array) -> Array:
        """The input u (n,) of the linearised arm, rad/s^2 (m/s^2), with ``disturbance`` (n,) added to it."""
        kp, kd = self._gains
        u = -kp * (q - reference.q) - kd * (dq - reference.dq) + disturbance
        return np.asarray(u + reference.ddq if self.feedforward else u)

    def torque(self, q: Array, dq: Array, reference: ReferenceMotion, disturbance: Array) -> Array:
        """Torque command (n,) of the computed-torque law; ``disturbance`` (n,), rad/s^2 (m/s^2), is added to u."""
        u = self.input(q, dq, reference, disturbance)
        at, speed = (reference.q, reference.dq) if self.along_reference else (q, dq)
        tau = self.body.mass(at) @ u + self.body.bias(at, speed)
        return np.asarray(tau if self.friction is None else tau + self.friction.torque(speed, load=tau))


class RecordedInput:
    """Computed torque that keeps the inputs u it computes, sample by sample, in ``inputs``."""

    def __init__(self, law: ComputedTorque) -> None:
        self.law = law
        self.inputs: list[Array] = []

    def torque(self, q: Array, dq: Array, reference: ReferenceMotion, disturbance: Array) -> Array:
        """Torque command (n,) of the law; its input is appended to ``inputs``."""
        self.inputs.append(self.law.input(q, dq, reference, disturbance))
        return self.law.torque(q, dq, reference, disturbance)


def pd_gains(inertia: ArrayLike, bandwidth: float | Sequence[float], damping: float = 1.0) -> PD:
    """PD gains that place the poles of ``J s^2 + kd s + kp`` at ``bandwidth`` (Hz) with damping ratio ``damping``.

    ``inertia`` (n,) is the largest or a typical moment of inertia J about each joint, kg m^2 (kg); ``bandwidth`` is a
    number or one per joint.
    """
    J = np.asarray(inertia, dtype=float)
    omega = 2.0 * np.pi * np.broadcast_to(np.asarray(bandwidth, dtype=float), J.shape)
    return PD(tuple((J * omega**2).tolist()), tuple((2.0 * damping * J * omega).tolist()))
