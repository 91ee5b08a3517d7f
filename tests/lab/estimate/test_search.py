"""The search for least squares: known optima, SciPy as oracle, states on a manifold, priors, weights, limits."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from rrrgen.lab.estimate.linear import project, solve
from rrrgen.lab.estimate.search import search


def rosenbrock(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Residuals and derivatives with the optimum [1, 1] (Rosenbrock 1960)."""
    return np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]]), np.array([[-20.0 * x[0], 10.0], [-1.0, 0.0]])


T = np.linspace(0.0, 4.0, 80)
NOISY = 2.0 * np.exp(-0.8 * T) + 0.3 + 0.05 * np.random.default_rng(0).normal(size=80)


def decay(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    e = np.exp(-x[1] * T)
    return x[0] * e + x[2] - NOISY, np.stack([e, -x[0] * T * e, np.ones(80)], axis=1)


@pytest.mark.parametrize("start", [[-1.2, 1.0], [5.0, -3.0], [0.0, 0.0]])
def test_curved_valley(start):
    end = search(np.array(start), rosenbrock)
    assert end.state == pytest.approx([1.0, 1.0], abs=1e-12)
    assert end.steps <= end.trials < 100


def test_same_optimum_as_scipy_and_covariance_from_the_last_derivatives():
    end = search(np.array([1.0, 0.1, 0.0]), decay, small_gain=1e-14)
    oracle = least_squares(lambda x: decay(x)[0], [1.0, 0.1, 0.0], xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert end.ended_by in ("gain", "optimum")
    assert end.state == pytest.approx(oracle.x, rel=1e-7)
    assert end.cost == pytest.approx(2.0 * oracle.cost, rel=1e-12)
    assert solve(end.J, end.r).covariance == pytest.approx(np.linalg.inv(oracle.jac.T @ oracle.jac), rel=1e-5)


def test_steps_do_not_depend_on_units():
    units = np.array([1e8, 1e-6, 1e3])

    def other(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r, J = decay(x / units)
        return r, J / units

    start = np.array([1.0, 0.1, 0.0])
    one, two = search(start, decay, steps=3), search(start * units, other, steps=3)
    assert two.state / units == pytest.approx(one.state, rel=1e-9)


def test_projected_problem_has_the_same_optimum():
    def reduced(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        e = np.exp(-z[0] * T)
        A = np.stack([e, np.ones(80)], axis=1)
        r, J, _ = project(A, NOISY, lambda c: np.stack([-T * e * c[0]], axis=1))
        return r, J

    whole = search(np.array([1.0, 0.1, 0.0]), decay)
    assert search(np.array([0.1]), reduced).state[0] == pytest.approx(whole.state[1], rel=1e-6)


def test_state_on_a_manifold():
    """Attitude of a body (Wahba's problem) against SciPy's Rotation.align_vectors."""
    rng = np.random.default_rng(2)
    true, p = Rotation.random(rng=rng), rng.normal(size=(20, 3))
    measured = true.apply(p) + 0.01 * rng.normal(size=(20, 3))

    def linearise(R: Rotation) -> tuple[np.ndarray, np.ndarray]:
        turned = R.apply(p)
        J = -np.cross(turned[:, None, :], np.eye(3)[None])  # d(w x v)/dw_i = e_i x v
        return (turned - measured).ravel(), J.transpose(0, 2, 1).reshape(-1, 3)

    end = search(Rotation.identity(), linearise, moved=lambda R, step: Rotation.from_rotvec(step) * R)
    oracle, _ = Rotation.align_vectors(measured, p)
    assert (end.state.inv() * oracle).magnitude() < 1e-8


def test_prior_is_further_rows():
    w = np.array([0.5, 3.0])

    def stacked(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r, J = rosenbrock(x)
        return np.concatenate([r, w * x]), np.vstack([J, np.diag(w)])

    start = np.array([-1.2, 1.0])
    one = search(start, stacked)
    for cost in (None, lambda x: float(np.sum(rosenbrock(x)[0] ** 2))):
        other = search(start, rosenbrock, cost=cost, prior=lambda x: (w * x, np.diag(w)))
        assert other.state == pytest.approx(one.state, abs=1e-9)
        assert other.cost == pytest.approx(one.cost, rel=1e-12)


def test_weights_are_renewed_after_each_step():
    """Iteratively reweighted least squares of a line through outliers ends at the stationary point of its weights."""
    t, y = np.linspace(0, 1, 40), 2.0 + 3.0 * np.linspace(0, 1, 40)
    y = y + 0.01 * np.random.default_rng(3).normal(size=40)
    y[::7] += 5.0
    A = np.stack([np.ones(40), t], axis=1)
    weight = np.ones(40)

    def renew(x: np.ndarray) -> None:
        weight[:] = 1.0 / np.sqrt(np.maximum(1.0, np.abs(A @ x - y) / 0.03))

    end = search(np.zeros(2), lambda x: ((A @ x - y) * weight, A * weight[:, None]), after=renew, steps=200)
    assert end.J.T @ end.r == pytest.approx(np.zeros(2), abs=1e-5)
    assert end.state == pytest.approx([2.0, 3.0], abs=0.03)


def test_refused_steps_raise_the_damping():
    """The logarithm is not defined on the other side, where a full step would end."""

    def linearise(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        with np.errstate(invalid="ignore"):
            return np.log(x) + 2.0, 1.0 / x[:, None]

    end = search(np.array([30.0]), linearise)
    assert end.trials > end.steps
    assert end.state == pytest.approx([np.exp(-2.0)], rel=1e-12)


def test_limits_and_reasons():
    start = np.array([-1.2, 1.0])
    assert search(start, rosenbrock, steps=3).ended_by == "steps"
    assert search(start, rosenbrock, steps=3).steps == 3
    few = search(start, rosenbrock, trials=4)
    assert (few.ended_by, few.trials) == ("trials", 4)
    assert search(start, rosenbrock, steps=0).steps == 0
    assert search(start, rosenbrock, small_step=1e9).steps == 1
    assert search(start, rosenbrock, small_gain=1.0).ended_by == "gain"
    assert search(np.ones(2), rosenbrock).ended_by == "optimum"
    assert search(start, rosenbrock, moved=lambda x, step: x).ended_by == "tries"
    assert search(np.array([np.nan, 1.0]), rosenbrock).ended_by == "not finite"
    assert search(np.array([1e120, 1.0]), rosenbrock).ended_by == "not finite"


def test_largest_bounds_every_step():
    visited = []
    end = search(np.array([-1.2, 1.0]), rosenbrock, largest=np.array([0.1, np.inf]), after=lambda x: visited.append(x))
    steps = np.diff(np.array([[-1.2, 1.0], *visited]), axis=0)
    assert np.max(np.abs(steps[:, 0])) <= 0.1 + 1e-15
    assert end.state == pytest.approx([1.0, 1.0], abs=1e-10)


def test_unknowns_without_effect_stay():
    def linearise(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r, J = rosenbrock(x[:2])
        return r, np.column_stack([J, np.zeros(2)])

    end = search(np.array([-1.2, 1.0, 7.0]), linearise)
    assert end.state == pytest.approx([1.0, 1.0, 7.0], abs=1e-10)


def test_progress_counts_steps():
    numbers: list[int] = []
    end = search(np.array([-1.2, 1.0]), rosenbrock, progress=numbers.append)
    assert numbers[: end.steps] == list(range(end.steps))
