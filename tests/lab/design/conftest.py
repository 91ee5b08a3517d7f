"""Searches of trajectories that several test files of this folder look at."""

from __future__ import annotations

import pytest


@pytest.fixture(scope="session")
def rrr_start():
    from lab.design.problems import CHAPTER_LIMITS
    from rrrgen.lab.design.design import excitation_problem, solve_start
    from samples.casadi_arms import rrr_regressor

    problem = excitation_problem(rrr_regressor(), CHAPTER_LIMITS, harmonics=12, at_rest=True)
    return problem, solve_start(problem, 1)


@pytest.fixture(scope="session")
def undisturbed():
    """What a search of the pendulum gives when nothing happens to it."""
    from lab.design.problems import SEARCHED, pendulum_problem
    from rrrgen.lab.design.design import run_starts

    return run_starts(pendulum_problem(), SEARCHED)
