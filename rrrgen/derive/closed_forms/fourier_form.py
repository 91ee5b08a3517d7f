"""Printing a trigonometric polynomial in the shorter of two forms: with products of sines and cosines, or of sums.

The second form replaces products of angles of one block of parallel axes by multiple angles, as in
``cos(q2) cos(q2+q3) + sin(q2) sin(q2+q3) = cos(q3)``. Angles of different blocks are never mixed.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import sympy as sp

from rrrgen.program.polynomials import Polynomial, to_expression

Pairs = Sequence[tuple[sp.Expr, sp.Expr]]
Wave = dict[sp.Expr, tuple[Fraction, Fraction]]
"""Sum of ``a cos(angle) + b sin(angle)``, keyed by the angle."""


def shorter_form(value: Polynomial, pairs: Pairs) -> sp.Expr:
    """Convert ``value`` to a SymPy expression, in the one of the module's two forms that has fewer operations.

    ``pairs`` are the (cosine, sine) generators of the angles in it.
    """
    plain = sp.factor_terms(value.expression())
    best = plain
    for block in _blocks(pairs):
        waves = sp.factor_terms(_as_waves(value, block))
        if waves.count_ops() < best.count_ops():
            best = waves
    return best


def _blocks(pairs: Pairs) -> list[Pairs]:
    """The (cosine, sine) pairs grouped into sets whose angles share joint variables."""
    blocks: list[tuple[set[sp.Symbol], list[tuple[sp.Expr, sp.Expr]]]] = []
    for pair in pairs:
        symbols = pair[0].args[0].free_symbols
        home = next((block for block in blocks if block[0] & symbols), None)
        if home is None:
            blocks.append((set(symbols), [pair]))
        else:
            home[0].update(symbols)
            home[1].append(pair)
    return [members for symbols, members in blocks if symbols]


def _as_waves(value: Polynomial, block: Pairs) -> sp.Expr:
    generators = [g for pair in block for g in pair]
    total: dict[sp.Expr, Any] = {}
    for powers, rest in value.coefficients(generators).items():
        wave: Wave = {sp.S.Zero: (Fraction(1), Fraction(0))}
        for (cosine, _), k in zip(block, range(0, len(powers), 2), strict=True):
            for _ in range(powers[k]):
                wave = _times(wave, cosine.args[0], Fraction(1), Fraction(0))
            for _ in range(powers[k + 1]):
                wave = _times(wave, cosine.args[0], Fraction(0), Fraction(1))
        for angle, (a, b) in wave.items():
            for function, factor in ((sp.cos(angle), a), (sp.sin(angle), b)):
                if factor:
                    total[function] = total.get(function, 0) + factor * rest
    return sp.Add(*(to_expression(v) * function for function, v in total.items()))


def _times(wave: Wave, angle: sp.Expr, a: Fraction, b: Fraction) -> Wave:
    """Multiply ``wave``, a sum of sines and cosines, by ``a cos(angle) + b sin(angle)``; the result is such a sum."""
    result: Wave = {}
    half = Fraction(1, 2)
    for present, (c, d) in wave.items():
        _accumulate(result, present + angle, half * (c * a - d * b), half * (c * b + d * a))
        _accumulate(result, present - angle, half * (c * a + d * b), half * (d * a - c * b))
    return result


def _accumulate(wave: Wave, angle: sp.Expr, a: Fraction, b: Fraction) -> None:
    if angle.could_extract_minus_sign():
        angle, b = -angle, -b
    if angle == 0:
        b = Fraction(0)
    old = wave.get(angle, (Fraction(0), Fraction(0)))
    wave[angle] = (old[0] + a, old[1] + b)
