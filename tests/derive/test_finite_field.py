"""Arithmetic and linear algebra modulo the prime, against rational arithmetic and SymPy."""

from __future__ import annotations

from fractions import Fraction

import pytest
import sympy as sp
from hypothesis import given
from hypothesis import strategies as st

from rrrgen.program.finite_field import PRIME, Residue, row_echelon, square_root

fractions = st.fractions(min_value=-1000, max_value=1000, max_denominator=1000)


def test_the_modulus_is_a_prime_that_is_3_modulo_4():
    assert sp.isprime(PRIME)
    assert PRIME % 4 == 3


@given(fractions, fractions)
def test_the_image_of_a_result_is_the_result_of_the_images(a, b):
    x, y = Residue.of(a), Residue.of(b)
    assert x + y == Residue.of(a + b) == x + b == a + y
    assert x - y == Residue.of(a - b) == x - b == a - y
    assert x * y == Residue.of(a * b) == x * b == a * y
    assert -x == Residue.of(-a)
    if b:
        assert x / y == Residue.of(a / b) == x / b


def test_multiples_of_zero_and_one_cost_nothing():
    x = Residue(5)
    assert (x * 0, x * 1, x + 0) == (0, x, x)
    assert type(x * 0) is int


@pytest.mark.parametrize("prime", [2, 3, 5, 7, 11, 13, 17, 19])
def test_small_primes_are_squares(prime):
    root = square_root(prime)
    assert root is not None
    assert root * root % PRIME == prime


def test_a_number_without_a_root_has_none():
    assert square_root(PRIME - 1) is None  # -1 is no square modulo a prime that is 3 modulo 4


@given(st.lists(st.lists(st.integers(-5, 5), min_size=5, max_size=5), min_size=1, max_size=6))
def test_the_echelon_form_has_the_pivots_of_the_rationals(rows):
    expected, pivots = sp.Matrix(rows).rref()  # entries so small that no minor is a multiple of the prime
    reduced, found = row_echelon([[value % PRIME for value in row] for row in rows])
    assert found == list(pivots)
    images = [[Residue.of(Fraction(int(v.p), int(v.q))).value for v in expected.row(r)] for r in range(len(pivots))]
    assert reduced == images
