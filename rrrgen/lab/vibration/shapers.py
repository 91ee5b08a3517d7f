"""Input shapers: filters that convolve a reference with a few impulses, timed so that a vibration cancels.

The residual vibration after the impulses ``A_i`` at ``t_i``, relative to that of one impulse of the same sum, is
``V(w, zeta) = exp(-zeta w t_m) |sum_i A_i exp(w t_i (zeta - j sqrt(1 - zeta^2)))|``. ZV (zero vibration, two impulses)
makes V zero at the mode's frequency w. ZVD (three impulses) also makes the derivative of V by w zero. EI (extra-
insensitive, three impulses) has V = V_tol at the mode and V = 0 at one frequency on either side, which gives the widest
range of frequencies with V below V_tol that three impulses allow.

Sources: N. Singer, W. Seering, Preshaping command inputs to reduce system vibration, 1990; W. Singhose, W. Seering,
N. Singer, Residual vibration reduction using vector diagrams to generate shaped inputs, 1994.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.lab.vibration.modes import Vibration, below_sampling, pole

KINDS = ("zv", "zvd", "ei")
TOLERANCE = 0.05
MOST_DAMPING = 0.4  # damping ratio: above it a vibration decays before a shaper's last impulse
STEPS_IN_DAMPING = 8


@dataclass(frozen=True)
class Shaper:
    """An input shaper as a FIR filter: ``y_k = sum_i weights_i u_{k - delays_i}``, for one or several modes in series.

    ``delays`` (in samples) and ``weights`` (sum 1) are those of its taps. ``kinds`` names the type of shaper of each
    mode ("zv", "zvd", "ei"); ``period`` is the sampling period in s.
    """

    kinds: tuple[str, ...]
    delays: tuple[int, ...]
    weights: tuple[float, ...]
    period: float

    @property
    def length(self) -> int:
        """Delay of the last tap in samples; the shaped reference ends this much later than the original."""
        return self.delays[-1]

    def response(self, frequency: Array) -> Any:
        """Complex frequency response (L,) at ``frequency`` (L,) in Hz."""
        z = np.exp(-2j * np.pi * np.asarray(frequency) * self.period)
        return np.sum(np.array(self.weights)[:, None] * z ** np.array(self.delays)[:, None], axis=0)

    def residual(self, frequency: float, damping: float) -> float:
        """Residual vibration V of a mode of ``frequency`` (Hz) and ``damping`` ratio, over that without a shaper."""
        p = pole(frequency, damping, self.period)
        return float(abs(np.sum(np.array(self.weights) * p ** (self.length - np.array(self.delays)))))

    def worst_residual(self, vibration: Vibration) -> float:
        """Largest residual vibration V of a mode over its postures, divided by that without shaper."""
        return max(self.residual(f, zeta) for f, zeta in zip(vibration.frequencies, vibration.dampings, strict=True))

    def run(self, u: Array) -> Array:
        """Shape a signal ``u`` (N,) and return the result (N,); before its start, u is taken as constant."""
        before = np.concatenate([np.full(self.length, u[0]), u])
        return sum(
            (w * before[self.length - d : len(before) - d] for d, w in zip(self.delays, self.weights, strict=True)),
            np.zeros(len(u)),
        )


def impulses(kind: str, damping: float, tolerance: float = TOLERANCE) -> tuple[Array, Array]:
    """Instants and amplitudes, (m,) each, of the impulses of the shaper ``kind`` for a mode with a ``damping`` ratio.

    Instants are multiples of 1/f, with the undamped frequency f of the mode; amplitudes have the sum 1. ``tolerance``
    is V_tol of the kind "ei".
    """
    if kind not in KINDS:
        raise InputError(f"'{kind}' is no shaper; allowed are {', '.join(KINDS)}")
    if not 0.0 <= damping <= MOST_DAMPING or not 0.0 < tolerance < 0.5:
        raise InputError(f"shapers take dampings from 0 to {MOST_DAMPING} and tolerances between 0 and 0.5")
    half = 0.5 / np.sqrt(1.0 - damping**2)
    K = float(np.exp(-np.pi * damping / np.sqrt(1.0 - damping**2)))
    if kind == "zv":
        return np.array([0.0, half]), np.array([1.0, K]) / (1.0 + K)
    if kind == "zvd":
        return np.array([0.0, half, 2.0 * half]), np.array([1.0, 2.0 * K, K * K]) / (1.0 + K) ** 2
    return _extra_insensitive(damping, tolerance)


def _extra_insensitive(damping: float, tolerance: float) -> tuple[Array, Array]:
    """Extra-insensitive (EI) shaper: the exact solution without damping, continued to the given ``damping`` (ratio).

    The six unknowns are A_1, A_3, t_2, t_3 and the two frequencies with V = 0, as multiples of the mode's. The six
    equations: V = 0 at these two frequencies (real and imaginary part), V = V_tol and dV/dw = 0 at the mode.
    Returns instants and amplitudes, (3,) each.
    """
    from scipy.optimize import fsolve

    apart = float(np.arccos(-(1.0 - tolerance) / (1.0 + tolerance))) / np.pi
    x = np.array([0.25 * (1.0 + tolerance), 0.25 * (1.0 + tolerance), 0.5, 1.0, apart, 2.0 - apart])

    def vibration(x: Array, ratio: float, zeta: float) -> complex:
        """Complex residual vibration ``sum_i A_i exp(s (t_m - t_i))`` at ``ratio`` times the design frequency.

        ``x`` holds the six unknowns in their order above, ``zeta`` is the damping ratio.
        """
        s = 2.0 * np.pi * ratio * (-zeta + 1j * np.sqrt(1.0 - zeta**2))
        A = np.array([x[0], 1.0 - x[0] - x[1], x[1]])
        return complex(np.sum(A * np.exp(s * (x[3] - np.array([0.0, x[2], x[3]])))))

    def equations(x: Array, zeta: float) -> list[float]:
        low, high = vibration(x, x[4], zeta), vibration(x, x[5], zeta)
        step = 1e-4
        slope = (abs(vibration(x, 1.0 + step, zeta)) - abs(vibration(x, 1.0 - step, zeta))) / (2.0 * step)
        return [low.real, low.imag, high.real, high.imag, abs(vibration(x, 1.0, zeta)) - tolerance, slope]

    for zeta in np.linspace(0.0, damping, STEPS_IN_DAMPING):
        found, _, done, message = fsolve(equations, x, args=(float(zeta),), full_output=True, xtol=1e-12)
        if done != 1 and max(abs(each) for each in equations(found, float(zeta))) > 1e-9:
            raise InputError(f"no EI shaper for a damping of {damping:g} and a tolerance of {tolerance:g}: {message}")
        x = found
    return np.array([0.0, x[2], x[3]]), np.array([x[0], 1.0 - x[0] - x[1], x[1]])


def design_shaper(
    vibrations: Sequence[Vibration], period: float, kind: str = "auto", tolerance: float = TOLERANCE
) -> Shaper:
    """Design input shapers for all ``vibrations`` and combine them in series, for a sampling ``period`` in s.

    ``kind`` "auto" takes for each mode ZV, the shortest, if its residual vibration is below ``tolerance`` in all
    postures, otherwise EI. An impulse between two samples is replaced by one at each of them, with weights that
    excite the mode alike, so that a zero of the residual vibration stays zero.
    """
    below_sampling(vibrations, period)
    if not vibrations:
        raise InputError("a shaper needs a vibration")
    kinds, total = [], np.ones(1)
    for each in vibrations:
        chosen = _shortest(each, period, tolerance) if kind == "auto" else kind
        kinds.append(chosen)
        total = np.convolve(total, _sampled(chosen, each, period, tolerance))
    delays = np.flatnonzero(np.abs(total) > 1e-12)
    return Shaper(tuple(kinds), tuple(delays.tolist()), tuple(total[delays].tolist()), period)


def _shortest(vibration: Vibration, period: float, tolerance: float) -> str:
    for kind in ("zv", "ei"):
        weights = _sampled(kind, vibration, period, tolerance)
        delays = tuple(range(len(weights)))
        if Shaper((kind,), delays, tuple(weights.tolist()), period).worst_residual(vibration) <= 1.01 * tolerance:
            return kind
    return "ei"


def _sampled(kind: str, vibration: Vibration, period: float, tolerance: float) -> Array:
    """Weights (N,) of the taps, one per sample, of the shaper ``kind`` for one mode; their sum is 1.

    An impulse A at the fraction a of a period after a sample is replaced by w_0 at this sample and w_1 at the next,
    with ``w_0 + w_1 p^-1 = A p^-a`` at the discrete-time pole p of the mode.
    """
    times, amplitudes = impulses(kind, vibration.damping, tolerance)
    inverse = 1.0 / pole(vibration.frequency, vibration.damping, period)
    samples = times / (vibration.frequency * period)
    weights = np.zeros(int(samples[-1] + 1e-9) + 2)
    for place, A in zip(samples, amplitudes, strict=True):
        before = int(place + 1e-9)
        wanted = A * inverse ** (place - before)
        later = wanted.imag / inverse.imag
        weights[before] += wanted.real - later * inverse.real
        weights[before + 1] += later
    return np.trim_zeros(np.where(np.abs(weights) < 1e-12, 0.0, weights), "b") / np.sum(weights)
