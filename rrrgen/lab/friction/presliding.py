"""Stiffness and damping of the LuGre bristles below break-away, from frequency responses at several amplitudes.

A joint with LuGre friction, linearised at rest, responds to a torque with ``q/tau = 1/(J s^2 + (sigma1 + viscous) s +
sigma0 + c)``, where c is the stiffness of gravity at the posture. Source: (14.16) of Kostic, de Jager, Steinbuch,
Robotics and Automation Handbook, CRC Press 2005, chapter 14. Micro-slip changes the response in proportion to the
amplitude. On average the bristles forget their deflection at a rate a: ``dz/dt = dq/dt - a z``, with which the joint
creeps at low frequencies and is damped more. The rate is fitted at each amplitude, and what it leaves is extrapolated
to zero amplitude. The rate also fluctuates with the speed, which acts like a disturbance of the bristles' deflection:
its share of the response falls with the frequency, and the frequencies are weighted accordingly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError
from rrrgen.lab.friction.joint_recording import encoder_step
from rrrgen.lab.response.estimation import instrumental_response, samples_of
from rrrgen.lab.response.local_polynomial import periodic_lines
from rrrgen.lab.response.response_file import ResponseRecording

LEAST_COUNTS = 12.0  # encoder steps of amplitude below which inertia and damping are unreliable
HIGHEST = 0.4  # times the sampling rate: with a higher resonance only the stiffness is reported
BREAK_AWAY = 0.5  # largest excitation, relative to the break-away torque
FASTEST = 1.5  # times the sampling rate: highest resonance that is tried
RESONANCES = 60  # tried resonances
RATIOS = (0.03, 0.1, 0.3, 1.0, 3.0)  # tried ratios of the damping to the critical one
REFINED = 3  # of the tried ones, the best are refined
ALIKE = 1.5  # largest ratio of the stiffnesses at two amplitudes
SLIP = 0.02  # first guess of the micro-slip rate, relative to the resonance in rad/s
DISTORTION = 0.01  # first guess of the relative distortion by micro-slip at the highest frequency
LATEST = 1.0  # periods by which the delay may differ from that of the recording in sliding
WEIGHTINGS = 4  # fits with weights from the distortion that the fit before left
WIDE = 0.5  # relative standard deviation of the response above which a frequency is left out

Complex = NDArray[np.complexfloating[Any, Any]]


@dataclass(frozen=True, eq=False)
class Level:
    """Estimates from one recording below break-away: ``values`` (3,) of inertia, damping and stiffness, in SI.

    ``std`` (3,) are their standard deviations, ``slip`` is the rate of micro-slip, 1/s. ``torque`` is the RMS torque of
    the excitation, N m (N), ``counts`` the amplitude in encoder steps, ``position`` the mean position, rad (m).
    """

    torque: float
    counts: float
    position: float
    values: Array
    std: Array
    slip: float


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

    def lines(self) -> list[str]:
        """The resonance and the parameters with their deviations as text."""
        lines = [f"presliding, resonance at {self.resonance:.4g} Hz:"]
        for name, pair in (("sigma0", self.sigma0), ("sigma1", self.sigma1), ("inertia", self.inertia)):
            lines.append(f"  {name:<16} " + ("unknown" if pair is None else f"{pair[0]:>12.5g} +- {pair[1]:.2g}"))
        return lines

    def to_json(self) -> dict[str, Any]:
        """Plain data for JSON: values and standard deviations by name, the levels, and the notes."""
        values = {"sigma0": self.sigma0, "sigma1": self.sigma1, "inertia": self.inertia}
        return {
            "parameters": {name: None if pair is None else pair[0] for name, pair in values.items()},
            "std": {name: None if pair is None else pair[1] for name, pair in values.items()},
            "resonance": self.resonance,
            "levels": [
                {
                    "torque_rms": level.torque,
                    "counts": level.counts,
                    "micro_slip_rate": level.slip,
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
    unsorted = (_level(record, resolution, break_away, viscous, gravity, delay) for record in records)
    levels = sorted(unsorted, key=lambda x: x.torque)
    stiffnesses = [float(level.values[2]) for level in levels]
    if max(stiffnesses) > ALIKE * min(stiffnesses):
        raise DerivationError(
            f"the stiffness is {min(stiffnesses):.3g} at one amplitude and {max(stiffnesses):.3g} at another: the "
            "recordings do not determine it; the joint oscillates on its bristles too fast for the sampling rate, or "
            "moves too little"
        )
    values, stds = _extrapolate(levels)
    J, damping, stiffness = values
    position = float(np.mean([level.position for level in levels]))
    around = _gravity_stiffness(gravity, position)
    resonance = float(np.sqrt(stiffness / J) / (2.0 * np.pi))
    notes = []
    determined = min(level.counts for level in levels) >= LEAST_COUNTS
    if not determined:
        notes.append(
            f"the motion has {levels[0].counts:.1f} encoder steps of amplitude: too few for inertia and damping"
        )
    if resonance * records[0].period > HIGHEST:
        determined = False
        notes.append(f"the resonance at {resonance:.0f} Hz is too near to the sampling rate for inertia and damping")
    if len(levels) < 2:
        notes.append("one amplitude: micro-slip can bias the damping by a few percent; record a second amplitude")
    return Presliding(
        sigma0=(float(stiffness - around), float(stds[2])),
        sigma1=(float(damping - viscous), float(stds[1])) if determined else None,
        inertia=(float(J), float(stds[0])) if determined else None,
        resonance=resonance,
        levels=tuple(levels),
        notes=tuple(notes),
    )


def _gravity_stiffness(gravity: tuple[float, float], position: float) -> float:
    return float(gravity[1] * np.cos(position) - gravity[0] * np.sin(position))


def _level(
    record: ResponseRecording,
    resolution: float,
    break_away: float,
    viscous: float,
    gravity: tuple[float, float],
    delay: float,
) -> Level:
    """Fit inertia, damping and stiffness to the frequency response of one recording.

    The other arguments are those of :func:`presliding`. Raises :class:`DerivationError` for an
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
    position = float(np.mean(record.q))
    rest = Rest(lines.frequency[use], record.period, viscous, _gravity_stiffness(gravity, position), delay)
    values, std, slip = _fit_response(rest, P[use], np.maximum(variance[use], 1e-300))
    amplitude = float(np.sqrt(2.0) * np.std(record.q)) / encoder_step(record.q, resolution)
    return Level(float(np.std(torque)), amplitude, position, values, std, slip)


