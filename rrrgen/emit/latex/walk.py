"""Writes an exact expression as LaTeX, plain text or MathML: visits its parts and joins the markup of each."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Protocol

import sympy as sp

from rrrgen.base.errors import BackendError
from rrrgen.derive.closed_forms.decimals import decimal_text, with_decimals_inside
from rrrgen.emit.latex.notation import Notation, notation, short_angle

_SUM, _PRODUCT, _POWER, _ATOM = range(4)

_ARGUMENTS = dict.fromkeys(("sin", "cos", "tan", "asin", "acos", "atan", "sign", "Abs", "exp", "tanh"), 1) | {
    "atan2": 2
}
"""Number of arguments of every function that has a notation."""


class Markup(Protocol):
    """The interface of a markup language: one method per kind of formula, given the text of its parts."""

    def symbol(self, parts: Notation) -> str:
        """The markup of a letter with dots and subscript."""
        ...

    def number(self, text: str) -> str:
        """The markup of an unsigned number."""
        ...

    def total(self, terms: Sequence[tuple[bool, str]]) -> str:
        """The markup of a sum, given its terms as (whether negative, text without sign)."""
        ...

    def product(self, factors: Sequence[str]) -> str:
        """The markup of a product."""
        ...

    def fraction(self, numerator: str, denominator: str) -> str:
        """The markup of a quotient."""
        ...

    def power(self, base: str, exponent: str) -> str:
        """The markup of a power."""
        ...

    def root(self, argument: str) -> str:
        """The markup of a square root."""
        ...

    def function(self, name: str, argument: str, exponent: str) -> str:
        """The markup of ``name(argument)``, to the power ``exponent`` unless that is empty."""
        ...

    def listed(self, arguments: Sequence[str]) -> str:
        """The markup of the arguments of a function, separated by commas."""
        ...

    def group(self, content: str) -> str:
        """The markup of an expression in parentheses."""
        ...


def _by_parameters(term: sp.Expr) -> list[tuple[str, int]]:
    """The sort key of a term: groups terms with the same parameters, with p9 before p10."""
    names = [str(symbol) for symbol in term.free_symbols]
    numbered = [re.fullmatch(r"(.*?)(\d*)", name) for name in names if not re.fullmatch(r"d{0,2}q\d+", name)]
    return sorted(((match[1], int(match[2] or 0)) for match in numbered if match), reverse=True)


class Walk:
    """Writes expressions in one markup; with ``short_trig``, cos(q2 + q3) becomes c_{23} and its sine s_{23}."""

    def __init__(self, markup: Markup, short_trig: bool = True) -> None:
        self.markup = markup
        self.short_trig = short_trig

    def write(self, expression: sp.Expr) -> str:
        """The markup of ``expression``. Raises :class:`BackendError` for what a closed form cannot contain."""
        return self._write(expression, _SUM)

    def terms(self, expression: sp.Expr) -> list[tuple[bool, str]]:
        """The terms of a sum in printing order, each as (whether negative, text without sign)."""
        return [self._signed(term) for term in self.ordered(expression)]

    def ordered(self, expression: sp.Expr) -> list[sp.Expr]:
        """The terms of a sum in printing order."""
        return sorted(expression.as_ordered_terms(), key=_by_parameters)

    def _signed(self, term: sp.Expr) -> tuple[bool, str]:
        negative = bool(term.could_extract_minus_sign()) and not term.is_Add
        return negative, self._write(-term if negative else term, _PRODUCT)

    def _write(self, expression: sp.Expr, needed: int) -> str:
        text, strength = self._node(expression)
        return text if strength >= needed else self.markup.group(text)

    def _node(self, e: sp.Expr) -> tuple[str, int]:
        markup = self.markup
        if e.is_Symbol:
            return markup.symbol(notation(str(e))), _ATOM
        if e is sp.pi:
            return markup.symbol(Notation("pi")), _ATOM
        if e.is_Add:
            return markup.total(self.terms(e)), _SUM
        if e.is_number and (e.is_Rational or e.is_Float):
            return self._number(e)
        if e.is_Mul:
            return self._product(e)
        if e.is_Pow:
            return self._power(e.base, e.exp)
        if e.is_Function:
            return self._function(e, ""), _ATOM
        raise BackendError(f"no notation for {type(e).__name__} in a closed form")

    def _number(self, value: sp.Expr) -> tuple[str, int]:
        if value < 0:
            return self.markup.total([(True, self._write(-value, _PRODUCT))]), _SUM
        text = f"{float(value):.6g}" if value.is_Float else decimal_text(value)
        if text is not None:
            return self.markup.number(text), _ATOM
        return self.markup.fraction(self.markup.number(str(value.p)), self.markup.number(str(value.q))), _PRODUCT

    def _product(self, e: sp.Expr) -> tuple[str, int]:
        if e.could_extract_minus_sign():
            return self.markup.total([(True, self._write(-e, _PRODUCT))]), _SUM
        e = with_decimals_inside(e)
        if not e.is_Mul:
            return self._node(e)
        above, below = [], []
        for factor in e.as_ordered_factors():
            if factor.is_Rational and decimal_text(factor) is not None:
                above += [factor] if factor != 1 else []
            elif factor.is_Rational:
                above += [sp.Integer(factor.p)] if factor.p != 1 else []
                below += [sp.Integer(factor.q)] if factor.q != 1 else []
            elif factor.is_Pow and factor.exp.is_number and factor.exp.is_negative:
                below.append(factor.base ** (-factor.exp))
            else:
                above.append(factor)
        if not below:
            return self._times(above), _PRODUCT
        return self.markup.fraction(self._times(above, alone=True), self._times(below, alone=True)), _PRODUCT

    def _times(self, factors: Sequence[sp.Expr], alone: bool = False) -> str:
        if len(factors) == 1 and alone:
            return self._write(factors[0], _SUM)
        if not factors:
            return self.markup.number("1")
        return self.markup.product([self._write(factor, _POWER) for factor in factors])

    def _power(self, base: sp.Expr, exponent: sp.Expr) -> tuple[str, int]:
        if exponent == sp.Rational(1, 2):
            return self.markup.root(self._write(base, _SUM)), _ATOM
        if exponent.is_number and exponent.is_negative:
            return self.markup.fraction(self.markup.number("1"), self._write(base**-exponent, _SUM)), _PRODUCT
        raised = self._write(exponent, _SUM)
        if base.is_Function:
            return self._function(base, raised), _POWER
        return self.markup.power(self._write(base, _ATOM), raised), _POWER

    def _function(self, e: sp.Expr, exponent: str) -> str:
        name = e.func.__name__
        if len(e.args) != _ARGUMENTS.get(name, 0):
            raise BackendError(f"no notation for the function {name} in a closed form")
        arguments = [sp.expand(argument) for argument in e.args]
        short = short_angle(arguments[0]) if self.short_trig and name in ("sin", "cos") else None
        if short is None:
            text = self.markup.listed([self.write(argument) for argument in arguments])
            return self.markup.function({"sign": "sgn", "Abs": "abs"}.get(name, name), text, exponent)
        letter = self.markup.symbol(Notation(name[0], (short,)))
        return self.markup.power(letter, exponent) if exponent else letter
