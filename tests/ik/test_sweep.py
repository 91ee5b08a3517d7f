"""Self-motion of redundant arms: the solutions of one pose over the redundancy parameter."""

from __future__ import annotations

from functools import cache, partial

import numpy as np
import pytest

from ik.test_mechanisms import poses
from rrrgen.base.errors import DerivationError
from rrrgen.robot.file import load_spec
from rrrgen.runtime.inverse_kinematics import load_solver

ANGLES = np.linspace(-np.pi, np.pi, 181)
EXACT = 1e-12  # of the reach, and of rotation matrices
STEPS_OF_JOINT = 20.0
"""Rows of one branch move at most this many times as far as the parameter, away from where branches meet."""


@cache
def arm(name):
    """The solver of a bundled robot, and the poses of its configurations from independent kinematics."""
    spec = load_spec(name)
    return load_solver(spec), partial(poses, spec)


def wrapped(angles):
    return np.abs(np.remainder(angles + np.pi, 2.0 * np.pi) - np.pi)


@pytest.mark.parametrize(("robot", "parameter"), [("iiwa14", "arm angle"), ("panda", "panda_joint7")])
def test_every_row_of_a_sweep_reaches_the_pose(robot, parameter):
    solver, forward = arm(robot)
    assert parameter in solver.plan.redundancy
    rng = np.random.default_rng(7)
    for q in rng.uniform(-1.2, 1.2, (5, solver.n)) + np.array([0, 0, 0, -1.5, 0, 1.3, 0]):
        (pose,) = forward(q[None])
        swept = solver.sweep(pose, ANGLES, limits=False)
        assert swept.q.shape == (len(ANGLES), solver.max_solutions, 7)
        assert swept.counts.max() > 0
        rows = [swept.q[k, i] for k in range(len(ANGLES)) for i in range(swept.counts[k])]
        assert np.abs(forward(np.array(rows)) - pose).max() <= EXACT
        single = solver.solve(pose, limits=False, redundancy=float(ANGLES[40]))
        assert np.array_equal(single.q, swept.q[40, : swept.counts[40]])


@pytest.mark.parametrize("robot", ["iiwa14", "panda"])
def test_the_parameter_of_a_configuration_gives_it_back(robot):
    solver, forward = arm(robot)
    rng = np.random.default_rng(8)
    for q in rng.uniform(-1.2, 1.2, (50, solver.n)) + np.array([0, 0, 0, -1.5, 0, 1.3, 0]):
        at = solver.parameter(q)
        found = solver.sweep(forward(q[None])[0], [at], limits=False)
        away = [wrapped(row - q).max() for row in found.q[0, : found.counts[0]]]
        assert min(away) < 1e-7


def test_a_branch_moves_smoothly_over_the_arm_angle():
    """On the arm angle every branch exists everywhere, and its label follows it."""
    solver, forward = arm("iiwa14")
    q = np.array([0.3, 0.6, -0.4, -1.4, 0.5, 1.1, -0.2])
    swept = solver.sweep(forward(q[None])[0], ANGLES, limits=False)
    assert np.all(swept.counts == 8)
    step = ANGLES[1] - ANGLES[0]
    for branch in range(8):
        rows = np.array([swept.q[k, list(swept.branch[k]).index(branch)] for k in range(len(ANGLES))])
        assert wrapped(np.diff(rows, axis=0)).max() < STEPS_OF_JOINT * step


def test_an_arm_without_a_parameter_says_so():
    with pytest.raises(DerivationError, match="no redundancy parameter"):
        load_solver(load_spec("puma560"), backend="numpy").sweep(np.eye(4), [0.0])
