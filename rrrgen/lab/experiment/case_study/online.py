"""Online estimation along the exciting trajectory of the case study, (14.21)-(14.23): estimates sample by sample."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.emit.controller.online_estimators import EstimatorSettings, Kind, chosen_gain, gain_bound, regression
from rrrgen.lab.data.figure_style import new_figure, style_axes
from rrrgen.lab.data.kalman import kalman_step
from rrrgen.runtime.online_estimators import online_estimator

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rrrgen.lab.experiment.case_study.case_study import CaseStudy

BLOCK = 20
"""Number of samples between two points of the plotted curves."""
CYCLES = 2
"""Number of times that the recorded period of the exciting trajectory is passed through the estimators."""
PANELS = 4
LABELS = {"rls": "recursive least squares", "gradient": "gradient"}
KINDS: tuple[Kind, ...] = ("rls", "gradient")


@dataclass(frozen=True, eq=False)
class OnlineEstimates:
    """Estimates ``p`` (points, p) of the parameters ``names`` by the estimator ``kind``, at times ``t`` (points,) in s.

    ``error`` (points,) is the norm of the torque error along the trajectory divided by that of the torque.
    """

    kind: Kind
    names: tuple[str, ...]
    t: Array
    p: Array
    error: Array


def online_estimates(study: CaseStudy) -> tuple[OnlineEstimates, ...]:
    """Run both estimators on the recorded positions and torques, from estimates of zero.

    Speeds and accelerations come from the Kalman filter; friction is taken as known.
    """
    log, model = study.excitation_log, study.model
    assert log.tau is not None
    q, dq, ddq = _filter_motion(study)
    tau = log.tau - study.friction.torque(dq)
    noise = np.diag(np.square(study.settings.torque_noise))
    fixed = {"p4": 0.0, "p15": 0.0} if study.settings.symmetric_links else {}
    setting = regression(model.derived, fixed)
    wanted = study.design.trajectory.evaluate(log.t[:: 5 * BLOCK])
    keep = [k for k, name in enumerate(model.base_parameter_names) if name in setting.names]
    Y, torque = model.regressor(*wanted)[..., keep], model.inverse_dynamics(*wanted)
    known = model.inverse_dynamics(*wanted) - Y @ np.asarray(model.beta)[keep]
    settings = EstimatorSettings(
        start=(0.0,) * len(setting.names),
        noise=tuple(tuple(float(v) for v in row) for row in noise),
        gain=chosen_gain(None, gain_bound(setting, *study.design.trajectory.evaluate(log.t))),
    )
    estimates = []
    for kind in KINDS:
        estimator = online_estimator(model, kind, settings, fixed)
        points = []
        for k in [*range(0, len(log.t), BLOCK)] * CYCLES:
            part = slice(k, k + BLOCK)
            estimator.update(q[part], dq[part], ddq[part], tau[part])
            points.append(estimator.parameters)
        p = np.array(points)
        error = np.linalg.norm((Y @ p[:, None, :, None])[..., 0] + known - torque, axis=(1, 2)) / np.linalg.norm(torque)
        estimates.append(
            OnlineEstimates(kind, estimator.names, study.settings.period * BLOCK * np.arange(1, len(p) + 1), p, error)
        )
    return tuple(estimates)


def _filter_motion(study: CaseStudy) -> tuple[Array, Array, Array]:
    """Estimate the motion from the recorded positions by the controller's Kalman filter, (14.30), (14.31).

    Returns positions, velocities and accelerations.
    """
    log = study.excitation_log
    reference = np.stack(study.design.trajectory.evaluate(log.t), axis=-1)
    E, gains = np.array([m.E for m in study.observer]), np.array([m.k for m in study.observer])
    x: Array = np.zeros((log.n, 3))
    motion = np.empty_like(reference)
    for k, reading in enumerate(log.q):
        x, motion[k] = kalman_step(E, gains, x, reading, reference[k])
    return motion[..., 0], motion[..., 1], motion[..., 2]


def _small(axis: Any, lowest: bool) -> None:
    """Give one panel a grid and small labels; the lowest panel of a column also labels the time axis."""
    style_axes(axis, "t [s]" if lowest else "", "")
    axis.tick_params(labelsize=8)
    axis.xaxis.label.set_fontsize(8)


def plot_online_estimates(estimates: tuple[OnlineEstimates, ...], truth: Array) -> Figure:
    """Plot every estimated parameter over time with its true value from ``truth`` (p,), and the torque error.

    As in Fig. 14.12.
    """
    names = estimates[0].names
    rows = -(-(len(names) + 1) // PANELS)
    figure, axes = new_figure(rows, PANELS, height=1.5 * rows + 0.6, width=2.4 * PANELS)
    for i, name in enumerate(names):
        axis = axes[i]
        for k, estimate in enumerate(estimates):
            axis.plot(estimate.t, estimate.p[:, i], color=f"C{k}", linewidth=0.9, label=LABELS[estimate.kind])
        axis.axhline(truth[i], color="0.2", linestyle="--", linewidth=0.8, label="true value")
        size = max(abs(truth[i]), float(np.abs(np.diff(estimates[0].p[len(estimates[0].p) // 10 :, i])).max()), 0.02)
        axis.set_ylim(truth[i] - 1.5 * size, truth[i] + 1.5 * size)
        axis.set_title(name, fontsize=8)
        _small(axis, i + PANELS > len(names))
    error = axes[len(names)]
    for k, estimate in enumerate(estimates):
        error.semilogy(estimate.t, 100.0 * estimate.error, color=f"C{k}", linewidth=0.9)
    error.set_title("torque error [%]", fontsize=8)
    error.set_ylim(0.05, 200.0)
    _small(error, True)
    for axis in axes[len(names) + 1 :]:
        axis.set_visible(False)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3, fontsize=8)
    return figure
