"""Friction that depends on the load torque: estimates load and friction parameters by fixed-point iteration.

The load is the torque of rigid body and drive inertia. For a known load, the Coulomb friction per load torque is one
more linear parameter; so each round computes the load with the parameters of the round before. Friction depends only
weakly on the load, so that a few rounds converge.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rrrgen.arrays import Array
from rrrgen.identify.estimation.full_regressor import FullRegressor
from rrrgen.identify.friction_laws.problem import Problem
from rrrgen.identify.friction_laws.shapes import Fitted, tune_shapes
from rrrgen.identify.friction_laws.surfaces import FrictionSurface

ROUNDS = 8
SETTLED = 1e-4  # relative change of the load at which the rounds end


def tune_under_load(
    problem: Problem, regressor: FullRegressor, surfaces: Sequence[FrictionSurface], use: NDArray[np.bool_]
) -> tuple[Fitted, tuple[float, ...]]:
    """Tune the shapes of ``surfaces`` on the rows ``use`` (r, n), and find the load if a law depends on it.

    ``regressor`` has the fixed columns of ``problem``. Also returns their parameters with zeros for friction, which
    give the load; none if no law depends on it.
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
