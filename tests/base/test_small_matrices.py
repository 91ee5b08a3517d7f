"""Small matrices as lists against NumPy: singular values, definiteness, roots of polynomials."""

from __future__ import annotations

import numpy as np
import pytest

from rrrgen.base.small_matrices import is_positive_definite, polynomial_roots, singular_values


@pytest.mark.parametrize("shape", [(1, 1), (3, 2), (2, 5), (6, 6), (6, 7)])
def test_singular_values(shape):
    rng = np.random.default_rng(sum(shape))
    for _ in range(20):
        A = rng.normal(size=shape) * 10.0 ** rng.uniform(-3, 3, shape[1])
        expected = np.linalg.svd(A, compute_uv=False)
        np.testing.assert_allclose(singular_values(A.tolist()), expected, rtol=1e-9, atol=1e-12 * expected[0])


def test_singular_values_of_dependent_columns():
    rng = np.random.default_rng(0)
    A = rng.normal(size=(6, 3)) @ rng.normal(size=(3, 6))
    values = singular_values(A.tolist())
    assert len(values) == 6
    assert max(values[3:]) < 1e-14 * values[0]
    assert singular_values([[0.0, 0.0], [0.0, 0.0]]) == [0.0, 0.0]


def test_definite_matrices():
    rng = np.random.default_rng(1)
    Q, _ = np.linalg.qr(rng.normal(size=(5, 5)))
    for smallest in (2.0, 1e-3, -1e-3):
        A = Q @ np.diag([smallest, 1.0, 2.0, 3.0, 4.0]) @ Q.T
        assert is_positive_definite(A.tolist()) is (smallest > 0.0)
        assert is_positive_definite(A.tolist(), 0.5) is (smallest > 0.5)
    assert not is_positive_definite([[float("nan")]])
    assert not is_positive_definite([[float("inf")]])
    assert not is_positive_definite([[0.0]])


@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_roots(degree):
    rng = np.random.default_rng(degree)
    for _ in range(50):
        roots = rng.normal(size=degree) + 1j * rng.normal(size=degree)
        found = polynomial_roots(np.poly(roots).tolist())
        assert len(found) == degree
        assert max(min(abs(z - root) for z in found) for root in roots) < 1e-9


def test_roots_of_special_polynomials():
    assert polynomial_roots([]) == []
    assert polynomial_roots([0.0, 0.0]) == []
    assert polynomial_roots([5.0]) == []
    assert polynomial_roots([0.0, 2.0, 1.0]) == [pytest.approx(-0.5)]
    assert sorted(z.real for z in polynomial_roots([1.0, 0.0, -1.0, 0.0])) == pytest.approx([-1.0, 0.0, 1.0])
    double = polynomial_roots(np.poly([0.5, 0.5, -2.0, 3.0]).tolist())  # a double root, to half of the digits
    assert sorted(z.real for z in double) == pytest.approx([-2.0, 0.5, 0.5, 3.0], abs=1e-6)
    circle = polynomial_roots([1.0, 0.0, 0.0, 0.0, 1.0])
    assert [abs(z) for z in circle] == pytest.approx([1.0] * 4)
