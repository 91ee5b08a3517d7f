"""Simulated experiments: sampled control of the virtual robot with encoders, drives and noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rrrgen.base.errors import InputError, UnstableLoopError
from rrrgen.lab.plant.compiled import WORTH_BUILDING, compiled_integrator, compiled_rigid_integrator
from rrrgen.lab.plant.controllers import ControlLaw, Observer, ReferenceMotion
from rrrgen.lab.plant.integration import Integrator, make_integrator
from rrrgen.lab.plant.plant import Plant

Array = NDArray[Any]
Progress = Callable[[int, int, str], None]
"""Called as ``progress(done, total, message)``."""


@dataclass(frozen=True)
class MotorLimits:
    """Torque limits ``torque`` (m,) of coupled motors, infinite where a motor has none.

    ``W`` (m, n) maps joint speeds to motor speeds, ``dq_m = W dq``.
    """

    torque: Array
    W: Array

    def clip(self, tau: Array) -> Array:
        """Joint torques (n,) that the motors deliver for the command ``tau`` (n,) within their limits.

        ``tau_m = W'^-1 tau`` is clipped and mapped back by ``tau = W' tau_m``.
        """
        motor_torques = np.linalg.solve(self.W.T, tau)
        held = np.clip(motor_torques, -self.torque, self.torque)
        return tau if np.array_equal(held, motor_torques) else np.asarray(self.W.T @ held)

    def saturates(self, tau: Array) -> NDArray[np.bool_]:
        """Which joints (n,) a saturated motor acts on, for the command ``tau`` (n,)."""
        full = np.abs(np.linalg.solve(self.W.T, tau)) >= self.torque
        return np.asarray((self.W[full] != 0.0).any(axis=0))


@dataclass(frozen=True)
class Instruments:
    """Encoders and drives of the joints, one value per joint; None where they are ideal.

    - ``encoder_resolution``: rad (m).
    - ``torque_limit``, ``torque_resolution``: saturation and step of the torque command, N m (N).
    - ``torque_noise``: standard deviation of the recorded torque about the true one, N m (N).
    - ``disturbance``: standard deviation of a white torque that acts on the joints and is not recorded, N m (N).
    - ``torque_record``: which torque is recorded. A drive holds its torque over a sample: "command" records it at the
      beginning, half a sample ahead of the motion it causes; "centred" records the mean over a sample period around the
      same time, like a drive that integrates its current.
    - ``motors``: torque limits of coupled motors.
    - ``delay``: samples from the reading of the encoders to the torque that follows from it.
    """

    encoder_resolution: tuple[float, ...] | None = None
    torque_limit: tuple[float, ...] | None = None
    torque_resolution: tuple[float, ...] | None = None
    torque_noise: tuple[float, ...] | None = None
    disturbance: tuple[float, ...] | None = None
    torque_record: Literal["centred", "command"] = "centred"
    motors: MotorLimits | None = None
    delay: int = 0

    def read(self, q: Array) -> Array:
        """Encoder readings (n,) of the positions ``q`` (n,), rounded to the resolution."""
        return _round_to_resolution(q, self.encoder_resolution)

    def drive(self, tau: Array) -> Array:
        """Torque (n,) that the drives deliver for the command ``tau`` (n,): rounded, then clipped at the limits."""
        tau = _round_to_resolution(tau, self.torque_resolution)
        limit = self.torque_limit
        held = tau if limit is None else np.clip(tau, -np.asarray(limit), np.asarray(limit))
        return held if self.motors is None else self.motors.clip(held)

    def saturates(self, command: Array) -> NDArray[np.bool_]:
        """Which joints (n,) have their ``command`` (n,) changed by a limit of the joint or of a coupled motor."""
        limit = np.inf if self.torque_limit is None else np.asarray(self.torque_limit)
        at_joint = np.abs(command) >= limit
        return at_joint if self.motors is None else at_joint | self.motors.saturates(command)


def _round_to_resolution(values: Array, resolution: tuple[float, ...] | None) -> Array:
    if resolution is None:
        return values
    step = np.asarray(resolution, dtype=float)
    return np.asarray(np.where(step > 0.0, np.round(values / np.where(step > 0.0, step, 1.0)) * step, values))


@dataclass(frozen=True, eq=False)
class SimulatedRecording:
    """Recording of a simulated experiment with m samples of n joints, together with the true signals.

    ``t`` (m,) s; ``q`` (m, n) encoder readings, ``tau`` (m, n) recorded torques; ``reference``, ``reference_dq`` (m, n)
    commanded motion. ``true_q``, ``true_dq`` (m, n) are the exact motion at the encoders, ``true_tau`` (m, n) the
    recorded torque without its noise; ``held`` (m, n) the torque that the drives hold from each sample to the next;
    ``saturated`` (m, n) marks torques that a limit has clipped; ``feedforward`` (m, n) are torques that were added to
    those of the controller, or None. In rad (m), N m (N). ``loop`` are the controller and the observer that were
    simulated.
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
    held: Array
    saturated: NDArray[np.bool_]
    loop: tuple[ControlLaw, Observer] | None = None
    feedforward: Array | None = None


