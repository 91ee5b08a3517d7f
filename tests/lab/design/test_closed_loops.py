"""Exciting trajectories of robots with closed loops stay where the loops are assembled, away from dead points."""

from __future__ import annotations

import numpy as np
import pytest

import rrrgen
from derive.loops import FOUR_BAR
from rrrgen.base.errors import InputError
from rrrgen.lab.design.problem import LEAST_SINE, ExcitationLimits
from rrrgen.lab.design.robot import robot_problem
from rrrgen.lab.design.search import solve_start

LIMITED = FOUR_BAR.replace(
    "{name: crank, type: revolute, alpha: 0, a: 0, d: 0}",
    "{name: crank, type: revolute, alpha: 0, a: 0, d: 0, limits: {velocity: 3 rad/s, acceleration: 30 rad/s^2}}",
)


def test_the_trajectory_keeps_away_from_dead_points():
    """With a rod of 0.25 m the crank cannot turn fully: in a part of its range the loop cannot be assembled."""
    short = LIMITED.replace("[0.6, 0, 0]", "[0.25, 0, 0]")
    model = rrrgen.compile(rrrgen.loads_spec(short), backend="numpy")
    q = np.linspace(-np.pi, np.pi, 400)[:, None]
    assert 0.2 < np.mean(model.closed_loops(q, with_status=True)[1] == 0) < 0.95
    found = rrrgen.excite(model, starts=1, harmonics=3)
    assert found.check.feasible
    motion, _, _ = found.trajectory.evaluate(np.linspace(0, found.trajectory.period, 3000))
    loops, status = model.closed_loops(motion, with_status=True)
    assert not status.any()
    assert loops.sine.min() >= LEAST_SINE * (1 - 1e-6)
    assert {limit.quantity for limit in found.check.limits} == {"speed", "acceleration", "loop"}


def test_limits_without_an_assembled_posture_are_refused():
    """Those of an experiment file; the limits of the robot file are checked when it is read."""
    short = LIMITED.replace("[0.6, 0, 0]", "[0.25, 0, 0]")
    model = rrrgen.compile(rrrgen.loads_spec(short), backend="numpy")
    limits = ExcitationLimits(position_lower=(2.9,), position_upper=(3.1,), speed=(3.0,))
    with pytest.raises(InputError, match="no configuration was found in which all closed loops are assembled"):
        solve_start(robot_problem(model, limits, harmonics=3), 0)
