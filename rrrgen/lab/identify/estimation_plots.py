"""Figures of the reconstruction filters, the convergence of the estimates and the whiteness of the residuals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.data.figure_style import new_figure, style_axes
from rrrgen.lab.data.kalman import KalmanMatrices, frequency_response
from rrrgen.lab.estimate.statistics import Whiteness
from rrrgen.lab.identify.convergence import Convergence

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PANELS_PER_ROW = 4
MANY_PANELS = 16
STYLES: tuple[Any, ...] = ("-", (0, (5, 2)), (0, (2, 1.5)), (0, (6, 2, 1, 2)))


def bode_data(matrices: KalmanMatrices, lowest: float = 0.1, highest: float | None = None, points: int = 400) -> Array:
    """Bode data (points, 4): frequency (Hz), magnitude (dB) and phase (deg) of the filter, magnitude of the smoother.

    ``lowest`` and ``highest`` bound the frequencies, Hz; the latter is 0.4 of the sampling rate by default.
    """
    highest = highest or 0.4 / matrices.period
    f = np.geomspace(lowest, highest, points)
    H = frequency_response(matrices, f)
    S = np.abs(frequency_response(matrices, f, smoother=True))
    smoother = 20.0 * np.log10(np.maximum(S, 1e-12))
    return np.column_stack([f, 20.0 * np.log10(np.abs(H)), np.degrees(np.unwrap(np.angle(H))), smoother])


def plot_bode(matrices: Sequence[KalmanMatrices], joints: Sequence[str], smoother: bool = False) -> Figure:
    """Bode plot from measured to reconstructed deviation, one curve per joint, as Fig. 14.2.

    With ``smoother``, the magnitude of the smoother is added as dotted lines; its phase is zero.
    """
    figure, axes = new_figure(2, 1, height=4.6, sharex=True)
    for k, (joint, each) in enumerate(zip(joints, matrices, strict=True)):
        data = bode_data(each)
        # curves of equally tuned joints coincide: later ones are drawn thinner and dashed, so that all stay visible
        style = {"linewidth": max(1.0, 3.2 - 1.1 * k), "linestyle": STYLES[k % len(STYLES)], "color": f"C{k}"}
        axes[0].semilogx(data[:, 0], data[:, 1], label=joint, **style)
        axes[1].semilogx(data[:, 0], data[:, 2], **style)
        if smoother:
            axes[0].semilogx(data[:, 0], data[:, 3], linestyle=":", color=f"C{k}")
    style_axes(axes[0], "", "magnitude [dB]")
    style_axes(axes[1], "f [Hz]", "phase [deg]")
    if smoother:
        axes[0].set_ylim(bottom=-60.0)
    axes[0].legend(loc="lower left", ncols=min(len(joints), 3), title="dotted: smoother" if smoother else None)
    return figure


def plot_convergence(
    settling: Convergence, std: Array | None = None, units: Sequence[str] = (), truth: Array | None = None
) -> Figure:
    """Plot the estimates over the number of fitted samples, one panel per parameter, as in Fig. 14.12.

    ``std`` (p,) adds a band of three standard deviations about the final value, ``truth`` (p,) dashed lines;
    ``units`` (p,) are those of the parameters.
    """
    p = len(settling.names)
    columns = min(PANELS_PER_ROW, p)
    rows = math.ceil(p / columns)
    many = p > MANY_PANELS  # the automatic layout takes seconds for so many
    layout = "none" if many else "constrained"
    figure, axes = new_figure(rows, columns, height=1.5 * rows + 0.5, width=2.6 * columns, layout=layout, sharex=True)
    if many:
        figure.subplots_adjust(0.06, 0.06, 0.98, 0.97, wspace=0.35, hspace=0.6)
    for i, axis in enumerate(axes):
        if i >= p:
            axis.set_visible(False)
            continue
        x = settling.x[:, i]
        axis.plot(settling.samples, x, linewidth=0.9)
        late = x[len(x) // 5 :]
        late = late[np.isfinite(late)]
        if std is not None:
            axis.axhspan(x[-1] - 3 * std[i], x[-1] + 3 * std[i], color="0.85", zorder=0)
        if len(late) and np.ptp(late) > 0:
            # the range is that of the later estimates: the first ones may be off by orders of magnitude
            low, high = np.quantile(late, [0.01, 0.99])
            axis.set_ylim(low - 0.3 * (high - low) - 1e-12, high + 0.3 * (high - low) + 1e-12)
        if truth is not None:
            axis.axhline(truth[i], color="C3", linestyle="--", linewidth=0.8, label="true value")
            low, high = axis.get_ylim()
            room = 0.05 * (high - low)
            axis.set_ylim(min(low, truth[i] - room), max(high, truth[i] + room))
        name = settling.names[i]
        unit = f" [{units[i].replace('^2', '²')}]" if units else ""
        axis.set_title((name if len(name) <= 28 else name[:25] + "...") + unit, fontsize=8)
        style_axes(axis, "samples" if i >= p - columns else "", "")
        axis.set_xlim(0, settling.samples[-1])
        axis.locator_params(axis="y", nbins=4)
        axis.tick_params(labelsize=8, labelbottom=i >= p - columns)
        axis.xaxis.label.set_fontsize(8)
    if truth is not None:
        axes[0].legend(loc="best", fontsize=8)
    return figure


def plot_whiteness(whiteness: Sequence[Whiteness], joints: Sequence[str]) -> Figure:
    """Plot the autocorrelation of the residuals of every joint over the lag, with the 95 % band of white noise."""
    figure, axes = new_figure(1, 1, height=3.0)
    for white, joint in zip(whiteness, joints, strict=True):
        lags = np.arange(1, len(white.autocorrelation) + 1)
        axes[0].plot(lags, white.autocorrelation, marker=".", linewidth=0.8, label=joint)
    band = 1.96 / math.sqrt(max(1, min((w.samples for w in whiteness), default=1)))
    axes[0].axhspan(-band, band, color="0.88", zorder=0)
    style_axes(axes[0], "lag [samples]", "autocorrelation of the residual")
    axes[0].legend(fontsize=8, ncols=3)
    return figure
