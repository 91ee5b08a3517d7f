"""A Python module that rebuilds every function in CasADi, from CasADi alone."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from rrrgen.backends.casadi.derivatives import matrix_size
from rrrgen.backends.casadi.printing import Dialect, Names, listing
from rrrgen.program import Op, Port, Program
from rrrgen.resources import render

_LINE = 116


def _constant(value: Fraction) -> str:
    return str(value.numerator) if value.denominator == 1 and abs(value.numerator) < 2**53 else repr(float(value))


PYTHON = Dialect(
    constant=_constant,
    functions={
        Op.SIN: "ca.sin",
        Op.COS: "ca.cos",
        Op.SQRT: "ca.sqrt",
        Op.ABS: "ca.fabs",
        Op.SIGN: "ca.sign",
        Op.EXP: "ca.exp",
        Op.TANH: "ca.tanh",
    },
    select="ca.if_else({condition} > 0, {positive}, {otherwise})",
)


@dataclass(frozen=True)
class _Definition:
    """One function of the module, ready for the template."""

    name: str
    docstring: str
    body: tuple[str, ...]


def rebuild_module(
    robot: str,
    programs: Sequence[tuple[str, Program]],
    base_parameters: Sequence[tuple[str, str]] = (),
    beta_nominal: Sequence[Fraction] | None = None,
    header: Sequence[str] = (),
) -> str:
    """The text of ``<robot>_casadi.py``: one Python function per program, each returning a ``casadi.Function``.

    ``programs`` pairs public names with programs; ``base_parameters`` pairs names with expressions, for reading only.
    The module needs CasADi 3.5 or newer and nothing else.
    """
    return render(
        "casadi/module.py.j2",
        robot=robot,
        header=[_quoted(line) for line in header],
        definitions=[_definition(robot, name, program) for name, program in programs],
        base_parameters=[(json.dumps(name), json.dumps(expression)) for name, expression in base_parameters],
        beta_nominal=None if beta_nominal is None else [repr(float(value)) for value in beta_nominal],
    )


def _definition(robot: str, public: str, program: Program) -> _Definition:
    names = Names(["_rows", "_matrix", "ca", public, *(p.name for p in (*program.inputs, *program.outputs))])
    elements: list[list[str]] = []
    opening, body = [], []
    for port in program.inputs:
        rows, cols = matrix_size(port)
        opening.append(f'{port.name} = ca.SX.sym("{port.name}", {rows}, {cols})')
        elements.append([port.name] if port.size == 1 else _element_names(names, port))
    written = listing(program, elements, names, PYTHON)
    used_ports = {port for port, _ in written.used_inputs}
    for index, (port, given) in enumerate(zip(program.inputs, elements, strict=True)):
        if index in used_ports and port.size > 1:
            opening += _wrapped(f"[{', '.join(given)}] = _rows({port.name})")
    body += [f"{name} = {text}" for name, text in written.assignments]
    for port, row in zip(program.outputs, written.results, strict=True):
        body += _output(port, row)
    returned = (
        f'return ca.Function("{robot}_casadi_{public}", [{_joined(program.inputs)}], [{_joined(program.outputs)}], '
        f"{[p.name for p in program.inputs]}, {[p.name for p in program.outputs]})"
    ).replace("'", '"')
    body += _wrapped(returned)
    return _Definition(public, _docstring(program), (*opening, *body))


def _element_names(names: Names, port: Port) -> list[str]:
    rows, cols = matrix_size(port)
    if cols == 1:
        return [names.claim(f"{port.name}{k + 1}") for k in range(rows)]
    return [names.claim(f"{port.name}_{r + 1}_{c + 1}") for r in range(rows) for c in range(cols)]


def _output(port: Port, row: Sequence[str]) -> list[str]:
    rows, cols = matrix_size(port)
    lines = [f"{port.name} = _matrix({rows}, {cols}, ["]
    lines += [f"    {', '.join(row[r * cols : (r + 1) * cols])}," for r in range(rows)]
    return [line for text in lines for line in _wrapped(text)] + ["])"]


def _wrapped(text: str) -> list[str]:
    """``text`` in lines of at most the usual length, broken at spaces inside its brackets."""
    if len(text) <= _LINE:
        return [text]
    first = len(text) - len(text.lstrip())
    folded = textwrap.wrap(text.strip(), _LINE - first - 4, break_long_words=False, break_on_hyphens=False)
    return [" " * first + folded[0], *(" " * (first + 4) + line for line in folded[1:])]


def _joined(ports: Sequence[Port]) -> str:
    return ", ".join(port.name for port in ports)


def _docstring(program: Program) -> str:
    lines = [program.summary or f"{program.name}."]
    if program.formula:
        lines += ["", program.formula]
    lines.append("")
    for kind, ports in (("input ", program.inputs), ("output", program.outputs)):
        for port in ports:
            rows, cols = matrix_size(port)
            facts = "; ".join(part for part in (port.meaning, port.unit, port.frame) if part)
            lines.append(f"{kind} {port.name} ({rows}, {cols}){': ' + facts if facts else ''}")
    lines += ["", *program.notes] if program.notes else []
    text = "\n".join(line if not line else f"    {line}" for line in lines).strip()
    return _quoted(text)


def _quoted(text: str) -> str:
    """``text`` as it must be written inside a docstring."""
    return text.replace("\\", "\\\\").replace('"""', "'''")
