"""The nonlinear program of a trajectory: its objectives and their gradients."""

from __future__ import annotations

import numpy as np
import pytest

from lab.design.problems import pendulum_problem

casadi = pytest.importorskip("casadi", reason="the search for exciting trajectories needs CasADi")
from rrrgen.lab.design.nonlinear_program import ExcitationProgram  # noqa: E402
from rrrgen.lab.design.search import random_start  # noqa: E402


@pytest.mark.parametrize(("stage", "p"), [("logdet", 0), ("cond", 1), ("cond", 4), ("cond", 64), ("sigma_min", 8)])
def test_objectives_and_their_gradients(stage: str, p: int) -> None:
    """Values against eigenvalues computed with NumPy; gradients against central differences."""
    problem = pendulum_problem()
    program = ExcitationProgram(problem)
    x0 = program.variables(random_start(problem, 3))
    objective = program.objective(stage, p, 1.0)
    value = casadi.Function("f", [program.x], [objective])
    gradient = casadi.Function("g", [program.x], [casadi.gradient(objective, program.x)])
    eigenvalues = np.linalg.eigvalsh(casadi.Function("A", [program.x], [program.information])(x0).full())
    if stage == "logdet":
        expected = -0.5 * np.sum(np.log(eigenvalues + 1e-6)) / problem.columns
    else:
        inverse = np.log(np.sum((eigenvalues[0] / eigenvalues) ** p)) / p - np.log(eigenvalues[0])
        upper = np.log(np.sum((eigenvalues / eigenvalues[-1]) ** p)) / p + np.log(eigenvalues[-1])
        expected = 0.5 * inverse if stage == "sigma_min" else 0.5 * (inverse + upper)
    assert float(value(x0)) == pytest.approx(expected, rel=1e-9)
    g = gradient(x0).full().ravel()
    steps = np.eye(x0.size) * 1e-5
    differences = np.array([(float(value(x0 + e)) - float(value(x0 - e))) / 2e-5 for e in steps])
    assert np.abs(g - differences).max() <= 1e-6 * np.abs(g).max()
