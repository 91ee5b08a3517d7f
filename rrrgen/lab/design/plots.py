"""Figures of an exciting trajectory: motion, speed, torque, singular values, convergence over the starts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.lab.data.figure_style import new_figure, style_axes
from rrrgen.lab.design.check import ProblemFunctions, check_trajectory
from rrrgen.lab.design.design import ExcitationDesign, ExcitationLimits
from rrrgen.lab.design.fourier_series import Floats, FourierTrajectory
from rrrgen.lab.design.plan import ResponseDesign

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def design_figures(design: ExcitationDesign, unit: str = "rad") -> dict[str, Figure]:
    """All figures of a design by name: motion, torque (if it is limited), singular values, condition, starts."""
    figures = {"motion": plot_motion(design.trajectory, design.problem.limits, unit=unit)}
    functions = ProblemFunctions(design.problem)
    if functions.torque is not None:
        t = np.linspace(0.0, design.trajectory.period, 2000)
        tau = functions.over(functions.torque, *design.trajectory.evaluate(t))[:, :, 0]
        figures["torque"] = plot_torque(t, tau, design.problem.limits.row("torque", design.problem.joints))
    return figures | {
        "singular_values": plot_singular_values(design),
        "condition": plot_information(design),
        "starts": plot_convergence(design),
    }


def plot_motion(
    trajectory: FourierTrajectory, limits: ExcitationLimits | None = None, samples: int = 2000, unit: str = "rad"
) -> Figure:
    """Plot position, velocity and acceleration of every joint over one cycle, limits dashed, as in Fig. 14.10.

    ``unit`` names that of the positions: rad, m, or "rad or m" for arms with both.
    """
    t = np.linspace(0.0, trajectory.period, samples)
    rows = zip(("position", "speed", "acceleration"), trajectory.evaluate(t), strict=True)
    figure, axes = new_figure(3, 1, height=6.0, sharex=True)
    for axis, (name, values) in zip(axes, rows, strict=True):
        for i in range(trajectory.n):
            (line,) = axis.plot(t, values[:, i], label=f"joint {i + 1}")
            bound = None if limits is None or name == "position" else limits.row(name, trajectory.n)[i]
            if bound is not None and np.isfinite(bound):
                axis.axhline(bound, color=line.get_color(), linestyle="--", linewidth=0.6)
                axis.axhline(-bound, color=line.get_color(), linestyle="--", linewidth=0.6)
    for axis, label in zip(axes, (f"q [{unit}]", f"dq [{unit}/s]", f"ddq [{unit}/s²]"), strict=True):
        style_axes(axis, "", label)
    axes[-1].set_xlabel("t [s]")
    title = None if limits is None else "dashed: limits"
    axes[0].legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=trajectory.n, title=title)
    return figure


def plot_torque(t: Floats, tau: Floats, limits: Sequence[float] | None = None) -> Figure:
    """Plot the torque of every joint over time, one panel per joint; ``tau`` (m, n) in N m (N if prismatic)."""
    n = tau.shape[1]
    figure, axes = new_figure(n, 1, height=1.8 * n + 0.6, sharex=True)
    for i, axis in enumerate(axes):
        axis.plot(t, tau[:, i], color=f"C{i}")
        if limits is not None and np.isfinite(limits[i]):
            axis.axhline(limits[i], color="0.4", linestyle="--", linewidth=0.6)
            axis.axhline(-limits[i], color="0.4", linestyle="--", linewidth=0.6)
        style_axes(axis, "", f"τ{i + 1} [N m]")
    axes[-1].set_xlabel("t [s]")
    return figure


def plot_joint(t: Any, motion: Sequence[Any], title: str) -> Figure:
    """Plot position, speed and acceleration of one joint, (m,) each, over the times ``t``, one panel each."""
    figure, axes = new_figure(3, 1, height=5.0, sharex=True)
    for axis, values, label in zip(axes, motion, ("q [rad]", "dq [rad/s]", "ddq [rad/s²]"), strict=True):
        axis.plot(t, values, linewidth=0.8)
        style_axes(axis, "", label)
    axes[0].set_title(title, fontsize=9, loc="left")
    axes[-1].set_xlabel("t [s]")
    return figure


def plot_singular_values(design: ExcitationDesign) -> Figure:
    """Plot the singular values of the best start's stacked regressor, divided by the root of the number of samples."""
    sigma = np.asarray(design.best.check.singular_values)
    start = check_trajectory(design.problem, _first_guess(design), design.problem.design_samples)
    figure, axes = new_figure(1, 1, height=3.2)
    index = np.arange(1, sigma.size + 1)
    axes[0].semilogy(index, start.singular_values, "o", color="0.6", label=f"random start, cond {start.condition:.3g}")
    axes[0].semilogy(index, sigma, "s", label=f"designed, cond {design.best.check.condition:.4g}")
    axes[0].legend()
    style_axes(axes[0], "index", "singular value / √samples")
    return figure


def _first_guess(design: ExcitationDesign) -> FourierTrajectory:
    from rrrgen.lab.design.search import random_start

    return random_start(design.problem, design.best.seed)


def plot_convergence(design: ExcitationDesign) -> Figure:
    """Plot the smooth upper bound on the condition number over the solver's iterations, one curve for each start.

    The stages of a start follow one another.
    """
    figure, axes = new_figure(1, 1, height=3.6)
    axis = axes[0]
    for start in sorted(design.starts, key=lambda s: s.seed):
        values = np.concatenate([np.exp(h) for stage, h in start.history if stage.startswith("cond")] or [np.zeros(0)])
        label = f"start {start.seed}: {start.check.condition:.4g}" + ("" if start.check.feasible else " (infeasible)")
        best = start is design.best
        axis.semilogy(values, linewidth=1.6 if best else 0.8, label=label, zorder=3 if best else 2)
    axis.legend(title="condition on the controller's grid")
    style_axes(axis, "iteration", "smooth bound on cond")
    return figure


def plot_information(design: ExcitationDesign, samples: int = 400) -> Figure:
    """Plot, over the time t in one cycle, the condition number of the regressor stacked over the times up to t."""
    functions = ProblemFunctions(design.problem)
    t = np.arange(samples) * (design.trajectory.period / samples)
    W = functions.weighted_regressor(*design.trajectory.evaluate(t)).reshape(samples, design.problem.joints, -1)
    A = np.cumsum(np.einsum("kib,kic->kbc", W, W), axis=0)
    eigenvalues = np.linalg.eigvalsh(A)
    ratio = eigenvalues[:, -1] / np.maximum(eigenvalues[:, 0], np.finfo(float).eps * eigenvalues[:, -1])
    figure, axes = new_figure(1, 1, height=3.0)
    axes[0].semilogy(t, np.sqrt(ratio))
    style_axes(axes[0], "t [s]", "cond of Φ up to t")
    return figure


# ------------------------------------------------------------------------------------------------------------------
# Figure of a designed frequency response experiment: the excitation over time and its spectrum.
# ------------------------------------------------------------------------------------------------------------------


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
