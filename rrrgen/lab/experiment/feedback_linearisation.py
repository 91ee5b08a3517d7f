"""Computation of the input u of a feedback linearisation from recorded joint torques.

``u = inv(M) (tau - c - g - tau_f)`` (14.34), with the model evaluated along the reference of the designed experiment,
so that the noise of the encoders has no effect. The controller of the robot need not be known and need not be that of
(14.36). The beginning of the excitation is searched in the recording by correlation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.derive.functions.friction import surfaces_of
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.data.uniform_stream import join_parts
from rrrgen.lab.design.plan import ResponseDesign, ResponseRun
from rrrgen.lab.identify.bandwidth import tune
from rrrgen.lab.identify.observations import Recording, reconstruct
from rrrgen.lab.plant.recording_files import LoopSignals

LEAST_CORRELATION = 0.2
"""Least correlation of torque and excitation at the best alignment; with less the excitation is not in the
recording."""
FEWEST = 100
"""Least number of samples of the excitation that the recording must contain to be aligned."""
PERIOD_SHARE = 1e-3
"""Largest difference of the sampling periods of recording and design, as a share of the period."""
LOAD_ROUNDS = 30
"""Number of iterations that find the load for which load and load-dependent friction add up to the torque; each reduces
the error tenfold."""
NEARBY = 0.2
"""Largest distance in rad (m) of the joint positions from those of the design."""


def linearised_log(model: Any, log: Log, design: ResponseDesign, run: ResponseRun) -> LoopSignals:
    """Extract the signals of ``run`` from the recording ``log`` of positions and torques of all joints.

    The excitation is aligned with the torque, so that a delay of the controller is not part of the response: it is
    placed where its differences correlate most with those of u. Samples before it, its settling periods and samples
    after it are left out. Friction is that of the robot file. Raises :class:`InputError` where the recording has
    another sampling rate or gaps, or where the excitation is not found in it.
    """
    _check(model, log, design)
    assert log.tau is not None
    lag = _lag(model, log, design, run)
    count = min(len(run.n), len(log.t) - lag)
    if count <= run.settle:
        raise InputError(f"{run.name}: the recording ends {count} samples after the excitation begins: still settling")
    rows = slice(lag, lag + count)
    t = design.period * np.arange(count)
    q_r, dq_r, _ = design.reference(run, t)
    i = design.joint
    q = log.q[rows]
    far = np.abs(q - q_r).max(axis=0)
    if far.max() > NEARBY:
        worst = int(np.argmax(far))
        raise InputError(
            f"{run.name}: joint {log.joints[worst]} is up to {far[worst]:.3g} from the designed motion: is this its "
            "recording, in its units, and did the robot start where the design says?"
        )
    u = _inputs(model, q_r, dq_r, log.tau[rows])
    return LoopSignals(run, t, run.n[:count], u[:, i], q[:, i], q_r[:, i])


def _check(model: Any, log: Log, design: ResponseDesign) -> None:
    if model.beta is None:
        raise InputError("the model torques need masses and inertias: the robot file has no links")
    if log.tau is None:
        raise InputError("the recording has no torques, from which the input follows")
    if log.n != model.n or len(design.kp) != model.n:
        raise InputError(f"recording and design are of {log.n} and {len(design.kp)} joints, the robot has {model.n}")
    if abs(log.period - design.period) > PERIOD_SHARE * design.period:
        raise InputError(f"the recording is sampled every {log.period:g} s, the design every {design.period:g} s")
    if log.segment is not None and np.ptp(log.segment) > 0:
        raise InputError("the recording has holes; a frequency response needs all its samples")


def _inputs(model: Any, q: Array, dq: Array, tau: Array) -> Array:
    """The inputs u (m, n) of (14.34) for the torques ``tau`` along the motion ``q``, ``dq``, (m, n) each."""
    net = tau - model.bias(q, dq) - _friction(model, dq, tau)
    return np.asarray(np.linalg.solve(model.mass_matrix(q), net[:, :, None])[:, :, 0])


def _friction(model: Any, dq: Array, tau: Array) -> Array:
    """Friction torques (m, n) at the speeds ``dq`` (m, n).

    For laws that depend on the load, the load is ``tau`` less friction, found by iteration.
    """
    if not any(surface.has_load for surface in surfaces_of(model.spec)):
        return np.asarray(model.friction(dq))
    friction = np.zeros_like(tau)
    for _ in range(LOAD_ROUNDS):
        friction = np.asarray(model.friction(dq, tau - friction))
    return friction


def _lag(model: Any, log: Log, design: ResponseDesign, run: ResponseRun) -> int:
    """Number of the sample of ``log`` at which the excitation of ``run`` begins."""
    assert log.tau is not None
    q = np.broadcast_to(np.asarray(run.start), log.q.shape).copy()
    q[:, design.joint] = log.q[:, design.joint]
    u = _inputs(model, q, np.zeros_like(q), log.tau)[:, design.joint]
    # differences suppress low frequencies, at which the response of the loop would hide the excitation
    a, b = np.diff(u - u.mean()), np.diff(run.n)
    size = len(a) + len(b)
    correlation = np.fft.irfft(np.fft.rfft(a, size) * np.fft.rfft(b, size).conj(), size)[: len(a)]
    overlap = np.minimum(len(b), len(a) - np.arange(len(a)))
    usable = overlap >= FEWEST
    if not usable.any():
        raise InputError(f"{run.name}: {len(log.t)} samples are too few for an excitation of {len(run.n)}")
    level = np.where(usable, correlation / np.sqrt(np.maximum(overlap, 1) / len(b)), -np.inf)
    lag = int(np.argmax(level))
    energy = np.linalg.norm(b[: overlap[lag]]) * np.linalg.norm(a[lag : lag + overlap[lag]])
    share = float(correlation[lag] / max(energy, 1e-300))
    if share < LEAST_CORRELATION:
        raise InputError(
            f"{run.name}: its excitation is not in the recording: the correlation of u and n is {share:.2g} at best "
            f"(limit {LEAST_CORRELATION})"
        )
    return lag


# ------------------------------------------------------------------------------------------------------------------
# A recorded motion as the reference of a simulation: positions, smooth speeds and accelerations at any time.
# ------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class RecordedMotion:
    """The reconstructed motion of one uninterrupted recording, from its first sample at t = 0 to ``duration`` (s).

    Between samples the position is the cubic that matches position and speed at both ends, the acceleration is linear.
    ``position`` and ``speed`` are these cubics and their derivative, ``ddq`` (N, n) the accelerations at the samples
    ``t`` (N,).
    """

    duration: float
    t: Array
    ddq: Array
    position: Any
    speed: Any

    @classmethod
    def of(cls, recording: Recording, processing: Processing) -> RecordedMotion:
        """Reconstruct ``recording`` by the method of ``processing``; settings left None are chosen from its bandwidth.

        Raises :class:`InputError` if the recording is interrupted.
        """
        from scipy.interpolate import CubicHermiteSpline

        parts = list(recording.parts())
        if len({part.segment for part in parts}) != 1:
            pieces = len({part.segment for part in parts})
            raise InputError(f"the reference has {pieces} stretches with gaps between them: it must be uninterrupted")
        motion = reconstruct(join_parts(parts), tune(processing, [recording]).processing)
        t = np.asarray(motion.t) - motion.t[0]
        position = CubicHermiteSpline(t, motion.q, motion.dq)
        return cls(float(t[-1]), t, motion.ddq, position, position.derivative())

    def evaluate(self, t: Array) -> tuple[Array, Array, Array]:
        """Position, speed and acceleration (N, n) at the times ``t`` (N,) in s; at rest beyond either end."""
        at = np.clip(t, 0.0, self.duration)
        inside = ((np.asarray(t) >= 0.0) & (np.asarray(t) <= self.duration))[:, None]
        ddq = np.column_stack([np.interp(at, self.t, column) for column in self.ddq.T])
        return np.asarray(self.position(at)), np.asarray(self.speed(at)) * inside, ddq * inside
