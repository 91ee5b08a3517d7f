"""Input shapers and notch filters for the controller, designed from the measured resonances of a robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.emit.controller.state_space import StateSpace, realize
from rrrgen.lab.data.figure_style import new_figure, style_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure


# ------------------------------------------------------------------------------------------------------------------
# Vibration modes: frequency and damping ratio, and how they vary between postures.
# ------------------------------------------------------------------------------------------------------------------

LEAST_DAMPING = 1e-4  # below it a measured damping cannot be distinguished from none


@dataclass(frozen=True)
class Vibration:
    """One vibration mode measured in several postures of the robot.

    ``frequencies`` (k,) in Hz and ``dampings`` (k,), damping ratios, hold one value per posture. Filters are designed
    for ``frequency``, the middle of the range of frequencies, and ``damping``, the geometric mean of the ratios.
    """

    frequencies: tuple[float, ...]
    dampings: tuple[float, ...]

    def __post_init__(self) -> None:
        if not self.frequencies or len(self.frequencies) != len(self.dampings):
            raise InputError("a vibration needs as many dampings as frequencies")
        if min(self.frequencies) <= 0.0 or not all(-1.0 < zeta < 1.0 for zeta in self.dampings):
            raise InputError("a vibration needs positive frequencies (Hz) and damping ratios below 1")

    @property
    def frequency(self) -> float:
        """Frequency for which filters are designed, Hz: ``(min + max)/2`` over the postures."""
        return 0.5 * (min(self.frequencies) + max(self.frequencies))

    @property
    def damping(self) -> float:
        """Damping ratio for which filters are designed: geometric mean over the postures, each at least 1e-4."""
        return float(np.exp(np.mean(np.log(np.maximum(self.dampings, LEAST_DAMPING)))))


def pole(frequency: float, damping: float, period: float) -> complex:
    """Discrete-time pole of a mode: ``exp(s T)`` with ``s = w (-zeta + j sqrt(1 - zeta^2))``.

    ``w = 2 pi frequency`` (Hz), zeta is the ``damping`` ratio, T the sampling ``period`` in s.
    """
    omega = 2.0 * np.pi * frequency
    return complex(np.exp(omega * period * (-damping + 1j * np.sqrt(1.0 - damping**2))))


def below_sampling(vibrations: Sequence[Vibration], period: float) -> None:
    """Raise :class:`InputError` if a vibration has a frequency of half the sampling rate 1/``period`` (s) or more."""
    for vibration in vibrations:
        if max(vibration.frequencies) >= 0.5 / period:
            raise InputError(
                f"a vibration of {max(vibration.frequencies):.4g} Hz lies above half the sampling rate of "
                f"{1.0 / period:.6g} Hz: no sampled filter acts on it"
            )


def grid_around(vibrations: Sequence[Vibration], period: float, points: int = 800) -> Array:
    """Frequencies (points,) in Hz for figures, spaced logarithmically.

    They range from a third of the lowest frequency of the vibrations to twice the highest, at most 0.49/``period`` (s).
    """
    low = min(min(vibration.frequencies) for vibration in vibrations) / 3.0
    high = min(2.0 * max(max(vibration.frequencies) for vibration in vibrations), 0.49 / period)
    return np.asarray(np.geomspace(low, high, points))


# ------------------------------------------------------------------------------------------------------------------
# Notch filters: cancel the lightly damped poles of vibration modes and replace them by well damped ones.
#
# ``H(z) = g prod_i (1 - 2 r_i cos(w_i) z^-1 + r_i^2 z^-2)/(1 - 2 R_i cos(W_i) z^-1 + R_i^2 z^-2)`` with H(1) = 1,
# whose zeros r_i e^(+-j w_i) are the sampled poles of mode i, so that they cancel exactly in a posture whose mode has
# the frequency and damping of the design. The poles R_i e^(+-j W_i) have the same frequency and the damping ratio
# ``width``.
# ------------------------------------------------------------------------------------------------------------------

LEAST_WIDTH = 0.1  # damping ratio of the poles: a narrower filter would ring itself
WIDEST = 1.0
PEAK = 3.0  # largest amplification by a mode that may remain after the filter, about 10 dB
FINENESS = 200


@dataclass(frozen=True)
class Notch:
    """Second-order notch filter with the sampling ``period`` (s).

    ``numerator`` ``g [1, c_1, c_2]`` and ``denominator`` ``[1, d_1, d_2]`` are in ascending powers of z^-1. ``width``
    is the damping ratio of the filter's poles. ``peak`` is the amplification by the vibration mode that remains after
    the filter, ``|H| / (2 zeta)`` at the mode's frequency, in the worst posture.
    """

    numerator: tuple[float, float, float]
    denominator: tuple[float, float, float]
    width: float
    peak: float
    period: float

    def response(self, frequency: Array) -> Any:
        """Complex frequency response H (L,) at ``frequency`` (L,) in Hz."""
        z = np.exp(-2j * np.pi * np.asarray(frequency) * self.period)
        powers = np.polynomial.polynomial.polyval
        return powers(z, self.numerator) / powers(z, self.denominator)

    def state_space(self) -> StateSpace:
        """The filter in the modal state-space form, which keeps its precision in single-precision C."""
        return realize(np.array(self.numerator), np.array(self.denominator))


def design_notches(
    vibrations: Sequence[Vibration], period: float, peak: float = PEAK, width: float | None = None
) -> list[Notch]:
    """Design one notch filter for each of the ``vibrations``, for the sampling ``period`` in s.

    ``width`` is the damping ratio of the filters' poles. If it is None, each filter gets the smallest width, from
    twice the damping ratio of the mode on, with which the amplification that remains, ``|H| / (2 zeta)``, is at most
    ``peak`` in every posture, or 1 if no width achieves that: a narrow notch costs least phase below its frequency.
    Raises :class:`InputError` for a vibration above half the sampling rate or a width outside (0, 1].
    """
    below_sampling(vibrations, period)
    if width is not None and not 0.0 < width <= WIDEST:
        raise InputError(f"the width of a notch is the damping ratio of its poles, above 0 and at most {WIDEST:g}")
    if width is not None:
        return [_notch(vibration, period, width) for vibration in vibrations]
    return [_narrowest(vibration, period, peak) for vibration in vibrations]


def _narrowest(vibration: Vibration, period: float, peak: float) -> Notch:
    widths = np.geomspace(min(max(LEAST_WIDTH, 2.0 * vibration.damping), WIDEST), WIDEST, FINENESS)
    trials = (_notch(vibration, period, float(width)) for width in widths)
    return next((notch for notch in trials if notch.peak <= peak), _notch(vibration, period, WIDEST))


def _notch(vibration: Vibration, period: float, width: float) -> Notch:
    zeros = _factor(pole(vibration.frequency, vibration.damping, period))
    poles = _factor(pole(vibration.frequency, min(width, 1.0 - 1e-12), period))
    gain = sum(poles) / sum(zeros)
    numerator = (gain, gain * zeros[1], gain * zeros[2])
    notch = Notch(numerator, poles, width, 0.0, period)
    left = np.abs(notch.response(np.array(vibration.frequencies)))
    peak = float(np.max(left / (2.0 * np.maximum(vibration.dampings, 1e-4))))
    return replace(notch, peak=peak)


def _factor(root: complex) -> tuple[float, float, float]:
    return 1.0, -2.0 * root.real, abs(root) ** 2


def phase_lag(notches: Sequence[Notch], frequency: float) -> float:
    """Phase lag in degrees of all notches in series at ``frequency`` in Hz, such as the crossover of a control loop.

    The lags of single notches, each below 180 degrees, add up to more where there are several. Raises
    :class:`InputError` for a frequency of half the sampling rate or more.
    """
    if any(frequency >= 0.5 / notch.period for notch in notches):
        raise InputError(
            f"a crossover of {frequency:.4g} Hz is not below half the sampling rate of {1.0 / notches[0].period:.6g} "
            "Hz: a sampled filter has no phase there"
        )
    return -sum(float(np.degrees(np.angle(notch.response(np.array([frequency]))[0]))) for notch in notches)


# ------------------------------------------------------------------------------------------------------------------
# Input shapers: filters that convolve a reference with a few impulses, timed so that a vibration cancels.
#
# The residual vibration after the impulses ``A_i`` at ``t_i``, relative to that of one impulse of the same sum, is
# ``V(w, zeta) = exp(-zeta w t_m) |sum_i A_i exp(w t_i (zeta - j sqrt(1 - zeta^2)))|``. ZV (zero vibration, two
# impulses) makes V zero at the mode's frequency w. ZVD (three impulses) also makes the derivative of V by w zero. EI
# (extra- insensitive, three impulses) has V = V_tol at the mode and V = 0 at one frequency on either side, which
# gives the widest range of frequencies with V below V_tol that three impulses allow.
#
# Sources: N. Singer, W. Seering, Preshaping command inputs to reduce system vibration, 1990; W. Singhose, W. Seering,
# N. Singer, Residual vibration reduction using vector diagrams to generate shaped inputs, 1994.
# ------------------------------------------------------------------------------------------------------------------

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
    """Times and amplitudes, (m,) each, of the impulses of the shaper ``kind`` for a mode with a ``damping`` ratio.

    Times are multiples of 1/f, with the undamped frequency f of the mode; amplitudes have the sum 1. ``tolerance``
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
    Returns times and amplitudes, (3,) each.
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
        solution, _, done, message = fsolve(equations, x, args=(float(zeta),), full_output=True, xtol=1e-12)
        if done != 1 and max(abs(residual) for residual in equations(solution, float(zeta))) > 1e-9:
            raise InputError(f"no EI shaper for a damping of {damping:g} and a tolerance of {tolerance:g}: {message}")
        x = solution
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
    for vibration in vibrations:
        chosen = _shortest(vibration, period, tolerance) if kind == "auto" else kind
        kinds.append(chosen)
        total = np.convolve(total, _tap_weights(chosen, vibration, period, tolerance))
    delays = np.flatnonzero(np.abs(total) > 1e-12)
    return Shaper(tuple(kinds), tuple(delays.tolist()), tuple(total[delays].tolist()), period)