@dataclass(frozen=True, eq=False)
class Rest:
    """What is known about a joint at rest: its response at the ``frequency`` (L,), Hz, sampled every ``period`` s.

    ``viscous`` and ``gravity`` are damping and stiffness beside the bristles, in SI; ``delay`` (s) is that of the
    motion behind the torque. Negative, it means that the recorded torque is a mean over the period before.
    """

    frequency: Array
    period: float
    viscous: float
    gravity: float
    delay: float

    def response(self, J: float, damping: float, stiffness: float, slip: float, late: float) -> Complex:
        """Frequency response (L,) of the position to a torque held over each period, for values in SI.

        ``damping`` and ``stiffness`` are those of the bristles and what is beside them; the bristles forget their
        deflection at the rate ``slip``, 1/s; ``late`` is a further delay in periods. The hold is modelled exactly: a
        continuous model with half a period of delay would bias J by 20 % at a fifth of the sampling rate.
        """
        from scipy.linalg import expm

        s0, s1 = stiffness - self.gravity, damping - self.viscous
        system = np.zeros((4, 4))  # position, speed, deflection; torque
        system[0, 1] = system[2, 1] = 1.0
        system[1] = np.array([-self.gravity, -damping, s1 * slip - s0, 1.0]) / J
        system[2, 2] = -slip
        step = expm(system * self.period)
        M, B = step[:3, :3] - np.eye(3), step[:3, 3]
        w = np.expm1(2j * np.pi * self.frequency * self.period)
        # B'[0] adj(w I - M) / det(w I - M) by the recursion of Leverrier and Faddeev
        first = M @ B - np.trace(M) * B
        square = 0.5 * (np.trace(M) ** 2 - np.trace(M @ M))
        second = M @ first + square * B
        response = ((w * B[0] + first[0]) * w + second[0]) / (((w - np.trace(M)) * w + square) * w - np.linalg.det(M))
        back = np.exp(-2j * np.pi * self.frequency * self.period)
        share = min(max(-self.delay / self.period, 0.0), 1.0)  # of the torque before in the recorded one
        late += max(self.delay / self.period, 0.0)
        return np.asarray(response * back**late / (1.0 - share + share * back))


