"""The shorter form of trigonometric polynomials: never longer, always equal."""

from __future__ import annotations

import sympy as sp
from hypothesis import given
from hypothesis import strategies as st

from rrrgen.derive.closed_forms import shorter_form
from rrrgen.program.polynomials import PolynomialRing

q1, q2, q3 = sp.symbols("q1 q2 q3", real=True)
m = sp.Symbol("m", real=True)
ANGLES = (q1, q2, q2 + q3)
PAIRS = [(sp.cos(angle), sp.sin(angle)) for angle in ANGLES]
RING = PolynomialRing([m], PAIRS)
FACTORS = [m, *(g for pair in PAIRS for g in pair)]


def element(expression: sp.Expr):
    return RING.convert(sp.expand(expression))


def test_a_product_over_parallel_axes_becomes_the_angle_between_them():
    product = sp.cos(q2) * sp.cos(q2 + q3) + sp.sin(q2) * sp.sin(q2 + q3)
    assert shorter_form(element(m * product), PAIRS) == m * sp.cos(q3)


def test_angles_of_different_blocks_are_not_mixed():
    product = sp.cos(q1) * sp.cos(q2) - sp.sin(q1) * sp.sin(q2)
    form = shorter_form(element(product), PAIRS)
    assert form == product
    assert not any(angle.has(q1) and angle.has(q2) for angle in (f.args[0] for f in form.atoms(sp.cos, sp.sin)))


def test_a_square_stays_a_square():
    assert shorter_form(element(sp.cos(q2) ** 2), PAIRS) == sp.cos(q2) ** 2


@given(st.lists(st.tuples(st.integers(-4, 4), st.lists(st.sampled_from(FACTORS), max_size=4)), min_size=1, max_size=4))
def test_the_value_is_kept_and_the_form_is_not_longer(terms):
    expression = sp.Add(m, *(sp.Mul(k, *factors) for k, factors in terms))
    value = element(expression)
    if not hasattr(value, "expression"):
        return  # everything cancelled: a plain number has one form
    form = shorter_form(value, PAIRS)
    assert form.count_ops() <= sp.factor_terms(value.expression()).count_ops()
    point = {q1: sp.Rational(3, 10), q2: sp.Rational(-7, 5), q3: sp.Rational(11, 10), m: sp.Rational(13, 10)}
    assert abs(sp.N((form - expression).subs(point), 40)) < sp.Float("1e-30")
