"""Estimators against textbook solutions and their promised statistics."""

from functools import reduce

import numpy as np
import pytest

from rrrgen.base.errors import DerivationError
from rrrgen.lab.estimate.identifiability import essential_parameters, unexcited, weak_directions
from rrrgen.lab.estimate.regression import (
    correlated_covariance,
    least_squares,
    robust_least_squares,
    weighted_least_squares,
)
from rrrgen.lab.estimate.statistics import confidence_factor, relative_error, residual_whiteness, rms, whiteness
from rrrgen.lab.estimate.tsqr import JointFactors, Rows, factor_rows
from rrrgen.lab.identify.parameters import DriveTerms
from rrrgen.lab.identify.regressor import FullRegressor
from samples.recordings import fourier_motion
from samples.stand_in import RRR_ROWS, NumericModel

EXACT = 1e-10  # relative: condition numbers of the tests times the round-off of a double

N, JOINTS, P = 400, 3, 8
NAMES = [f"p{i}" for i in range(P)]
SIGMA = np.array([1.0, 0.3, 0.05])


def problem(seed=0, noise=SIGMA, samples=N):
    rng = np.random.default_rng(seed)
    W = rng.normal(size=(samples, JOINTS, P)) * 10.0 ** np.linspace(-2, 2, P)
    x = rng.normal(size=P)
    tau = W @ x + rng.normal(size=(samples, JOINTS)) * noise
    return rows_of(W, tau), x


def rows_of(W, tau):
    k = len(tau)
    return Rows(np.arange(k) * 0.01, W, tau, np.ones(tau.shape, bool), np.zeros(k, np.int64))


def pieces(rows, size):
    for start in range(0, len(rows.t), size):
        s = slice(start, start + size)
        yield Rows(rows.t[s], rows.W[s], rows.tau[s], rows.use[s], rows.segment[s])


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


def test_factors_arrive_in_any_pieces_and_order():
    rows, _ = problem()
    whole = weighted_least_squares(factor_rows(rows), NAMES)
    many, few = ([factor_rows(part) for part in pieces(rows, count)] for count in (57, 3))
    for factors in (reduce(JointFactors.merged, many), reduce(JointFactors.merged, few[::-1])):
        found = weighted_least_squares(factors, NAMES)
        np.testing.assert_allclose(found.x, whole.x, rtol=EXACT)
        np.testing.assert_allclose(found.std, whole.std, rtol=1e-8)
        np.testing.assert_array_equal(factors.counts, whole.counts)


def test_rows_out_of_use_do_not_count():
    rows, _ = problem()
    mask = np.random.default_rng(1).random(rows.tau.shape) < 0.7
    poisoned = Rows(rows.t, rows.W, np.where(mask, rows.tau, 1e6), mask, rows.segment)
    found = least_squares(factor_rows(poisoned), NAMES)
    expected = np.linalg.lstsq(rows.W[mask], rows.tau[mask], rcond=None)[0]
    np.testing.assert_allclose(found.x, expected, rtol=EXACT)
    np.testing.assert_array_equal(found.counts, mask.sum(axis=0))


def test_parameters_can_be_fixed_left_out_and_mapped_afterwards():
    rows, _ = problem()
    factors = factor_rows(rows)
    kept = [0, 2, 3, 5, 6, 7]
    found = least_squares(factors.selected(kept, {1: 0.7}), [NAMES[i] for i in kept])
    y = (rows.tau - rows.W[..., 1] * 0.7).ravel()
    np.testing.assert_allclose(found.x, np.linalg.lstsq(rows.W[..., kept].reshape(-1, 6), y, rcond=None)[0], rtol=EXACT)
    rng = np.random.default_rng(4)
    T, known = rng.normal(size=(P, 3)), rng.normal(size=P)
    z = rng.normal(size=3)
    np.testing.assert_allclose(
        factors.mapped(T, known).residual_squares(z), factors.residual_squares(T @ z + known), rtol=EXACT
    )


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


def correlated_noise(rng, samples, rho):
    e = rng.normal(size=(samples, JOINTS))
    for k in range(1, samples):
        e[k] = rho * e[k - 1] + np.sqrt(1 - rho**2) * e[k]
    return e * SIGMA