def _shortest(vibration: Vibration, period: float, tolerance: float) -> str:
    for kind in ("zv", "ei"):
        weights = _tap_weights(kind, vibration, period, tolerance)
        delays = tuple(range(len(weights)))
        if Shaper((kind,), delays, tuple(weights.tolist()), period).worst_residual(vibration) <= 1.01 * tolerance:
            return kind
    return "ei"


def _tap_weights(kind: str, vibration: Vibration, period: float, tolerance: float) -> Array:
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


# ------------------------------------------------------------------------------------------------------------------
# Figure of input shapers and notch filters: the residual of the vibrations for which they were designed.
# ------------------------------------------------------------------------------------------------------------------

PERIODS_SHOWN = 6.0  # of the slowest vibration


def plot_vibration(
    vibrations: Sequence[Vibration], shaper: Shaper | None, notches: Sequence[Notch], period: float
) -> Figure:
    """Plot residual vibration over frequency, vibration after a step of the reference, and the notches' Bode diagram.

    The grey areas are the ranges of the vibrations' frequencies over the postures.
    """
    from matplotlib.ticker import FuncFormatter

    rows = 2 * (shaper is not None) + 2 * bool(notches)
    figure, axes = new_figure(rows, 1, 2.2 * rows + 0.6)
    over_frequency = []
    if shaper is not None:
        _residual(axes[0], vibrations, shaper)
        _step(axes[1], vibrations, shaper)
        over_frequency.append(axes[0])
    if notches:
        magnitude, phase = axes[-2:]
        f = grid_around(vibrations, period)
        total = np.prod([notch.response(f) for notch in notches], axis=0)
        magnitude.plot(f, 20.0 * np.log10(np.abs(total)), color="C0", label="notch filters")
        phase.plot(f, np.degrees(np.unwrap(np.angle(total))), color="C0")
        style_axes(magnitude, "", "notch (dB)")
        style_axes(phase, "frequency (Hz)", "phase (deg)")
        over_frequency += [magnitude, phase]
    for axis in over_frequency:
        axis.set_xscale("log")
        axis.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.xaxis.set_minor_formatter(FuncFormatter(lambda value, _: f"{value:g}" if f"{value:g}"[0] in "235" else ""))
        axis.grid(True, which="minor", axis="x", linewidth=0.25, alpha=0.4)
        for vibration in vibrations:
            low, high = min(vibration.frequencies), max(vibration.frequencies)
            axis.axvspan(low * 0.998, high * 1.002, color="0.8", zorder=0)
    return figure


