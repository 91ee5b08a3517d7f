"""Figures of frequency responses: Bode diagram with 95 % bands, coherence below."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from rrrgen.arrays import Array
from rrrgen.response.controller import Complex
from rrrgen.response.frequency_response import FrequencyResponse
from rrrgen.runs.figures import new_figure, style_axes

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_responses(found: Sequence[FrequencyResponse], models: Sequence[tuple[str, Array, Complex]] = ()) -> Figure:
    """Magnitude (dB), phase (deg) and coherence over frequency; ``models`` (label, Hz, response) as dashed lines.

    Bands hold the true response with 95 %; lines that are not trusted are drawn light.
    """
    figure, (magnitude, phase, coherence) = new_figure(
        3, 1, 7.2, 7.0, sharex=True, gridspec_kw={"height_ratios": [2.2, 1.6, 0.8]}
    )
    for number, each in enumerate(found):
        color = f"C{number % 10}"
        gain, angle = 20.0 * np.log10(np.abs(each.P)), _phase(each.P)
        band = np.minimum(each.band95, 0.999)
        lower, upper = 20.0 * np.log10(1.0 - band), 20.0 * np.log10(1.0 + each.band95)
        lower = np.maximum(lower, -40.0)
        spread = np.degrees(np.arcsin(band))
        magnitude.fill_between(each.frequency, gain + lower, gain + upper, color=color, alpha=0.22, linewidth=0)
        phase.fill_between(each.frequency, angle - spread, angle + spread, color=color, alpha=0.22, linewidth=0)
        for axis, values in ((magnitude, gain), (phase, angle), (coherence, each.coherence)):
            axis.plot(each.frequency, np.where(each.trusted, values, np.nan), color=color, linewidth=1.1)
            axis.plot(each.frequency, values, color=color, linewidth=0.7, alpha=0.4)
        magnitude.plot([], [], color=color, label=each.name if len(found) > 1 else "estimate, 95 % band")
    for number, (label, frequency, P) in enumerate(models):
        style = {"color": "k" if len(models) == 1 else f"C{number + 3}", "linewidth": 0.9, "linestyle": "--"}
        magnitude.plot(frequency, 20.0 * np.log10(np.abs(P)), label=label, **style)
        phase.plot(frequency, _phase(P), **style)
    if any(not each.trusted.all() for each in found):
        magnitude.plot([], [], color="0.3", alpha=0.4, linewidth=0.7, label="not trusted")
    magnitude.set_xscale("log")
    style_axes(magnitude, "", "magnitude (dB)")
    style_axes(phase, "", "phase (deg)")
    style_axes(coherence, "frequency (Hz)", "coherence")
    coherence.set_ylim(0.0, 1.05)
    for axis in (magnitude, phase):
        axis.grid(True, which="minor", axis="x", linewidth=0.25, alpha=0.4)
    magnitude.legend(frameon=False, loc="lower left", fontsize=8)
    return figure


def _phase(P: Complex) -> Array:
    """In degrees, unwrapped, and moved by whole turns so that it starts between -360 and 0."""
    angle = np.degrees(np.unwrap(np.angle(P)))
    return np.asarray(angle - 360.0 * np.ceil(angle[0] / 360.0))
