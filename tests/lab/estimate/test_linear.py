"""Linear least squares with scaled columns, and variable projection, against NumPy and against differences."""

from __future__ import annotations

import numpy as np
import pytest

from rrrgen.lab.estimate.linear import project, scale_columns, solve

UNITS = np.array([1e-9, 1.0, 3e7, 1e3])


def system(seed: int, rows: int = 30) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(rows, 4)) * UNITS, rng.normal(size=rows)


def test_scaled_columns_have_length_1():
    A, _ = system(0)
    A[:, 2] = 0.0
    B, size = scale_columns(A)
    assert np.linalg.norm(B, axis=0) == pytest.approx([1.0, 1.0, 0.0, 1.0], rel=1e-15)
    assert size[2] == 1.0
    assert B * size == pytest.approx(A, rel=1e-15)


@pytest.mark.parametrize("seed", range(4))
def test_solution_residual_and_covariance(seed):
    A, y = system(seed)
    fit = solve(A, y)
    Q, R = np.linalg.qr(A)
    x = np.linalg.solve(R, Q.T @ y)
    assert fit.rank == 4
    assert fit.weak.shape == (0, 4)
    assert fit.x == pytest.approx(x, rel=1e-12)
    assert fit.residual(y) == pytest.approx(y - A @ x, abs=1e-13)
    inverse = np.linalg.inv(R)
    scale = np.sqrt(np.outer(np.diag(inverse @ inverse.T), np.diag(inverse @ inverse.T)))
    assert fit.covariance / scale == pytest.approx(inverse @ inverse.T / scale, abs=1e-12)
    assert fit.condition == pytest.approx(np.linalg.cond(scale_columns(A)[0]), rel=1e-12)


def test_solution_does_not_depend_on_units():
    A, y = system(1)
    units = np.array([1e12, 1e-3, 1e-12, 5.0])
    assert solve(A * units, y).x * units == pytest.approx(solve(A, y).x, rel=1e-12)


def test_dependent_columns_are_named_and_kept_out():
    A, y = system(2)
    A[:, 3] = A[:, 0] * 1e9 - 2.0 * A[:, 1]
    fit = solve(A, y)
    assert (fit.rank, fit.condition, fit.weak.shape) == (3, np.inf, (1, 4))
    assert scale_columns(A)[0] @ fit.weak[0] == pytest.approx(np.zeros(30), abs=1e-14)
    assert fit.weak[0] @ (fit.x * scale_columns(A)[1]) == pytest.approx(0.0, abs=1e-12)  # the shortest solution
    assert fit.residual(y) == pytest.approx(solve(A[:, :3], y).residual(y), abs=1e-13)


@pytest.mark.parametrize(("rows", "columns", "rank"), [(5, 0, 0), (5, 3, 0), (2, 4, 2), (0, 2, 0)])
def test_degenerate_shapes(rows, columns, rank):
    A = np.random.default_rng(3).normal(size=(rows, columns)) * (rank > 0)
    fit = solve(A, np.ones(rows))
    assert (fit.rank, fit.x.shape, fit.weak.shape) == (rank, (columns,), (columns - rank, columns))
    assert np.all(np.isfinite(fit.x))


def decays(z: np.ndarray) -> np.ndarray:
    t = np.linspace(0.0, 3.0, 60)
    return np.stack([np.exp(-z[0] * t), np.sin(z[1] * t), np.ones(60)], axis=1)


def test_variable_projection_has_the_gradient_of_the_reduced_problem():
    t = np.linspace(0.0, 3.0, 60)
    z = np.array([0.7, 2.1])
    y = np.random.default_rng(4).normal(size=60) + 3.0 * np.exp(-t)

    def derivative(c: np.ndarray) -> np.ndarray:
        return np.stack([-t * np.exp(-z[0] * t) * c[0], t * np.cos(z[1] * t) * c[1]], axis=1)

    r, J, fit = project(decays(z), y, derivative)
    assert decays(z).T @ r == pytest.approx(np.zeros(3), abs=1e-12)
    assert fit.x == pytest.approx(np.linalg.lstsq(decays(z), y)[0], rel=1e-10)
    h = 1e-6
    costs = [[np.sum(solve(decays(z + sign * h * e), y).residual(y) ** 2) for sign in (1.0, -1.0)] for e in np.eye(2)]
    assert 2.0 * J.T @ r == pytest.approx([(a - b) / (2 * h) for a, b in costs], rel=1e-6)
    near = decays(z) @ [3.0, 1.0, 0.5]  # without a residual Kaufman's derivative is that of the residual itself
    r, J, _ = project(decays(z), near, derivative)
    ends = [[solve(decays(z + sign * h * e), near).residual(near) for sign in (1.0, -1.0)] for e in np.eye(2)]
    differences = np.stack([(a - b) / (2 * h) for a, b in ends], axis=1)
    assert pytest.approx(differences, abs=1e-8) == J
