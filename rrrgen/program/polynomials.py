"""Exact polynomials in sines, cosines and symbols, always in normal form.

A :class:`PolynomialRing` has generators for everything that is not rational: named parameters, joint variables, base
parameters, and a cosine and a sine for each angle. The relation ``s**2 = 1 - c**2`` (and ``r**2 = k`` for a square
root) is applied after every product. Equal expressions therefore have equal polynomials, and a zero is recognized at
once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from fractions import Fraction
from typing import Any

import sympy as sp
from sympy.polys.rings import PolyElement, ring


class PolynomialRing:
    """Polynomials over the rationals, modulo ``s**2 = 1 - c**2`` for sines and ``r**2 = k`` for square roots.

    ``symbols`` are generators without relations, ``pairs`` the (cosine, sine) of each angle, ``roots`` square roots of
    primes.
    """

    def __init__(
        self,
        symbols: Sequence[sp.Expr],
        pairs: Sequence[tuple[sp.Expr, sp.Expr]] = (),
        roots: Sequence[sp.Expr] = (),
    ) -> None:
        self._arguments = tuple(symbols), tuple(pairs), tuple(roots)
        self.generators: list[sp.Expr] = [*symbols, *(g for pair in pairs for g in pair), *roots]
        names = [f"g{k}" for k in range(len(self.generators))] or ["g0"]
        self.ring = ring(names, sp.QQ)[0]
        self._gens = self.ring.gens
        self.index = {g: k for k, g in enumerate(self.generators)}
        self._squares: dict[int, PolyElement] = {}
        for cosine, sine in pairs:
            self._squares[self.index[sine]] = 1 - self._gens[self.index[cosine]] ** 2
        for root in roots:
            self._squares[self.index[root]] = self.ring(sp.QQ.from_sympy(sp.expand(root**2)))

    def __reduce__(self) -> tuple[Any, ...]:
        return PolynomialRing, self._arguments  # SymPy's rings cannot be pickled

    def generator(self, expression: sp.Expr) -> Polynomial:
        """The generator that stands for ``expression``."""
        return Polynomial(self, self._gens[self.index[expression]])

    def number(self, value: int | Fraction) -> Polynomial:
        """The constant polynomial ``value``."""
        value = Fraction(value)
        return Polynomial(self, self.ring(sp.QQ(value.numerator, value.denominator)))

    def element(self, poly: PolyElement) -> Any:
        """Convert a SymPy ring element to a :class:`Polynomial` in normal form; a constant becomes a Fraction."""
        return self.number(0) + Polynomial(self, self.reduce(poly))

    def convert(self, expression: sp.Expr) -> Any:
        """Convert an exact SymPy expression to a polynomial, or to a Fraction if it is rational.

        Raises KeyError for symbols that are no generators of the ring.
        """
        if expression.is_Rational:
            return Fraction(int(expression.p), int(expression.q))
        if expression in self.index:
            return self.generator(expression)
        if expression.is_Add or expression.is_Mul:
            total: Any = 0 if expression.is_Add else 1
            for part in expression.args:
                value = self.convert(part)
                total = total + value if expression.is_Add else total * value
            return total
        if expression.is_Pow and expression.exp.is_Integer and expression.exp > 0:
            base = self.convert(expression.base)
            result = base
            for _ in range(int(expression.exp) - 1):
                result = result * base
            return result
        if len(roots := root_factors(expression)) > 1:
            return self.convert(sp.Mul(*roots, evaluate=False))
        raise KeyError(expression)

    def conjugations(self) -> list[Callable[[Polynomial], Polynomial]]:
        """For each sine and square root, the ring automorphism that changes its sign."""

        def conjugation(k: int) -> Callable[[Polynomial], Polynomial]:
            def conjugate(value: Polynomial) -> Polynomial:
                terms = {m: (-c if m[k] % 2 else c) for m, c in value.poly.terms()}
                return Polynomial(self, self.ring.from_dict(terms))

            return conjugate

        return [conjugation(k) for k in self._squares]

    def reduce(self, poly: PolyElement) -> PolyElement:
        """The normal form: squares of sines and roots replaced until none is left."""
        for k, square in self._squares.items():
            while any(monomial[k] > 1 for monomial in poly):
                high, rest = [], {}
                for monomial, coefficient in poly.terms():
                    if monomial[k] > 1:
                        high.append(((*monomial[:k], monomial[k] - 2, *monomial[k + 1 :]), coefficient))
                    else:
                        rest[monomial] = coefficient
                poly = self.ring.from_dict(rest) + self.ring.from_terms(high) * square
        return poly


class Polynomial:
    """An element of a :class:`PolynomialRing`, with the Python operators; constant results are Fractions."""

    __slots__ = ("poly", "ring")

    def __init__(self, ring_: PolynomialRing, poly: PolyElement) -> None:
        self.ring = ring_
        self.poly = poly

    def __reduce__(self) -> tuple[Any, ...]:
        return _from_terms, (
            self.ring,
            [(powers, Fraction(int(c.numerator), int(c.denominator))) for powers, c in self.poly.terms()],
        )

    def _of(self, other: Operand) -> PolyElement:
        if isinstance(other, Polynomial):
            return other.poly
        value = Fraction(other)
        return self.ring.ring(sp.QQ(value.numerator, value.denominator))

    def _result(self, poly: PolyElement) -> Any:
        if poly.is_ground:
            value = poly.coeff(1)
            return Fraction(int(value.numerator), int(value.denominator))
        return Polynomial(self.ring, poly)

    def __add__(self, other: Operand) -> Any:
        return self._result(self.poly + self._of(other))

    __radd__ = __add__

    def __sub__(self, other: Operand) -> Any:
        return self._result(self.poly - self._of(other))

    def __rsub__(self, other: Operand) -> Any:
        return self._result(self._of(other) - self.poly)

    def __mul__(self, other: Operand) -> Any:
        if isinstance(other, Polynomial):
            return self._result(self.ring.reduce(self.poly * other.poly))
        if not isinstance(other, (int, Fraction)):
            return NotImplemented
        return self._result(self.poly * self._of(other)) if other else 0

    __rmul__ = __mul__

    def __truediv__(self, other: int | Fraction) -> Any:
        return self * (1 / Fraction(other))

    def __neg__(self) -> Any:
        return self._result(-self.poly)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, (Polynomial, int, Fraction)) and not (self.poly - self._of(other))

    def __hash__(self) -> int:
        return hash(self.poly)

    def derivative(self, generator: sp.Expr) -> Any:
        """Partial derivative with respect to a generator that has no relation."""
        return self._result(self.poly.diff(self.ring._gens[self.ring.index[generator]]))

    def coefficients(self, generators: Iterable[sp.Expr]) -> dict[tuple[int, ...], Any]:
        """Collect the terms by powers of ``generators``: a map from the exponents to the coefficient polynomial."""
        places = [self.ring.index[g] for g in generators]
        parts: dict[tuple[int, ...], dict[tuple[int, ...], Any]] = {}
        for monomial, coefficient in self.poly.terms():
            key = tuple(monomial[k] for k in places)
            rest = list(monomial)
            for k in places:
                rest[k] = 0
            parts.setdefault(key, {})[tuple(rest)] = coefficient
        return {key: Polynomial(self.ring, self.ring.ring.from_dict(part)) for key, part in sorted(parts.items())}

    def expression(self) -> sp.Expr:
        """The polynomial as an expanded SymPy expression."""
        terms = []
        for monomial, coefficient in self.poly.terms():
            factors = [g**e for g, e in zip(self.ring.generators, monomial, strict=False) if e]
            terms.append(sp.Mul(sp.Rational(int(coefficient.numerator), int(coefficient.denominator)), *factors))
        return sp.Add(*terms)


Operand = Polynomial | int | Fraction


def root_factors(expression: sp.Expr) -> list[sp.Expr]:
    """Factor a square root of a rational into square roots of primes: ``[sqrt(2), sqrt(3)]`` for sqrt(6).

    Empty if the expression is no square root of a rational. Roots of primes are the generators because they satisfy no
    relations except their squares; a generator sqrt(6) would add sqrt(6) = sqrt(2) sqrt(3).
    """
    if not (expression.is_Pow and expression.exp == sp.Rational(1, 2) and expression.base.is_Rational):
        return []
    return [sp.sqrt(prime) for prime in sp.factorint(expression.base, limit=2**15)]


def to_expression(value: Operand) -> sp.Expr:
    """Convert a polynomial or a rational number to a SymPy expression."""
    if isinstance(value, Polynomial):
        return value.expression()
    value = Fraction(value)
    return sp.Rational(value.numerator, value.denominator)


def _from_terms(ring_: PolynomialRing, terms: Sequence[tuple[tuple[int, ...], Fraction]]) -> Polynomial:
    """Rebuild a polynomial from its terms, (exponents, coefficient) each, the form in which pickle stores it."""
    coefficients = {powers: sp.QQ(value.numerator, value.denominator) for powers, value in terms}
    return Polynomial(ring_, ring_.ring.from_dict(coefficients))
