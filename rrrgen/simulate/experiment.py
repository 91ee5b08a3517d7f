"""An experiment on the virtual robot: sampled control with encoders, drives and noise; the record a real one leaves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rrrgen.errors import DerivationError, InputError
from rrrgen.simulate.control import Controller, Observer, Reference
from rrrgen.simulate.integration import make_integrator
from rrrgen.simulate.plant import Plant

Array = NDArray[Any]
Progress = Callable[[int, int, str], None]
"""Called as ``progress(done, total, message)``."""


@dataclass(frozen=True)
class MotorLimits:
    """Torque limits (m,) of coupled motors, infinite where there is none, and ``motor_from_joint`` W (m, n)."""

    torque: Array
    W: Array

    def clipped(self, tau: Array) -> Array:
        """Joint torques (n,) that motors within their limits make of ``tau``: ``tau = W' tau_m``."""
        own = np.linalg.solve(self.W.T, tau)
        held = np.clip(own, -self.torque, self.torque)
        return tau if np.array_equal(held, own) else np.asarray(self.W.T @ held)

    def saturates(self, tau: Array) -> NDArray[np.bool_]:
        """The joints that a motor at its limit acts on."""
        full = np.abs(np.linalg.solve(self.W.T, tau)) >= self.torque
        return np.asarray((self.W[full] != 0.0).any(axis=0))


@dataclass(frozen=True)
class Instruments:
    """Encoders and drives, joint by joint; ``None`` where they are ideal.

    ``encoder_resolution`` rad (m); ``torque_limit`` where drives saturate and ``torque_resolution`` of their commands,
    N m (N); ``torque_noise`` is the standard deviation of the recorded torque about the true one, ``disturbance`` that
    of a white torque that acts on the joints, sample by sample, and is not recorded.

    ``torque_record``: a drive holds its torque over a sample. "command" records it at the sample's begin, and so is
    half a sample ahead of the motion it causes; "centred" is the mean over the sample around the instant, as a drive
    reports that integrates its current. ``motors`` are the limits of coupled motors.
    """

    encoder_resolution: tuple[float, ...] | None = None
    torque_limit: tuple[float, ...] | None = None
    torque_resolution: tuple[float, ...] | None = None
    torque_noise: tuple[float, ...] | None = None
    disturbance: tuple[float, ...] | None = None
    torque_record: Literal["centred", "command"] = "centred"
    motors: MotorLimits | None = None

    def read(self, q: Array) -> Array:
        """Encoder readings of the positions ``q``."""
        return _rounded(q, self.encoder_resolution)

    def drive(self, tau: Array) -> Array:
        """The torque that the drives make of a command."""
        tau = _rounded(tau, self.torque_resolution)
        limit = self.torque_limit
        held = tau if limit is None else np.clip(tau, -np.asarray(limit), np.asarray(limit))
        return held if self.motors is None else self.motors.clipped(held)

    def saturates(self, command: Array) -> NDArray[np.bool_]:
        """At which joints a limit of joint or motors changes the command."""
        limit = np.inf if self.torque_limit is None else np.asarray(self.torque_limit)
        at_joint = np.abs(command) >= limit
        return at_joint if self.motors is None else at_joint | self.motors.saturates(command)


def _rounded(values: Array, resolution: tuple[float, ...] | None) -> Array:
    if resolution is None:
        return values
    step = np.asarray(resolution, dtype=float)
    return np.asarray(np.where(step > 0.0, np.round(values / np.where(step > 0.0, step, 1.0)) * step, values))


@dataclass(frozen=True, eq=False)
class Recording:
    """What an experiment leaves: time (m,), encoder positions and torques (m, n), and the truth behind them.

    ``true_q``, ``true_dq`` are the mechanical motion at the samples, ``true_tau`` the applied torque as it is recorded,
    without noise; ``reference`` (m, n) is the commanded position; ``saturated`` (m, n) marks clipped torques.
    """

    period: float
    t: Array
    q: Array
    tau: Array
    reference: Array
    reference_dq: Array
    true_q: Array
    true_dq: Array
    true_tau: Array
    saturated: NDArray[np.bool_]


