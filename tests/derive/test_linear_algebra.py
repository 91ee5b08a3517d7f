"""Factorization along a tree: from the tips, without fill-in."""

from __future__ import annotations

import numpy as np

from rrrgen.derive.recursions.linear_algebra import factorize
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
