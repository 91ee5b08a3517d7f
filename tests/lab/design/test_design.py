"""Exciting trajectories: measures, gradients, limits on the controller's grid, and a search that survives losses."""

from __future__ import annotations

import numpy as np
import pytest

import rrrgen
from lab.design.problems import (
    CHAPTER_LIMITS,
    independent_peaks,
    pendulum_problem,
)
from oracles.chapter14 import regressor_1447
from rrrgen.lab.design.design import (
    check_trajectory,
    solve_start,
)
from rrrgen.lab.design.robot import robot_problem
from rrrgen.lab.design.search import random_start

TARGET_CONDITION = 1.6  # the chapter reports 3.1 on a grid that aliases


def test_rrr_reaches_the_target_within_the_chapters_limits(rrr_start) -> None:
    """15 columns, judged with the oracle's regressor and series on the 1 ms grid."""
    _, result = rrr_start
    q, dq, ddq = independent_peaks(result.trajectory, 10_000)
    rows = [
        np.broadcast_to(np.asarray(entry, float), 10_000) for row in regressor_1447(q.T, dq.T, ddq.T) for entry in row
    ]
    W = np.array(rows).reshape(3, 15, 10_000).transpose(2, 0, 1).reshape(-1, 15)
    condition = np.linalg.cond(W)
    assert condition <= TARGET_CONDITION
    assert condition == pytest.approx(result.check.condition, rel=1e-9)
    assert np.all(np.abs(dq).max(axis=0) <= CHAPTER_LIMITS.speed)
    assert np.all(np.abs(ddq).max(axis=0) <= CHAPTER_LIMITS.acceleration)
    assert np.abs([dq[0], ddq[0]]).max() < 1e-6 * np.abs(ddq).max()
    assert result.check.feasible


@pytest.mark.parametrize("objective", ["cond", "logdet", "frobenius", "sigma_min"])
def test_every_objective_improves_its_own_measure(objective: str) -> None:
    problem = pendulum_problem(objective=objective)
    before = check_trajectory(problem, random_start(problem, 1))
    after = solve_start(problem, 1).check
    assert after.feasible
    measure = {
        "cond": lambda c: c.condition,
        "logdet": lambda c: -c.log_determinant,
        "frobenius": lambda c: c.frobenius_condition,
        "sigma_min": lambda c: -c.singular_values[-1],
    }[objective]
    assert measure(after) < measure(before) - 0.02 * abs(measure(before))


def test_a_motion_whose_size_does_not_change_the_condition_number_uses_the_limits(tmp_path) -> None:
    """One axis along gravity has one parameter, of condition number 1 at any amplitude: 0.0065 rad were taken."""
    text = (
        "schema: rrrgen/1\nname: turntable\nconvention: standard\ngravity: [0, 0, -9.81]\n"
        "units: {angle: rad, length: m}\njoints: [{name: q1, type: revolute, alpha: 0, a: 0.1, d: 0, theta: 0, "
        "limits: {lower: -2.8, upper: 2.8, velocity: 2.5}}]\n"
    )
    (tmp_path / "turntable.yaml").write_text(text, encoding="utf-8")
    model = rrrgen.compile(tmp_path / "turntable.yaml")
    problem = robot_problem(model, harmonics=3, base_frequency=1 / 6)
    found = solve_start(problem, 0)
    assert found.check.condition == pytest.approx(1.0)
    assert found.check.feasible
    assert found.check.worst_use > 0.9
