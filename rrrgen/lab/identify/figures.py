"""Figures of measured and modelled torques over time with their residuals, and of friction over speed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.lab.data.figure_style import new_figure, style_axes
from rrrgen.lab.data.kalman import KalmanMatrices, frequency_response
from rrrgen.lab.estimate.statistics import Whiteness
from rrrgen.lab.estimate.tsqr import Rows
from rrrgen.lab.identify.bandwidth import Spectra
from rrrgen.lab.identify.cross_validation import Convergence
from rrrgen.lab.identify.diagnosis.trial_fits import Sample
from rrrgen.lab.identify.friction_columns import FrictionSurface, law_columns
from rrrgen.lab.identify.scores import BAND, TorqueBand
from rrrgen.robot.friction.laws import LOAD
from rrrgen.runtime.regressor_columns import drive_columns

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rrrgen.lab.identify.parameters import Column


# ------------------------------------------------------------------------------------------------------------------
# Figures of the reconstruction filters, the convergence of the estimates and the whiteness of the residuals.
# ------------------------------------------------------------------------------------------------------------------

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


def plot_spectra(spectra: Spectra, joints: Sequence[str]) -> Figure:
    """Power density of the speed of every joint with its noise floor; a dotted line marks the bandwidth.

    ``spectra`` (n,) are those of the joints that move, None for the others, ``joints`` (n,) their names.
    """
    moving = [(joint, spectrum) for joint, spectrum in zip(joints, spectra, strict=True) if spectrum is not None]
    columns = min(3, len(moving))
    rows = -(-len(moving) // columns)
    figure, axes = new_figure(rows, columns, height=0.4 + 2.4 * rows)
    for axis in axes[len(moving) :]:
        axis.set_visible(False)
    for axis, (joint, spectrum) in zip(axes, moving, strict=False):
        inside = (spectrum.f > 0.0) & (spectrum.power > 0.0)
        axis.loglog(spectrum.f[inside], spectrum.power[inside], color="0.6", linewidth=0.8, label="speed")
        axis.loglog(spectrum.f[inside], spectrum.floor[inside], color="C0", linewidth=1.4, label="noise floor")
        axis.axvline(spectrum.bandwidth, color="C1", linestyle=":", label=f"{spectrum.bandwidth:.3g} Hz")
        axis.legend(loc="lower left", fontsize=8)
        style_axes(axis, "frequency [Hz]", f"{joint}: power density")
    return figure


def plot_bode(matrices: Sequence[KalmanMatrices], joints: Sequence[str], smoother: bool = False) -> Figure:
    """Bode plot from measured to reconstructed deviation, one curve per joint, as Fig. 14.2.

    With ``smoother``, the magnitude of the smoother is added as dotted lines; its phase is zero.
    """
    figure, axes = new_figure(2, 1, height=4.6, sharex=True)
    for k, (joint, joint_matrices) in enumerate(zip(joints, matrices, strict=True)):
        data = bode_data(joint_matrices)
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


# ------------------------------------------------------------------------------------------------------------------
# Figures of measured and modelled torques over time with their residuals, and of friction over speed
# ------------------------------------------------------------------------------------------------------------------

MOST_POINTS = 20_000
"""Largest number of samples in a figure; of longer recordings only every k-th row is drawn and kept in memory."""


@dataclass(frozen=True)
class TorqueCurves:
    """Measured and modelled torques (N, n), N m (N), at the times ``t`` (N,), s; ``use`` (N, n): samples used.

    ``spread`` (N, n) is the standard deviation of the measured torque about the model, ``parameter_spread`` (N, n) the
    part of it that the parameters cause; None if unknown.
    """

    t: Array
    measured: Array
    model: Array
    use: NDArray[np.bool_]
    spread: Array | None = None
    parameter_spread: Array | None = None

    def halve(self) -> TorqueCurves:
        """A copy with every second sample only, to bound the number of points."""
        return TorqueCurves(*(None if part is None else part[::2] for part in self.parts))  # type: ignore[arg-type]

    @property
    def parts(self) -> tuple[Any, ...]:
        """The arrays of all fields, in the order of the fields."""
        return (self.t, self.measured, self.model, self.use, self.spread, self.parameter_spread)


def torque_curves(
    blocks: Iterable[Rows], theta: Array, most: int = MOST_POINTS, band: TorqueBand | None = None
) -> TorqueCurves | None:
    """Measured torques of a stream of rows, and those modelled with ``theta`` (p,); None if no row is in use.

    At most ``most`` samples are kept; ``band`` adds the uncertainty of the model.
    """
    kept: TorqueCurves | None = None
    step, seen = 1, 0
    for rows in blocks:
        chosen = np.arange(-seen % step, len(rows.t), step)
        seen += len(rows.t)
        W = rows.W[chosen]
        spread = (None, None) if band is None else (band.factor / BAND * band.total(W), band.parameters(W))
        new = TorqueCurves(rows.t[chosen], rows.tau[chosen], W @ theta, rows.use[chosen], *spread)
        kept = new if kept is None else _join_curves(kept, new)
        while len(kept.t) > most:
            kept, step = kept.halve(), 2 * step
    return kept if kept is not None and kept.use.any() else None


def _join_curves(a: TorqueCurves, b: TorqueCurves) -> TorqueCurves:
    pairs = zip(a.parts, b.parts, strict=True)
    return TorqueCurves(*(None if x is None else np.concatenate([x, y]) for x, y in pairs))  # type: ignore[arg-type]


def force_units(spec: Any) -> list[str]:
    """Unit of the torque of every joint: ``N m`` if revolute, ``N`` if prismatic."""
    return ["N m" if joint.is_revolute else "N" for joint in spec.joints]


def plot_torque_curves(
    curves: TorqueCurves, joints: Sequence[str], units: Sequence[str], titles: Sequence[str] = ()
) -> Figure:
    """Plot two panels per joint: measured and modelled torque, and below them the residual on its own scale.

    For rows that are not in use (at rest, or in the other part of the data), the model is drawn thin and grey, without
    a residual. Where the uncertainty is known, the residual has the 95 % band of the prediction behind it, and in it
    the darker part that the parameters cause.
    """
    n = len(joints)
    ratios = [2.2, 1.0] * n
    figure, axes = new_figure(2 * n, 1, height=2.4 * n + 0.6, width=8.0, sharex=True, height_ratios=ratios)
    for i, joint in enumerate(joints):
        torque, residual = axes[2 * i], axes[2 * i + 1]
        used = np.where(curves.use[:, i], 1.0, np.nan)
        torque.plot(curves.t, curves.measured[:, i], color="0.72", linewidth=2.2, label="measured")
        torque.plot(curves.t, curves.model[:, i], color="0.45", linewidth=0.5)
        torque.plot(curves.t, curves.model[:, i] * used, color="C0", linewidth=1.0, label="model")
        for part, shade, name in (
            (curves.spread, "0.9", "95 % band"),
            (curves.parameter_spread, "0.7", "of it from parameters"),
        ):
            if part is not None:
                half = BAND * part[:, i] * used
                residual.fill_between(curves.t, -half, half, color=shade, linewidth=0.0, label=name)
        residual.plot(curves.t, (curves.measured - curves.model)[:, i] * used, color="C3", linewidth=0.7)
        residual.axhline(0.0, color="0.3", linewidth=0.5)
        style_axes(torque, "", f"{joint} [{units[i]}]")
        style_axes(residual, "", f"residual\n[{units[i]}]")
        residual.yaxis.label.set_fontsize(8)
        torque.set_title(titles[i] if titles else "", fontsize=9, loc="left")
    handles = [*axes[0].get_legend_handles_labels()[0], *axes[1].get_legend_handles_labels()[0]]
    axes[0].legend(handles=handles, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, fontsize=8)
    axes[-1].set_xlabel("t [s]")
    figure.align_ylabels(axes)
    return figure


def plot_friction(
    sample: Sample,
    W: Array,
    columns: Sequence[Column],
    theta: Array,
    joints: Sequence[str],
    revolute: Sequence[bool],
    surfaces: Sequence[FrictionSurface] = (),
) -> Figure:
    """Plot friction over speed for every joint: measured torque minus the rest of the model, and the identified law.

    ``W`` (N, n, p) is the regressor at the times of ``sample``, ``columns`` and ``theta`` (p,) are its columns and
    their parameters; ``revolute`` (n,) gives the joint types, ``surfaces`` the friction laws. Points off the line show
    what the law does not describe, such as a rise near standstill or another slope at high speed.
    """
    n = len(joints)
    across = min(3, n)
    down = -(-n // across)
    figure, axes = new_figure(down, across, height=2.5 * down + 0.4, width=2.9 * across + 0.6)
    rest = sample.tau - W @ theta
    for i, axis in enumerate(axes):
        if i >= n:
            axis.set_visible(False)
            continue
        indices = [k for k, column in enumerate(columns) if column.kind in ("viscous", "coulomb", "offset", "law")]
        indices = [k for k in indices if not columns[k].name.startswith(LOAD)]  # the line is that without load
        indices = [
            k for k in indices if sum(w != 0.0 for w in columns[k].direction) == 1 and columns[k].direction[i] != 0.0
        ]
        speed, use = sample.dq[:, i], sample.use[:, i]
        cloud = rest[:, i] + W[:, i, indices] @ theta[indices]
        axis.plot(speed[use], cloud[use], ".", markersize=2.0, color="0.6", label="measured less the rest of the model")
        low, high = min(0.0, float(np.min(speed))), max(0.0, float(np.max(speed)))
        for a, b in ((low, -1e-6), (1e-6, high)):
            v = np.zeros((50, n))
            v[:, i] = np.linspace(a, b, 50)
            law = _friction_at(v, indices, columns, theta, surfaces)[:, i]
            axis.plot(v[:, i], law, color="C0", linewidth=1.4, label="identified law" if a < 0.0 else None)
        unit, speeds = ("N m", "rad/s") if revolute[i] else ("N", "m/s")
        style_axes(axis, f"speed of {joints[i]} [{speeds}]", f"friction [{unit}]")
    axes[0].legend(loc="upper left", fontsize=8)
    return figure


def _friction_at(
    v: Array, indices: Sequence[int], columns: Sequence[Column], theta: Array, surfaces: Sequence[FrictionSurface]
) -> Array:
    """Friction torques (N, n) of the columns ``indices`` at the speeds ``v`` (N, n), in sliding."""
    linear = [k for k in indices if columns[k].kind != "law"]
    torque = drive_columns([columns[k] for k in linear], v, np.zeros_like(v)) @ theta[linear]
    laws = [k for k, column in enumerate(columns) if column.kind == "law"]
    return np.asarray(torque + law_columns(surfaces, v) @ np.where(np.isin(laws, indices), theta[laws], 0.0))