def _residual(axis: Any, vibrations: Sequence[Vibration], shaper: Shaper) -> None:
    f = grid_around(vibrations, shaper.period)
    middle = vibrations[0].damping
    axis.plot(f, [100.0 * shaper.residual(float(x), middle) for x in f], color="C0", label=f"damping {middle:.3g}")
    for number, vibration in enumerate(vibrations[1:], start=1):
        values = [100.0 * shaper.residual(float(x), vibration.damping) for x in f]
        axis.plot(f, values, color=f"C{number}", linewidth=0.9, label=f"damping {vibration.damping:.3g}")
    for vibration in vibrations:
        for frequency, damping in zip(vibration.frequencies, vibration.dampings, strict=True):
            axis.plot(frequency, 100.0 * shaper.residual(frequency, damping), "k.", markersize=5)
    axis.set_ylim(0.0, 105.0)
    style_axes(axis, "frequency (Hz)", "vibration left (%)")
    axis.legend(frameon=False, fontsize=8, ncols=len(vibrations), loc="upper left")


def _step(axis: Any, vibrations: Sequence[Vibration], shaper: Shaper) -> None:
    """Plot the slowest vibration, in its first posture, after a step of the reference with and without the shaper."""
    slowest = min(vibrations, key=lambda vibration: vibration.frequency)
    f, damping = slowest.frequencies[0], slowest.dampings[0]
    count = int(PERIODS_SHOWN / f / shaper.period) + shaper.length
    u = np.ones(count)
    u[0] = 0.0
    t = 1e3 * shaper.period * np.arange(count)
    for label, signal, style in (
        ("step", u, {"color": "0.6", "linewidth": 0.9}),
        ("shaped step", shaper.run(u), {"color": "C0", "linewidth": 1.2}),
    ):
        axis.plot(t, _swing(signal, f, damping, shaper.period), label=label, **style)
    style_axes(axis, "time (ms)", f"mode of {f:.3g} Hz")
    axis.legend(frameon=False, fontsize=8, ncols=2, loc="upper right")


def _swing(u: Array, frequency: float, damping: float, period: float) -> Array:
    """Response (N,) of a vibration mode of static gain 1 to the input ``u`` (N,), sampled with ``period`` (s)."""
    from scipy.signal import lfilter

    p = pole(frequency, damping, period)
    denominator = np.array([1.0, -2.0 * p.real, abs(p) ** 2])
    return np.asarray(lfilter([denominator.sum()], denominator, u))