@dataclass(frozen=True)
class VirtualRobot:
    """A simulated robot: its plant and instruments, sampled and controlled with ``period`` (s).

    ``steps`` is the number of Runge-Kutta steps per sample of a rigid plant, ``tolerance`` that of the stiff solver for
    any other that is not compiled.
    """

    plant: Plant
    instruments: Instruments = field(default_factory=Instruments)
    period: float = 1e-3
    steps: int = 2
    tolerance: float = 1e-8

    def run(
        self,
        reference: Callable[[Array], tuple[Array, Array, Array]],
        duration: float,
        controller: ControlLaw,
        observer: Observer,
        *,
        seed: int = 0,
        excitation: ArrayLike | None = None,
        feedforward: Array | None = None,
        start: tuple[ArrayLike, ArrayLike] | None = None,
        progress: Progress | None = None,
    ) -> SimulatedRecording:
        """Run the experiment: follow ``reference(t) -> (q, dq, ddq)``, each (m, n), for ``duration`` seconds.

        ``controller`` computes the torques from the estimates of ``observer``. The robot starts on the reference, or at
        ``start = (q, dq)``. ``excitation`` (m, n) is the injected noise n of (14.36); ``feedforward`` (m, n), N m
        (N), is added to the torques. The same ``seed`` gives the same
        recording. ``progress(done, total, message)`` is called every 500 samples. Raises UnstableLoopError if the
        motion diverges, InputError for fewer than two samples.
        """
        count = round(duration / self.period)
        if count < 2:
            raise InputError(f"an experiment of {duration:g} s has fewer than two samples of {self.period:g} s")
        t = np.arange(count) * self.period
        wanted = [np.asarray(part, dtype=float) for part in reference(t)]
        loop = _Loop(self, controller, observer, np.random.default_rng(seed), count, feedforward)
        injected = np.zeros((count, self.plant.n)) if excitation is None else np.asarray(excitation, dtype=float)
        first = (wanted[0][0], wanted[1][0]) if start is None else start
        state = self.plant.initial_state(*first)
        integrator = self._integrator(state, count)
        for k in range(count):
            now = ReferenceMotion(wanted[0][k], wanted[1][k], wanted[2][k])
            applied = loop.sample(k, state, now, injected[k])
            try:
                state = integrator.advance(state, applied, self.period)
            except np.linalg.LinAlgError as error:
                raise UnstableLoopError(_runaway(t[k]) + f" ({error})") from error
            if not np.all(np.isfinite(state)):
                raise UnstableLoopError(_runaway(t[k]))
            if progress is not None and (k + 1) % 500 == 0:
                progress(k + 1, count, f"simulated {t[k]:.2f} s")
        return loop.recording(t, wanted[0], wanted[1])

    def _integrator(self, state: Array, count: int) -> Integrator:
        """The integrator for ``count`` samples from ``state`` on: in C where that is possible and saves time."""
        compiled: Integrator | None = compiled_integrator(self.plant, state, self.period)
        if compiled is None and count * self.steps >= WORTH_BUILDING:
            compiled = compiled_rigid_integrator(self.plant, self.steps)
        return compiled or make_integrator(self.plant, self.steps, self.tolerance)


class _Loop:
    """The sampled control loop and its recorded signals."""

    def __init__(
        self,
        robot: VirtualRobot,
        controller: ControlLaw,
        observer: Observer,
        rng: np.random.Generator,
        count: int,
        feedforward: Array | None,
    ) -> None:
        n = robot.plant.n
        self.feedforward = feedforward
        self.robot, self.controller, self.observer, self.rng = robot, controller, observer, rng
        self.reading, self.q, self.dq, self.command, self.held = (np.zeros((count, n)) for _ in range(5))
        self.saturated = np.zeros((count, n), dtype=bool)
        self.disturbance = rng.normal(size=(count, n)) * _row(robot.instruments.disturbance, n)

    def sample(self, k: int, state: Array, reference: ReferenceMotion, injected: Array) -> Array:
        """Read the encoders, compute the command, drive; returns the joint torque (n,) held until the next sample."""
        plant, instruments = self.robot.plant, self.robot.instruments
        self.q[k], self.dq[k] = plant.encoders(state), plant.speeds(state)
        self.reading[k] = instruments.read(self.q[k])
        if k == 0:
            self.observer.start(self.reading[0], reference)
        seen = self.observer.update(self.reading[k], reference)
        self.command[k] = self.controller.torque(*seen, reference, injected)
        if self.feedforward is not None:
            self.command[k] += self.feedforward[k]
        command = self.command[max(0, k - instruments.delay)]
        self.held[k] = instruments.drive(command)
        self.saturated[k] = instruments.saturates(command)
        return np.asarray(self.held[k] + self.disturbance[k])

    def recording(self, t: Array, reference: Array, reference_dq: Array) -> SimulatedRecording:
        """Assemble the recording from the stored signals, with noise added to the torques."""
        instruments = self.robot.instruments
        torque = self.held
        if instruments.torque_record == "centred":
            torque = 0.5 * (self.held + np.vstack([self.held[:1], self.held[:-1]]))
        noise = self.rng.normal(size=torque.shape) * _row(instruments.torque_noise, torque.shape[1])
        return SimulatedRecording(
            period=self.robot.period,
            t=t,
            q=self.reading,
            tau=torque + noise,
            reference=reference,
            reference_dq=reference_dq,
            true_q=self.q,
            true_dq=self.dq,
            true_tau=torque,
            held=self.held,
            saturated=self.saturated,
            loop=(self.controller, self.observer),
            feedforward=self.feedforward,
        )


def _runaway(instant: float) -> str:
    return f"the virtual robot ran away at t = {instant:.3f} s: check the gains, and that M(q) is positive definite"


def _row(values: tuple[float, ...] | None, n: int) -> Array:
    return np.zeros(n) if values is None else np.asarray(values, dtype=float)
