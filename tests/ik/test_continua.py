"""Beside two singular configurations at once the solutions are several continua: each has a row of its own."""

import numpy as np
import pytest

from ik.checks import FK_ERROR
from ik.robots import ROWS, reference, robot
from rrrgen.runtime.inverse_kinematics import load_solver
from rrrgen.runtime.results import FREE


def solved(name, backend, q):
    """The answer to the pose of ``q``, whose rows all meet it, and the solver."""
    solver = load_solver(robot(name), backend=backend)
    T = reference(ROWS[name], q)[0]
    given = {} if solver.plan.locked is None else {"redundancy": solver.parameter(q)}
    answer = solver.solve(T, limits=False, **given)
    assert np.abs(reference(ROWS[name], answer.q) - T).max() <= FK_ERROR
    return answer, solver


@pytest.mark.parametrize("backend", ["c", "numpy"])
@pytest.mark.parametrize("q3", [1e-7, -3.4e-7])
def test_a_retracted_arm_has_rows_on_both_sides_of_its_shoulder(backend, q3):
    """Joint 2 turns freely while the slide is almost in the shoulder, but not past the pose with the slide across."""
    answer, _ = solved("stanford", backend, [1.04, 0.49, q3, -1.9, 2.78, -0.02])
    sides = {(q[2] > 0.0, q[4] > 0.0) for q in answer.q}
    assert sides == {(forward, flip) for forward in (True, False) for flip in (True, False)}
    assert (answer.flags & FREE).all()


@pytest.mark.parametrize("backend", ["c", "numpy"])
def test_a_straight_continuum_keeps_one_row(backend):
    """The slide exactly in the shoulder: joint 2 is free all the way round, and at its reference."""
    answer, _ = solved("stanford", backend, [1.04, 0.49, 0.0, -1.9, 2.78, -0.02])
    assert len(answer) == 2
    assert np.abs(answer.q[:, 1]).max() < 1e-9


@pytest.mark.parametrize("backend", ["c", "numpy"])
@pytest.mark.parametrize("joint", [1, 5])
def test_turning_a_joint_a_little_is_not_turning_it_half_round(backend, joint):
    """0.01 rad stays within the accuracy of the target, but a half turn does not: all eight rows are distinct."""
    q = np.array([0.7, 0.9, -0.8, 1.2, -0.6, 0.8, 0.4])
    q[joint] = 5e-12
    answer, solver = solved("iiwa14", backend, q)
    assert len(answer) == 8
    assert max(abs(solver.parameter(row) - solver.parameter(q)) for row in answer.q) < 1e-8