def test_correlated_residuals_widen_the_standard_deviations():
    rng = np.random.default_rng(6)
    samples, slow = 800, np.linspace(0, 20, 800)
    z_white, z_wide, wide = [], [], None
    for _ in range(60):
        W = np.stack([np.sin(slow * (1 + 0.3 * i) + i) for i in range(4)], -1)[:, None, :] * np.ones((1, JOINTS, 1))
        W = W * np.arange(1, JOINTS + 1)[:, None]
        x = rng.normal(size=4)
        rows = rows_of(W, W @ x + correlated_noise(rng, samples, 0.9))
        found = weighted_least_squares(factor_rows(rows), NAMES[:4])
        wide = correlated_covariance([rows], found, 40, lambda v: v, np.eye(4))
        pieced = correlated_covariance(pieces(rows, 33), found, 40, lambda v: v, np.eye(4))
        np.testing.assert_allclose(pieced, wide, rtol=1e-9, atol=1e-12 * np.abs(wide).max())
        z_white.append((found.x - x) / found.std)
        z_wide.append((found.x - x) / np.sqrt(np.diag(wide)))
    assert np.sqrt(np.mean(np.square(z_white))) > 2.5  # what would be reported as 3 sigma is 1
    assert np.sqrt(np.mean(np.square(z_wide))) < 1.6


def test_white_residuals_keep_their_standard_deviations():
    rows, _ = problem(7, samples=2000)
    found = weighted_least_squares(factor_rows(rows), NAMES)
    wide = correlated_covariance([rows], found, 2, lambda v: v, np.eye(P))
    np.testing.assert_allclose(np.sqrt(np.diag(wide)), found.std, rtol=0.1)


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
    words = unexcited(factors, NAMES)
    assert words[0] == "this motion does not excite p3 at all"
    assert words[1].startswith("this motion determines p5 only within 'p1 + 2*p5'")
    assert len(words) == 2
    with pytest.raises(DerivationError, match="no parameter at all"):
        least_squares(factor_rows(rows_of(0 * W, rows.tau)), NAMES)


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


def test_whiteness_against_its_definitions():
    rng = np.random.default_rng(3)
    r = rng.normal(size=3000)
    found = whiteness(r, lags=15)
    assert found.durbin_watson == pytest.approx(np.sum(np.diff(r) ** 2) / np.sum(r**2), rel=2e-3)
    rho = [np.sum(r[k:] * r[:-k]) / np.sum(r**2) for k in range(1, 16)]
    np.testing.assert_allclose(found.autocorrelation, rho, atol=2e-3)
    n = len(r)
    assert found.ljung_box == pytest.approx(n * (n + 2) * sum(c**2 / (n - k) for k, c in enumerate(rho, 1)), rel=0.02)
    assert found.p_value > 0.01
    coloured = np.convolve(r, [1, 0.8, 0.5], "same")
    assert whiteness(coloured).p_value < 1e-10
    assert whiteness(coloured).inflation > 2
    with_gaps = r.copy()
    with_gaps[::7] = np.nan
    assert whiteness(with_gaps).durbin_watson == pytest.approx(2.0, abs=0.1)


def test_whiteness_of_a_stream_does_not_depend_on_its_pieces_nor_cross_its_holes():
    rows, x = problem(4, samples=300)
    segment = (np.arange(300) >= 130).astype(np.int64)
    rows = Rows(rows.t, rows.W, rows.tau, rows.use, segment)
    whole = residual_whiteness([rows], x, lags=10)
    for size in (4, 29):
        for a, b in zip(residual_whiteness(pieces(rows, size), x, lags=10), whole, strict=True):
            np.testing.assert_allclose(a.autocorrelation, b.autocorrelation, atol=1e-13)
    jump = rows_of(np.zeros((300, JOINTS, P)), np.where(segment[:, None], 1.0, -1.0) * np.ones(JOINTS))
    jump = Rows(jump.t, jump.W, jump.tau, jump.use, segment)
    np.testing.assert_allclose(residual_whiteness([jump], x)[0].autocorrelation, 1.0)


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


def test_factors_of_different_problems_do_not_merge():
    from rrrgen.base.errors import InputError

    a = JointFactors(np.zeros((2, 3, 3)), np.zeros(2, np.int64))
    b = JointFactors(np.zeros((2, 4, 4)), np.zeros(2, np.int64))
    with pytest.raises(InputError):
        a.merged(b)
