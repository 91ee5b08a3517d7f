"""Exciting motions of a mechanism: rows that follow several joints stay in their range."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import rrrgen
from rrrgen.base.errors import InputError
from rrrgen.lab.design.check import check_trajectory
from rrrgen.lab.design.friction_motion import design_friction_motion
from rrrgen.lab.design.plan import ResponsePlan
from rrrgen.lab.design.response_design import design_response
from rrrgen.lab.design.robot import robot_problem
from rrrgen.lab.design.search import solve_start
from rrrgen.robot.file import loads_spec
from rrrgen.robot.model.mechanism import follower_limits, limits_at

# a planar parallelogram: the range of the forearm against the arm is that of the crank less the arm
TEXT = """\
schema: rrrgen/1
name: parallelogram
convention: standard
units: {angle: deg, length: m}
gravity: [0, 0, -9.81]
joints:
  - {name: arm, type: revolute, alpha: 0, a: 0.5, d: 0, limits: {lower: -90, upper: 90, velocity: 150, acceleration: 900}}
  - {name: crank, type: revolute, alpha: 0, a: -0.15, d: 0, parent: base, limits: {lower: -90, upper: 90, velocity: 150, acceleration: 900}}
  - {name: rod, type: revolute, alpha: 0, a: 0.5, d: 0, follows: {arm: 1, crank: -1}}
  - {name: forearm, type: revolute, alpha: 0, a: 0.4, d: 0, parent: arm, follows: {arm: -1, crank: 1}, limits: {lower: -20, upper: 35}}
tip: forearm
"""  # noqa: E501


@pytest.fixture(scope="module")
def model():
    return rrrgen.compile(loads_spec(TEXT), backend="numpy")


def forearm(q):
    return np.degrees(q[:, 1] - q[:, 0])


def test_the_design_keeps_followers_in_their_range(model):
    pytest.importorskip("casadi")
    problem = robot_problem(model, harmonics=3, base_frequency=0.2, sample_period=0.01, objective="logdet")
    found = solve_start(problem, 1)
    assert found.check.feasible
    angle = forearm(found.trajectory.evaluate(np.linspace(0.0, 5.0, 2000))[0])
    assert angle.min() > -20.001
    assert angle.max() < 35.001
    assert angle.max() - angle.min() > 45  # the range is used
    free = replace(problem, limits=replace(problem.limits, followers=()))
    loose = solve_start(free, 1)
    angle = forearm(loose.trajectory.evaluate(np.linspace(0.0, 5.0, 2000))[0])
    assert angle.max() > 40  # without the limit the motion would leave it
    worst = max(check_trajectory(problem, loose.trajectory).limits, key=lambda use: use.use)
    assert worst.quantity == "follower"


def test_limits_of_a_joint_while_the_others_stand(model):
    (only,) = follower_limits(model.spec)
    assert (only.name, only.factors) == ("forearm", (-1.0, 1.0))
    held = limits_at(model.spec, 0, [0.0, np.radians(30)])
    np.testing.assert_allclose(np.degrees([held.lower, held.upper]), [-5, 50])
    held = limits_at(model.spec, 1, [np.radians(80), 0.0])
    np.testing.assert_allclose(np.degrees([held.lower, held.upper]), [60, 90])


def test_friction_motion_of_one_joint_keeps_the_follower_in_its_range(model):
    motion = design_friction_motion(model.spec, "crank", 20.0, 0)
    angle = forearm(motion.evaluate(np.arange(0.0, 20.0, 0.01))[0])
    assert angle.min() >= -20
    assert angle.max() <= 35
    assert angle.max() - angle.min() > 15


def test_response_experiments_keep_followers_in_their_range(model):
    plan = ResponsePlan(joint="crank", postures=((0.2, 0.1),), band=(2.0, 60.0), period=0.5, periods=4, rms=1.0)
    design = design_response(model, plan, 500.0)
    assert len(design.runs) >= 1
    for run in design.runs:
        ends = np.degrees([run.start[1], run.start[1] + run.speed * len(run.n) / 500.0]) - np.degrees(0.2)
        assert ends.min() >= -20
        assert ends.max() <= 35
    longer = replace(plan, period=4.0, band=(0.5, 60.0), rms=3.0)
    with pytest.raises(InputError, match="has room for"):
        design_response(model, longer, 500.0)
    tilted = TEXT.replace("follows: {arm: 1, crank: -1}", "follows: {arm: 1, crank: -1}, limits: {upper: 10}")
    outside = loads_spec(tilted.replace("{arm: -1, crank: 1}, limits: {lower: -20, upper: 35}", "{arm: -1, crank: 1}"))
    assert [each.name for each in follower_limits(outside)] == ["rod"]


WITHOUT_LIMITS = """\
schema: rrrgen/1
name: unlimited
convention: standard
units: {angle: rad, length: m}
gravity: [0, 0, -9.81]
joints:
  - {name: q1, type: revolute, alpha: pi/2, a: 0, d: 0, limits: {velocity: 3}}
  - {name: q2, type: revolute, alpha: 0, a: 0.4, d: 0, limits: {velocity: 3}}
  - {name: q3, type: prismatic, alpha: 0, a: 0, theta: 0, limits: {velocity: 1}}
"""


def test_the_motion_of_joints_without_position_limits_stays_within_a_turn():
    """It moved about 2644 rad, or -1.9e9 m, where the condition number was 3e33."""
    pytest.importorskip("casadi")
    model = rrrgen.compile(loads_spec(WITHOUT_LIMITS), backend="numpy")
    problem = robot_problem(model, harmonics=2, base_frequency=0.2, sample_period=0.01, objective="logdet")
    found = solve_start(problem, 0)
    assert np.abs(found.trajectory.q0).max() <= np.pi + 1e-6
    assert found.check.feasible
    assert found.check.condition < 200
