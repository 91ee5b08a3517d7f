"""Comparison with independent dynamics: every wrong sign and misread number fails, and is named."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from oracles.newton_euler import Link
from rrrgen.verify import verify
from verify.distorted import FUNCTIONS, SAMPLES, Broken, arm, flip_largest, indefinite_arm
from verify.oracle_model import OracleModel


@pytest.mark.parametrize("name", FUNCTIONS)
def test_one_wrong_sign_fails_and_is_named(complete, name):
    report = verify(Broken(complete, name, flip_largest), samples=SAMPLES, libraries=False)
    assert not report.ok
    assert any(name in row.function for row in report.failures), report.to_text()


@pytest.mark.parametrize(
    ("name", "part", "row"),
    [("kinematics", 0, "T"), ("kinematics", 1, "J"), *(("dynamics_terms", k, "Mcg"[k]) for k in range(3))],
)
def test_one_wrong_sign_in_one_of_several_results_fails(complete, name, part, row):
    def distort(values):
        return tuple(flip_largest(value) if k == part else value for k, value in enumerate(values))

    report = verify(Broken(complete, name, distort), samples=SAMPLES, libraries=False)
    assert {r.function for r in report.failures} == {f"{name}: {row}"}


@pytest.mark.parametrize("error", [1e-6, 1e-9])
def test_small_errors_fail_too(complete, error):
    report = verify(Broken(complete, "coriolis", lambda c: c * (1 + error)), samples=SAMPLES, libraries=False)
    assert not report.ok


def test_misread_inertia_fails_for_nominal_parameters_only():
    """A model whose nominal links have products of the wrong sign is consistent in itself, and still wrong."""
    right = arm()
    signs = np.array([[1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    links = tuple(Link(link.mass, link.com, link.inertia * signs) for link in right.robot.links)
    wrong = OracleModel(right.robot.with_links(links))
    wrong.spec = right.spec
    report = verify(wrong, samples=SAMPLES, libraries=False)
    assert {row.parameters for row in report.failures} == {"nominal"}
    assert "beta = K phi" in {row.function for row in report.failures}


def test_wrong_gravity_direction_fails():
    right = arm()
    wrong = OracleModel(dataclasses.replace(right.robot, gravity=-right.robot.gravity))
    wrong.spec = right.spec
    failed = {row.function for row in verify(wrong, samples=SAMPLES, libraries=False).failures}
    assert {"gravity", "inverse_dynamics", "energy, potential"} <= failed
    assert "mass_matrix" not in failed


@pytest.mark.parametrize("name", ["forward_dynamics", "forward_dynamics_derivatives"])
def test_accelerations_from_an_indefinite_mass_matrix_fail(name):
    class Careless(OracleModel):
        def _accelerations(self, q, dq, tau, phi):
            return np.linalg.solve(self._mass(q, phi), tau - self._bias(q, dq, phi))

    model = indefinite_arm()
    report = verify(Careless(model.robot), samples=SAMPLES, libraries=False)
    assert f"{name} refuses an indefinite M" in {row.function for row in report.failures}
