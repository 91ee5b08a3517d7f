"""Input shapers: filters that convolve a reference with a few impulses, timed so that a vibration cancels.

The residual vibration after the impulses ``A_i`` at ``t_i``, relative to that of one impulse of the same sum, is
``V(w, zeta) = exp(-zeta w t_m) |sum_i A_i exp(w t_i (zeta - j sqrt(1 - zeta^2)))|``. ZV (zero vibration, two impulses)
makes it zero at the mode, ZVD also its derivative by w (three), EI (extra-insensitive, three) lets it be V_tol at the
mode and zero at either side, which is the widest range below V_tol that three impulses reach.

Sources: N. Singer, W. Seering, Preshaping command inputs to reduce system vibration, 1990; W. Singhose, W. Seering,
N. Singer, Residual vibration reduction using vector diagrams to generate shaped inputs, 1994.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rrrgen.arrays import Array
from rrrgen.control.vibration.modes import Vibration, below_sampling, pole
from rrrgen.errors import InputError

KINDS = ("zv", "zvd", "ei")
TOLERANCE = 0.05
MOST_DAMPING = 0.4  # beyond, a vibration is gone before a shaper's last impulse
STEPS_IN_DAMPING = 8


@dataclass(frozen=True)
class Shaper:
    """``y_k = sum_i w_i u_{k - delay_i}`` with the weights and whole delays (samples) of its taps, sum 1.

    ``kinds`` names the shaper of every mode, ``period`` is that of the sampling in s.
    """

    kinds: tuple[str, ...]
    delays: tuple[int, ...]
    weights: tuple[float, ...]
    period: float

    @property
    def length(self) -> int:
        """Delay of the last tap in samples, by which the shaped reference ends later than the original."""
        return self.delays[-1]

    def response(self, frequency: Array) -> Any:
        """Complex response at ``frequency`` (L,) in Hz."""
        z = np.exp(-2j * np.pi * np.asarray(frequency) * self.period)
        return np.sum(np.array(self.weights)[:, None] * z ** np.array(self.delays)[:, None], axis=0)

    def residual(self, frequency: float, damping: float) -> float:
        """Residual vibration V of a mode (Hz, ratio), relative to that without shaper."""
        p = pole(frequency, damping, self.period)
        return float(abs(np.sum(np.array(self.weights) * p ** (self.length - np.array(self.delays)))))

    def worst_residual(self, vibration: Vibration) -> float:
        """The largest residual vibration over the postures of a mode."""
        return max(self.residual(f, zeta) for f, zeta in zip(vibration.frequencies, vibration.dampings, strict=True))

    def run(self, u: Array) -> Array:
        """Shape a signal ``u`` (N,); before its first sample it is taken to have its first value. Returns (N,)."""
        before = np.concatenate([np.full(self.length, u[0]), u])
        return sum(
            (w * before[self.length - d : len(before) - d] for d, w in zip(self.delays, self.weights, strict=True)),
            np.zeros(len(u)),
        )


def impulses(kind: str, damping: float, tolerance: float = TOLERANCE) -> tuple[Array, Array]:
    """Instants (m,) in periods of the undamped mode, 1/f, and amplitudes (m,) with the sum 1, of one shaper."""
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

    The unknowns are A_1, A_3, t_2, t_3 and the two frequencies without vibration, relative to that of the mode. The
    equations: no vibration at the two (two equations each), V = V_tol at the mode, and a maximum of V there.
    """
    from scipy.optimize import fsolve

    apart = float(np.arccos(-(1.0 - tolerance) / (1.0 + tolerance))) / np.pi
    x = np.array([0.25 * (1.0 + tolerance), 0.25 * (1.0 + tolerance), 0.5, 1.0, apart, 2.0 - apart])

    def vibration(x: Array, ratio: float, zeta: float) -> complex:
        """``sum A_i exp(s (t_m - t_i))`` of a mode at ``ratio`` times the frequency of the design."""
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
    """The shaper of all ``vibrations``, one after the other, for a sampling ``period`` in s.

    "auto" takes for every mode the shortest kind whose residual stays below ``tolerance`` in all its postures, and EI
    where none does. Impulses between two samples are shared by both so that the mode sees what it would have seen in
    between: a zero of vibration stays one.
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
    """Weights (N,) at whole samples of the impulses of one mode, sum 1.

    An impulse A at the fraction a after a sample becomes ``w_0 + w_1 p^-1 = A p^-a`` at the pole p of the mode.
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
