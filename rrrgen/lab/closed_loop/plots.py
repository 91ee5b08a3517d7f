"""Figure that compares recorded torques with those of the simulated closed loop."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from rrrgen.lab.closed_loop.estimation import ClosedLoopEstimate
from rrrgen.lab.identify.torque_plots import MOST_POINTS, TorqueCurves, plot_torque_curves

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_loop(found: ClosedLoopEstimate, joints: Sequence[str], units: Sequence[str]) -> Figure:
    """Plot recorded and simulated torques of all joints over time (s), with their difference.

    ``joints`` are the joint names, ``units`` the units of their torques.
    """
    pairs = list(zip(found.recordings, found.runs, strict=True))
    every = max(1, sum(map(len, found.recordings)) // MOST_POINTS)
    curves = TorqueCurves(
        np.concatenate([r.t[::every] for r, _ in pairs]),
        np.concatenate([r.tau[::every] for r, _ in pairs]),
        np.concatenate([run.tau[::every] for _, run in pairs]),
        np.concatenate([r.scored[::every] for r, _ in pairs]),
    )
    return plot_torque_curves(curves, list(joints), list(units))
