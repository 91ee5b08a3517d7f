"""Figure of input shapers and notch filters: the residual of the vibrations for which they were designed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.data.figure_style import new_figure, style_axes
from rrrgen.lab.vibration.modes import Vibration, grid_around, pole
from rrrgen.lab.vibration.notches import Notch
from rrrgen.lab.vibration.shapers import Shaper

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
        total = np.prod([each.response(f) for each in notches], axis=0)
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
        for each in vibrations:
            low, high = min(each.frequencies), max(each.frequencies)
            axis.axvspan(low * 0.998, high * 1.002, color="0.8", zorder=0)
    return figure


def _residual(axis: Any, vibrations: Sequence[Vibration], shaper: Shaper) -> None:
    f = grid_around(vibrations, shaper.period)
    middle = vibrations[0].damping
    axis.plot(f, [100.0 * shaper.residual(float(x), middle) for x in f], color="C0", label=f"damping {middle:.3g}")
    for number, each in enumerate(vibrations[1:], start=1):
        values = [100.0 * shaper.residual(float(x), each.damping) for x in f]
        axis.plot(f, values, color=f"C{number}", linewidth=0.9, label=f"damping {each.damping:.3g}")
    for each in vibrations:
        for frequency, damping in zip(each.frequencies, each.dampings, strict=True):
            axis.plot(frequency, 100.0 * shaper.residual(frequency, damping), "k.", markersize=5)
    axis.set_ylim(0.0, 105.0)
    style_axes(axis, "frequency (Hz)", "vibration left (%)")
    axis.legend(frameon=False, fontsize=8, ncols=len(vibrations), loc="upper left")


def _step(axis: Any, vibrations: Sequence[Vibration], shaper: Shaper) -> None:
    """Plot the slowest vibration, in its first posture, after a step of the reference with and without the shaper."""
    slowest = min(vibrations, key=lambda each: each.frequency)
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
