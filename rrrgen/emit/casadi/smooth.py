"""Replacement of sgn by a smooth function, for solvers that differentiate through Coulomb friction."""

from __future__ import annotations

from rrrgen.emit.casadi.derivatives import input_place
from rrrgen.program import Builder, Op, Port, Program, Value


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
