"""Physically consistent estimates: what they promise, and that they cost nothing where the data are good."""

import numpy as np
import pytest

from rrrgen.base.errors import InputError
from rrrgen.derive.parameters.physical_links import Prior, pseudo_inertia
from rrrgen.lab.estimate.regression import least_squares
from rrrgen.lab.estimate.tsqr import Rows, factor_rows
from rrrgen.lab.identify.consistency import (
    InconsistentEstimateError,
    KnownParameters,
    consistent_estimate,
    indefinite_share,
    mass_matrix,
)
from rrrgen.lab.identify.parameters import DriveTerms
from rrrgen.lab.identify.regressor import FullRegressor
from rrrgen.robot.spec import standard_names
from samples.recordings import fourier_motion, point_masses
from samples.stand_in import RRR_ROWS, NumericModel

pytest.importorskip("cvxpy", reason="cvxpy and CLARABEL solve the semidefinite program")

SOLVER = 1e-6  # relative accuracy that CLARABEL reaches in the parameters


def sphere_prior(n, mass=3.0, radius=0.2, strength=1e-6):
    return Prior(np.stack([mass * np.diag([radius**2] * 3 + [1.0])] * n), strength)


def observed(model, terms, theta, noise, seed, samples=300):
    regressor = FullRegressor(model, terms)
    rng = np.random.default_rng(seed)
    W = regressor(*fourier_motion(0.02 * np.arange(samples), model.n, seed))
    tau = W @ theta + noise * rng.normal(size=W.shape[:2])
    use = np.ones(tau.shape, bool)
    return regressor, factor_rows(Rows(np.arange(samples) * 0.02, W, tau, use, np.zeros(samples, np.int64)))


def test_exact_torques_of_a_possible_robot_are_matched():
    model = NumericModel(RRR_ROWS)
    phi = point_masses(3, 1)
    friction = np.array([1.0, 2.0, 0.5, 3.0, 1.0, 0.7])
    theta = np.concatenate([model.base_projection @ phi, friction])
    regressor, factors = observed(model, DriveTerms.everywhere(3, "viscous", "coulomb"), theta, 0.0, 0)
    found = consistent_estimate(model, factors, regressor.columns, np.full(3, 1e3), sphere_prior(3))
    np.testing.assert_allclose(found.theta, theta, rtol=1e-4, atol=SOLVER * np.abs(theta).max())
    np.testing.assert_allclose(found.beta, model.base_projection @ found.phi, rtol=1e-12)
    assert found.relative_error < SOLVER
    assert found.drives["fc1"] == pytest.approx(3.0, rel=1e-4)
    assert np.all(found.eigenvalues > 0)


def test_noise_makes_least_squares_impossible_but_not_the_consistent_estimate():
    model = NumericModel(RRR_ROWS)
    phi = point_masses(3, 2)
    beta = model.base_projection @ phi
    regressor, factors = observed(model, DriveTerms(), beta, 10.0, 6, samples=40)
    columns = regressor.columns
    plain = least_squares(factors, regressor.names)
    limits = np.full(3, -np.pi), np.full(3, np.pi)
    share, smallest = indefinite_share(lambda q: mass_matrix(model, columns, plain.x, q), *limits, poses=2000)
    assert share > 0.05
    assert smallest < 0
    weights = 1.0 / plain.joint_sigma
    found = consistent_estimate(model, factors, columns, weights, sphere_prior(3, strength=1.0), plain)
    assert np.all(np.linalg.eigvalsh(pseudo_inertia(found.phi.reshape(3, 10))) > 0)
    share, smallest = indefinite_share(lambda q: mass_matrix(model, columns, found.theta, q), *limits)
    assert share == 0.0
    assert smallest > 0
    assert found.loss > 0
    # and it is nearer to the truth than least squares
    assert np.linalg.norm(found.beta - beta) < np.linalg.norm(plain.x - beta)


