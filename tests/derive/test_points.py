"""Kinematics at any link frame or point against the independent kinematics."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import Phase, given, settings

from oracles import chapter14
from oracles import newton_euler as oracle
from oracles.random_robots import random_robot, random_state, robots, to_yaml, transform
from rrrgen.derive import derive_model
from rrrgen.derive.functions.table import functions_of
from rrrgen.program import evaluate
from rrrgen.robot.file import load_spec, loads_spec

FINDING = (Phase.explicit, Phase.generate)  # a robot prints as it is; shrinking one would take minutes
EXACT = 1e-11
DIFFERENCE = 1e-6
H = 1e-6


def functions(robot):
    return {name: p for name, (p,) in derive_model(loads_spec(to_yaml(robot)), ("points",)).alternatives.items()}


def close(value, expected, tolerance=EXACT):
    assert np.max(np.abs(value - expected)) <= tolerance * max(1.0, np.max(np.abs(expected)))


def spin(T, dT):
    """The velocity (6,) of a frame from its pose and the derivative of that."""
    W = dT[:3, :3] @ T[:3, :3].T
    return np.array([*dT[:3, 3], W[2, 1], W[0, 2], W[1, 0]])


@settings(max_examples=4, phases=FINDING)
@given(robots(max_joints=4))
def test_links_and_points(robot):
    found = functions(robot)
    q, dq, _ = random_state(robot, np.random.default_rng(1))
    frames, jacobians = oracle.frames(robot, q).links, oracle.link_jacobians(robot, q)
    (V,), (A,) = evaluate(found["link_velocities"], q, dq), evaluate(found["link_jacobians_dot_dq"], q, dq)
    close(V, jacobians @ dq)
    ahead, behind = (oracle.link_jacobians(robot, q + h * dq) for h in (H, -H))
    close(A, (ahead - behind) @ dq / (2 * H), DIFFERENCE)
    point, i = np.array([0.2, -0.1, 0.3]), robot.n - 1
    (J,) = evaluate(found["point_jacobian"], frames[i], jacobians[i], point)
    v, a = evaluate(found["point_motion"], frames[i], V[i], A[i], point)

    def place(h):
        return (oracle.frames(robot, q + h * dq).links[i] @ [*point, 1.0])[:3]

    close(J[:3] @ dq, (place(H) - place(-H)) / (2 * H), DIFFERENCE)
    close(J[3:], jacobians[i][3:])
    close(v, J @ dq)
    step = 1e-4
    close(a[:3], (place(step) - 2 * place(0.0) + place(-step)) / step**2, 1e-5)
    close(a[3:], A[i][3:])
    F = np.array([1.0, -2.0, 0.5, 0.25, 3.0, -1.0])
    (tau,) = evaluate(found["wrench_torques"], J, F)
    close(tau, J.T @ F)


@settings(max_examples=4, phases=FINDING)
@given(robots(max_joints=4))
def test_tools(robot):
    found = functions(robot)
    q, dq, _ = random_state(robot, np.random.default_rng(2))
    tool = transform((2, -1, 1, 3), (0.1, -0.2, 0.35))

    def pose(h):
        return oracle.frames(robot, q + h * dq).links[-1] @ tool

    T, J = evaluate(found["tool_kinematics"], q, tool)
    close(T, pose(0.0))
    close(J @ dq, spin(T, (pose(H) - pose(-H)) / (2 * H)), DIFFERENCE)
    (target,) = evaluate(found["tool_target"], T, tool)
    close(target, oracle.forward_kinematics(robot, q))


def product_of_singular_values(J):
    return float(np.prod(np.linalg.svd(J, compute_uv=False)))


@pytest.mark.parametrize("seed", range(7))
def test_manipulability_and_null_space(seed):
    robot = random_robot(3300 + seed, n=2 + seed % 6, prismatic=0.2)
    found = functions(robot)
    assert set(found) == set(functions_of("points", robot.n))
    assert ("nullspace" in found) == (robot.n > 6)
    q, *_ = random_state(robot, np.random.default_rng(seed))
    for rows, prefix in ((6, ""), (3, "position_")):
        J = oracle.jacobian(robot, q)[:rows]
        expected = product_of_singular_values(J)
        w, gradient, status = evaluate(found[f"{prefix}manipulability"], q)
        if np.linalg.svd(J, compute_uv=False)[-1] < 1e-5:  # the structure of the arm keeps J from full rank
            assert (status, w) == (1, 0)
            assert not gradient.any()
            continue
        assert status == 0
        close(w, expected, 1e-9)
        ahead, behind = (
            [product_of_singular_values(oracle.jacobian(robot, q + h * e)[:rows]) for e in np.eye(robot.n)]
            for h in (H, -H)
        )
        close(gradient, (np.array(ahead) - np.array(behind)) / (2 * H), 1e-6)
        if f"{prefix}nullspace" in found:
            N, status = evaluate(found[f"{prefix}nullspace"], q, 0.0)
            assert status == 0
            close(N, np.eye(robot.n) - np.linalg.pinv(J) @ J, 1e-8)
            damped, _ = evaluate(found[f"{prefix}nullspace"], q, 0.5)
            close(damped, np.eye(robot.n) - J.T @ np.linalg.solve(J @ J.T + 0.25 * np.eye(rows), J))


def test_the_reference_robot_has_the_determinant_of_its_closed_form():
    """det J = -a2 a3 sin q3 rho; a stretched arm is singular, and the functions say so."""
    (program,) = derive_model(load_spec("rrr"), ("points",)).alternatives["position_manipulability"]
    for q in ([0.3, -0.7, 1.1], [1.0, 0.4, -2.0]):
        x, y, _ = chapter14.fk_1444(np.array(q))
        reach = np.sqrt(x * x + y * y - (chapter14.D2 + chapter14.D3) ** 2)
        close(evaluate(program, np.array(q))[0], abs(chapter14.A2 * chapter14.A3 * np.sin(q[2]) * reach))
    w, gradient, status = evaluate(program, np.array([0.3, -0.7, 0.0]))
    assert (status, w) == (1, 0)
    assert not gradient.any()
