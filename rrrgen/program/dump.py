"""Print a program as text, for reading and for comparing in tests.

The text lists the ports, the definitions (one per line), the outputs and the operation counts:

    height: Height of the tip above the base.
      h = d + a sin(q1)
      in   q  (1)  rad  position  joint positions
      out  h  ()   m    other     base frame, height
      %1 = sin(q[0])  # s1
      %2 = (3/5)*%1
      %3 = 2 + %2
      h = %3
      operations: 1 mul, 1 add, 1 sincos

Definitions are numbered in the order of evaluation; inputs and constants stand where they are used. A name suggested
for printed code follows its definition after ``#``. Constants are exact where that is short; ``~`` marks the nearest
double of others.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from itertools import count
from typing import TYPE_CHECKING

from rrrgen.program.counts import count_operations
from rrrgen.program.nodes import Node, Op
from rrrgen.program.ports import Port

if TYPE_CHECKING:
    from rrrgen.program.ir import Program

_INFIX = {Op.ADD: " + ", Op.SUB: " - ", Op.MUL: "*", Op.DIV: "/"}
_LONGEST_FRACTION = 12  # characters
_WIDTH = 100


def text_of(program: Program) -> str:
    """Print ``program`` as text in the format of the module's docstring, ending with a line feed."""
    texts: list[str] = []
    numbers = count(1)
    lines: list[str] = []
    for index, node in enumerate(program.nodes):
        if node.op is Op.INPUT:
            port, element = node.place
            texts.append(_element(program.inputs[port], element))
        elif node.op is Op.CONST:
            texts.append(_constant(node.number))
        else:
            texts.append(f"%{next(numbers)}")
            label = f"  # {program.labels[index]}" if index in program.labels else ""
            lines.append(f"{texts[-1]} = {_operation(node, texts)}{label}")
    for port_, elements in zip(program.outputs, program.results, strict=True):
        lines += _broken(f"{port_.name} = ", [texts[index] for index in elements])
    title = f"{program.name}: {program.summary}" if program.summary else f"{program.name}:"
    formula = [line.strip() for line in program.formula.splitlines()]
    body = [*formula, *_ports(program), *lines, f"operations: {count_operations(program)}"]
    return "\n".join([title, *(f"  {line}" for line in body)]) + "\n"


def _ports(program: Program) -> list[str]:
    rows = [("in", *_facts(port)) for port in program.inputs]
    for k, port in enumerate(program.outputs):
        direction, facts = ("status", _facts(port)) if program.is_status(k) else ("out", _facts(port))
        meaning = facts[-1]
        if direction == "status" and program.status:
            meaning = "0, or " + ", ".join(f"{each.code} where {each.meaning}" for each in program.status.failures)
        rows.append((direction, *facts[:-1], meaning))
    widths = [max(len(row[k]) for row in rows) for k in range(5)] if rows else []
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, [*widths, 0], strict=True)).rstrip() for row in rows
    ]


def _facts(port: Port) -> tuple[str, str, str, str, str]:
    """Name, shape, unit, role and description of a port."""
    shape = "(" + ", ".join(map(str, port.shape)) + ")"
    words = ", ".join(part for part in (port.frame, port.meaning) if part)
    return port.name, shape, port.unit or "-", port.role.value, words


def _element(port: Port, element: int) -> str:
    return f"{port.name}[{element}]" if port.shape else port.name


def _constant(value: Fraction | int) -> str:
    exact = str(value)
    return exact if len(exact) <= _LONGEST_FRACTION else f"~{float(value)!r}"


def _operation(node: Node, texts: Sequence[str]) -> str:
    args = [texts[arg] for arg in node.args]
    if node.op in _INFIX:
        left, right = (f"({arg})" if arg[0] in "-~" or "/" in arg else arg for arg in args)
        return f"{left}{_INFIX[node.op]}{right}"
    if node.op is Op.NEG:
        return f"-{args[0]}"
    if node.op is Op.SELECT:
        return f"{args[0]} > 0 ? {args[1]} : {args[2]}"
    return f"{node.op.value}({', '.join(args)})"


def _broken(head: str, values: Sequence[str]) -> list[str]:
    """Print ``head`` followed by the values, joined by commas and wrapped at the line width."""
    lines, line = [], head
    for k, value in enumerate(values):
        cell = value + (", " if k < len(values) - 1 else "")
        if len(line) + len(cell) > _WIDTH and line != head:
            lines.append(line.rstrip())
            line = " " * len(head)
        line += cell
    return [*lines, line.rstrip()]
