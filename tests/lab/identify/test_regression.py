"""Estimators against textbook solutions and their promised statistics."""

import numpy as np
import pytest

from lab.identify.regression_problems import EXACT, JOINTS, NAMES, SIGMA, P, pieces, problem, rows_of
from rrrgen.base.errors import DerivationError
from rrrgen.lab.estimate.identifiability import essential_parameters, unexcited_parameters, weak_directions
from rrrgen.lab.estimate.regression import (
    least_squares,
    robust_least_squares,
    weighted_least_squares,
)
from rrrgen.lab.estimate.statistics import confidence_factor, relative_error, rms
from rrrgen.lab.estimate.tsqr import Rows, factor_rows
from rrrgen.lab.identify.parameters import DriveTerms
from rrrgen.lab.identify.regressor import FullRegressor
from samples.recordings import fourier_motion
from samples.stand_in import RRR_ROWS, NumericModel


def test_ordinary_least_squares_is_the_pseudoinverse():
    rows, _ = problem()
    Phi, y = rows.W.reshape(-1, P), rows.tau.ravel()
    found = least_squares(factor_rows(rows), NAMES)
    expected = np.linalg.lstsq(Phi, y, rcond=None)[0]
    np.testing.assert_allclose(found.x, expected, rtol=EXACT)
    residual = y - Phi @ expected
    variance = residual @ residual / (len(y) - P)
    np.testing.assert_allclose(found.covariance, variance * np.linalg.inv(Phi.T @ Phi), rtol=1e-8)
    assert found.condition == pytest.approx(np.linalg.cond(Phi))
    assert found.relative_error == pytest.approx(relative_error(y, Phi @ expected))
    assert found.rms == pytest.approx(float(rms(residual)))
    half = confidence_factor(0.95, len(y) - P) * np.sqrt(np.diag(found.covariance))
    np.testing.assert_allclose(found.confidence()[:, 1] - found.x, half)
    assert confidence_factor(0.95, 1e6) == pytest.approx(1.959964, rel=1e-4)


def test_weighted_least_squares_is_generalised_least_squares_with_the_noise_it_finds():
    rows, x = problem()
    found = weighted_least_squares(factor_rows(rows), NAMES)
    np.testing.assert_allclose(found.joint_sigma, SIGMA, rtol=0.15)
    w = 1.0 / found.joint_sigma
    A, b = (rows.W * w[:, None]).reshape(-1, P), (rows.tau * w).ravel()
    np.testing.assert_allclose(found.x, np.linalg.lstsq(A, b, rcond=None)[0], rtol=1e-6)
    plain = least_squares(factor_rows(rows), NAMES)
    assert np.linalg.norm((found.x - x) / found.std) < np.linalg.norm((plain.x - x) / found.std)


def test_reported_standard_deviations_are_those_of_repeated_experiments():
    """Mean square of the standardised errors over 200 experiments is 1."""
    z = []
    for seed in range(200):
        rows, x = problem(seed, samples=60)
        found = weighted_least_squares(factor_rows(rows), NAMES)
        z.append((found.x - x) / found.std)
    z = np.array(z)
    np.testing.assert_allclose(np.mean(z**2, axis=0), 1.0, atol=0.45)
    assert np.mean(z**2) == pytest.approx(1.0, abs=0.15)
    assert np.mean(np.abs(z) < 3) > 0.99


def test_outliers_hardly_move_the_robust_estimate():
    rows, x = problem(3)
    rng = np.random.default_rng(0)
    hit = rng.random(rows.tau.shape) < 0.05
    spoiled = Rows(rows.t, rows.W, rows.tau + 30.0 * hit, rows.use, rows.segment)
    start = weighted_least_squares(factor_rows(spoiled), NAMES)
    for size in (400, 61):
        found = robust_least_squares(lambda size=size: pieces(spoiled, size), NAMES, start)
        clean = weighted_least_squares(factor_rows(rows), NAMES)
        assert np.max(np.abs(found.x - x) / clean.std) < 6
        assert np.max(np.abs(start.x - x) / clean.std) > 30
        # the scale estimate stays near the noise, not the outliers
        assert np.all(found.joint_sigma < 1.6 * SIGMA)


def test_without_outliers_the_robust_estimate_is_nearly_least_squares():
    rows, _ = problem(5)
    start = weighted_least_squares(factor_rows(rows), NAMES)
    found = robust_least_squares(lambda: [rows], NAMES, start)
    assert np.max(np.abs(found.x - start.x) / start.std) < 1.0
    np.testing.assert_allclose(found.joint_sigma, start.joint_sigma, rtol=0.1)


