"""Program for one step of linear state-space models in series, with their matrices as constants."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from rrrgen.base.errors import InputError
from rrrgen.emit.controller.state_space import StateSpace
from rrrgen.program import Builder, Port, Program
from rrrgen.program.guard import guarded


def linear_step_program(systems: Sequence[StateSpace], period: float, name: str, title: str) -> Program:
    """Program for one step of single-input single-output models in series.

    Each model is ``y = C x + D u``, ``x_next = A x + B u``, and its output is the input of the next one; zeros in the
    matrices cost no operations. The program takes the input ``u`` of the first model and the states ``x`` (n,) of all
    models, which the caller stores; it returns the output ``y`` of the last model and ``x_next`` (n,). ``name`` is that
    of the program; ``period`` (s) and ``title`` appear in its documentation.
    """
    n = sum(len(system.B) for system in systems)
    if n < 1:
        raise InputError("a step of linear models needs a state")
    builder = Builder()
    signal: Any = builder.input(Port("u", (), "", "", "input of this sample"))[0]
    x = builder.input(Port("x", (n,), "", "", "state"))
    following: list[Any] = []
    for system in systems:
        own, u = x[len(following) : len(following) + len(system.B)], signal
        signal = _combination(system.C, own, system.D, u)
        following += [_combination(row, own, of_u, u) for row, of_u in zip(system.A, system.B, strict=True)]
    outputs = [
        (Port("y", (), "", "", "output of this sample"), [signal]),
        (Port("x_next", (n,), "", "", "state for the next sample", state="x"), following),
    ]
    program = builder.program(
        name,
        outputs,
        summary=f"One step of {title}, once per sample of {period:.9g} s.",
        formula="y = C x + D u, x_next = A x + B u" + (", one after the other" if len(systems) > 1 else ""),
        notes=("Start with x = 0; pass x_next as x at the next sample.",),
    )
    return guarded(program)


def _combination(weights: Any, values: Sequence[Any], of_u: float, u: Any) -> Any:
    total: Any = 0
    for weight, value in zip((*weights, of_u), (*values, u), strict=True):
        total = total + Fraction(float(weight)) * value
    return total
