"""Polynomials in sines and cosines: one normal form, the same values as SymPy's expressions."""

from __future__ import annotations

from fractions import Fraction

import pytest
import sympy as sp
from hypothesis import given
from hypothesis import strategies as st

from rrrgen.program.polynomials import PolynomialRing, root_factors, to_expression

x, a = sp.symbols("x a", real=True)
q = sp.Symbol("q", real=True)
COS, SIN, ROOT = sp.cos(q), sp.sin(q), sp.sqrt(2)
RING = PolynomialRing([x, a], [(COS, SIN)], [ROOT])
ATOMS = (x, a, COS, SIN, ROOT, sp.Rational(2, 3), sp.Integer(-1))

expressions = st.recursive(
    st.sampled_from(ATOMS),
    lambda inner: st.builds(lambda f, g, kind: f + g if kind else f * g, inner, inner, st.booleans()),
    max_leaves=8,
)


@given(expressions)
def test_conversion_keeps_the_value(expression):
    value = to_expression(RING.convert(expression))
    point = {x: sp.Rational(3, 7), a: sp.Rational(-5, 4), q: sp.Rational(9, 10)}
    assert abs(sp.N((value - expression).subs(point), 40)) < sp.Float("1e-30")


@given(expressions, expressions)
def test_equal_expressions_have_equal_polynomials(f, g):
    u, v = RING.convert(f), RING.convert(g)
    assert u * v - v * u == 0
    assert (u + v) * (u - v) == u * u - v * v


def test_the_relations_are_applied():
    c, s, r = (RING.generator(g) for g in (COS, SIN, ROOT))
    assert c * c + s * s == 1
    assert isinstance(c * c + s * s, Fraction)  # numbers become plain
    assert r * r == 2
    assert (s * s * s) == s - c * c * s


def test_conjugation_changes_the_sign_of_one_generator():
    c, s, r = (RING.generator(g) for g in (COS, SIN, ROOT))
    value = c * s + r + 3 * r * s
    results = [conjugate(value) for conjugate in RING.conjugations()]
    assert -c * s + r - 3 * r * s in results
    assert c * s - r - 3 * r * s in results


def test_derivatives_and_coefficients():
    X, A, c = (RING.generator(g) for g in (x, a, COS))
    value = X * X * A + 2 * X * c + 5
    assert value.derivative(x) == 2 * X * A + 2 * c
    parts = value.coefficients([x])
    assert {powers: to_expression(part) for powers, part in parts.items()} == {(0,): 5, (1,): 2 * COS, (2,): a}


def test_what_is_no_element_is_refused():
    with pytest.raises(KeyError):
        RING.convert(sp.exp(x))


def test_roots_split_into_roots_of_primes():
    assert root_factors(sp.sqrt(6)) == [sp.sqrt(2), sp.sqrt(3)]
    assert root_factors(sp.Symbol("y")) == []
