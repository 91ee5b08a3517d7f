"""Factoring: a system of polynomials rewritten with as few operations as a greedy search finds.

Polynomials are sums of coefficient times product of literals. Two kinds of common parts are worth a name of their own:

* a *double* divisor, two terms that occur (times a common factor) in several places: ``x a + x b -> x (a + b)``;
* a *single* divisor, a product of two literals (or of a coefficient and a literal) that occurs in several terms.

The divisor that saves most operations is extracted, becomes a literal defined by its own polynomial, and the search
goes on with everything there is now (the method of fast extraction from logic synthesis, for real polynomials).
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from math import gcd
from typing import Any

Monomial = tuple[int, ...]
Polynomial = dict[Monomial, Fraction | int]
Ratio = tuple[int, int]
"""A coefficient as numerator and denominator: hashed a million times, and much faster so than a Fraction."""

Terms = dict[Monomial, Ratio]
Double = tuple[Monomial, Monomial, Ratio]
Single = tuple[int, int, Ratio]
Place = tuple[int, Monomial]
Pair = tuple[int, Monomial, Monomial]

ONE: Ratio = (1, 1)
NUMBER = -1
"""First member of a single divisor that is a number times a literal."""

ADDITION = 0.95
"""Weight of an addition against a multiplication; a little less, so that ties go to fewer multiplications."""


def term_cost(monomial: Monomial, coefficient: Ratio) -> int:
    """Multiplications in one term."""
    if not monomial:
        return 0
    numerator, denominator = coefficient
    return len(monomial) - (denominator == 1 and (numerator == 1 or numerator == -1))


def divide(x: Ratio, y: Ratio) -> Ratio:
    """x / y in lowest terms."""
    numerator, denominator = x[0] * y[1], x[1] * y[0]
    if denominator < 0:
        numerator, denominator = -numerator, -denominator
    common = gcd(numerator, denominator)
    return numerator // common, denominator // common


def split_common(x: Monomial, y: Monomial) -> tuple[Monomial, Monomial, Monomial]:
    """Greatest common factor of two sorted monomials, and what is left of each."""
    common: list[int] = []
    left: list[int] = []
    right: list[int] = []
    i = j = 0
    while i < len(x) and j < len(y):
        if x[i] == y[j]:
            common.append(x[i])
            i, j = i + 1, j + 1
        elif x[i] < y[j]:
            left.append(x[i])
            i += 1
        else:
            right.append(y[j])
            j += 1
    return tuple(common), tuple(left + list(x[i:])), tuple(right + list(y[j:]))


def without(monomial: Monomial, *literals: int) -> Monomial:
    """``monomial`` with one occurrence of each literal removed."""
    rest = list(monomial)
    for literal in literals:
        rest.remove(literal)
    return tuple(rest)


class Factoring:
    """The search. ``polynomials`` holds the given ones first, then the definitions of extracted literals.

    Every pair of terms is looked at once, when the later of the two appears; what divisors gain is kept up to date.
    """

    def __init__(self, polynomials: list[Polynomial], literals: int) -> None:
        self.count = len(polynomials)
        self.first = literals
        self.next = literals
        self._terms: list[Terms] = []
        self._doubles: dict[Double, dict[Pair, tuple[Monomial, Ratio, float]]] = {}
        self._singles: dict[Single, dict[Place, None]] = {}
        self._doubles_of: dict[Place, dict[tuple[Double, Pair], None]] = {}
        self._double_gains: dict[Double, float] = {}
        self._single_gains: dict[Single, float] = {}
        self._touched_doubles: dict[Double, None] = {}
        self._touched_singles: dict[Single, None] = {}
        for polynomial in polynomials:
            self._append({m: (c.numerator, c.denominator) for m, c in sorted(polynomial.items())})
        self._update_gains()

    @property
    def polynomials(self) -> list[Polynomial]:
        """The given polynomials as they are now, then the definitions of extracted literals."""
        return [{m: c[0] if c[1] == 1 else Fraction(*c) for m, c in terms.items()} for terms in self._terms]

    def run(self) -> None:
        """Extract until nothing saves any more."""
        while True:
            double = max(self._double_gains, key=self._double_gains.__getitem__, default=None)
            single = max(self._single_gains, key=self._single_gains.__getitem__, default=None)
            gain = self._double_gains[double] if double is not None else 0.0
            saved = self._single_gains[single] if single is not None else 0.0
            if max(gain, saved) <= 1e-9:
                return
            if double is not None and gain >= saved:
                self._extract_double(double)
            elif single is not None:
                self._extract_single(single)
            self._update_gains()

    # -- terms and their divisors --------------------------------------------------------------------------------

    def _append(self, terms: Terms) -> None:
        self._terms.append({})
        for monomial, coefficient in terms.items():
            self._insert(len(self._terms) - 1, monomial, coefficient)

    def _insert(self, k: int, x: Monomial, cx: Ratio) -> None:
        """Add a term to polynomial k, and the divisors it makes with the terms there."""
        place = (k, x)
        found: dict[tuple[Double, Pair], None] = {}
        literals, cost = set(x), term_cost(x, cx) + ADDITION
        for y, cy in self._terms[k].items():
            first, second, c1, c2 = (x, y, cx, cy) if x < y else (y, x, cy, cx)
            common, left, right = ((), first, second) if literals.isdisjoint(y) else split_common(first, second)
            ratio = divide(c2, c1)
            if common or ratio in ((1, 1), (-1, 1)) or (left and right):
                saved = cost + term_cost(y, cy) - term_cost((*common, 0), c1)
                if saved <= 0:
                    continue
                key, pair = (left, right, ratio), (k, first, second)
                self._doubles.setdefault(key, {})[pair] = (common, c1, saved)
                self._touched_doubles[key] = None
                found[key, pair] = None
                self._doubles_of[k, y][key, pair] = None
        self._doubles_of[place] = found
        self._terms[k][x] = cx
        for single in _pairs(x, cx):
            self._singles.setdefault(single, {})[place] = None
            self._touched_singles[single] = None

    def _remove(self, k: int, x: Monomial) -> Ratio:
        """Take a term out of polynomial k, with its divisors; returns its coefficient."""
        place = (k, x)
        for key, pair in self._doubles_of.pop(place):
            del self._doubles[key][pair]
            self._touched_doubles[key] = None
            other = pair[2] if pair[1] == x else pair[1]
            del self._doubles_of[k, other][key, pair]
        coefficient = self._terms[k].pop(x)
        for single in _pairs(x, coefficient):
            del self._singles[single][place]
            self._touched_singles[single] = None
        return coefficient

    def _accumulate(self, k: int, monomial: Monomial, coefficient: Ratio) -> None:
        """Add to the coefficient of a term that may be there already."""
        if monomial in self._terms[k]:
            total = Fraction(*self._remove(k, monomial)) + Fraction(*coefficient)
            coefficient = (total.numerator, total.denominator)
        if coefficient[0]:
            self._insert(k, monomial, coefficient)

    # -- gains ---------------------------------------------------------------------------------------------------

    def _update_gains(self) -> None:
        for double in self._touched_doubles:
            _keep(self._double_gains, double, self._gain(double))
            if not self._doubles[double]:
                del self._doubles[double]
        for single in self._touched_singles:
            _keep(self._single_gains, single, len(self._singles[single]) - 1.0)
            if not self._singles[single]:
                del self._singles[single]
        self._touched_doubles.clear()
        self._touched_singles.clear()

    def _gain(self, key: Double) -> float:
        """What the extraction of a divisor saves."""
        occurrences = self._doubles[key]
        if len(occurrences) == 1:
            return next(iter(occurrences.values()))[2] - _definition_cost(key)
        return self._choose(key)[1]

    def _choose(self, key: Double) -> tuple[list[tuple[Pair, Monomial, Ratio]], float]:
        """The disjoint occurrences of a divisor that pay, and what its extraction saves."""
        used: set[Place] = set()
        chosen: list[tuple[Pair, Monomial, Ratio]] = []
        gain = -_definition_cost(key)
        for pair, (common, cx, saved) in self._doubles[key].items():
            k, x, y = pair
            first, second = (k, x), (k, y)
            if first not in used and second not in used:
                used.add(first)
                used.add(second)
                chosen.append((pair, common, cx))
                gain += saved
        return chosen, gain

    # -- extraction ----------------------------------------------------------------------------------------------

    def _define(self, terms: Terms) -> int:
        literal = self.next
        self.next += 1
        self._append(terms)
        return literal

    def _extract_double(self, key: Double) -> None:
        left, right, ratio = key
        places, _ = self._choose(key)
        literal = self._define({left: ONE, right: ratio})
        for (k, x, y), common, cx in places:
            self._remove(k, x)
            self._remove(k, y)
            self._accumulate(k, tuple(sorted((*common, literal))), cx)

    def _extract_single(self, key: Single) -> None:
        first, second, number = key
        product = (second,) if first == NUMBER else (first, second)
        places = list(self._singles[key])
        literal = self._define({product: number})
        for k, monomial in places:
            coefficient = divide(self._remove(k, monomial), number)
            self._accumulate(k, tuple(sorted((*without(monomial, *product), literal))), coefficient)


def _definition_cost(key: Double) -> float:
    left, right, ratio = key
    return term_cost(left, ONE) + term_cost(right, ratio) + ADDITION


def _keep(gains: dict[Any, float], key: Any, gain: float) -> None:
    """Record a gain, or forget one that is none."""
    if gain > 0:
        gains[key] = round(gain, 6)
    else:
        gains.pop(key, None)


def _pairs(x: Monomial, coefficient: Ratio) -> Iterator[Single]:
    """Products of two literals, or of the coefficient and a literal, that are part of a term."""
    seen: set[tuple[int, int]] = set()
    for i, u in enumerate(x):
        for v in x[i + 1 :]:
            if (u, v) not in seen:
                seen.add((u, v))
                yield (u, v, ONE)
    numerator, denominator = coefficient
    if len(x) > 1 and not (denominator == 1 and abs(numerator) == 1):
        for u in dict.fromkeys(x):
            yield (NUMBER, u, (abs(numerator), denominator))
