"""The Kalman filter and smoother of motions: gains, responses, innovations, against recursions and least squares."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rrrgen.lab.data.kalman import (
    KalmanSmoother,
    frequency_response,
    innovations,
    kalman_matrices,
    kalman_step,
    quantisation_variance,
    tune_by_innovations,
)
from rrrgen.lab.data.reconstruction import Reconstruction
from rrrgen.lab.estimate.statistics import whiteness
from samples.recordings import fourier_motion

RICCATI = 1e-9  # relative: a fixed point reached by plain iteration in double precision
STATE = 1e-6  # relative to the size of a signal: two recursions of different rounding


def plain_riccati(period, var_eta, var_xi, steps=20000):
    """The predicted covariance by iterating the textbook recursion in physical units."""
    E = np.array([[1, period, period**2 / 2], [0, 1, period], [0, 0, 1]])
    g = np.array([period**3 / 6, period**2 / 2, period])
    P = np.diag([1e-6, 1e-2, 1e2])
    for _ in range(steps):
        k = P[:, 0] / (P[0, 0] + var_eta)
        P = E @ (P - np.outer(k, P[0])) @ E.T + var_xi * np.outer(g, g)
    return P, P[:, 0] / (P[0, 0] + var_eta)


@pytest.mark.parametrize(("period", "jerk"), [(1e-3, 20.0), (2e-4, 1e3), (1e-2, 5.0)])
def test_gain_is_that_of_the_riccati_recursion(period, jerk):
    var_eta = quantisation_variance(1e-5)
    m = kalman_matrices(period, var_eta, jerk**2)
    P, k = plain_riccati(period, var_eta, jerk**2)
    np.testing.assert_allclose(m.k, k, rtol=RICCATI)
    np.testing.assert_allclose(m.predicted * var_eta, P, rtol=RICCATI)
    assert np.max(np.abs(m.poles)) < 1


@given(st.floats(-11, 2))
def test_gain_depends_only_on_the_ratio_and_is_stable(log_ratio):
    ratio = 10.0**log_ratio
    a = kalman_matrices(1e-3, 1.0, ratio**2 / 1e-18)
    b = kalman_matrices(0.5, 4.0, 4.0 * ratio**2 / 0.5**6)
    np.testing.assert_allclose(a.k * 1e-3 ** np.arange(3), b.k * 0.5 ** np.arange(3), rtol=1e-7)
    assert np.max(np.abs(a.poles)) < 1
    k, P, E = a.k, a.predicted, a.E
    again = E @ (P - np.outer(k, P[0])) @ E.T + ratio**2 / 1e-18 * np.outer(a.g, a.g)
    np.testing.assert_allclose(again, P, rtol=1e-6)


def test_figure_14_2():
    """Jerk of 8 to 30 rad/s^3 at 1e-5 rad and 1 ms puts the Bode plot on the axes of the figure."""
    f = np.geomspace(0.1, 400, 500)
    for jerk in (8.0, 30.0):
        H = frequency_response(kalman_matrices(1e-3, quantisation_variance(1e-5), jerk**2), f)
        gain = 20 * np.log10(np.abs(H))
        assert 3.2 < gain.max() < 3.6
        assert -18 < gain.min() < -13.5
        assert -61 < np.degrees(np.angle(H)).min() < -53
        assert abs(gain[0]) < 1e-2


def test_frequency_response_is_what_a_sine_sees():
    m = kalman_matrices(1e-3, 1e-10, 900.0)
    t = 1e-3 * np.arange(4000)
    for f in (3.0, 15.0, 40.0):
        y = np.sin(2 * np.pi * f * t)
        for smooth in (False, True):
            e = KalmanSmoother(1e-10, 900.0, smooth)(t, y[:, None]).q[1000:3000, 0]
            basis = np.column_stack([np.sin(2 * np.pi * f * t), np.cos(2 * np.pi * f * t)])[1000:3000]
            s, c = np.linalg.lstsq(basis, e, rcond=None)[0]
            np.testing.assert_allclose(s + 1j * c, frequency_response(m, np.array([f]), smooth)[0], atol=1e-8)


def test_step_by_step_equals_the_offline_filter():
    t = 1e-3 * np.arange(800)
    q, dq, ddq = fourier_motion(t, 1, 1)
    rng = np.random.default_rng(0)
    y = q[:, 0] + 1e-5 * rng.normal(size=len(t))
    m = kalman_matrices(1e-3, 1e-10, 400.0)
    reference = Reconstruction(t, q, dq, ddq)
    offline = KalmanSmoother(1e-10, 400.0, smooth=False)(t, y[:, None], reference)
    state = np.zeros(3)
    for k in range(len(t)):
        state, found = kalman_step(m.E, m.k, state, y[k], (q[k, 0], dq[k, 0], ddq[k, 0]))
    # the filters started differently; by the end both have forgotten it
    np.testing.assert_allclose(found, [offline.q[-1, 0], offline.dq[-1, 0], offline.ddq[-1, 0]], rtol=1e-7)


def test_smoother_is_the_most_likely_motion():
    """Dense check: minimise sum eta^2/r + sum xi^2/q over all states at once, and compare inside the record."""
    period, r, var_xi, N = 1e-2, 1e-6, 25.0, 500
    E = np.array([[1, period, period**2 / 2], [0, 1, period], [0, 0, 1]])
    g = np.array([period**3 / 6, period**2 / 2, period])
    rng = np.random.default_rng(4)
    t = period * np.arange(N)
    y = np.sin(2 * t) + 1e-3 * rng.normal(size=N)
    # unknowns: the first state and every xi; states are linear in them
    states = np.zeros((N, 3, 3 + N - 1))
    states[0, :, :3] = np.eye(3)
    for k in range(N - 1):
        states[k + 1] = E @ states[k]
        states[k + 1, :, 3 + k] += g
    A = np.vstack([states[:, 0] / np.sqrt(r), np.eye(3 + N - 1)[3:] / np.sqrt(var_xi)])
    scale = np.linalg.norm(A, axis=0)
    u = np.linalg.lstsq(A / scale, np.concatenate([y / np.sqrt(r), np.zeros(N - 1)]), rcond=None)[0] / scale
    best = states @ u
    found = KalmanSmoother(r, var_xi)(t, y[:, None])
    inner = slice(220, -220)
    for i, signal in enumerate((found.q, found.dq, found.ddq)):
        size = np.ptp(best[:, i])
        assert np.max(np.abs(signal[inner, 0] - best[inner, i])) < STATE * size


def test_innovations_find_the_variances_and_are_white():
    period, N = 1e-3, 10000
    var_eta, var_xi = 1e-10, 2e3
    rng = np.random.default_rng(8)
    xi = rng.normal(size=N) * np.sqrt(var_xi)
    x = np.zeros((N, 3))
    m = kalman_matrices(period, var_eta, var_xi)
    for k in range(N - 1):
        x[k + 1] = m.E @ x[k] + m.g * xi[k]
    t = period * np.arange(N)
    y = (x[:, 0] + rng.normal(size=N) * np.sqrt(var_eta))[:, None]
    found = tune_by_innovations(t, y)
    # standard error of a variance from N samples is about sqrt(2/N); the ratio is told less sharply
    assert found.var_eta[0] == pytest.approx(var_eta, rel=0.05)
    assert found.var_xi[0] == pytest.approx(var_xi, rel=0.5)
    nu = innovations(m, y[:, 0])[100:]
    assert np.var(nu) == pytest.approx(m.innovation * var_eta, rel=0.05)
    assert whiteness(nu).p_value > 1e-3
    coarse = innovations(kalman_matrices(period, var_eta, 1e-6 * var_xi), y[:, 0])[2000:]
    assert whiteness(coarse).p_value < 1e-6


def test_the_variance_of_rounding_is_that_of_the_chapter():
    assert quantisation_variance(1e-5) == pytest.approx(8.3e-12, rel=0.01)


@pytest.mark.parametrize("smooth", [True, False])
def test_the_deviation_of_the_speed_is_that_of_motions_of_the_model(smooth):
    """Sample motions of the model, white jerk held over a period, measured with white noise."""
    period, eta, xi, rng = 2e-3, 1e-10, 4e4, np.random.default_rng(5)
    matrices = kalman_matrices(period, eta, xi)
    states = np.zeros((40_000, 3))
    for k, jerk in enumerate(rng.normal(0.0, np.sqrt(xi), len(states) - 1)):
        states[k + 1] = matrices.E @ states[k] + matrices.g * jerk
    measured = states[:, 0] + rng.normal(0.0, np.sqrt(eta), len(states))
    smoother = KalmanSmoother((eta,), (xi,), smooth=smooth)
    found = smoother(np.arange(len(states)) * period, measured[:, None])
    error = (found.dq[:, 0] - states[:, 1])[500:-500]
    assert smoother.speed_deviations(period) == pytest.approx([np.sqrt(np.mean(error**2))], rel=0.03)
