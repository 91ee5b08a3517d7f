"""Doubling by addition: ``2 x`` becomes ``x + x``, which no processor does more slowly than a product."""

from __future__ import annotations

from rrrgen.program import Builder, Op, Program, Value


def double_by_addition(program: Program) -> Program:
    """``program`` with products by two recorded as additions."""
    if not any(node.op is Op.MUL and _is_two(program, node.args[0]) for node in program.nodes):
        return program
    builder = Builder()
    inputs = [builder.input(port) for port in program.inputs]
    values: list[Value] = []
    for index, node in enumerate(program.nodes):
        if node.op is Op.INPUT:
            port, element = node.place
            value: Value = inputs[port][element]
        elif node.op is Op.CONST:
            value = node.number
        elif node.op is Op.MUL and _is_two(program, node.args[0]):
            value = builder.double(values[node.args[1]])
        else:
            value = getattr(builder, node.op.value)(*(values[arg] for arg in node.args))
        if index in program.labels:
            builder.label(value, program.labels[index])
        values.append(value)
    outputs = [(port, [values[k] for k in row]) for port, row in zip(program.outputs, program.results, strict=True)]
    return builder.program(program.name, outputs, program.summary, program.formula, program.notes)


def _is_two(program: Program, index: int) -> bool:
    node = program.nodes[index]
    return node.op is Op.CONST and node.value == 2
