"""One step of a linear model in state space as a program, its matrices folded in."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from rrrgen.errors import InputError
from rrrgen.program import Builder, Port, Program

Row = Sequence[float]


def state_space_program(
    A: Sequence[Row], B: Row, C: Row, D: float, period: float, name: str = "step", title: str = "a linear model"
) -> Program:
    """Output ``y = C x + D u`` and next state ``x_next = A x + B u`` of a model with one input and one output.

    ``A`` (n, n), ``B`` (n,), ``C`` (n,), n >= 1; their zeros cost nothing. Inputs ``u`` and the state ``x`` (n,), which
    the caller owns; outputs ``y`` and ``x_next`` (n,). ``period`` in s is for the documentation.
    """
    n = len(B)
    if n < 1 or len(A) != n or len(C) != n or any(len(row) != n for row in A):
        raise InputError("a model in state space needs A (n, n), B (n,) and C (n,) with n of 1 at least")
    builder = Builder()
    u = builder.input(Port("u", (), "", "", "input of this sample"))[0]
    x = builder.input(Port("x", (n,), "", "", "state"))

    def combination(weights: Row, of_u: float) -> Any:
        total: Any = 0
        for weight, value in zip((*weights, of_u), (*x, u), strict=True):
            total = total + Fraction(float(weight)) * value
        return total

    outputs = [
        (Port("y", (), "", "", "output of this sample"), [combination(C, D)]),
        (
            Port("x_next", (n,), "", "", "state for the next sample"),
            [combination(row, of_u) for row, of_u in zip(A, B, strict=True)],
        ),
    ]
    return builder.program(
        name,
        outputs,
        summary=f"One step of {title}, once per sample of {period:.9g} s.",
        formula="y = C x + D u, x_next = A x + B u",
        notes=("Start with x = 0; pass x_next as x at the next sample.",),
    )
