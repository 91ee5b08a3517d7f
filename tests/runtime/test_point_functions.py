"""Kinematics at links and points in Python: results in one call, statuses, tools with the inverse kinematics."""

from __future__ import annotations

import numpy as np
import pytest

import rrrgen
from oracles.random_robots import transform
from rrrgen.base.errors import InputError

TOOL = transform((2, -1, 1, 3), (0.1, -0.2, 0.35))


@pytest.fixture(scope="module")
def model():
    return rrrgen.compile("ur5", backend="numpy")


def test_a_point_of_a_link(model):
    q, dq = np.random.default_rng(0).normal(size=(2, model.n))
    T, J, V = model.link_frames(q)[2], model.link_jacobians(q)[2], model.link_velocities(q, dq)[2]
    A, point = model.link_jacobians_dot_dq(q, dq)[2], [0.1, 0.0, -0.2]
    J_p = model.point_jacobian(T, J, point)
    motion = model.point_motion(T, V, A, point)
    np.testing.assert_allclose(motion.V_p, J_p @ dq, atol=1e-12)
    force = np.array([0.0, 0.0, -10.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(model.wrench_torques(J_p, force), J_p.T @ force, atol=1e-12)
    np.testing.assert_allclose(force @ motion.V_p, model.wrench_torques(J_p, force) @ dq, atol=1e-12)


def test_a_tool_at_run_time_reaches_its_target(model):
    q = np.array([0.4, -1.0, 1.2, 0.3, 0.8, -0.5])
    T = model.tool_kinematics(q, TOOL).T
    solutions = model.inverse_kinematics(model.tool_target(T, TOOL)).q
    assert len(solutions) > 1
    np.testing.assert_array_equal(model.inverse_kinematics(T, tool=TOOL).q, solutions)
    batch = model.inverse_kinematics(np.array([T, T]), tool=TOOL)
    assert batch.counts.tolist() == [len(solutions)] * 2
    with pytest.raises(ValueError, match="needs poses"):
        model.inverse_kinematics(T[:3, 3], tool=TOOL)
    for found in solutions:
        np.testing.assert_allclose(model.tool_kinematics(found, TOOL).T, T, atol=1e-9)


@pytest.mark.parametrize(
    ("entry", "value", "message"),
    [
        ((3, slice(None)), 9.0, "tool: the last row of a pose is 0 0 0 1, not 9 9 9 9"),
        ((0, 0), 2.0, "tool: the rotation of a pose is not orthonormal"),
        ((0, 0), -1.0, "tool: the rotation of a pose is left-handed"),
    ],
)
def test_a_tool_that_is_no_rigid_motion_is_refused(model, entry, value, message):
    tool = np.eye(4)
    tool[entry] = value
    q, T = np.zeros(model.n), np.eye(4)
    with pytest.raises(InputError, match=message):
        model.tool_kinematics(q, tool)
    with pytest.raises(InputError, match=message):
        model.tool_target(T, np.stack([np.eye(4), tool]))
    with pytest.raises(InputError, match=message.replace("tool", "T")):
        model.tool_target(tool, np.eye(4))


def test_a_tool_of_an_arm_that_is_solved_for_positions():
    model, q = rrrgen.compile("rrr", backend="numpy"), np.array([0.4, -0.3, 0.7])
    T = model.tool_kinematics(q, TOOL).T
    solutions = model.inverse_kinematics(T[:3, 3], tool=TOOL, limits=False).q
    assert len(solutions) == 4
    assert min(np.abs(solutions - q).max(axis=1)) < 1e-12
    for found in solutions:
        np.testing.assert_allclose(model.tool_kinematics(found, TOOL).T[:3, 3], T[:3, 3], atol=1e-12)
    tools = np.array([TOOL, np.eye(4)])
    batch = model.inverse_kinematics(T[:3, 3], tool=tools, limits=False)
    np.testing.assert_array_equal(batch.q[0], solutions)
    assert batch.counts.tolist() == [4, 0]  # out of reach without the tool
    with pytest.raises(ValueError, match="tool must be a pose"):
        model.inverse_kinematics(T[:3, 3], tool=TOOL[:3, 3])
    with pytest.raises(ValueError, match="target must hold positions"):
        model.inverse_kinematics(T[:3, 3].tolist() * 2, tool=TOOL)


def test_loss_of_rank_is_an_error_unless_the_status_is_asked_for(model):
    stretched = np.zeros(model.n)
    with pytest.raises(np.linalg.LinAlgError, match="singular"):
        model.manipulability(stretched)
    (w, gradient), status = model.manipulability(stretched, with_status=True)
    assert (w, status) == (0.0, 1)
    assert not gradient.any()
    assert model.manipulability(np.full(model.n, 0.7)).w > 0


def test_the_null_space_belongs_to_redundant_robots(model):
    with pytest.raises(ValueError, match="no function 'nullspace'"):
        model.nullspace(np.zeros(model.n))
    N = model.position_nullspace(np.full(model.n, 0.7))
    assert np.abs(model.jacobian(np.full(model.n, 0.7))[:3] @ N).max() < 1e-12
    assert np.linalg.matrix_rank(N) == model.n - 3
