"""Triangular factors of the rows: in any pieces and order, without rows out of use, restricted and mapped."""

from functools import reduce

import numpy as np
import pytest

from lab.identify.regression_problems import EXACT, NAMES, P, pieces, problem
from rrrgen.lab.estimate.regression import least_squares, weighted_least_squares
from rrrgen.lab.estimate.tsqr import JointFactors, Rows, factor_rows


def test_factors_arrive_in_any_pieces_and_order():
    rows, _ = problem()
    whole = weighted_least_squares(factor_rows(rows), NAMES)
    many, few = ([factor_rows(part) for part in pieces(rows, count)] for count in (57, 3))
    for factors in (reduce(JointFactors.merge, many), reduce(JointFactors.merge, few[::-1])):
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
    found = least_squares(factors.select_columns(kept, {1: 0.7}), [NAMES[i] for i in kept])
    y = (rows.tau - rows.W[..., 1] * 0.7).ravel()
    np.testing.assert_allclose(found.x, np.linalg.lstsq(rows.W[..., kept].reshape(-1, 6), y, rcond=None)[0], rtol=EXACT)
    rng = np.random.default_rng(4)
    T, known = rng.normal(size=(P, 3)), rng.normal(size=P)
    z = rng.normal(size=3)
    np.testing.assert_allclose(
        factors.substitute(T, known).residual_squares(z), factors.residual_squares(T @ z + known), rtol=EXACT
    )


def test_a_column_of_round_off_counts_as_zero_and_a_short_one_does_not():
    rows, _ = problem()
    for size, lost in ((1e-14, True), (1e-9, False)):
        W = rows.W * np.where(np.arange(P) == 2, size, 1.0)
        factors = factor_rows(Rows(rows.t, W, rows.tau, rows.use, rows.segment)).without_round_off()
        solution = least_squares(factors, NAMES)
        assert solution.rank == P - lost
        assert (abs(solution.x[2]) < 1e-9) == lost


def test_factors_of_different_problems_do_not_merge():
    from rrrgen.base.errors import InputError

    a = JointFactors(np.zeros((2, 3, 3)), np.zeros(2, np.int64))
    b = JointFactors(np.zeros((2, 4, 4)), np.zeros(2, np.int64))
    with pytest.raises(InputError):
        a.merge(b)
