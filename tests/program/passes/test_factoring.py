"""The search for common factors: exact, never more expensive, and good on examples whose best form is known."""

from __future__ import annotations

from fractions import Fraction

from hypothesis import given
from hypothesis import strategies as st

from rrrgen.program.passes.factoring import (
    ADDITION,
    MULTIPLICATION,
    Factoring,
    divide,
    split_common,
    term_cost,
    without,
)

LITERALS = 5
HALF = Fraction(1, 2)
A, B, C, D, E = range(LITERALS)

MONOMIAL = st.lists(st.integers(0, LITERALS - 1), max_size=4).map(lambda m: tuple(sorted(m)))
COEFFICIENT = st.sampled_from([Fraction(1), Fraction(-1), Fraction(2), HALF, Fraction(-3, 5)])
POLYNOMIAL = st.dictionaries(MONOMIAL, COEFFICIENT, max_size=8)


def weight(polynomials) -> int:
    """What the search minimises: products and, a little cheaper, sums."""
    return sum(
        MULTIPLICATION * sum(term_cost(m, (abs(c).numerator, c.denominator)) for m, c in p.items())
        + ADDITION * max(len(p) - 1, 0)
        for p in polynomials
    )


def substituted(polynomials, count):
    """The given polynomials with all extracted literals replaced by their definitions."""
    definitions = {LITERALS + k: p for k, p in enumerate(polynomials[count:])}
    done: dict[int, dict] = {}

    def literal(k):
        if k < LITERALS:
            return {(k,): Fraction(1)}
        if k not in done:
            done[k] = expand(definitions[k])
        return done[k]

    def expand(p):
        total: dict = {}
        for monomial, coefficient in p.items():
            product = {(): coefficient}
            for k in monomial:
                product = times(product, literal(k))
            for m, c in product.items():
                total[m] = total.get(m, 0) + c
        return {m: c for m, c in total.items() if c}

    return [expand(p) for p in polynomials[:count]]


def times(x, y):
    total: dict = {}
    for m, c in x.items():
        for n, d in y.items():
            key = tuple(sorted(m + n))
            total[key] = total.get(key, 0) + c * d
    return {m: c for m, c in total.items() if c}


def run(*polynomials):
    search = Factoring([dict(p) for p in polynomials], LITERALS)
    search.run()
    return search.polynomials


@given(st.lists(POLYNOMIAL, min_size=1, max_size=4))
def test_the_system_stays_the_same_and_its_cost_never_rises(system):
    system = [{m: c for m, c in p.items() if c} for p in system]
    found = run(*system)
    assert substituted(found, len(system)) == system
    assert weight(found) <= weight(system)


def one(*terms):
    return dict.fromkeys((tuple(sorted(t)) for t in terms), Fraction(1))


def test_a_product_of_sums_is_found():
    """a c + a d + b c + b d = (a + b)(c + d): one product and two sums."""
    assert weight(run(one((A, C), (A, D), (B, C), (B, D)))) == MULTIPLICATION + 2 * ADDITION


def test_a_common_factor_is_taken_out():
    assert weight(run(one((A, B), (A, C), (A, D)))) == MULTIPLICATION + 2 * ADDITION


def test_a_sum_used_twice_is_computed_once():
    system = one((A, C), (B, C)), one((A, D), (B, D))
    assert weight(run(*system)) == 2 * MULTIPLICATION + ADDITION


def test_a_difference_and_its_negative_are_one():
    minus = {(A, C): Fraction(1), (B, C): Fraction(-1)}
    reverse = {(A, D): Fraction(-1), (B, D): Fraction(1)}
    assert weight(run(minus, reverse)) == 2 * MULTIPLICATION + ADDITION


def test_a_scaled_product_used_twice_is_computed_once():
    system = {(A, B, C): HALF, (D,): Fraction(1)}, {(A, B, E): -HALF}
    assert weight(run(*system)) == 4 * MULTIPLICATION + ADDITION


def test_nothing_to_find_leaves_everything():
    system = [one((A, B), (C, D)), one((E,))]
    assert run(*system) == system


def test_the_same_system_gives_the_same_result():
    system = [one((A, B), (A, C), (B, D), (C, D)), one((A, A), (B, B)), one((A, E), (D, E))]
    assert run(*system) == run(*system)


def test_arithmetic_of_terms():
    assert divide((3, 2), (-6, 5)) == (-5, 4)
    assert split_common((A, A, B, D), (A, C, D)) == ((A, D), (A, B), (C,))
    assert without((A, A, B), A) == (A, B)
    assert [term_cost((A, B), (1, 1)), term_cost((A, B), (-1, 1)), term_cost((A,), (1, 2)), term_cost((), (3, 2))] == [
        1,
        1,
        1,
        0,
    ]
