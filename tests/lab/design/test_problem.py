"""Problems of excitation: faults, units of the condition number, dependent columns, torques of the drives."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("casadi", reason="the search for exciting trajectories needs CasADi")


import casadi

import rrrgen
from lab.design.problems import independent_peaks, pendulum_problem
from rrrgen.base.errors import InputError
from rrrgen.lab.design.design import ExcitationLimits, check_trajectory, excitation_problem, solve_start
from rrrgen.lab.design.search import random_start
from rrrgen.robot.robots import bundled_path
from samples.casadi_arms import double_pendulum_regressor


def test_weights_and_scales_are_the_units_of_the_condition_number() -> None:
    scales, weights = (2.0, 1.0, 0.5, 1.0, 1.0, 3.0), (1.0, 4.0)
    plain, weighted = pendulum_problem(), pendulum_problem(row_weights=weights, column_scales=scales)
    trajectory = random_start(plain, 0)
    regressor = double_pendulum_regressor()
    states = zip(*independent_peaks(trajectory, 2000), strict=True)
    W = np.array([np.array(weights)[:, None] * regressor(*s).full() * np.array(scales) for s in states])
    assert check_trajectory(weighted, trajectory).condition == pytest.approx(np.linalg.cond(W.reshape(-1, 6)), rel=1e-9)
    assert check_trajectory(plain, trajectory).condition != pytest.approx(np.linalg.cond(W.reshape(-1, 6)), rel=0.01)


def test_dependent_columns_are_refused_with_their_rank() -> None:
    q, dq, ddq = (casadi.SX.sym(k, 1) for k in ("q", "dq", "ddq"))
    doubled = casadi.Function("r", [q, dq, ddq], [casadi.horzcat(ddq, casadi.sin(q), 2 * ddq)])
    problem = excitation_problem(doubled, ExcitationLimits(speed=(1.0,)), harmonics=3)
    with pytest.raises(InputError, match=r"3 columns but rank 2.*write their angles exactly"):
        solve_start(problem, 0)


def test_every_fault_of_a_problem_is_reported() -> None:
    bad = ExcitationLimits(
        speed=(1.0,), torque=(1.0, -1.0), position_lower=(0.0, 1.0), position_upper=(1.0, 1.0), box_lower=(0, 0, 0)
    )
    with pytest.raises(InputError) as caught:
        pendulum_problem(limits=bad, harmonics=100, sample_period=0.1)
    text = str(caught.value)
    for part in (
        "'speed' has 1",
        "'torque' must be positive",
        "must lie below",
        "torque function",
        "tip function",
        "alias",
    ):
        assert part in text
    with pytest.raises(InputError, match="nothing else bounds"):
        pendulum_problem(limits=ExcitationLimits())
    with pytest.raises(InputError, match="design samples alias"):
        pendulum_problem(design_samples=8)


@pytest.mark.sweep
def test_torques_with_friction_stay_within_the_drives_by_default() -> None:
    """The drive of the pendulum cannot hold it where it is level: the motion must not stop there."""
    text = bundled_path("pendulum").read_text(encoding="utf-8")
    robot = rrrgen.loads_spec(text.replace("    limits:", "    friction: {viscous: 0.02, coulomb: 0.3}\n    limits:"))
    result = rrrgen.excite(robot, harmonics=5, starts=3)
    assert result.check.feasible
    assert result.overloads == ()
    assert {limit.quantity for limit in result.check.limits} == {"speed", "acceleration", "torque"}
