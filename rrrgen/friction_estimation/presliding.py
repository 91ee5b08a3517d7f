"""Stiffness and damping of the LuGre bristles below break-away, from frequency responses at several amplitudes.

A joint with LuGre friction, linearised at rest, responds to a torque with ``q/tau = 1/(J s^2 + (sigma1 + viscous) s +
sigma0 + c)``, where c is the stiffness of gravity at the posture. Micro-slip adds damping in proportion to the
amplitude; the results are extrapolated to zero amplitude. Source: (14.16) of Kostic, de Jager, Steinbuch, Robotics and
Automation Handbook, CRC Press 2005, chapter 14.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.arrays import Array
from rrrgen.errors import DerivationError
from rrrgen.friction_estimation.joint_data import encoder_step
from rrrgen.response.estimators.estimate import instrumental_response
from rrrgen.response.estimators.excitation_period import samples_of
from rrrgen.response.estimators.local_polynomial import periodic_lines
from rrrgen.response.response_file import ResponseRecording

LEAST_COUNTS = 12.0  # encoder steps of amplitude below which inertia and damping are unreliable
HIGHEST = 0.4  # times the sampling rate: with a higher resonance only the stiffness is reported
BREAK_AWAY = 0.5  # largest excitation, relative to the break-away torque
FASTEST = 1.5  # times the sampling rate: highest resonance that is tried
RESONANCES = 60  # tried resonances
RATIOS = (0.03, 0.1, 0.3, 1.0, 3.0)  # tried ratios of the damping to the critical one
REFINED = 3  # of the tried ones, the best are refined
ALIKE = 1.5  # largest ratio of the stiffnesses at two amplitudes
WIDE = 0.5  # relative standard deviation of the response above which a frequency is left out

Complex = NDArray[np.complexfloating[Any, Any]]


@dataclass(frozen=True, eq=False)
class Level:
    """Estimates from one recording below break-away: ``values`` (3,) of inertia, damping and stiffness, in SI.

    ``std`` (3,) are their standard deviations. ``torque`` is the RMS excitation torque, N m (N), ``counts`` the
    amplitude of the motion in encoder steps, ``position`` the mean position, rad (m).
    """

    torque: float
    counts: float
    position: float
    values: Array
    std: Array


@dataclass(frozen=True, eq=False)
class Presliding:
    """Bristle parameters of the LuGre law measured at rest, each as (value, standard deviation) in SI.

    ``sigma0`` is the stiffness, ``sigma1`` the damping of the bristles; ``sigma1`` and ``inertia`` are None if the
    recordings do not determine them. ``resonance`` is the frequency in Hz, ``levels`` are the estimates at each
    amplitude of the excitation, ``notes`` warnings to the user.
    """

    sigma0: tuple[float, float]
    sigma1: tuple[float, float] | None
    inertia: tuple[float, float] | None
    resonance: float
    levels: tuple[Level, ...]
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Plain data for JSON: values and standard deviations by name, the levels, and the notes."""
        told = {"sigma0": self.sigma0, "sigma1": self.sigma1, "inertia": self.inertia}
        return {
            "parameters": {name: None if pair is None else pair[0] for name, pair in told.items()},
            "std": {name: None if pair is None else pair[1] for name, pair in told.items()},
            "resonance": self.resonance,
            "levels": [
                {
                    "torque_rms": level.torque,
                    "counts": level.counts,
                    **dict(zip(("inertia", "damping", "stiffness"), level.values.tolist(), strict=True)),
                }
                for level in self.levels
            ],
            "notes": list(self.notes),
        }