def test_friction_and_drive_inertia_are_not_negative():
    model = NumericModel(RRR_ROWS)
    terms = DriveTerms.everywhere(3, "inertia", "viscous", "coulomb", "offset")
    theta = np.concatenate([model.base_projection @ point_masses(3, 5), np.full(12, -0.3)])
    regressor, factors = observed(model, terms, theta, 0.1, 6)
    found = consistent_estimate(model, factors, regressor.columns, np.full(3, 10.0), sphere_prior(3))
    assert all(value >= 0 for name, value in found.drives.items() if not name.startswith("off"))
    assert found.drives["off2"] == pytest.approx(-0.3, abs=0.2)


def test_known_standard_parameters_are_kept():
    model = NumericModel(RRR_ROWS)
    phi = point_masses(3, 7)
    regressor, factors = observed(model, DriveTerms(), model.base_projection @ phi, 0.05, 8)
    names = standard_names(3)
    base = 4  # a base parameter is known as well, at a value 5 % beside the true one
    value = 1.05 * (model.base_projection @ phi)[base]
    known = KnownParameters.of(model, {model.base_parameter_names[base]: value}, {"my2": 0.0, "m3": 2.5})
    found = consistent_estimate(
        model, factors, regressor.columns, np.full(3, 20.0), sphere_prior(3, strength=1.0), known=known
    )
    assert found.phi[names.index("my2")] == pytest.approx(0.0, abs=1e-12)
    assert found.phi[names.index("m3")] == pytest.approx(2.5, rel=1e-12)
    assert model.base_projection[base] @ found.phi == pytest.approx(value, rel=1e-12)
    assert np.all(found.eigenvalues > 0)
    # the covariance has none of what is known
    along = found.near.directions[base]
    assert np.abs(along).max() < 1e-9 * np.abs(found.near.directions).max()


@pytest.mark.filterwarnings("ignore:Solution may be inaccurate")  # there is none, which the solver tells so
@pytest.mark.parametrize(("name", "value"), [("Izz3", -1.0), ("m2", -2.0)])
def test_known_values_that_no_body_has_are_named(name, value):
    model = NumericModel(RRR_ROWS)
    regressor, factors = observed(model, DriveTerms(), model.base_projection @ point_masses(3, 7), 0.05, 8)
    known = KnownParameters.of(model, {}, {name: value})
    with pytest.raises(InconsistentEstimateError, match=f"no arm that can be built has {name} = {value:g}"):
        consistent_estimate(
            model, factors, regressor.columns, np.full(3, 20.0), sphere_prior(3, strength=1.0), known=known
        )


def test_the_prior_decides_what_the_torques_leave_open():
    model = NumericModel(RRR_ROWS)
    beta = model.base_projection @ point_masses(3, 9)
    regressor, factors = observed(model, DriveTerms(), beta, 0.05, 10)
    light, heavy = (
        consistent_estimate(model, factors, regressor.columns, np.full(3, 20.0), sphere_prior(3, mass, strength=1.0))
        for mass in (1.0, 8.0)
    )
    # the mass of link 1 has no effect on any torque: it is the prior's
    assert light.phi[0] == pytest.approx(1.0, rel=0.1)
    assert heavy.phi[0] == pytest.approx(8.0, rel=0.1)
    # what the torques tell hardly changes
    np.testing.assert_allclose(light.beta, heavy.beta, atol=0.05 * np.abs(beta).max())


def test_impossible_priors_are_refused():
    with pytest.raises(InputError, match="not positive definite"):
        Prior(np.stack([np.diag([1.0, 1.0, -1.0, 1.0])]))
    with pytest.raises(InputError, match="positive"):
        sphere_prior(2, strength=0.0)


def test_mass_matrix_by_columns_equals_the_model():
    model = NumericModel(RRR_ROWS)
    beta = model.base_projection @ point_masses(3, 3)
    terms = DriveTerms.everywhere(3, "inertia")
    theta = np.concatenate([beta, [0.1, 0.2, 0.3]])
    q = np.random.default_rng(0).uniform(-3, 3, (1500, 3))
    M = mass_matrix(model, FullRegressor(model, terms).columns, theta, q)
    np.testing.assert_allclose(M, model.mass_matrix(q, beta) + np.diag([0.1, 0.2, 0.3]), atol=1e-12)
