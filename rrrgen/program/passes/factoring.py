"""Factoring: a greedy search for a form of a system of polynomials with few operations.

A polynomial is a sum of terms, each a coefficient times a product of literals. Two kinds of common divisors are sought:

* a *double* divisor, a sum of two terms that occurs, times some factor, in several places: ``x a + x b -> x (a + b)``;
* a *single* divisor, a product of two literals (or of a coefficient and a literal) that occurs in several terms.

The divisor that saves most operations is extracted: it becomes a new literal, defined by a polynomial of its own. The
search repeats on the enlarged system until no divisor saves anything. This is the fast-extract algorithm of multilevel
logic synthesis (Rajski and Vasudevamurthy, 1992), applied to real polynomials.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from math import gcd

Monomial = tuple[int, ...]
Polynomial = dict[Monomial, Fraction | int]
Ratio = tuple[int, int]
"""A coefficient as (numerator, denominator). The search hashes millions of them, and a tuple hashes much faster than a
Fraction."""

Terms = dict[Monomial, Ratio]
Single = tuple[int, int, Ratio]
"""A single divisor: two literals and the ratio 1, or NUMBER, a literal and its coefficient."""

ONE: Ratio = (1, 1)
MINUS_ONE: Ratio = (-1, 1)
UNITS = (ONE, MINUS_ONE)
NOTHING: Monomial = ()
NUMBER = -1
"""Takes the place of the first literal in a single divisor that is a number times a literal."""

MULTIPLICATION, ADDITION = 20, 19
"""Weights of the operations. An addition weighs slightly less, so that ties go to fewer multiplications.

