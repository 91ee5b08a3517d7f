"""Statistics of residuals: whiteness, and deviations that allow for correlated ones."""

from dataclasses import replace

import numpy as np
import pytest

from lab.identify.regression_problems import JOINTS, NAMES, SIGMA, P, pieces, problem, rows_of
from rrrgen.lab.estimate.regression import correlated_covariance, weighted_least_squares
from rrrgen.lab.estimate.statistics import correlation_lags, residual_whiteness, whiteness
from rrrgen.lab.estimate.tsqr import Rows, factor_rows


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


@pytest.mark.parametrize("rho", [pytest.param(0.0, marks=pytest.mark.sweep), 0.7])
def test_intervals_from_few_rows_hold_their_share(rho):
    """Rows of a short periodic motion, estimated 200 times; the normal factor of the variances alone holds 90 %."""
    rng = np.random.default_rng(8)
    samples = 80
    phase = 2 * np.pi * 4 * np.arange(samples) / samples
    W = np.stack([np.ones(samples), np.sin(phase), np.cos(phase), np.sin(2 * phase)], -1)[:, None, :]
    W = W * np.array([[1.0, 2.0, 0.5, 1.0], [0.3, -1.0, 2.0, 1.0], [1.0, 1.0, 1.0, -2.0]])
    inside = []
    for _ in range(200):
        rows = rows_of(W, correlated_noise(rng, samples, rho))
        found = weighted_least_squares(factor_rows(rows), NAMES[:4])
        lags = max(correlation_lags(each) for each in residual_whiteness([rows], found.x))
        covariance = correlated_covariance([rows], found, lags, lambda v: v, np.eye(4))
        found = replace(found, covariance=covariance)
        inside.append(np.prod(found.confidence(0.95), axis=1) < 0.0)
    assert np.mean(inside) == pytest.approx(0.95, abs=0.02), np.mean(inside)


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
