"""The figures of the chapter's case study, drawn with the data of the virtual robot, and their numbers as tables."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.data.figure_style import new_figure, style_axes
from rrrgen.lab.data.run_folder import RunFolder
from rrrgen.lab.design.plots import design_figures
from rrrgen.lab.experiment.case_study.online import online_estimates, plot_online_estimates
from rrrgen.lab.experiment.writing_task import JointPath
from rrrgen.lab.identify.cross_validation import convergence
from rrrgen.lab.identify.figures import plot_bode
from rrrgen.lab.identify.figures import plot_convergence as plot_settling
from rrrgen.lab.identify.validation import plot_torques

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rrrgen.lab.experiment.case_study.case_study import CaseStudy

MAGNITUDES, PHASES = (-15.0, 5.0), (-60.0, 0.0)
"""Axes of Fig. 14.2, dB and degrees."""
ANGLES = (-5.0, 4.0)
"""Axis of the angles in Fig. 14.10, rad."""
SAMPLES = 2000
"""Number of samples in the plot of the convergence of estimates, as in Fig. 14.12."""


def write_figures(run: RunFolder, study: CaseStudy) -> None:
    """Write every figure (SVG, PNG), and tables (CSV) of the numbers in the figures drawn here."""
    joints = [joint.name for joint in study.model.spec.joints]
    t = study.writing_log.t
    reference = study.path.evaluate(t)
    run.figure("fig_14_02_kalman_bode", _in_ranges(plot_bode(study.observer, joints)))
    run.figure("fig_14_03_writing_task", plot_task(study.path, t))
    run.figure("fig_14_06_joint_motion", plot_joint_motion(t, reference[0], reference[1]))
    run.figure("fig_14_07_inverse_kinematics", plot_differences(*_kinematics(run, study, t, reference[0])))
    run.figure("fig_14_08_inverse_dynamics", plot_differences(*_dynamics(run, study, t, reference)))
    excitation = design_figures(study.design)
    run.figure("fig_14_10_exciting_trajectory", _with_range(excitation.pop("motion")))
    run.figure("fig_14_11_torque_and_friction", plot_experiment(study))
    run.figure("fig_14_12_settling_estimates", _settling(run, study))
    run.figure("fig_14_12_online_estimates", _online(run, study))
    run.figure("fig_14_13_validation", plot_torques(study.validation))
    run.figure("fig_14_09_joint_friction", study.joint_friction.figure())
    run.figure("fig_14_14_flexible_dynamics", study.flexible.figure())
    for name, figure in excitation.items():
        run.figure(f"excitation_{name}", figure)
    _tables(run, study)


def _in_ranges(figure: Figure) -> Figure:
    """Widen the axis ranges of ``figure`` to include those of the chapter's Bode plot; returns the figure."""
    for axis, (low, high) in zip(figure.axes, (MAGNITUDES, PHASES), strict=True):
        bottom, top = axis.get_ylim()
        axis.set_ylim(min(low, bottom), max(high, top))
    return figure


def _with_range(figure: Figure) -> Figure:
    """Shade the range of angles of the chapter's figure behind those of the exciting trajectory.

    Joints without position limits may leave that range.
    """
    axis = figure.axes[0]
    axis.axhspan(*ANGLES, color="0.92", zorder=0)
    low, high = axis.get_ylim()
    axis.set_ylim(min(low, ANGLES[0] - 0.5), max(high, ANGLES[1] + 0.5))
    axis.annotate(
        f"grey: {ANGLES[0]:g} to {ANGLES[1]:g} rad, the range of the chapter's figure",
        (0.01, 0.03),
        xycoords="axes fraction",
        fontsize=8,
    )
    return figure


def plot_task(path: JointPath, t: Array) -> Figure:
    """Plot the letters in their plane and the tip speed over time (Fig. 14.3)."""
    position, _, _ = path.task.evaluate(t)
    figure, axes = new_figure(1, 2, height=3.2, width=8.0)
    for segment, ink in zip(path.task.segments, path.task.ink, strict=True):
        points = segment.frame(np.linspace(0.0, segment.length, 40))[0]
        style = {"color": "C0"} if ink else {"color": "0.7", "linestyle": ":"}
        axes[0].plot(points[:, 0], points[:, 1], **style)
    plane = path.task.plane
    axes[0].set_xlim(*plane.x)
    axes[0].set_ylim(*plane.z)
    axes[0].set_aspect("equal")
    axes[0].set_xlabel("x [m]")
    axes[0].set_ylabel("z [m]")
    axes[0].set_title(f"y = {position[0, 1]:g} m; dotted: transfers", fontsize=9, loc="left")
    axes[0].grid(True, linewidth=0.4, alpha=0.5)
    axes[1].plot(t, path.task.speed(t))
    style_axes(axes[1], "t [s]", "tip speed [m/s]")
    return figure


def plot_joint_motion(t: Array, q: Array, dq: Array) -> Figure:
    """Plot the joint positions and velocities of the writing task over time (Fig. 14.6)."""
    figure, axes = new_figure(2, 1, height=4.4, sharex=True)
    for axis, values, label in zip(axes, (q, dq), ("q [rad]", "dq [rad/s]"), strict=True):
        for i in range(values.shape[1]):
            axis.plot(t, values[:, i], label=f"joint {i + 1}")
        style_axes(axis, "", label)
    axes[0].legend(loc="upper right", ncols=3, fontsize=8)
    axes[1].set_xlabel("t [s]")
    return figure