@dataclass(frozen=True)
class VirtualRobot:
    """A plant with its instruments, sampled at ``period`` s (1 ms in the case study)."""

    plant: Plant
    instruments: Instruments = field(default_factory=Instruments)
    period: float = 1e-3
    steps: int = 2
    tolerance: float = 1e-8

    def run(
        self,
        reference: Callable[[Array], tuple[Array, Array, Array]],
        duration: float,
        controller: Controller,
        observer: Observer,
        *,
        seed: int = 0,
        excitation: ArrayLike | None = None,
        start: tuple[ArrayLike, ArrayLike] | None = None,
        progress: Progress | None = None,
    ) -> Recording:
        """Follow ``reference(t) -> (q, dq, ddq)``, each (m, n), for ``duration`` seconds.

        The robot starts on the reference, or at ``start = (q, dq)``. ``excitation`` (m, n) is the noise n of (14.36).
        The same ``seed`` gives the same recording. Raises DerivationError when the motion runs away.
        """
        count = round(duration / self.period)
        if count < 2:
            raise InputError(f"an experiment of {duration:g} s has fewer than two samples of {self.period:g} s")
        t = np.arange(count) * self.period
        wanted = [np.asarray(part, dtype=float) for part in reference(t)]
        loop = _Loop(self, controller, observer, np.random.default_rng(seed), count)
        injected = np.zeros((count, self.plant.n)) if excitation is None else np.asarray(excitation, dtype=float)
        first = (wanted[0][0], wanted[1][0]) if start is None else start
        state = self.plant.initial_state(*first)
        integrator = make_integrator(self.plant, self.steps, self.tolerance)
        for k in range(count):
            now = Reference(wanted[0][k], wanted[1][k], wanted[2][k])
            applied = loop.sample(k, state, now, injected[k])
            try:
                state = integrator.advance(state, applied, self.period)
            except np.linalg.LinAlgError as error:
                raise DerivationError(_runaway(t[k]) + f" ({error})") from error
            if not np.all(np.isfinite(state)):
                raise DerivationError(_runaway(t[k]))
            if progress is not None and (k + 1) % 500 == 0:
                progress(k + 1, count, f"simulated {t[k]:.2f} s")
        return loop.recording(t, wanted[0], wanted[1])


class _Loop:
    """The sampled side: what happens at every sample, and what is recorded."""

    def __init__(
        self, robot: VirtualRobot, controller: Controller, observer: Observer, rng: np.random.Generator, count: int
    ) -> None:
        n = robot.plant.n
        self.robot, self.controller, self.observer, self.rng = robot, controller, observer, rng
        self.reading, self.q, self.dq, self.held = (np.zeros((count, n)) for _ in range(4))
        self.saturated = np.zeros((count, n), dtype=bool)
        self.disturbance = rng.normal(size=(count, n)) * _row(robot.instruments.disturbance, n)

    def sample(self, k: int, state: Array, reference: Reference, injected: Array) -> Array:
        """Read, control, drive; returns the torque that acts on the joints until the next sample."""
        plant, instruments = self.robot.plant, self.robot.instruments
        self.q[k], self.dq[k] = plant.encoders(state), plant.speeds(state)
        self.reading[k] = instruments.read(self.q[k])
        if k == 0:
            self.observer.start(self.reading[0], reference)
        seen = self.observer.update(self.reading[k], reference)
        command = self.controller.torque(*seen, reference, injected)
        self.held[k] = instruments.drive(command)
        self.saturated[k] = instruments.saturates(command)
        return np.asarray(self.held[k] + self.disturbance[k])

    def recording(self, t: Array, reference: Array, reference_dq: Array) -> Recording:
        """Everything that was recorded."""
        instruments = self.robot.instruments
        torque = self.held
        if instruments.torque_record == "centred":
            torque = 0.5 * (self.held + np.vstack([self.held[:1], self.held[:-1]]))
        noise = self.rng.normal(size=torque.shape) * _row(instruments.torque_noise, torque.shape[1])
        return Recording(
            period=self.robot.period,
            t=t,
            q=self.reading,
            tau=torque + noise,
            reference=reference,
            reference_dq=reference_dq,
            true_q=self.q,
            true_dq=self.dq,
            true_tau=torque,
            saturated=self.saturated,
        )


def _runaway(instant: float) -> str:
    return f"the virtual robot ran away at t = {instant:.3f} s: check the gains, and that M(q) is positive definite"


def _row(values: tuple[float, ...] | None, n: int) -> Array:
    return np.zeros(n) if values is None else np.asarray(values, dtype=float)
