"""Friction that depends on the load torque: estimates load and friction parameters by fixed-point iteration.

The load is the torque of rigid body and drive inertia. For a known load, the ratio of Coulomb friction to load torque
is one more linear parameter. So each iteration computes the load with the parameters of the iteration before. Friction
depends only weakly on the load, so that a few iterations converge.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.lab.identify.friction_columns import FrictionSurface
from rrrgen.lab.identify.full_regressor import FullRegressor
from rrrgen.lab.identify.problem import Problem
from rrrgen.lab.identify.shapes import Fitted, tune_shapes

ROUNDS = 8
SETTLED = 1e-4  # relative change of the load at which the iteration ends


def tune_under_load(
    problem: Problem, regressor: FullRegressor, surfaces: Sequence[FrictionSurface], use: NDArray[np.bool_]
) -> tuple[Fitted, tuple[float, ...]]:
    """Fit the friction shapes of ``surfaces`` to the rows with ``use`` (r, n) True, and find the load torques.

    ``regressor`` has the columns of ``problem`` that do not depend on shapes. Returns the fit and the parameters of
    these columns, with zeros for friction, from which the load is computed; these are empty if no law depends on it.
    """
    fitted = tune_shapes(problem, surfaces, use)
    if not any(surface.definition.has_load for surface in surfaces):
        return fitted, ()
    carried = np.array([column.kind in ("rigid", "inertia") for column in regressor.columns])
    theta: Array = np.zeros(len(carried))
    for _ in range(ROUNDS):
        theta = np.where(carried, fitted.theta[: len(carried)], 0.0)
        before, problem = problem.load, problem.under_load(regressor, theta)
        fitted = tune_shapes(problem, fitted.surfaces, use)
        if np.linalg.norm(problem.load - before) <= SETTLED * np.linalg.norm(problem.load):
            break
    return fitted, tuple(float(value) for value in theta)