def plot_differences(t: Array, differences: Array, label: str, title: str) -> Figure:
    """Plot the differences between two computations, one panel per joint (Fig. 14.7, Fig. 14.8)."""
    n = differences.shape[1]
    figure, axes = new_figure(n, 1, height=1.5 * n + 0.8, sharex=True)
    for i, axis in enumerate(axes):
        axis.plot(t, differences[:, i], linewidth=0.6, color=f"C{i}")
        style_axes(axis, "", label.format(i + 1))
        axis.ticklabel_format(axis="y", style="sci", scilimits=(0, 0))
    axes[0].set_title(title, fontsize=9, loc="left")
    axes[-1].set_xlabel("t [s]")
    return figure


def plot_experiment(study: CaseStudy) -> Figure:
    """Plot the applied torque and its friction part along the exciting trajectory, one panel per joint (Fig. 14.11)."""
    log = study.excitation_log
    assert log.tau is not None
    friction = study.friction.torque(study.design.trajectory.derivative(log.t, 1))
    figure, axes = new_figure(log.n, 1, height=2.0 * log.n + 0.6, sharex=True)
    for i, axis in enumerate(axes):
        axis.plot(log.t, log.tau[:, i], color="C0", linewidth=0.7, label="applied torque")
        axis.plot(log.t, friction[:, i], color="C3", linewidth=0.9, label="friction")
        style_axes(axis, "", f"τ{i + 1} [N m]")
    axes[0].legend(loc="upper right", ncols=2, fontsize=8)
    axes[-1].set_xlabel("t [s]")
    return figure


def _kinematics(run: RunFolder, study: CaseStudy, t: Array, closed: Array) -> tuple[Array, Array, str, str]:
    """Compare closed-form with recursive inverse kinematics along the writing task.

    Returns times, differences of the joint positions, axis label and title.
    """
    recursive = study.recursive(study.path.task.evaluate(t)[0])
    difference = closed - recursive
    run.write_json("inverse_kinematics.json", {"largest_difference_rad": np.abs(difference).max(axis=0)})
    return t, difference, "e{} [rad]", "closed-form minus recursive inverse kinematics"


def _dynamics(
    run: RunFolder, study: CaseStudy, t: Array, motion: tuple[Array, Array, Array]
) -> tuple[Array, Array, str, str]:
    """Compare the emitted inverse dynamics with a recursive Newton-Euler routine; both use the nominal parameters.

    Returns times, differences of the joint torques, axis label and title.
    """
    from rrrgen.verify.references.newton_euler import NewtonEuler
    from rrrgen.verify.references.numeric_robot import chain_of, nominal_parameters

    phi = nominal_parameters(study.model.spec)
    assert phi is not None
    q, dq, ddq = (np.asarray(part, dtype=np.float64) for part in motion)
    recursive = NewtonEuler(chain_of(study.model.spec), phi).inverse_dynamics(q, dq, ddq)
    difference = study.model.inverse_dynamics(*motion) - recursive
    scale = np.abs(recursive).max(axis=0)
    run.write_json(
        "inverse_dynamics.json",
        {"largest_difference_Nm": np.abs(difference).max(axis=0), "largest_torque_Nm": scale},
    )
    return t, difference, "Δτ{} [N m]", "emitted inverse dynamics minus recursive Newton-Euler"


def _settling(run: RunFolder, study: CaseStudy) -> Figure:
    identification = study.identification
    samples = sum(len(rows.t) for rows in identification.blocks)
    settling = convergence(
        identification.blocks,
        identification.names,
        identification.estimate.weights,
        identification.transform,
        every=max(1, samples // SAMPLES),
    )
    header = ("samples", *settling.names)
    run.write_csv("settling.csv", header, ([int(k), *row] for k, row in zip(settling.samples, settling.x, strict=True)))
    return plot_settling(settling, identification.estimate.std, identification.units, study.truth)


def _online(run: RunFolder, study: CaseStudy) -> Figure:
    estimates = online_estimates(study)
    names = estimates[0].names
    header = ("t", *(f"{estimate.kind}_{name}" for estimate in estimates for name in (*names, "torque_error")))
    columns = [part for estimate in estimates for part in (estimate.p, estimate.error[:, None])]
    run.write_csv("online_estimates.csv", header, np.column_stack([estimates[0].t, *columns]).tolist())
    values = dict(zip(study.model.base_parameter_names, study.model.beta, strict=True))
    return plot_online_estimates(estimates, np.array([values[name] for name in names]))


def _tables(run: RunFolder, study: CaseStudy) -> None:
    rows: list[list[Any]] = [
        list(row)
        for row in zip(
            study.identification.names,
            study.identification.estimate.x.tolist(),
            study.identification.estimate.std.tolist(),
            study.truth.tolist(),
            study.deviations.tolist(),
            strict=True,
        )
    ]
    run.write_csv("parameters.csv", ("parameter", "estimate", "std", "truth", "deviations"), rows)
    result = study.validation
    n = result.measured.shape[1]
    header = ("t", *(f"tau{i + 1}" for i in range(n)), *(f"model{i + 1}" for i in range(n)))
    curves = np.column_stack([result.t, result.measured, result.predicted])
    run.write_csv("validation.csv", header, curves.tolist())