Weights of 20 to 10 and of 20 to 20 change the operations of all functions of the bundled robots by less than 0.04 %.
"""


def term_cost(monomial: Monomial, coefficient: Ratio) -> int:
    """Number of multiplications that the term ``coefficient`` times ``monomial`` takes."""
    if not monomial:
        return 0
    numerator, denominator = coefficient
    return len(monomial) - (denominator == 1 and (numerator == 1 or numerator == -1))


def divide(x: Ratio, y: Ratio) -> Ratio:
    """x / y in lowest terms."""
    if y == ONE:
        return x
    numerator, denominator = x[0] * y[1], x[1] * y[0]
    if denominator < 0:
        numerator, denominator = -numerator, -denominator
    common = gcd(numerator, denominator)
    return numerator // common, denominator // common


def split_common(x: Monomial, y: Monomial) -> tuple[Monomial, Monomial, Monomial]:
    """Greatest common factor of two sorted monomials, and the cofactor of each."""
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
    """Remove one occurrence of each of the ``literals`` from ``monomial``."""
    rest = list(monomial)
    for literal in literals:
        rest.remove(literal)
    return tuple(rest)


@dataclass(eq=False, slots=True)
class _FactoredTerm:
    """One term ``coefficient * monomial`` of polynomial ``k``; ``cost`` is its number of multiplications.

    ``singles`` are the single divisors that it contains, ``pairs`` the double ones that it forms with other terms.
    """

    k: int
    monomial: Monomial
    coefficient: Ratio
    cost: int
    singles: list[Single]
    pairs: dict[_Pair, None]


@dataclass(eq=False, slots=True)
class _Pair:
    """An occurrence of a double divisor: two terms of a polynomial whose sum is ``coefficient * common * divisor``.

    ``saved`` are the weighted operations that are saved where the two terms are replaced by that product.
    """

    divisor: _Double
    first: _FactoredTerm
    second: _FactoredTerm
    common: Monomial
    coefficient: Ratio
    saved: int


@dataclass(eq=False, slots=True)
class _Double:
    """The double divisor ``left + ratio * right``, its occurrences ``pairs``, and the weighted ``cost`` to form it."""

    left: Monomial
    right: Monomial
    ratio: Ratio
    cost: int
    pairs: dict[_Pair, None]


class Factoring:
    """The search for divisors in ``polynomials``, whose literals are numbered 0 to ``literals - 1``.

    Every pair of terms is examined once, when the later of the two is inserted; the gains of the divisors are updated
    incrementally. Dictionaries serve as insertion-ordered sets, which makes the result reproducible.
    """

    def __init__(self, polynomials: list[Polynomial], literals: int) -> None:
        self.count = len(polynomials)
        self.first = literals
        self.next = literals
        self._terms: list[dict[Monomial, _FactoredTerm]] = []
        self._doubles: dict[tuple[Monomial, Monomial, Ratio], _Double] = {}
        self._singles: dict[Single, dict[_FactoredTerm, None]] = {}
        self._double_gains: dict[_Double, int] = {}
        self._single_gains: dict[Single, int] = {}
        self._touched_doubles: dict[_Double, None] = {}
        self._touched_singles: dict[Single, None] = {}
        for polynomial in polynomials:
            self._append({m: (c.numerator, c.denominator) for m, c in sorted(polynomial.items())})
        self._update_gains()

    @property
    def polynomials(self) -> list[Polynomial]:
        """The rewritten polynomials, followed by the definitions of the extracted literals."""
        return [{m: _number(term.coefficient) for m, term in terms.items()} for terms in self._terms]

    def run(self) -> None:
        """Extract the best divisor until none saves an operation."""
        while True:
            double = max(self._double_gains, key=self._double_gains.__getitem__, default=None)
            single = max(self._single_gains, key=self._single_gains.__getitem__, default=None)
            gain = self._double_gains[double] if double is not None else 0
            saved = self._single_gains[single] if single is not None else 0
            if not gain and not saved:
                break
            if double is not None and gain >= saved:
                self._extract_double(double)
            elif single is not None:
                self._extract_single(single)
            self._update_gains()
        self._forget()

    def _forget(self) -> None:
        """Break the reference cycles, which would otherwise stay in memory while garbage collection is paused."""
        for terms in self._terms:
            for term in terms.values():
                term.pairs.clear()
        for double in self._doubles.values():
            double.pairs.clear()

    # -- terms and their divisors --------------------------------------------------------------------------------

    def _append(self, terms: Terms) -> None:
        self._terms.append({})
        for monomial, coefficient in terms.items():
            self._insert(len(self._terms) - 1, monomial, coefficient)

    def _insert(self, k: int, monomial: Monomial, coefficient: Ratio) -> None:
        """Add a term to polynomial k, and the divisors that it forms with the terms already there."""
        cost = term_cost(monomial, coefficient)
        term = _FactoredTerm(k, monomial, coefficient, cost, list(_products(monomial, coefficient)), {})
        literals = set(monomial)
        for other in self._terms[k].values():
            first, second = (term, other) if monomial < other.monomial else (other, term)
            common, left, right = NOTHING, first.monomial, second.monomial
            if not literals.isdisjoint(other.monomial):
                common, left, right = split_common(left, right)
            ratio = divide(second.coefficient, first.coefficient)
            if common or (left and right) or ratio in UNITS:
                rest = len(common) + (first.coefficient not in UNITS)
                saved = MULTIPLICATION * (cost + other.cost - rest) + ADDITION
                if saved > 0:
                    divisor = self._doubles.get((left, right, ratio)) or self._double(left, right, ratio)
                    pair = _Pair(divisor, first, second, common, first.coefficient, saved)
                    divisor.pairs[pair] = term.pairs[pair] = other.pairs[pair] = None
                    self._touched_doubles[divisor] = None
        self._terms[k][monomial] = term
        for single in term.singles:
            self._singles.setdefault(single, {})[term] = None
            self._touched_singles[single] = None

    def _double(self, left: Monomial, right: Monomial, ratio: Ratio) -> _Double:
        cost = MULTIPLICATION * (term_cost(left, ONE) + term_cost(right, ratio)) + ADDITION
        double = self._doubles[left, right, ratio] = _Double(left, right, ratio, cost, {})
        return double

    def _remove(self, term: _FactoredTerm) -> None:
        """Remove a term from its polynomial, and its part in every divisor."""
        for pair in term.pairs:
            del pair.divisor.pairs[pair]
            self._touched_doubles[pair.divisor] = None
            other = pair.second if pair.first is term else pair.first
            del other.pairs[pair]
        term.pairs.clear()
        del self._terms[term.k][term.monomial]
        for single in term.singles:
            del self._singles[single][term]
            self._touched_singles[single] = None

    def _accumulate(self, k: int, monomial: Monomial, coefficient: Ratio) -> None:
        """Add ``coefficient`` to that of the term ``monomial``, which may exist already."""
        term = self._terms[k].get(monomial)
        if term is not None:
            self._remove(term)
            total = Fraction(*term.coefficient) + Fraction(*coefficient)
            coefficient = (total.numerator, total.denominator)
        if coefficient[0]:
            self._insert(k, monomial, coefficient)

    # -- gains ---------------------------------------------------------------------------------------------------

    def _update_gains(self) -> None:
        for double in self._touched_doubles:
            if (gain := self._gain(double)) > 0:
                self._double_gains[double] = gain
            else:
                self._double_gains.pop(double, None)
            if not double.pairs:
                del self._doubles[double.left, double.right, double.ratio]
        for single in self._touched_singles:
            terms = self._singles[single]
            if len(terms) > 1:
                self._single_gains[single] = MULTIPLICATION * (len(terms) - 1)
            else:
                self._single_gains.pop(single, None)
            if not terms:
                del self._singles[single]
        self._touched_doubles.clear()
        self._touched_singles.clear()

    def _gain(self, double: _Double) -> int:
        """Weighted operations saved by extracting a divisor."""
        if len(double.pairs) == 1:
            return next(iter(double.pairs)).saved - double.cost
        return sum([pair.saved for pair in _disjoint(double)]) - double.cost

    # -- extraction ----------------------------------------------------------------------------------------------

    def _define(self, terms: Terms) -> int:
        literal = self.next
        self.next += 1
        self._append(terms)
        return literal

    def _extract_double(self, double: _Double) -> None:
        pairs = _disjoint(double)
        literal = self._define({double.left: ONE, double.right: double.ratio})
        for pair in pairs:
            self._remove(pair.first)
            self._remove(pair.second)
            self._accumulate(pair.first.k, tuple(sorted((*pair.common, literal))), pair.coefficient)

    def _extract_single(self, key: Single) -> None:
        first, second, number = key
        product = (second,) if first == NUMBER else (first, second)
        terms = list(self._singles[key])
        literal = self._define({product: number})
        for term in terms:
            self._remove(term)
            rest = tuple(sorted((*without(term.monomial, *product), literal)))
            self._accumulate(term.k, rest, divide(term.coefficient, number))


def _disjoint(double: _Double) -> list[_Pair]:
    """Occurrences of a divisor that share no term, chosen greedily in order of insertion."""
    used: set[_FactoredTerm] = set()
    chosen: list[_Pair] = []
    for pair in double.pairs:
        if pair.first not in used and pair.second not in used:
            used.add(pair.first)
            used.add(pair.second)
            chosen.append(pair)
    return chosen


def _number(ratio: Ratio) -> Fraction | int:
    return ratio[0] if ratio[1] == 1 else Fraction(*ratio)


def _products(x: Monomial, coefficient: Ratio) -> Iterator[Single]:
    """The single divisors of a term: products of two of its literals, or of its coefficient and a literal."""
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