def _fit_response(rest: Rest, P: Complex, variance: Array) -> tuple[Array, Array, float]:
    """Inertia, damping and stiffness (3,) of the response P (L,), their standard deviations (3,), micro-slip rate.

    ``variance`` (L,) is that of P by noise. That of a relative distortion which falls with the frequency is added; its
    size is estimated from what the fit leaves, and the fit is repeated.
    """
    from scipy.optimize import least_squares

    f = rest.frequency
    low, high = np.log([2.0 * np.pi * f[0] / 3.0, 2.0 * np.pi * FASTEST / rest.period])
    limits = ([low, np.log(1e-4), -np.inf, 0.0, -LATEST], [high, np.log(1e3), np.inf, 1.0, LATEST])
    distortion = (DISTORTION * f[-1]) ** 2

    def weight(distortion: float) -> Array:
        return np.asarray(1.0 / np.sqrt(variance + distortion * np.abs(P) ** 2 / f**2))

    def residual(x: Array, weight: Array) -> Array:
        e = (rest.response(*_physical(x)) - P) * weight
        return np.concatenate([e.real, e.imag])

    def search(start: Array, weight: Array) -> Any:
        return least_squares(residual, start, x_scale="jac", bounds=limits, args=(weight,))

    first = weight(distortion)
    starts = _starts(rest, P, first, low, high)
    solution = min((search(start, first) for start in starts), key=lambda trial: float(trial.cost))
    for _ in range(WEIGHTINGS):
        model = rest.response(*_physical(solution.x))
        left = (np.abs(model - P) ** 2 - variance) * f**2 / np.abs(P) ** 2
        distortion = max(float(np.median(left)) / np.log(2.0), 0.0)  # ln 2: median of an exponential distribution
        solution = search(solution.x, weight(distortion))
    scale = max(1.0, 2.0 * float(solution.cost) / max(len(solution.fun) - 5, 1))
    logs = np.array([[-2.0, 0.0, 1.0], [-1.0, 1.0, 1.0], [0.0, 0.0, 1.0]])  # of the values by those of the search
    covariance = logs @ np.linalg.pinv(solution.jac.T @ solution.jac)[:3, :3] @ logs.T * scale
    *values, slip, _ = _physical(solution.x)
    return np.array(values), np.array(values) * np.sqrt(np.diag(covariance)), slip


def _physical(x: Array) -> tuple[float, float, float, float, float]:
    """Inertia, damping, stiffness, micro-slip rate and further delay.

    ``x`` (5,) are the logarithms of resonance, damping ratio and stiffness, the rate over the resonance, the delay.
    """
    omega, ratio, stiffness = np.exp(x[:3]).tolist()
    return stiffness / omega**2, 2.0 * ratio * stiffness / omega, stiffness, float(x[3]) * omega, float(x[4])


def _starts(rest: Rest, P: Complex, weight: Array, low: float, high: float) -> list[Array]:
    """The best start values of a grid of resonances, of logarithms ``low`` to ``high``, and damping ratios.

    Each has the best stiffness: from a single guess the search can end at a resonance far above the sampling rate.
    """
    tried = []
    free = Rest(rest.frequency, rest.period, 0.0, 0.0, rest.delay)  # its response is proportional to the compliance
    for omega, ratio in product(np.linspace(low, high, RESONANCES)[:-1], np.log(RATIOS)):
        unit = free.response(*_physical(np.array([omega, ratio, 0.0, SLIP, 0.0]))) * weight
        gain = float(np.real(np.vdot(unit, P * weight)) / np.real(np.vdot(unit, unit)))
        if gain > 0.0:
            error = float(np.sum(np.abs(gain * unit - P * weight) ** 2))
            tried.append((error, np.array([omega, ratio, -np.log(gain), SLIP, 0.0])))
    return [start for _, start in sorted(tried, key=lambda trial: trial[0])[:REFINED]]


def _extrapolate(levels: Sequence[Level]) -> tuple[Array, Array]:
    """Inertia, damping and stiffness (3,) at zero amplitude, by straight lines, and standard deviations (3,).

    A single level is taken as it is.
    """
    if len(levels) < 2:
        return levels[0].values, levels[0].std
    values, std = np.array([level.values for level in levels]), np.array([level.std for level in levels])
    weight = 1.0 / np.maximum(std, 1e-12 * np.abs(values)) ** 2
    A = np.stack([np.ones(len(levels)), [level.torque for level in levels]], axis=1)
    intercepts, spread = np.empty(3), np.empty(3)
    for column in range(3):
        H = np.linalg.inv(A.T @ (weight[:, column, None] * A))
        intercepts[column] = (H @ (A.T @ (weight[:, column] * values[:, column])))[0]
        spread[column] = np.sqrt(H[0, 0])
    return intercepts, spread
