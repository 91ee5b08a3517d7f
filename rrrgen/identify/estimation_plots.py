"""Figures of reconstruction and estimation."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from rrrgen.arrays import Array
from rrrgen.identify.convergence import Convergence
from rrrgen.identify.estimation.statistics import Whiteness
from rrrgen.identify.estimation.tsqr import Rows
from rrrgen.runs.figures import new_figure, style_axes
from rrrgen.signals.kalman import KalmanMatrices, frequency_response

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PANELS_PER_ROW = 4
MANY_PANELS = 16


def bode_data(matrices: KalmanMatrices, lowest: float = 0.1, highest: float | None = None, points: int = 400) -> Array:
    """Frequency (Hz), magnitude (dB) and phase (degrees) of the filter, and magnitude of the smoother (dB): (points,
    4).
    """
    highest = highest or 0.4 / matrices.period
    f = np.geomspace(lowest, highest, points)
    H = frequency_response(matrices, f)
    S = np.abs(frequency_response(matrices, f, smoother=True))
    smoother = 20.0 * np.log10(np.maximum(S, 1e-12))
    return np.column_stack([f, 20.0 * np.log10(np.abs(H)), np.degrees(np.unwrap(np.angle(H))), smoother])


def plot_bode(matrices: Sequence[KalmanMatrices], joints: Sequence[str], smoother: bool = False) -> Figure:
    """Measured to reconstructed deviation, magnitude and phase, one curve per joint, as Fig. 14.2."""
    figure, axes = new_figure(2, 1, height=4.6, sharex=True)
    for joint, each in zip(joints, matrices, strict=True):
        data = bode_data(each)
        axes[0].semilogx(data[:, 0], data[:, 1], label=joint)
        axes[1].semilogx(data[:, 0], data[:, 2])
        if smoother:
            axes[0].semilogx(data[:, 0], data[:, 3], linestyle=":", color=axes[1].lines[-1].get_color())
    style_axes(axes[0], "", "magnitude [dB]")
    style_axes(axes[1], "f [Hz]", "phase [deg]")
    if smoother:
        axes[0].set_ylim(bottom=-60.0)
    axes[0].legend(loc="lower left", ncols=min(len(joints), 3), title="dotted: smoother" if smoother else None)
    return figure


def plot_convergence(settling: Convergence, std: Array | None = None) -> Figure:
    """Every estimate against the number of samples, as Fig. 14.12; a band of three final standard deviations."""
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
        late = x[len(x) // 20 :]
        late = late[np.isfinite(late)]
        if std is not None:
            axis.axhspan(x[-1] - 3 * std[i], x[-1] + 3 * std[i], color="0.85", zorder=0)
        if len(late) and np.ptp(late) > 0:
            # the first estimates may be anywhere: they are not shown
            low, high = np.quantile(late, [0.01, 0.99])
            axis.set_ylim(low - 0.3 * (high - low) - 1e-12, high + 0.3 * (high - low) + 1e-12)
        name = settling.names[i]
        axis.set_title(name if len(name) <= 28 else name[:25] + "...", fontsize=7)
        style_axes(axis, "samples" if i >= p - columns else "", "")
        axis.tick_params(labelsize=6)
    return figure


def plot_torques(blocks: Iterable[Rows], theta: Array, joints: Sequence[str]) -> Figure:
    """Torque applied and torque of the model, joint by joint, over the rows in use (as Fig. 14.13), with the
    residual.
    """
    kept = list(blocks)
    t = np.concatenate([rows.t for rows in kept])
    tau = np.concatenate([rows.tau for rows in kept])
    model = np.concatenate([rows.W @ theta for rows in kept])
    use = np.concatenate([rows.use for rows in kept])
    n = tau.shape[1]
    figure, axes = new_figure(n, 1, height=1.6 * n + 0.6, sharex=True)
    for j, axis in enumerate(axes):
        hidden = np.where(use[:, j], 1.0, np.nan)
        axis.plot(t, tau[:, j] * hidden, color="0.35", linewidth=1.0, label="measured")
        axis.plot(t, model[:, j] * hidden, color="C0", linewidth=0.8, label="model")
        axis.plot(t, (tau - model)[:, j] * hidden, color="C3", linewidth=0.7, label="residual")
        style_axes(axis, "t [s]" if j == n - 1 else "", f"{joints[j]} [N m]")
    axes[0].legend(loc="upper right", ncols=3, fontsize=7)
    return figure


def plot_whiteness(whiteness: Sequence[Whiteness], joints: Sequence[str]) -> Figure:
    """Autocorrelation of the residuals with the 95 % band of white noise."""
    figure, axes = new_figure(1, 1, height=3.0)
    for white, joint in zip(whiteness, joints, strict=True):
        lags = np.arange(1, len(white.autocorrelation) + 1)
        axes[0].plot(lags, white.autocorrelation, marker=".", linewidth=0.8, label=joint)
    band = 1.96 / math.sqrt(max(1, min((w.samples for w in whiteness), default=1)))
    axes[0].axhspan(-band, band, color="0.88", zorder=0)
    style_axes(axes[0], "lag [samples]", "autocorrelation of the residual")
    axes[0].legend(fontsize=7, ncols=3)
    return figure
