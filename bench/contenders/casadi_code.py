"""CasADi functions as C, and their operations counted."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bench.contenders.hand_casadi import HandFunctions


def operations(function: Any) -> dict[str, int]:
    """Multiplications, additions, divisions and angles of a CasADi function."""
    import casadi as ca

    kinds = {ca.OP_MUL: "mul", ca.OP_SQ: "mul", ca.OP_ADD: "add", ca.OP_SUB: "add", ca.OP_TWICE: "add"}
    kinds |= {ca.OP_DIV: "div", ca.OP_INV: "div", ca.OP_SIN: "sincos"}
    count = {"mul": 0, "add": 0, "div": 0, "sincos": 0}
    for k in range(function.n_instructions()):
        kind = kinds.get(function.instruction_id(k))
        if kind:
            count[kind] += 1
    return count


def c_source(hand: HandFunctions) -> str:
    """CasADi's C of all functions."""
    import casadi as ca

    generator = ca.CodeGenerator("hand.c")
    for function in hand.functions.values():
        generator.add(function)
    return str(generator.dump())
