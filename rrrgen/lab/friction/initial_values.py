"""Initial parameter values by least squares on samples at which the joint slides: ``tau = J ddq + gravity + tau_f``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.friction.candidate_laws import DELAY, GRAVITY, Candidate
from rrrgen.lab.friction.joint_recording import JointData
from rrrgen.lab.friction.joint_simulation import Torque

DELAYS = np.arange(-1.5, 6.1, 0.5)  # sampling periods that are tried
SPEEDS = np.geomspace(0.03, 1.0, 25)  # Stribeck speeds that are tried, relative to the rms speed
STEEPNESS = np.array([0.7, 2.0, 6.0, 15.0, 40.0, 100.0, 300.0])  # tried slopes of the neurons, times the rms speed
MOST_SAMPLES = 20_000
LEAST_INERTIA = 1e-9  # kg m^2 (kg), replaces a negative estimate
RIDGE = 1e-3  # relative to a column's norm: keeps nearly dependent columns from large opposite coefficients


@dataclass(frozen=True, eq=False)
class SlidingSamples:
    """Samples at which the joint slides: position, speed, acceleration, torque and time (s) of each, (n,)."""

    q: Array
    dq: Array
    ddq: Array
    tau: Array
    t: Array

    def rigid_columns(self, gravity: int) -> list[Array]:
        """Regressor columns (n,) of the inertia and of the ``gravity`` (0 to 3) gravity coefficients."""
        one = np.ones_like(self.q)
        return [self.ddq, one] if gravity == 1 else [self.ddq, *[np.cos(self.q), np.sin(self.q), one][:gravity]]


def sliding_samples(data: JointData, delay: float) -> SlidingSamples:
    """Select the samples at which the joint slides, after filtering torque and motion with the same low-pass.

    The motion lags the torque by ``delay`` sampling periods. Torques are held from one sample to the next; that of a
    sample is the mean of the values held before and after it.
    """
    torque = np.empty_like(data.u)
    for first, last in data.stretches:
        stretch = Torque(data.smoothed[first:last], np.arange(last - first))
        torque[first:last] = stretch.centred_torque(np.array([[delay]]))[0]
    chosen = np.flatnonzero(data.sliding)
    chosen = chosen[:: max(1, len(chosen) // MOST_SAMPLES)]
    q, dq, ddq = (part[chosen] for part in data.motion)
    return SlidingSamples(q, dq, ddq, torque[chosen], chosen * data.period)


def best_delay(data: JointData, gravity: int) -> float:
    """Delay of the motion behind the torque, in sampling periods, with the smallest least-squares torque error."""
    errors = []
    for delay in DELAYS:
        samples = sliding_samples(data, float(delay))
        s = np.sign(samples.dq)
        extra = [s, samples.dq, s * np.exp(-np.abs(samples.dq) / (0.2 * data.speed))]
        errors.append(_solve([*samples.rigid_columns(gravity), *extra], samples.tau)[1])
    return float(DELAYS[int(np.argmin(errors))])


def start_values(candidate: Candidate, data: JointData, delay: float) -> tuple[Array, float]:
    """Least-squares estimate of the parameters (k,) of ``candidate``, and the relative torque error in sliding.

    ``delay`` of the motion behind the torque is in sampling periods.
    """
    samples = sliding_samples(data, delay)
    rigid = samples.rigid_columns(candidate.gravity)
    values, error = _law_start(candidate.name, samples, rigid, data.speed)
    inertia = values["inertia"] = max(values["inertia"], LEAST_INERTIA)
    if candidate.name == "lugre":
        level = abs(values["coulomb"]) + abs(values["stiction_excess"])
        values["sigma0"] = level / max(5.0 * data.resolution, 1e-4 * data.speed)
        values["sigma1"] = float(np.sqrt(values["sigma0"] * inertia))
    values[DELAY] = delay
    theta = np.array([values[name] for name in candidate.names])
    return candidate.clip(theta), error / float(np.linalg.norm(samples.tau))


def growth_rate(data: JointData, gravity: int, delay: float) -> Array:
    """Rate (N,), 1/s, at which an error of the state grows in sliding: ``-(d tau_f / d dq) / J``, 0 where it decays.

    Friction and inertia are those of the Stribeck law by least squares, ``gravity`` is the number of gravity
    coefficients, and the motion lags the torque by ``delay`` sampling periods.
    """
    samples = sliding_samples(data, delay)
    known, _ = _law_start("stribeck", samples, samples.rigid_columns(gravity), data.speed)
    ratio = np.abs(data.motion[1]) / known["stribeck_speed"]
    falls = 2.0 * known["stiction_excess"] / known["stribeck_speed"] * ratio * np.exp(-(ratio**2)) - known["viscous"]
    return np.asarray(np.maximum(falls, 0.0) / max(known["inertia"], LEAST_INERTIA))


def _law_start(
    law: str, samples: SlidingSamples, rigid: Sequence[Array], scale: float
) -> tuple[dict[str, float], float]:
    """Least-squares parameters (name -> value) of the friction ``law`` and the norm of the torque error.

    Parameters in which the law is nonlinear are tried on a grid. ``rigid`` are the columns of inertia and gravity,
    ``scale`` is the RMS speed, rad/s (m/s).
    """
    s, v = np.sign(samples.dq), samples.dq
    names = ["inertia", *GRAVITY][: len(rigid)]
    if law == "coulomb_viscous":
        return _fit([*names, "coulomb", "viscous"], [*rigid, s, v], samples.tau)
    if law == "asymmetric":
        up, down = (s > 0).astype(float), (s < 0).astype(float)
        columns = [*rigid, v * up, v * down, up, -down]
        return _fit([*names, "viscous_p", "viscous_n", "coulomb_p", "coulomb_n"], columns, samples.tau)
    if law == "neural":
        fits = [
            (_fit([*names, "f1", "f2", "f3", "viscous"], [*rigid, *(np.tanh(w * v) for w in ws), v], samples.tau), ws)
            for ws in combinations(STEEPNESS / scale, 3)
        ]
        (values, error), ws = min(fits, key=lambda fit: fit[0][1])
        return values | {f"w{k + 1}": float(w) for k, w in enumerate(ws)}, error
    tried = []
    for speed in SPEEDS * scale:
        columns = [*rigid, s * np.exp(-((v / speed) ** 2)), s, v]
        values, error = _fit([*names, "stiction_excess", "coulomb", "viscous"], columns, samples.tau)
        tried.append((values | {"stribeck_speed": float(speed)}, error))
    return min(tried, key=lambda trial: trial[1])


def _fit(names: Sequence[str], columns: Sequence[Array], tau: Array) -> tuple[dict[str, float], float]:
    values, error = _solve(columns, tau)
    return dict(zip(names, values.tolist(), strict=True)), error


def _solve(columns: Sequence[Array], tau: Array) -> tuple[Array, float]:
    """Ridge regression ``tau = columns x``, computed on columns scaled to norm 1.

    Returns x for the given columns, and the norm of the residual.
    """
    A = np.stack(columns, axis=1)
    scale = np.linalg.norm(A, axis=0)
    A = A / np.where(scale > 0.0, scale, 1.0)
    H = A.T @ A + RIDGE**2 * np.eye(A.shape[1])
    x = np.linalg.solve(H, A.T @ tau)
    return x / np.where(scale > 0.0, scale, 1.0), float(np.linalg.norm(tau - A @ x))
