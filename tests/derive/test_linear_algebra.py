"""Factorization: along a tree from the tips, without fill-in; limits that keep every value finite."""

from __future__ import annotations

import numpy as np
import pytest

from rrrgen.derive.recursions.linear_algebra import SHORT, factorize
from rrrgen.program import Builder, Port
from rrrgen.program.evaluation import evaluate

"""Turns of any size and by quarters, before revolute and prismatic rows, parallel and tilted ones, at the base."""


def test_a_tree_is_factorized_from_the_tips_without_fill_in():
    """Two branches of two joints on one: L has no entry between them, and solutions are those of NumPy."""
    pattern = np.array([[1, 1, 1, 1, 1], [1, 1, 1, 0, 0], [1, 1, 1, 0, 0], [1, 0, 0, 1, 1], [1, 0, 0, 1, 1]])
    b = Builder()
    values, right = b.input(Port("M", (5, 5))), b.input(Port("b", (5,)))
    M = [[values[5 * i + j] if pattern[i, j] else 0 for j in range(5)] for i in range(5)]
    factors = factorize(b, M, tips_first=True)
    filled = {(factors.order[i], factors.order[j]) for i in range(5) for j in range(i) if factors.L[i][j] != 0}
    assert filled == {(0, 1), (0, 2), (0, 3), (0, 4), (1, 2), (3, 4)}
    inverse = [value for row in factors.negative_inverse() for value in row]
    outputs = [(Port("x", (5,)), factors.solve(list(right))), (Port("N", (5, 5)), inverse)]
    program = b.program("solution", [*outputs, (Port("status", ()), [factors.status])])
    rng = np.random.default_rng(2)
    matrix, rhs = pattern * (0.1 + 0.1 * rng.random()) + np.diag(1 + rng.random(5)), rng.random(5)
    x, negative, status = evaluate(program, matrix, rhs)
    np.testing.assert_allclose(matrix @ x, rhs, rtol=1e-13)
    np.testing.assert_allclose(matrix @ negative, -np.eye(5), atol=1e-13)
    assert status == 0


@pytest.mark.parametrize("tips_first", [False, True])
def test_limits_change_no_solution_of_an_ill_conditioned_matrix(tips_first):
    """Diagonal entries from 1e-6 to 1e6 and pivots down to 1e-8 of them: entries of L far below their limit."""
    b = Builder()
    values, right = b.input(Port("M", (6, 6))), b.input(Port("b", (6,)))
    factors = factorize(b, [list(values[6 * i : 6 * i + 6]) for i in range(6)], tips_first=tips_first)
    program = b.program("solution", [(Port("x", (6,)), factors.solve(list(right))), (Port("s", ()), [factors.status])])
    rng = np.random.default_rng(4)
    scale = np.diag(10.0 ** np.array([-3, 3, 0, 2, -2, 1]))
    root = np.eye(6) + 1e4 * np.outer(rng.random(6), rng.random(6))
    matrix, wanted = scale @ root @ root.T @ scale, rng.random(6)
    x, status = evaluate(program, matrix, matrix @ wanted)
    assert status == 0
    np.testing.assert_allclose(matrix @ x, matrix @ wanted, rtol=1e-9)


@pytest.mark.parametrize("size", [SHORT, 7])
def test_every_value_is_finite_whatever_the_matrix(size):
    """Zero or nearly, indefinite, singular up to round-off: no node overflows, and what is refused is zero."""
    b = Builder()
    values, right = b.input(Port("M", (size, size))), b.input(Port("b", (size,)))
    factors = factorize(b, [list(values[size * i : size * i + size]) for i in range(size)])
    nodes = [*(value for row in factors.L for value in row), *factors.pivots, *factors.reciprocals]
    everything = [b.add(value, 0) for value in [*nodes, *factors.forward(list(right))]]
    outputs = [(Port("x", (size,)), factors.solve(list(right))), (Port("s", ()), [factors.status])]
    program = b.program("solution", [*outputs, (Port("all", (len(everything),)), everything)])
    rng = np.random.default_rng(3)
    vector = rng.uniform(-1, 1, size)
    zero, ones = np.zeros((size, size)), np.ones((size, size))
    for matrix in (zero, ones, ones - 2 * np.eye(size), np.outer(vector, vector), 1e-200 * np.eye(size), 10 * ones):
        x, status, every = evaluate(program, matrix, vector)
        assert np.isfinite(every).all()
        assert status == (1 if matrix[0, 0] != 1e-200 else 0)
        assert np.isfinite(x).all()
        assert status == 0 or not x.any()
