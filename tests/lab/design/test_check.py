"""The check of a trajectory on a dense grid, and which limit fails."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("casadi", reason="the search for exciting trajectories needs CasADi")


from lab.design.problems import BETA, independent_peaks, pendulum_problem
from rrrgen.base.errors import DerivationError
from rrrgen.lab.design.design import ExcitationLimits, check_trajectory, design_excitation, solve_start
from samples.casadi_arms import double_pendulum_tip, double_pendulum_torque


@pytest.mark.sweep
def test_rrr_check_reports_what_a_dense_grid_shows(rrr_start) -> None:
    problem, result = rrr_start
    dense = check_trajectory(problem, result.trajectory, 40_000)
    assert dense.condition == pytest.approx(result.check.condition, rel=1e-6)
    for coarse, fine in zip(result.check.limits, dense.limits, strict=True):
        assert (coarse.quantity, coarse.index) == (fine.quantity, fine.index)
        assert fine.use <= coarse.use * (1 + 1e-9)  # the bound between samples covers every finer grid
        assert fine.use == pytest.approx(coarse.use, rel=1e-4)


def test_positions_torques_and_a_box_are_kept_on_the_controllers_grid() -> None:
    limits = ExcitationLimits(
        position_lower=(-1.0, None),
        position_upper=(1.2, 1.5),
        speed=(6.0, 8.0),
        acceleration=(None, 60.0),
        torque=(14.0, 5.0),
        box_lower=(0.1, None, -0.45),
        box_upper=(None, None, 0.4),
    )
    problem = pendulum_problem(limits=limits, torque=double_pendulum_torque(BETA), tip=double_pendulum_tip())
    # the free problem violates these limits, so that keeping them is an achievement
    free = solve_start(pendulum_problem(), 2).trajectory
    assert check_trajectory(problem, free).worst_use > 1.1
    result = solve_start(problem, 2)
    assert result.check.feasible
    q, dq, ddq = independent_peaks(result.trajectory, 2000)
    assert q[:, 0].min() >= -1.0
    assert q[:, 0].max() <= 1.2
    assert q[:, 1].max() <= 1.5
    assert np.all(np.abs(dq).max(axis=0) <= limits.speed)
    assert np.abs(ddq[:, 1]).max() <= 60.0
    torque, tip = double_pendulum_torque(BETA), double_pendulum_tip()
    tau = np.array([torque(*state).full().ravel() for state in zip(q, dq, ddq, strict=True)])
    assert np.all(np.abs(tau).max(axis=0) <= limits.torque)
    x, _, z = np.array([tip(state).full().ravel() for state in q]).T
    assert x.min() >= 0.1
    assert z.min() >= -0.45
    assert z.max() <= 0.4
    binding = [use.use for use in result.check.limits]
    assert max(binding) > 0.95  # some limit is really in the way


def test_a_problem_that_cannot_be_met_says_which_limit_fails() -> None:
    # gravity alone needs more torque than this somewhere in the given range
    limits = ExcitationLimits(
        position_lower=(-0.2, -0.2), position_upper=(0.2, 0.2), speed=(6.0, 8.0), torque=(1.0, 5.0)
    )
    problem = pendulum_problem(limits=limits, torque=double_pendulum_torque(BETA), max_iterations=10)
    with pytest.raises(DerivationError, match="torque 1 at"):
        design_excitation(problem, 1)
