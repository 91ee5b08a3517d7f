"""Figure of a designed frequency response experiment: the excitation over time and its spectrum."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rrrgen.lab.data.figure_style import new_figure, style_axes
from rrrgen.lab.design.plan import ResponseDesign

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_response_excitation(design: ResponseDesign, unit: str = "rad/s²") -> Figure:
    """Plot the excitation of the first run, in ``unit``, over one period (noise: over all of it), and its spectrum."""
    run = design.runs[0]
    n = run.n[: design.signal_period]
    amplitude = 2.0 * np.abs(np.fft.rfft(n)) / len(n)
    frequency = np.fft.rfftfreq(len(n), design.period)
    excited = amplitude > 1e-3 * np.max(amplitude)
    figure, axes = new_figure(2, 1, height=4.4)
    axes[0].plot(design.period * np.arange(len(n)), n, linewidth=0.6)
    axes[0].set_title(
        f"{design.joint_name}: {design.signal.replace('_', ' ')}, rms {n.std():.3g}, crest factor "
        f"{np.abs(n).max() / n.std():.2f}, speed {abs(run.speed):.4g}",
        fontsize=9,
        loc="left",
    )
    style_axes(axes[0], "t [s]", f"n [{unit}]")
    axes[1].semilogx(frequency[excited], amplitude[excited], ".", markersize=2.5)
    axes[1].set_ylim(0.0, 1.2 * float(np.max(amplitude)))
    style_axes(axes[1], "frequency [Hz]", f"amplitude of n [{unit}]")
    return figure
