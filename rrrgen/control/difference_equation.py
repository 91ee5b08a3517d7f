"""One step of a linear difference equation as a program, its coefficients folded in."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from rrrgen.errors import InputError
from rrrgen.program import Builder, Port, Program


def difference_equation_program(
    numerator: Sequence[float], denominator: Sequence[float], period: float, name: str = "step"
) -> Program:
    """Output and next state of ``y = (c_0 + c_1 z^-1 + ..)/(1 + d_1 z^-1 + ..) u``, sample by sample.

    Observer form: ``y = x_0 + c_0 u``, ``x_next_i = x_{i+1} + c_{i+1} u - d_{i+1} y``. Inputs ``u`` and the state ``x``
    (n,), which the caller owns; outputs ``y`` and ``x_next`` (n,). ``period`` in s is for the documentation.
    """
    n = max(len(numerator), len(denominator)) - 1
    if n < 1 or denominator[0] != 1.0:
        raise InputError("a difference equation needs an order of 1 at least, and a denominator that starts with 1")
    c, d = ([Fraction(float(v)) for v in values] + [Fraction(0)] * n for values in (numerator, denominator))
    builder = Builder()
    u = builder.input(Port("u", (), "", "", "input of this sample"))[0]
    x = builder.input(Port("x", (n,), "", "", "state"))
    y: Any = x[0] + c[0] * u
    following = []
    for i in range(1, n + 1):
        carried: Any = x[i] if i < n else 0
        following.append(carried + c[i] * u - d[i] * y)
    outputs = [
        (Port("y", (), "", "", "output of this sample"), [y]),
        (Port("x_next", (n,), "", "", "state for the next sample"), following),
    ]
    return builder.program(
        name,
        outputs,
        summary=f"One step of a linear model, once per sample of {period:.9g} s.",
        formula="y = x_0 + c_0 u, x_next_i = x_i+1 + c_i+1 u - d_i+1 y",
        notes=("Start with x = 0; pass x_next as x at the next sample.",),
    )
