"""What stands in the place of a bound of inverse kinematics: the largest residual that a search finds."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest

from rrrgen.base.errors import DerivationError
from rrrgen.evidence.ik_residual import RANDOM, SINGULAR, inverse_kinematics_row, largest_residual
from rrrgen.robot.file import read
from rrrgen.runtime import load


@pytest.fixture(scope="module")
def model():
    return load.compile(read("rrr"), "c", "double")


def test_the_largest_residual_is_some_roundings(model):
    found = largest_residual(model, 0)
    assert 1e-17 < found.largest < 4e-15
    assert found.targets > RANDOM + SINGULAR


def test_an_error_of_one_solution_near_a_singular_position_is_found(model):
    """A joint of one solution that is off by a nanoradian, of targets near the stretched arm only."""
    solver = model.ik

    class Faulty:
        plan = solver.plan

        def solve_batch(self, targets, **given):
            batch = solver.solve_batch(targets, **given)
            stretched = abs(batch.q[:, 0, 2]) < 0.02
            batch.q[stretched, 0, 0] += 1e-9
            return replace(batch)

    faulty = SimpleNamespace(spec=model.spec, ik=Faulty())
    assert 1e-10 < largest_residual(faulty, 0).largest < 2e-9


def test_the_row_has_the_reason_the_figure_and_the_bound_of_forward_kinematics(model):
    reason, instead = inverse_kinematics_row(model, {"T": [1e-16, 2.5e-15]}, 0)
    assert "singular position" in reason
    assert f"{largest_residual(model, 0).largest:.2g}" in instead
    assert "no more than 2.5e-15" in instead
    assert "forward_kinematics" not in inverse_kinematics_row(model, None, 0)[1]


def test_a_robot_without_a_solver_has_no_row():
    class Unsolved:
        @property
        def ik(self):
            raise DerivationError("no solver")

    assert inverse_kinematics_row(Unsolved(), None, 0) is None
