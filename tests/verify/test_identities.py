"""Identities of mechanics that a model must satisfy: energy, skew symmetry, counts of base parameters, derivatives."""

from __future__ import annotations

import numpy as np
import pytest

from rrrgen.verify import verify
from verify.distorted import DERIVATIVES, SAMPLES, Broken, arm, flip_largest, indefinite_arm
from verify.oracle_model import OracleModel


@pytest.mark.parametrize("part", [0, 1])
def test_wrong_energy_fails(complete, part):
    def distort(energies):
        return tuple(-e if k == part else e for k, e in enumerate(energies))

    report = verify(Broken(complete, "energy", distort), samples=SAMPLES, libraries=False)
    assert {"energy, kinetic", "energy, potential"} & {row.function for row in report.failures}
    assert "d(K + U)/dt = tau.dq" in {row.function for row in report.failures}


def test_a_constant_added_to_the_potential_is_no_fault(complete):
    shifted = Broken(complete, "energy", lambda energies: (energies[0], energies[1] + 7.0))
    assert verify(shifted, samples=SAMPLES, libraries=False).ok


def test_any_coriolis_matrix_with_the_right_product_but_no_skew_symmetry_fails(complete):
    """C dq = c is not enough: the columns (c 0 0)/dq1 give the same product."""

    class Wrong(OracleModel):
        def coriolis_matrix(self, q, dq, *, beta=None):
            C = np.zeros((*q.shape, q.shape[-1]))
            C[..., 0] = self.coriolis(q, dq, beta=beta) / dq[..., :1]
            return C

    report = verify(Wrong(complete.robot), samples=SAMPLES, libraries=False)
    failed = {row.function for row in report.failures}
    assert "dM/dt - 2C skew" in failed
    assert "coriolis_matrix dq" not in failed


def test_too_few_or_too_many_base_parameters_fail():
    count = "number of base parameters (rank)"
    missing = arm()
    missing.base_projection = missing.base_projection[:-1]
    missing.base_parameter_names = missing.identification_parameter_names = missing.base_parameter_names[:-1]
    missing.beta = missing.beta[:-1]
    assert {count, "regressor K"} <= {row.function for row in verify(missing, samples=2, libraries=False).failures}
    doubled = arm()
    K = doubled.base_projection
    doubled.base_projection = np.vstack([K[:1] / np.sqrt(2), K[:1] / np.sqrt(2), K[1:]])
    doubled.base_parameter_names = doubled.identification_parameter_names = (*doubled.base_parameter_names, "p16")
    doubled.beta = doubled.base_projection @ doubled.robot.phi
    assert [row.function for row in verify(doubled, samples=2, libraries=False).failures] == [count]


def test_derivatives_are_checked_behind_a_wrapper(whole):
    """An object that answers through ``__getattr__`` has no attributes for a static look, as from Python 3.12 on."""
    assert whole.ok, whole.to_text()
    for name in DERIVATIVES:
        assert sum(row.function.startswith(name) for row in whole.rows) == 2 * 4


@pytest.mark.parametrize("part", range(4))
@pytest.mark.parametrize("name", DERIVATIVES)
def test_one_wrong_sign_in_a_derivative_fails(complete, name, part):
    def distort(values):
        return tuple(flip_largest(value) if k == part else value for k, value in enumerate(values))

    report = verify(Broken(complete, name, distort), samples=1, libraries=False)
    assert {row.function.split(":")[0] for row in report.failures} == {name}


def test_an_indefinite_mass_matrix_must_be_refused():
    report = verify(indefinite_arm(), samples=SAMPLES)
    assert report.ok, report.to_text()
    asked = {row.function for row in report.rows if row.parameters == "nominal"}
    assert {f"{name} refuses an indefinite M" for name in ("forward_dynamics", DERIVATIVES[1])} <= asked
    assert {name for name, _ in report.skipped} <= {"Pinocchio", "MuJoCo", "Robotics Toolbox", "inverse_kinematics"}
