"""Inverse kinematics of positions with the tool as an input: every family, against forward kinematics."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from ik.chains import position
from ik.robots import h, make
from ik.test_mechanisms import GEARED
from rrrgen.base.errors import DerivationError
from rrrgen.ik.geometry.chain import multiply, translation
from rrrgen.robot.file import loads_spec, read
from rrrgen.runtime.inverse_kinematics import load_solver, load_tool_solver

SPECIAL = {
    "meeting": [("R", h, 0, 0.5, 0), ("R", 0.7, 0.4, 0.1, 0.2), ("R", 0.3, 0.3, 0, 0)],
    "elbow turned round": [("R", h, 0, 0.5, 0), ("R", 0, -0.4, 0.1, 0), ("R", 0, 0.3, 0, 0)],
    "parallel": [("R", 0, 0.4, 0.1, 0), ("R", 0.6, 0.3, 0.2, 0), ("R", 0.4, 0.2, 0, 0)],
    "nearly parallel": [("R", h, 0.1, 0.5, 0), ("R", 2e-4, 0.4, 0.1, 0), ("R", 0.2, 0.3, 0, 0)],
}
CHAINS = {"".join(types): position("".join(types), 3) for n in (1, 2, 3) for types in product("RP", repeat=n)} | SPECIAL


def tip_with(solver, tool):
    """The chain of ``solver`` whose tip is the point ``tool`` of the last link."""
    return replace(solver.plan.chain, tip=multiply(solver.plan.last_link, translation(tuple(tool))))


def configuration(rng, chain):
    return np.array([rng.uniform(-3, 3) if joint.revolute else rng.uniform(-0.5, 0.5) for joint in chain.joints])


@pytest.mark.parametrize("name", CHAINS)
def test_configurations_are_found_again_from_the_position_of_a_random_tool(name):
    spec, rng = make("arm", CHAINS[name]), np.random.default_rng(4)
    solver = load_tool_solver(spec, backend="numpy")
    for size in (0.1, 1.0, 4.0):
        tool = size * solver.plan.chain.reach * rng.uniform(-1, 1, 3)
        arm = tip_with(solver, tool)
        q = configuration(rng, arm)
        goal = arm.forward(q)[:3, 3]
        answer = solver.solve([*goal, *tool], q, limits=False, sort="nearest")
        assert np.abs(answer.q[0] - q).max() < 1e-7
        for row in answer.q:
            assert np.abs(arm.forward(row)[:3, 3] - goal).max() < 1e-11
    own = load_solver(spec, backend="numpy")  # the tool of the robot file: the same rows with the same labels
    goal = solver.plan.chain.forward(q)[:3, 3]
    tip = np.linalg.solve(np.array([*solver.plan.last_link, (0, 0, 0, 1)], float), np.eye(4))
    tool = (tip @ np.array([*solver.plan.chain.tip, (0, 0, 0, 1)], float))[:3, 3]
    expected, found = own.solve(goal, q, limits=False), solver.solve([*goal, *tool], q, limits=False)
    np.testing.assert_allclose(found.q, expected.q, atol=1e-7)
    assert (found.branch == expected.branch).all()


@pytest.mark.parametrize("spec", [read("rrr"), loads_spec(GEARED)], ids=["rrr", "mechanism"])
def test_the_emitted_c_and_its_evaluation_agree(spec):
    compiled, evaluated = load_tool_solver(spec), load_tool_solver(spec, backend="numpy")
    rng = np.random.default_rng(5)
    arm, q = tip_with(compiled, tool := rng.uniform(-0.3, 0.3, 3)), rng.uniform(-1, 1, 3)
    coupling = compiled.plan.coupling
    goal = arm.forward(q if coupling is None else np.array(coupling.matrix, float) @ q)[:3, 3]
    found, expected = (each.solve([*goal, *tool], q, limits=False) for each in (compiled, evaluated))
    np.testing.assert_allclose(found.q, expected.q, atol=1e-12)
    assert min(np.abs(found.q - q).max(axis=1)) < 1e-12
    many = compiled.solve_batch([[*goal, *tool], [*(2 * goal), *tool], [*goal, 20, 0, 0]], q, limits=False)
    np.testing.assert_array_equal(many.q[0, : len(found.q)], found.q)
    for each in (compiled, evaluated):
        answer = each.solve([*goal, 20, 0, 0])
        assert (answer.status, len(answer.q)) == ("unreachable", 0)
        assert "longer than 10 reaches" in answer.reason
    assert compiled.closest([*(9 * goal), *tool], q).residual[0] > 1


def test_casadi_takes_the_tool_too():
    pytest.importorskip("casadi")
    from rrrgen.emit.casadi.inverse_kinematics import branch_function, branch_signs

    spec = read("rrr")
    solver, f = load_tool_solver(spec, backend="numpy"), branch_function(spec, tool=True)
    target = [0.3, -0.4, 0.6, 0.1, -0.05, 0.08]
    answer = solver.solve(target, limits=False)
    assert len(answer.q) == 4
    for q, branch in zip(answer.q, answer.branch, strict=True):
        np.testing.assert_allclose(np.ravel(f(target, branch_signs(solver.labels, branch))), q, atol=1e-12)


def test_arms_that_are_solved_for_poses_have_no_such_solver():
    with pytest.raises(DerivationError, match="solves for poses, and a tool only changes its target"):
        load_tool_solver(read("ur5"))
