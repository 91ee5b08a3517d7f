"""Factoring: a system of polynomials rewritten with as few operations as a greedy search finds.

Polynomials are sums of coefficient times product of literals. Two kinds of common parts are worth a name of their own:

* a *double* divisor, two terms that occur (times a common factor) in several places: ``x a + x b -> x (a + b)``;
* a *single* divisor, a product of two literals (or of a coefficient and a literal) that occurs in several terms.

The divisor that saves most operations is extracted, becomes a literal defined by its own polynomial, and the search
goes on with everything there is now (the method of fast extraction from logic synthesis, for real polynomials).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from fractions import Fraction
from math import gcd
from typing import Any

Monomial = tuple[int, ...]
Polynomial = dict[Monomial, Fraction]
Ratio = tuple[int, int]
"""A coefficient as numerator and denominator: hashed a million times, and much faster so than a Fraction."""

Terms = dict[Monomial, Ratio]
Double = tuple[Monomial, Monomial, Ratio]
Single = tuple[int, int, Ratio]
Occurrence = tuple[int, Monomial, Monomial, Monomial, Ratio]

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
    """The search. ``polynomials`` holds the given ones first, then the definitions of extracted literals."""

    def __init__(self, polynomials: list[Polynomial], literals: int) -> None:
        self._terms: list[Terms] = []
        self.count = len(polynomials)
        self.first = literals
        self.next = literals
        self._doubles: dict[Double, dict[int, list[Occurrence]]] = {}
        self._singles: dict[Single, dict[int, list[Monomial]]] = {}
        self._double_gains: dict[Double, float] = {}
        self._single_gains: dict[Single, float] = {}
        self._keys: list[tuple[set[Double], set[Single]]] = []
        for polynomial in polynomials:
            self._append({m: (c.numerator, c.denominator) for m, c in polynomial.items()})

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

    @property
    def polynomials(self) -> list[Polynomial]:
        """The given polynomials as they are now, then the definitions of extracted literals."""
        return [{m: Fraction(*c) for m, c in terms.items()} for terms in self._terms]

    # -- candidates ----------------------------------------------------------------------------------------------

    def _append(self, terms: Terms) -> None:
        self._terms.append(terms)
        self._keys.append((set(), set()))
        self._scan([len(self._terms) - 1])

    def _scan(self, changed: Iterable[int]) -> None:
        """Find the divisors of changed polynomials anew, and the gains of all divisors that this touches."""
        ordered = sorted(changed)
        doubles: set[Double] = set()
        singles: set[Single] = set()
        for k in ordered:
            doubles |= self._keys[k][0]
            singles |= self._keys[k][1]
            for double in self._keys[k][0]:
                self._doubles[double].pop(k)
            for single in self._keys[k][1]:
                self._singles[single].pop(k)
        for k in ordered:
            found = self._find(k)
            self._keys[k] = (set(found[0]), set(found[1]))
            doubles |= self._keys[k][0]
            singles |= self._keys[k][1]
            for double, places in found[0].items():
                self._doubles.setdefault(double, {})[k] = places
            for single, monomials in found[1].items():
                self._singles.setdefault(single, {})[k] = monomials
        for double in sorted(doubles):
            self._set(self._double_gains, double, self._doubles, self._double_choice(double)[1])
        for single in sorted(singles):
            gain = sum(map(len, self._singles[single].values())) - 1.0
            self._set(self._single_gains, single, self._singles, gain)

    @staticmethod
    def _set(gains: dict[Any, float], key: Any, places: dict[Any, Any], gain: float) -> None:
        """Record a gain; forget divisors that are gone or save nothing."""
        if not places[key]:
            del places[key]
        if gain > 0:
            gains[key] = round(gain, 6)
        else:
            gains.pop(key, None)

    def _find(self, k: int) -> tuple[dict[Double, list[Occurrence]], dict[Single, list[Monomial]]]:
        doubles: dict[Double, list[Occurrence]] = {}
        singles: dict[Single, list[Monomial]] = {}
        terms = sorted(self._terms[k].items())
        for a, (x, cx) in enumerate(terms):
            for key in _pairs(x, cx):
                singles.setdefault(key, []).append(x)
            for y, cy in terms[a + 1 :]:
                common, left, right = split_common(x, y)
                ratio = divide(cy, cx)
                if common or ratio in ((1, 1), (-1, 1)) or (left and right):
                    doubles.setdefault((left, right, ratio), []).append((k, x, y, common, cx))
        return doubles, singles

    def _double_choice(self, key: Double) -> tuple[list[Occurrence], float]:
        """The disjoint occurrences of a divisor that pay, and what its extraction saves."""
        left, right, ratio = key
        used: set[tuple[int, Monomial]] = set()
        chosen: list[Occurrence] = []
        gain = -(term_cost(left, ONE) + term_cost(right, ratio) + ADDITION)
        for k in sorted(self._doubles[key]):
            for place in self._doubles[key][k]:
                _, x, y, common, cx = place
                if (k, x) in used or (k, y) in used:
                    continue
                own = term_cost(x, cx) + term_cost(y, self._terms[k][y]) + ADDITION
                saved = own - term_cost((*common, 0), cx)
                if saved > 0:
                    used.update(((k, x), (k, y)))
                    chosen.append(place)
                    gain += saved
        return chosen, gain

    # -- extraction ----------------------------------------------------------------------------------------------

    def _define(self, terms: Terms) -> int:
        literal = self.next
        self.next += 1
        self._append(terms)
        return literal

    def _add(self, k: int, monomial: Monomial, coefficient: Ratio) -> None:
        terms = self._terms[k]
        total = Fraction(*terms.get(monomial, (0, 1))) + Fraction(*coefficient)
        if total:
            terms[monomial] = (total.numerator, total.denominator)
        else:
            terms.pop(monomial, None)

    def _extract_double(self, key: Double) -> None:
        left, right, ratio = key
        places, _ = self._double_choice(key)
        literal = self._define({left: ONE, right: ratio})
        for k, x, y, common, cx in places:
            del self._terms[k][x], self._terms[k][y]
            self._add(k, tuple(sorted((*common, literal))), cx)
        self._scan({place[0] for place in places})

    def _extract_single(self, key: Single) -> None:
        first, second, number = key
        product = (second,) if first == NUMBER else (first, second)
        places = {k: list(monomials) for k, monomials in self._singles[key].items()}
        literal = self._define({product: number})
        for k, monomials in places.items():
            for monomial in monomials:
                coefficient = divide(self._terms[k].pop(monomial), number)
                self._add(k, tuple(sorted((*without(monomial, *product), literal))), coefficient)
        self._scan(places)


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
