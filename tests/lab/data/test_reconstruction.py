"""Reconstruction against independent solutions: brute-force Riccati, dense estimation, known spectra."""

import numpy as np
import pytest

from rrrgen.base.errors import InputError
from rrrgen.lab.data.kalman import (
    KalmanSmoother,
    kalman_matrices,
    tune_by_innovations,
)
from rrrgen.lab.data.preprocessing import Decimator
from rrrgen.lab.data.reconstruction import Butterworth, CentralDifferences, Reconstruction
from samples.recordings import fourier_motion


@pytest.mark.parametrize("method", ["butterworth", "kalman"])
def test_accelerations_from_a_coarse_encoder(method):
    """The point of it all: two differences of the raw encoder would be useless."""
    t = 1e-3 * np.arange(6000)
    q, dq, ddq = fourier_motion(t, 2, 5)
    y = np.round(q / 1e-5) * 1e-5
    tuned = Butterworth(25.0) if method == "butterworth" else tune_by_innovations(t, y)
    found, raw = tuned(t, y), CentralDifferences()(t, y)
    inner = slice(300, -300)

    def error(a, b):
        return np.sqrt(np.mean((a - b)[inner] ** 2)) / np.sqrt(np.mean(b[inner] ** 2))

    assert error(found.dq, dq) < 2e-3
    assert error(found.ddq, ddq) < 0.02
    assert error(raw.ddq, ddq) > 0.25


def test_butterworth_has_no_phase_and_its_cutoff_is_at_6_db():
    t = 1e-3 * np.arange(8000)
    y = np.sin(2 * np.pi * 20.0 * t)[:, None]
    found = Butterworth(20.0, order=4)(t, y).q[3000:5000, 0]
    basis = np.column_stack([np.sin(2 * np.pi * 20 * t), np.cos(2 * np.pi * 20 * t)])[3000:5000]
    np.testing.assert_allclose(np.linalg.lstsq(basis, found, rcond=None)[0], [0.5, 0.0], atol=1e-9)


def test_a_reference_motion_is_passed_through():
    t = 1e-3 * np.arange(3000)
    q, dq, ddq = fourier_motion(t, 2, 6)
    reference = Reconstruction(t, q, dq, ddq)
    for method in (Butterworth(5.0), KalmanSmoother(1e-8, 1.0), KalmanSmoother((1e-8, 1e-9), (1.0, 2.0), smooth=False)):
        found = method(t, q, reference)
        np.testing.assert_allclose(found.q, q, atol=1e-13)
        np.testing.assert_allclose(found.ddq, ddq, atol=1e-10)


@pytest.mark.parametrize("method", [Butterworth(40.0), KalmanSmoother(1e-10, 1e4), KalmanSmoother(1e-10, 1e4, False)])
def test_a_window_with_its_surroundings_gives_what_the_whole_gives(method):
    t = 1e-3 * np.arange(6000)
    y = np.round(fourier_motion(t, 2, 7)[0], 5)
    whole = method(t, y)
    reach = method.memory(1e-3)
    part = method(t[2000 - reach : 3000 + reach], y[2000 - reach : 3000 + reach])
    for name in ("q", "dq", "ddq"):
        a, b = getattr(part, name)[reach : reach + 1000], getattr(whole, name)[2000:3000]
        # two differences at 1 ms multiply the round-off of q by 1e6
        np.testing.assert_allclose(a, b, atol=1e-8)


@pytest.mark.parametrize("factor", [1, 3, 10])
@pytest.mark.parametrize("first", [0, 7])
def test_decimation_of_a_window_equals_that_of_the_whole(factor, first):
    rng = np.random.default_rng(factor)
    x = rng.normal(size=(1500, 2, 3))
    decimate = Decimator(factor)
    whole = decimate(x, first)
    grid = np.arange(-first % factor, len(x), factor)
    start, stop = 400, 1000
    lo, hi = start - decimate.memory, stop + decimate.memory
    inside = (grid >= start) & (grid < stop)
    window = decimate(x[lo:hi], first + lo)
    window_grid = lo + np.arange(-(first + lo) % factor, hi - lo, factor)
    chosen = (window_grid >= start) & (window_grid < stop)
    np.testing.assert_array_equal(window_grid[chosen], grid[inside])
    np.testing.assert_allclose(window[chosen], whole[inside], rtol=0, atol=1e-14)


@pytest.mark.parametrize(("factor", "step"), [(1, 1), (5, 1), (8, 2), (12, 3)])
def test_dense_samples_of_decimation_are_the_decimated_ones_and_those_between(factor, step):
    x = np.random.default_rng(factor).normal(size=(1501, 2))
    at, dense = Decimator(factor).dense(x, first=7)
    assert np.all((at + 7) % step == 0)
    assert np.all(np.diff(at) == step)
    shared = np.isin(at, np.arange(-7 % factor, len(x), factor))
    np.testing.assert_allclose(dense[shared], Decimator(factor)(x, first=7), rtol=0, atol=1e-14)


def test_decimation_keeps_the_equations_and_rejects_what_would_alias():
    rng = np.random.default_rng(0)
    W, x = rng.normal(size=(2000, 2, 4)), rng.normal(size=4)
    decimate = Decimator(20)
    np.testing.assert_allclose(decimate(W @ x), decimate(W) @ x, atol=1e-13)
    t = np.arange(20000)
    middle = slice(100, -100)
    slow, fast = np.sin(2 * np.pi * t * 0.1 / 20), np.sin(2 * np.pi * t * 0.75 / 20)
    assert np.max(np.abs(decimate(slow[:, None])[middle, 0] - slow[::20][middle])) < 2e-3
    assert np.max(np.abs(decimate(fast[:, None])[middle])) < 2e-3
    assert Decimator(1)(W) is W


def test_what_cannot_be_reconstructed_is_refused():
    t = np.array([0.0, 1e-3, 5e-3, 6e-3])
    with pytest.raises(InputError, match="constant period"):
        CentralDifferences()(t, np.zeros((4, 1)))
    with pytest.raises(InputError, match="half the sampling rate"):
        Butterworth(600.0)(1e-3 * np.arange(100), np.zeros((100, 1)))
    with pytest.raises(InputError, match="positive"):
        kalman_matrices(1e-3, 0.0, 1.0)
    with pytest.raises(InputError, match="does not move"):
        tune_by_innovations(1e-3 * np.arange(100), np.zeros((100, 1)))
    with pytest.raises(InputError, match="variances"):
        KalmanSmoother((1.0, 1.0), 1.0)(1e-3 * np.arange(100), np.zeros((100, 3)))
