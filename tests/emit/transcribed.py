"""Expressions and their transcription, read back."""

from __future__ import annotations

import sympy as sp

TRANSCRIBED = 1e-9  # numbers may be shown to 12 digits; a wrong sign or grouping is of order one
NAMES = ("q1", "q2", "q3", "dq1", "ddq2", "p3", "p12", "a2", "mx2", "Ixx3", "tau1", "beta4")
S = {name: sp.Symbol(name, real=True) for name in NAMES}
VALUES = {name: 0.3 + 0.37 * k for k, name in enumerate(NAMES)}


def value_of(expression: sp.Expr) -> float:
    return float(expression.subs({S[name]: value for name, value in VALUES.items()}))
