"""The Fourier trajectory (14.24) against complex exponentials, and the bound between samples against dense sampling."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rrrgen.base.errors import InputError
from rrrgen.lab.design.fourier_series import FourierTrajectory, fourier_basis, intersample_peak_factor

# Sums of N terms of size one: a few units in the last place each, relative to the sum of magnitudes.
ROUND_OFF = 1e-12


def random_trajectory(seed: int, n: int = 3, N: int = 12, f0: float = 0.1) -> FourierTrajectory:
    rng = np.random.default_rng(seed)
    return FourierTrajectory(rng.normal(size=n), rng.normal(size=(n, N)), rng.normal(size=(n, N)), f0)


def complex_series(trajectory: FourierTrajectory, t: np.ndarray, order: int) -> np.ndarray:
    """Re sum_j c_j (i w_j)^order exp(i w_j t) with c_j = -(b_j + i a_j)/w_j, plus q0."""
    omega = 2 * np.pi * trajectory.base_frequency * np.arange(1, trajectory.harmonics + 1)
    c = -(trajectory.b + 1j * trajectory.a) / omega
    wave = np.exp(1j * np.outer(t, omega)) * (1j * omega) ** order
    return (wave @ c.T).real + (trajectory.q0 if order == 0 else 0.0)


@pytest.mark.parametrize("order", [0, 1, 2, 3, 4])
def test_derivatives_equal_the_complex_series(order: int) -> None:
    trajectory = random_trajectory(1)
    t = np.linspace(-3.0, 27.0, 301)
    expected = complex_series(trajectory, t, order)
    got = trajectory.derivative(t, order)
    assert got.shape == (301, 3)
    assert np.abs(got - expected).max() <= ROUND_OFF * np.abs(expected).max() * 100


def test_batch_shapes_and_evaluate_agree() -> None:
    trajectory = random_trajectory(2)
    t = np.linspace(0, 10, 12).reshape(3, 4)
    q, dq, ddq = trajectory.evaluate(t)
    assert q.shape == dq.shape == ddq.shape == (3, 4, 3)
    assert np.abs(q[1, 2] - trajectory.derivative(t[1, 2], 0)).max() <= ROUND_OFF


def test_cycles_repeat_exactly_and_late_samples_lose_nothing() -> None:
    trajectory = random_trajectory(3, f0=0.125)  # a period of 8 s: multiples are exact in binary
    t = trajectory.times(1.0 / 64)
    assert np.array_equal(trajectory.derivative(t, 0), trajectory.derivative(t + 8.0 * 2**20, 0))
    assert t.size == 512
    assert np.array_equal(trajectory.derivative(0.0, 2), trajectory.derivative(8.0, 2))


@given(st.integers(0, 10_000), st.integers(1, 9), st.integers(1, 40))
def test_bound_between_samples_holds(seed: int, N: int, extra: int) -> None:
    M = 2 * N + extra
    rng = np.random.default_rng(seed)
    coefficients = rng.normal(size=1 + 2 * N)
    shift = rng.uniform()
    samples = fourier_basis((np.arange(M) + shift) / M, N, 1.0) @ coefficients
    dense = fourier_basis(np.linspace(0, 1, 4000), N, 1.0) @ coefficients
    assert np.abs(dense).max() <= intersample_peak_factor(N, M) * np.abs(samples).max() * (1 + ROUND_OFF)


def test_bound_is_attained_and_aliasing_proves_nothing() -> None:
    # cos(N x) sampled half a step off its peaks: the factor is sharp when 2N divides M.
    N, M = 4, 24
    samples = np.cos(N * 2 * np.pi * (np.arange(M) + 0.5) / M)
    assert intersample_peak_factor(N, M) * np.abs(samples).max() == pytest.approx(1.0, rel=1e-12)
    assert intersample_peak_factor(50, 100) == np.inf


def test_harmonic_100_looks_constant_on_a_tenth_of_a_second_grid() -> None:
    """Why the search refuses such grids: harmonics j and 100 - j coincide there."""
    B = fourier_basis(np.arange(101) * 0.1, 100, 0.1, 1)
    assert np.ptp(B[:, 100]) < 1e-9
    assert np.linalg.matrix_rank(B[:, 1:]) <= 100 < 200


def test_json_round_trip_is_exact(tmp_path) -> None:
    trajectory = random_trajectory(5)
    path = tmp_path / "trajectory.json"
    path.write_text(json.dumps(trajectory.to_json()))
    again = FourierTrajectory.from_json(path)
    for name in ("q0", "a", "b"):
        assert np.array_equal(getattr(again, name), getattr(trajectory, name))
    assert np.array_equal(
        FourierTrajectory.from_coefficients(trajectory.coefficients, 0.1).coefficients, trajectory.coefficients
    )


@pytest.mark.parametrize(
    "data",
    [
        {"q0": [0.0], "a": [[1.0]], "b": [[1.0]]},
        {"base_frequency_hz": 1.0, "q0": [0.0], "a": [[1.0]], "b": [[1.0, 2.0]]},
    ],
)
def test_bad_trajectories_are_refused(data: dict) -> None:
    with pytest.raises(InputError):
        FourierTrajectory.from_json(data)
