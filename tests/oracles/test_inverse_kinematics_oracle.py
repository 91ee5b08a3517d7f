"""The numerical inverse kinematics finds whole solution sets where they are known."""

from __future__ import annotations

import numpy as np
import pytest

from oracles import chapter14
from oracles import newton_euler as ne
from oracles.inverse_kinematics import batch_kinematics, distance, same_sets, solve_all
from oracles.known_robots import BASE_PARAMETER_COUNTS
from oracles.random_robots import random_robot

ON_TARGET = 1e-12  # m and 1; Newton ends at round-off away from singular poses


def robot_of(name: str):
    return BASE_PARAMETER_COUNTS[name][0]


@pytest.mark.parametrize("seed", range(6))
def test_batch_kinematics_equals_the_single_one(seed):
    robot = random_robot(seed)
    q = np.random.default_rng(seed).uniform(-3, 3, (4, robot.n))
    T, J = batch_kinematics(robot, q)
    for k in range(4):
        assert np.max(np.abs(T[k] - ne.forward_kinematics(robot, q[k]))) < ON_TARGET
        assert np.max(np.abs(J[k] - ne.jacobian(robot, q[k]))) < ON_TARGET


@pytest.mark.parametrize("seed", range(5))
def test_reference_arm_has_the_four_closed_form_solutions(seed):
    arm = chapter14.rrr()
    q = np.random.default_rng(seed).uniform(-np.pi, np.pi, 3)
    target = ne.forward_kinematics(arm, q)[:3, 3]
    closed, found = chapter14.ik_1445_complete(target), solve_all(arm, target)
    assert len(found) == len(closed) == 4
    assert same_sets(arm, found, closed, 1e-9)


@pytest.mark.sweep(but=["puma560-counts0", "stanford-counts1"])
@pytest.mark.parametrize(
    ("name", "counts"), [("puma560", {8}), ("stanford", {8}), ("ur10", {4, 6, 8}), ("generic6r", {2, 4, 6, 8})]
)
def test_pose_sets(name, counts):
    robot = robot_of(name)
    q = np.random.default_rng(7).uniform(-2.5, 2.5, robot.n)
    target = ne.forward_kinematics(robot, q)
    first, second = solve_all(robot, target), solve_all(robot, target, seed=1)
    assert len(first) in counts
    assert same_sets(robot, first, second)
    assert distance(robot, q, first).min() < 1e-9
    assert max(np.max(np.abs(ne.forward_kinematics(robot, row) - target)) for row in first) < ON_TARGET


def test_double_root_counts_once():
    arm = chapter14.rrr()
    stretched = ne.forward_kinematics(arm, np.array([0.3, 0.5, 0.0]))[:3, 3]
    assert len(solve_all(arm, stretched)) == 2


def test_out_of_reach_is_empty_and_redundancy_is_refused():
    assert solve_all(chapter14.rrr(), np.array([2.0, 0.0, 0.0])).shape == (0, 3)
    panda = robot_of("panda")
    q = np.full(7, 0.4)
    target = ne.forward_kinematics(panda, q)
    with pytest.raises(ValueError, match="lock"):
        solve_all(panda, target)
    assert distance(panda, q, solve_all(panda, target, locked={6: 0.4})).min() < 1e-9
