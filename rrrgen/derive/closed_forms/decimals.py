"""Exact numbers as people write them: 9.81 where SymPy prints 981/100."""

from __future__ import annotations

import sympy as sp


def decimal_text(value: sp.Rational) -> str | None:
    """Print ``value`` as an integer or a decimal fraction; None if the fraction p/q is easier to read.

    Simple fractions stay fractions; infinite or very long decimal expansions are shown to 12 digits.
    """
    if value.q == 1:
        return str(value.p)
    rest = int(value.q)
    for prime in (2, 5):
        while rest % prime == 0:
            rest //= prime
    if value.q <= 10 or (rest != 1 and max(abs(value.p), value.q) < 10**6):
        return None
    return f"{float(value):.12g}"


def with_decimals_inside(product: sp.Expr) -> sp.Expr:
    """Multiply decimal factors into sums, so that the numbers of the robot file appear.

    ``0.025*(13*c1 + 11*c12)`` becomes ``0.325*c1 + 0.275*c12``.
    """
    number, rest = product.as_coeff_Mul()
    if not number.is_Rational or number.q == 1 or decimal_text(number) is None:
        return product
    factors = list(sp.Mul.make_args(rest))
    for k, factor in enumerate(factors):
        if factor.is_Add:
            factors[k] = sp.Add(*(number * term for term in factor.args))
            return sp.Mul(*factors)
    return product


def with_decimals(expression: sp.Expr) -> sp.Expr:
    """``expression`` for printing, no longer exact: rational numbers that read better as decimals become floats.

    Exponents and simple fractions such as 1/2 stay as they are.
    """
    if expression.is_Rational:
        text = decimal_text(expression)
        return expression if expression.q == 1 or text is None else sp.Float(text)
    if expression.is_Mul:
        expression = with_decimals_inside(expression)
    if expression.is_Pow:
        return with_decimals(expression.base) ** expression.exp
    if expression.args:
        return expression.func(*(with_decimals(part) for part in expression.args))
    return expression