def presliding(
    records: Sequence[ResponseRecording],
    resolution: float,
    break_away: float,
    viscous: float,
    gravity: tuple[float, float],
    delay: float,
) -> Presliding:
    """Estimate stiffness and damping of the bristles from recordings below break-away at different amplitudes.

    ``resolution`` is that of the encoder, rad (m), used if the recorded positions do not lie on a grid. The other
    arguments come from an estimate with sliding motion: the ``break_away`` torque (N m or N), the ``viscous``
    coefficient, the ``gravity`` coefficients of cos q and sin q, and the ``delay`` (s) of the motion behind the torque.
    Raises :class:`DerivationError` if the excitation comes near break-away or is not periodic, or if the stiffnesses at
    two amplitudes contradict each other.
    """
    levels = sorted((_level(each, resolution, break_away, delay) for each in records), key=lambda x: x.torque)
    found = [float(level.values[2]) for level in levels]
    if max(found) > ALIKE * min(found):
        raise DerivationError(
            f"the stiffness is {min(found):.3g} at one amplitude and {max(found):.3g} at another: the recordings do "
            "not tell it; the joint oscillates on its bristles too fast for the sampling rate, or moves too little"
        )
    values, stds = _extrapolated(levels)
    J, damping, stiffness = values
    position = float(np.mean([level.position for level in levels]))
    around = gravity[1] * np.cos(position) - gravity[0] * np.sin(position)
    resonance = float(np.sqrt(stiffness / J) / (2.0 * np.pi))
    notes = []
    told = min(level.counts for level in levels) >= LEAST_COUNTS
    if not told:
        notes.append(
            f"the motion has {levels[0].counts:.1f} encoder steps of amplitude: too few for inertia and damping"
        )
    if resonance * records[0].period > HIGHEST:
        told = False
        notes.append(f"the resonance at {resonance:.0f} Hz is too near to the sampling rate for inertia and damping")
    if len(levels) < 2:
        notes.append("one amplitude: micro-slip adds 10 to 20 % to the damping; record a second amplitude")
    return Presliding(
        sigma0=(float(stiffness - around), float(stds[2])),
        sigma1=(float(damping - viscous), float(stds[1])) if told else None,
        inertia=(float(J), float(stds[0])) if told else None,
        resonance=resonance,
        levels=tuple(levels),
        notes=tuple(notes),
    )


def _level(record: ResponseRecording, resolution: float, break_away: float, delay: float) -> Level:
    """Fit inertia, damping and stiffness to the frequency response of one recording.

    Frequencies are weighted by the inverse standard deviation of the response. Raises :class:`DerivationError` for an
    excitation that comes near the torque ``break_away``, is not periodic, or is hidden by noise.
    """
    torque = record.u - np.mean(record.u)
    if float(np.max(np.abs(torque))) > BREAK_AWAY * break_away:
        raise DerivationError(
            f"{record.name}: the torque varies by {np.max(np.abs(torque)):.3g}, more than half of the break-away level "
            f"of {break_away:.3g}: presliding is measured below it"
        )
    samples = samples_of(record, None)
    if samples is None:
        raise DerivationError(
            f"{record.name}: the torque does not repeat; presliding needs a periodic multisine, ten periods of 2 s"
        )
    lines = periodic_lines(record, samples)
    P, variance = instrumental_response(lines)
    use = np.sqrt(variance) < WIDE * np.abs(P)
    if np.count_nonzero(use) < 6:
        raise DerivationError(f"{record.name}: noise hides the response at all but {np.count_nonzero(use)} lines")
    f, P, weight = lines.frequency[use], P[use], 1.0 / np.sqrt(np.maximum(variance[use], 1e-300))
    values, std = _fitted(f, P, weight, record.period, delay)
    amplitude = float(np.sqrt(2.0) * np.std(record.q)) / encoder_step(record.q, resolution)
    return Level(float(np.std(torque)), amplitude, float(np.mean(record.q)), values, std)


