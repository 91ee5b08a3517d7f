"""CasADi Functions of single branches: the rows of the emitted C, differentiable away from singularities."""

from __future__ import annotations

import numpy as np
import pytest

from ik.checks import sample
from ik.robots import ROWS, make
from rrrgen.base.errors import DerivationError

pytest.importorskip("casadi", reason="CasADi Functions need the extra 'casadi'")

from rrrgen.emit.casadi.inverse_kinematics import branch_function, branch_labels, branch_signs

SAME = 1e-7  # rad: both evaluate the same closed form; near a double root half the digits are left
POSES = 20


@pytest.mark.parametrize("name", ["rrr", "puma", "ur5", "stanford", "scara"])
def test_every_branch_gives_the_row_of_the_emitted_code(name):
    spec = make(name, ROWS[name])
    result = sample(name, N=POSES)
    f, labels = branch_function(spec), result.solver.labels
    assert branch_labels(spec) == tuple(label for label, _, _ in labels)
    goals = result.T[:, :3, 3] if result.solver.plan.task == "position" else result.T
    compared = 0
    for k, goal in enumerate(goals):
        answer = result.solver.solve(goal, limits=False)
        for row, branch in zip(answer.q, answer.branch, strict=True):
            q = np.array(f(goal, branch_signs(labels, branch))).ravel()
            assert np.abs(result.wrapped(q - row)).max() < SAME, (k, branch)
            compared += 1
    assert compared >= POSES


def test_the_derivative_is_the_inverse_of_the_jacobian():
    import casadi as ca

    spec = make("rrr", ROWS["rrr"])
    result = sample("rrr", N=10)
    f = branch_function(spec)
    p, signs = ca.SX.sym("p", 3), ca.SX.sym("b", f.size1_in(1))
    derivative = ca.Function("d", [p, signs], [ca.jacobian(f(p, signs), p)])
    for goal in result.T[:, :3, 3]:
        answer = result.solver.solve(goal, limits=False)
        for row, branch in zip(answer.q, answer.branch, strict=True):
            J = result.solver.plan.chain.jacobian(row)[:3]
            own = np.array(derivative(goal, branch_signs(result.solver.labels, branch)))
            assert np.abs(own @ J - np.eye(3)).max() < 1e-9 * np.linalg.cond(J) ** 2


def test_a_target_out_of_reach_is_not_a_number_and_quartics_are_refused():
    f = branch_function(make("rrr", ROWS["rrr"]))
    assert np.isnan(np.array(f([9.0, 0.0, 0.0], [1.0] * f.size1_in(1)))).any()
    with pytest.raises(DerivationError, match="quartic"):
        branch_function(make("ortho3r", ROWS["ortho3r"]))
