"""Whether an expression in sines, cosines and symbols is zero, decided exactly."""

from __future__ import annotations

import sympy as sp


def vanishes(expression: sp.Expr) -> bool:
    """Zero exactly when the remainder modulo sin^2 + cos^2 - 1 of every single angle is.

    Sums of angles are expanded first; the relations have different leading terms, so they are a Groebner basis and the
    remainder is unique.
    """
    expanded = sp.expand(sp.expand_trig(sp.expand(expression)))
    angles = sorted({f.args[0] for f in expanded.atoms(sp.sin, sp.cos)}, key=sp.default_sort_key)
    for angle in angles:
        s, c = sp.sin(angle), sp.cos(angle)
        expanded = sp.expand(sp.rem(expanded, s**2 + c**2 - 1, s)) if expanded.has(s) else expanded
    return expanded == 0