def _fitted(f: Array, P: Complex, weight: Array, period: float, delay: float) -> tuple[Array, Array]:
    """Inertia, damping and stiffness (3,) of a response P (L,) at the frequencies f (L,), and standard deviations (3,).

    ``weight`` (L,) are inverse standard deviations of P. Resonance and damping ratio are tried on a grid, with the best
    stiffness of each: from a single guess the search can end at a resonance far above the sampling rate.
    """
    from scipy.optimize import least_squares

    low, high = np.log([2.0 * np.pi * f[0] / 3.0, 2.0 * np.pi * FASTEST / period])

    def physical(x: Array) -> Array:
        omega, ratio, stiffness = np.exp(x)
        return np.array([stiffness / omega**2, 2.0 * ratio * stiffness / omega, stiffness])

    def shape(x: Array) -> Complex:
        inertia, damping, stiffness = physical(x).tolist()
        return np.asarray(zero_order_hold(f, period, inertia, damping, stiffness, delay) * weight)

    def residual(x: Array) -> Array:
        e = shape(x) - P * weight
        return np.concatenate([e.real, e.imag])

    tried = []
    for omega, ratio in product(np.linspace(low, high, RESONANCES)[:-1], np.log(RATIOS)):
        unit = shape(np.array([omega, ratio, 0.0]))
        gain = float(np.real(np.vdot(unit, P * weight)) / np.real(np.vdot(unit, unit)))
        if gain > 0.0:
            start = np.array([omega, ratio, -np.log(gain)])
            tried.append((float(np.sum(residual(start) ** 2)), start))
    limits = ([low, np.log(1e-4), -np.inf], [high, np.log(1e3), np.inf])
    best = sorted(tried, key=lambda each: each[0])[:REFINED]
    results = [least_squares(residual, start, x_scale="jac", bounds=limits) for _, start in best]
    found = min(results, key=lambda each: float(each.cost))
    scale = max(1.0, 2.0 * float(found.cost) / max(len(found.fun) - 3, 1))
    logs = np.array([[-2.0, 0.0, 1.0], [-1.0, 1.0, 1.0], [0.0, 0.0, 1.0]])  # of the values by those of the search
    covariance = logs @ np.linalg.pinv(found.jac.T @ found.jac) @ logs.T * scale
    values = physical(found.x)
    return values, values * np.sqrt(np.diag(covariance))


def zero_order_hold(f: Array, period: float, J: float, damping: float, stiffness: float, delay: float) -> Complex:
    """Frequency response (L,) of ``1/(J s^2 + damping s + stiffness)`` to a torque held over each ``period`` (s).

    ``f`` (L,) are frequencies in Hz, ``delay`` is in s. The hold is modelled exactly: a continuous model with half a
    period of delay would bias J by 20 % at a fifth of the sampling rate.
    """
    from scipy.linalg import expm

    system = np.zeros((3, 3))
    system[0, 1], system[1] = 1.0, [-stiffness / J, -damping / J, 1.0 / J]
    step = expm(system * period)
    A, B = step[:2, :2], step[:2, 2]
    z = np.exp(2j * np.pi * f * period)
    (a, b), (c, d) = A
    determinant = (z - a) * (z - d) - b * c
    response = ((z - d) * B[0] + b * B[1]) / determinant
    return np.asarray(response * np.exp(-2j * np.pi * f * delay))


def _extrapolated(levels: Sequence[Level]) -> tuple[Array, Array]:
    """Combine the estimates at all amplitudes: inertia, damping and stiffness (3,) and standard deviations (3,).

    The inertia is a weighted mean; damping and stiffness are extrapolated to zero amplitude by a straight line.
    """
    values, std = np.array([level.values for level in levels]), np.array([level.std for level in levels])
    weight = 1.0 / np.maximum(std, 1e-12 * np.abs(values)) ** 2
    J = float(np.sum(weight[:, 0] * values[:, 0]) / np.sum(weight[:, 0]))
    found, spread = [J], [float(1.0 / np.sqrt(np.sum(weight[:, 0])))]
    amplitudes = np.array([level.torque for level in levels])
    for column in (1, 2):
        if len(levels) < 2:
            found.append(float(values[0, column]))
            spread.append(float(std[0, column]))
            continue
        A = np.stack([np.ones(len(levels)), amplitudes], axis=1)
        H = np.linalg.inv(A.T @ (weight[:, column, None] * A))
        found.append(float((H @ (A.T @ (weight[:, column] * values[:, column])))[0]))
        spread.append(float(np.sqrt(H[0, 0])))
    return np.array(found), np.array(spread)