def test_what_the_motion_does_not_excite_is_named_and_does_no_harm():
    rows, x = problem(8)
    W = rows.W.copy()
    W[..., 3] = 0.0
    W[..., 5] = 2 * W[..., 1] - W[..., 2]
    rows = rows_of(W, W @ x)
    factors = factor_rows(rows)
    found = least_squares(factors, NAMES)
    assert found.rank == P - 2
    assert found.condition == np.inf
    np.testing.assert_allclose(W @ found.x, rows.tau, atol=1e-8)
    words = unexcited_parameters(factors, NAMES)
    assert words[0] == "this motion does not excite p3 at all"
    assert words[1].startswith("this motion determines p5 only within 'p1 + 2*p5'")
    assert len(words) == 2
    with pytest.raises(DerivationError, match="no parameter at all"):
        least_squares(factor_rows(rows_of(0 * W, rows.tau)), NAMES)


def test_a_motion_whose_rank_rounding_decides_is_blamed_and_not_the_robot():
    """Kahan's matrix, the trap of rank by columns: none of 60 is small, and the last singular value is below 1e-12."""
    size, cosine = 60, 0.5
    R = np.diag(np.sqrt(1 - cosine**2) ** np.arange(size)) @ (np.eye(size) - cosine * np.triu(np.ones((size, size)), 1))
    rows = rows_of(R[None].swapaxes(0, 1) * np.ones((1, JOINTS, 1)), np.zeros((size, JOINTS)))
    with pytest.raises(DerivationError, match="the recordings may be too short"):
        unexcited_parameters(factor_rows(rows), [f"p{k}" for k in range(size)])


def test_weak_directions_are_named():
    rng = np.random.default_rng(1)
    W = rng.normal(size=(300, 1, 3))
    W[..., 2] = W[..., 0] + 1e-6 * rng.normal(size=(300, 1))
    (weak,) = weak_directions(factor_rows(rows_of(W, W[..., 0])), ["a", "b", "c"])
    assert weak.sentence.startswith(("a - c is hardly excited", "-a + c is hardly excited", "a - 1*c", "c - a"))
    assert weak.excitation < 1e-5


def test_too_few_rows_are_refused():
    rows, _ = problem()
    with pytest.raises(DerivationError, match="cannot determine"):
        least_squares(factor_rows(next(pieces(rows, 2))), NAMES)


def test_noise_free_data_do_not_break_the_weights():
    rows, x = problem(2, noise=np.zeros(3))
    found = weighted_least_squares(factor_rows(rows), NAMES)
    np.testing.assert_allclose(found.x, x, rtol=1e-10)
    assert np.all(np.isfinite(found.std))


def test_essential_parameters_are_those_that_matter():
    rng = np.random.default_rng(12)
    W = rng.normal(size=(500, JOINTS, P))
    x = np.array([3.0, 0.0, -2.0, 0.0, 1.0, 1e-4, 0.0, 5.0])
    rows = rows_of(W, W @ x + rng.normal(size=(500, JOINTS)) * SIGMA)
    found = essential_parameters(factor_rows(rows), NAMES)
    assert set(found.kept) >= {0, 2, 4, 7}
    assert len(found.kept) <= 5
    assert set(found.dropped) == {NAMES[i] for i in range(P) if i not in found.kept}
    full = weighted_least_squares(factor_rows(rows), NAMES)
    assert found.estimate.relative_error < 1.01 * full.relative_error
    # nothing is dropped where everything is significant
    rows = rows_of(W, W @ (1.0 + np.arange(P)) + 0.01 * rng.normal(size=(500, JOINTS)))
    assert essential_parameters(factor_rows(rows), NAMES).dropped == ()


def test_an_arm_is_identified_within_its_reported_deviations():
    model = NumericModel(RRR_ROWS)
    t = 0.01 * np.arange(1000)
    regressor = FullRegressor(model, DriveTerms.everywhere(3, "viscous", "coulomb"))
    rng = np.random.default_rng(11)
    x = rng.normal(size=len(regressor.names))
    W = regressor(*fourier_motion(t, 3, 2))
    rows = rows_of(W, W @ x + rng.normal(size=(1000, 3)) * SIGMA)
    found = weighted_least_squares(factor_rows(rows), regressor.names)
    assert np.max(np.abs(found.x - x) / found.std) < 3.5
    assert found.rank == 21
