"""Figures of frequency responses: Bode diagrams with 95 % confidence bands and coherence."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.data.figure_style import new_figure, style_axes
from rrrgen.lab.response.frequency_response import WIDEST_BAND, FrequencyResponse
from rrrgen.lab.response.resonances import Resonating, modes_over_postures
from rrrgen.lab.response.response_model import Complex, ResponseModel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rrrgen.lab.response.matrix_response import MatrixResponse


CURVE = 2000  # points of a model's curve


def plot_models(measured: Sequence[FrequencyResponse], models: Sequence[ResponseModel]) -> Figure:
    """Plot measured responses and the curves of the models fitted to them."""
    low, high = (pick([pick(response.frequency) for response in measured]) for pick in (min, max))
    frequency = np.geomspace(low, high, CURVE)
    return plot_responses(measured, [("model", frequency, model.response(frequency)) for model in models])


def plot_resonances(models: Sequence[Resonating]) -> Figure:
    """Plot frequencies and damping ratios of the modes over the postures, with bars of two standard deviations.

    Values that are uncertain have an open marker.
    """
    modes = modes_over_postures(models)
    from matplotlib.ticker import FuncFormatter, LogLocator

    figure, axes = new_figure(2, 1, 5.4, max(6.0, 1.6 + 1.1 * len(models)), sharex=True)
    place = {model.name: k for k, model in enumerate(models)}
    style_of_doubt: dict[str, Any] = {"markersize": 3.5, "markerfacecolor": "w", "zorder": 3}
    any_doubt = False
    for number, mode in enumerate(modes):
        at = [place[name] for name in mode.resonances]
        style = {"color": f"C{number % 10}", "marker": "o", "markersize": 3.5, "linewidth": 0.9, "capsize": 3}
        resonances = mode.resonances.values()
        for axis, name, values, stds in (
            (axes[0], "frequency", mode.frequencies, [resonance.frequency_std for resonance in resonances]),
            (axes[1], "damping", mode.dampings, [resonance.damping_std for resonance in resonances]),
        ):
            axis.errorbar(
                at,
                values,
                yerr=[min(2.0 * (std or 0.0), 0.9 * v) for std, v in zip(stds, values, strict=True)],
                **style,
            )
            doubtful = np.array([name in resonance.uncertain for resonance in resonances])
            axis.plot(
                np.array(at)[doubtful],
                values[doubtful],
                "o",
                **(style_of_doubt | {"markeredgecolor": f"C{number % 10}"}),
            )
            any_doubt = any_doubt or bool(doubtful.any())
    for axis, label in ((axes[0], "frequency (Hz)"), (axes[1], "damping ratio")):
        style_axes(axis, "", label)
        axis.set_yscale("log")
        axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 1.5, 2.0, 3.0, 5.0, 7.0)))
        axis.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.minorticks_off()
        axis.margins(x=0.15, y=0.15)
    if any_doubt:
        axes[0].plot([], [], "o", markeredgecolor="0.3", label="hardly known", **style_of_doubt)
        axes[0].legend(frameon=False, fontsize=8)
    axes[1].set_xticks(range(len(models)), [model.name for model in models])
    return figure


def plot_responses(responses: Sequence[FrequencyResponse], models: Sequence[tuple[str, Array, Complex]] = ()) -> Figure:
    """Plot magnitude (dB), phase (deg), confidence radius and coherence of responses over frequency.

    ``models`` are triples (label, frequencies in Hz, response), drawn as dashed curves; each label appears once. The
    bands contain the true response with probability 95 %; their relative radius has a panel of its own, with the limit
    of trust as a dotted line. Lines that are not trusted are drawn in a light colour.
    """
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    figure, (magnitude, phase, radius, coherence) = new_figure(
        4, 1, 8.4, 7.0, sharex=True, gridspec_kw={"height_ratios": [2.2, 1.6, 0.9, 0.7]}
    )
    for number, response in enumerate(responses):
        color = f"C{number % 10}"
        gain, angle = 20.0 * np.log10(np.abs(response.P)), _phase(response.P)
        band = np.minimum(response.band95, 0.999)
        lower, upper = 20.0 * np.log10(1.0 - band), 20.0 * np.log10(1.0 + response.band95)
        lower = np.maximum(lower, -40.0)
        spread = np.degrees(np.arcsin(band))
        magnitude.fill_between(response.frequency, gain + lower, gain + upper, color=color, alpha=0.22, linewidth=0)
        phase.fill_between(response.frequency, angle - spread, angle + spread, color=color, alpha=0.22, linewidth=0)
        percent = 100.0 * response.band95
        for axis, values in ((magnitude, gain), (phase, angle), (radius, percent), (coherence, response.coherence)):
            axis.plot(response.frequency, np.where(response.trusted, values, np.nan), color=color, linewidth=1.1)
            axis.plot(response.frequency, values, color=color, linewidth=0.7, alpha=0.4)
        magnitude.plot([], [], color=color, label=response.name if len(responses) > 1 else "estimate, 95 % band")
    style = {"color": "k", "linewidth": 0.6, "linestyle": "--"}
    for number, (label, frequency, P) in enumerate(models):
        known = label in (other for other, _, _ in models[:number])
        magnitude.plot(frequency, 20.0 * np.log10(np.abs(P)), label=None if known else label, **style)
        phase.plot(frequency, _phase(P), **style)
    if any(not response.trusted.all() for response in responses):
        magnitude.plot([], [], color="0.3", alpha=0.4, linewidth=0.7, label="not trusted")
    magnitude.set_xscale("log")
    coherence.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    style_axes(magnitude, "", "magnitude (dB)")
    style_axes(phase, "", "phase (deg)")
    phase.yaxis.set_major_locator(MaxNLocator(7, steps=[1.0, 1.5, 3.0, 4.5, 9.0, 10.0]))  # 15, 30, 45 or 90 degrees
    style_axes(radius, "", "95 % band (%)")
    style_axes(coherence, "frequency (Hz)", "coherence")
    radius.axhline(100.0 * WIDEST_BAND, color="0.4", linewidth=0.7, linestyle=":")
    radius.set_yscale("log")
    radius.set_ylim(0.5, 60.0)
    radius.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    coherence.set_ylim(0.0, 1.05)
    for axis in (magnitude, phase, radius):
        axis.grid(True, which="minor", axis="x", linewidth=0.25, alpha=0.4)
    magnitude.legend(frameon=False, loc="lower left", fontsize=8)
    return figure


def plot_matrix(responses: Sequence[MatrixResponse]) -> Figure:
    """Plot the magnitudes of all elements of a response, with 95 % bands, a colour for each posture.

    Dotted lines are the resonances. The row is the position, the column the torque.
    """
    n = len(responses[0].joints)
    figure, axes = new_figure(n, n, 2.0 * n + 0.8, max(4.0, 2.3 * n), sharex=True, sharey=True)
    for (i, j), axis in zip(np.ndindex(n, n), axes, strict=True):
        for number, response in enumerate(responses):
            gain, band = 20.0 * np.log10(np.abs(response.G[:, i, j])), response.band95[:, i, j]
            ends = (gain + 20.0 * np.log10(np.maximum(1.0 - band, 1e-2)), gain + 20.0 * np.log10(1.0 + band))
            axis.fill_between(response.frequency, *ends, color=f"C{number % 10}", alpha=0.22, linewidth=0)
            label = response.name if len(responses) > 1 else None
            axis.plot(response.frequency, gain, color=f"C{number % 10}", linewidth=0.9, label=label)
            for mode in response.resonances:
                axis.axvline(mode.frequency, color=f"C{number % 10}", linewidth=0.6, linestyle=":")
        axis.set_xscale("log")
        joints = responses[0].joints
        style_axes(axis, f"torque of {joints[j]}, Hz" if i == n - 1 else "", f"{joints[i]} (dB)" if j == 0 else "")
    if len(responses) > 1:
        axes[0].legend(frameon=False, fontsize=8)
    return figure


def _phase(P: Complex) -> Array:
    """Phase of ``P`` in degrees, unwrapped and shifted by multiples of 360 so that it starts between -360 and 0."""
    angle = np.degrees(np.unwrap(np.angle(P)))
    return np.asarray(angle - 360.0 * np.ceil(angle[0] / 360.0))
