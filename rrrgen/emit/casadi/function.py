"""Conversion of a program to a CasADi ``Function`` over SX."""

from __future__ import annotations

from sys import float_info
from typing import Any

from rrrgen.base.errors import MissingExtraError
from rrrgen.emit.casadi.derivatives import input_place, matrix_size
from rrrgen.program import Builder, Op, Port, Program, Value

LARGEST = float_info.max


def import_casadi() -> Any:
    """The ``casadi`` package, or a :class:`MissingExtraError` that says how to install it."""
    try:
        import casadi
    except ImportError as error:
        raise MissingExtraError("a function of CasADi", "casadi", "casadi") from error
    return casadi


def function(program: Program, name: str | None = None, smooth_sign: float | None = None) -> Any:
    """Convert ``program`` to a ``casadi.Function`` over SX; its inputs and outputs have the names of the ports.

    Outputs are dense (rows, columns) matrices. ``smooth_sign`` = eps > 0, in the unit of the argument (rad/s for joint
    speeds), replaces sgn(x) by tanh(x / eps), so that derivatives include friction; without it sgn is exact and its
    derivative is 0. Raises :class:`MissingExtraError` without CasADi and ``ValueError`` for eps <= 0.
    """
    if smooth_sign is not None and not smooth_sign > 0:
        raise ValueError(f"the width of the smooth sign must be positive, got {smooth_sign}")
    ca = import_casadi()
    inputs = [ca.SX.sym(port.name, *matrix_size(port)) for port in program.inputs]
    places = [_row_major(ca, symbol) for symbol in inputs]
    sign = ca.sign if smooth_sign is None else (lambda x: ca.tanh(x / smooth_sign))
    operations = {
        Op.ADD: lambda x, y: x + y,
        Op.SUB: lambda x, y: x - y,
        Op.MUL: lambda x, y: x * y,
        Op.DIV: lambda x, y: x / y,
        Op.NEG: lambda x: -x,
        Op.SIN: ca.sin,
        Op.COS: ca.cos,
        Op.SQRT: ca.sqrt,
        Op.ABS: ca.fabs,
        Op.SIGN: sign,
        Op.EXP: ca.exp,
        Op.TANH: ca.tanh,
        Op.MIN: ca.fmin,
        Op.NONFINITE: lambda x: nonfinite(ca, x),
        Op.SELECT: lambda c, x, y: ca.if_else(c > 0, x, y),
    }
    values: list[Any] = []
    for node in program.nodes:
        if node.op is Op.INPUT:
            place, element = input_place(node)
            values.append(places[place][element])
        elif node.op is Op.CONST:
            values.append(ca.SX(float(node.value)))  # type: ignore[arg-type]
        else:
            values.append(operations[node.op](*(values[arg] for arg in node.args)))
    outputs = []
    for port, row in zip(program.outputs, program.results, strict=True):
        rows, cols = matrix_size(port)
        elements = ca.vertcat(*(values[index] for index in row)) if row else ca.SX(0, 1)
        outputs.append(ca.densify(ca.reshape(elements, cols, rows).T))
    return ca.Function(
        name or program.name,
        inputs,
        outputs,
        [port.name for port in program.inputs],
        [port.name for port in program.outputs],
    )


def nonfinite(ca: Any, x: Any) -> Any:
    """The expression that is 0 of a finite ``x``, 1 of an infinite one, 2 of NaN, with which no comparison is true."""
    size = ca.fabs(x)
    return ca.if_else(size <= LARGEST, 0, ca.if_else(size > LARGEST, 1, 2))


def _row_major(ca: Any, symbol: Any) -> list[Any]:
    return list(ca.vertsplit(ca.vec(symbol.T)))


# ------------------------------------------------------------------------------------------------------------------
# Replacement of sgn by a smooth function, for solvers that differentiate through Coulomb friction.
# ------------------------------------------------------------------------------------------------------------------


def has_sign(program: Program) -> bool:
    """Whether ``program`` contains sgn or an absolute value, whose derivatives jump."""
    return any(node.op is Op.SIGN for node in program.nodes)


def smooth_sign(program: Program) -> Program:
    """Replace sgn(x) in ``program`` by tanh(x / eps), with one more scalar input ``eps`` > 0, in the unit of x.

    The replacement is off by less than 2 exp(-2 |x| / eps): at |x| = 3 eps it has reached 99.5 % of sgn x. The limit
    eps -> 0 is the exact model, and eps = 0 is not allowed. The name gains ``_smooth``.
    """
    builder = Builder()
    inputs: list[list[Value]] = [list(builder.input(port)) for port in program.inputs]
    width = builder.input(
        Port("eps", (), unit="rad/s or m/s", meaning="width of the smooth sign: sgn(x) is replaced by tanh(x/eps)")
    )[0]
    values: list[Value] = []
    for index, node in enumerate(program.nodes):
        if node.op is Op.INPUT:
            port, element = input_place(node)
            value: Value = inputs[port][element]
        elif node.op is Op.CONST:
            value = node.value  # type: ignore[assignment]
        elif node.op is Op.SIGN:
            value = builder.tanh(builder.div(values[node.args[0]], width))
        else:
            value = getattr(builder, node.op.value)(*(values[arg] for arg in node.args))
        if index in program.labels:
            builder.label(value, program.labels[index])
        values.append(value)
    outputs = [
        (port, [values[index] for index in row]) for port, row in zip(program.outputs, program.results, strict=True)
    ]
    notes = (*program.notes, "sgn(x) is replaced by tanh(x/eps).")
    return builder.program(f"{program.name}_smooth", outputs, program.summary, program.formula, notes, program.status)
