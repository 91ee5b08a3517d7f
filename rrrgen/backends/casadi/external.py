"""C behind CasADi's external interface: the functions and their derivatives, found by ``casadi.external``.

For a function ``f`` of the robot ``name`` the symbols are ``<name>_casadi_f``, and ``jac_``, ``fwd1_``, ``adj1_`` and
``fwd1_adj1_`` in front of it for its derivatives: the names under which CasADi looks them up. The robot's name is part
of every symbol, so robots do not clash with each other nor with the plain C of the same robot (``<name>_f``).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction

from rrrgen.backends.casadi.derivatives import Matrix, Routine, forward, jacobian, reverse, routine
from rrrgen.backends.casadi.printing import Dialect, Listing, Names, listing
from rrrgen.program import Op, Program
from rrrgen.resources import render

_TRANSFORMS = {"jac": jacobian, "fwd1": forward, "adj1": reverse}

_MATHS = {
    Op.SIN: ("sin", "sin((double)x)"),
    Op.COS: ("cos", "cos((double)x)"),
    Op.SQRT: ("sqrt", "sqrt((double)x)"),
    Op.ABS: ("abs", "fabs((double)x)"),
    Op.SIGN: ("sign", "(x > 0) - (x < 0)"),
    Op.EXP: ("exp", "exp((double)x)"),
    Op.TANH: ("tanh", "tanh((double)x)"),
}


def derivative(base: Routine, kind: str) -> Routine:
    """The derivative ``kind`` of ``base``: "jac", "fwd1", "adj1", or several joined by "_", outermost first."""
    for step in reversed(kind.split("_")):
        base = _TRANSFORMS[step](base)
    return base


@dataclass(frozen=True)
class _Definition:
    """One external function, ready for the template."""

    name: str
    comment: tuple[str, ...]
    inputs: tuple[Matrix, ...]
    outputs: tuple[Matrix, ...]
    sparsity_in: tuple[int, ...]  # indices into the table of patterns
    sparsity_out: tuple[int, ...]
    loads: tuple[str, ...]
    assignments: tuple[str, ...]
    results: tuple[tuple[str, ...], ...]


def external_sources(
    robot: str,
    programs: Sequence[tuple[str, Program, Sequence[str]]],
    header: Sequence[str] = (),
) -> dict[str, str]:
    """``<robot>_casadi.h`` and ``<robot>_casadi.c`` for ``programs`` = (public name, program, derivative kinds).

    Derivative kinds are "jac", "fwd1", "adj1" and "fwd1_adj1". The code is C99 and C++, has no state, no heap and no
    working memory, and computes in ``casadi_real``, which is double unless defined otherwise when compiling.
    """
    patterns: dict[tuple[int, ...], int] = {}
    definitions, maths = [], set()
    for public, program, kinds in programs:
        base = routine(program, f"{robot}_casadi_{public}")
        for item in (base, *(derivative(base, kind) for kind in kinds)):
            definitions.append(_definition(robot, item, program if item is base else None, patterns))
            maths |= {node.op for node in item.program.nodes} & set(_MATHS)
    context = {
        "robot": robot,
        "header": [_harmless(line) for line in header],
        "definitions": definitions,
        "patterns": [", ".join(map(str, pattern)) for pattern in patterns],
        "maths": [_MATHS[op] for op in _MATHS if op in maths],
    }
    return {
        f"{robot}_casadi.h": render("casadi/external.h.j2", **context),
        f"{robot}_casadi.c": render("casadi/external.c.j2", **context),
    }


def _dialect(robot: str) -> Dialect:
    return Dialect(
        constant=_constant,
        functions={op: f"{robot}_casadi_{name}" for op, (name, _) in _MATHS.items()},
        select="({condition} > 0 ? {positive} : {otherwise})",
    )


def _constant(value: Fraction) -> str:
    whole = value.denominator == 1 and abs(value.numerator) < 2**24
    magnitude = str(abs(value.numerator)) if whole else f"{float(abs(value)):.17g}"
    if not whole and not set(magnitude) & set(".en"):
        magnitude += ".0"
    return f"{'-' if value < 0 else ''}(casadi_real){magnitude}"


def _definition(robot: str, item: Routine, source: Program | None, patterns: dict[tuple[int, ...], int]) -> _Definition:
    names = Names()
    elements = [_element_names(names, matrix) for matrix in item.inputs]
    written = listing(item.program, elements, names, _dialect(robot))
    return _Definition(
        name=item.name,
        comment=tuple(_harmless(line) for line in _comment(item, source)),
        inputs=item.inputs,
        outputs=item.outputs,
        sparsity_in=tuple(_pattern(m, patterns) for m in item.inputs),
        sparsity_out=tuple(_pattern(m, patterns) for m in item.outputs),
        loads=tuple(_loads(elements, written)),
        assignments=tuple(f"const casadi_real {name} = {text};" for name, text in written.assignments),
        results=written.results,
    )


def _loads(elements: Sequence[Sequence[str]], written: Listing) -> Iterable[str]:
    """Reading the inputs that are used; CasADi passes a null pointer for an input that is zero."""
    for port, row in enumerate(elements):
        for element, name in enumerate(row):
            if (port, element) in written.used_inputs:
                yield f"const casadi_real {name} = arg[{port}] ? arg[{port}][{element}] : (casadi_real)0;"


def _element_names(names: Names, matrix: Matrix) -> list[str]:
    if matrix.rows == matrix.cols == 1:
        return [names.claim(matrix.name) for _ in matrix.entries]
    if matrix.cols == 1:
        return [names.claim(f"{matrix.name}{r + 1}") for r, _ in matrix.entries]
    return [names.claim(f"{matrix.name}_{r + 1}_{c + 1}") for r, c in matrix.entries]


def _pattern(matrix: Matrix, patterns: dict[tuple[int, ...], int]) -> int:
    """The index of the matrix' sparsity in CasADi's notation: rows, columns, then 1 (dense) or compressed columns."""
    if matrix.is_dense:
        key: tuple[int, ...] = (matrix.rows, matrix.cols, 1)
    else:
        starts = [0] * (matrix.cols + 1)
        for _, column in matrix.entries:
            starts[column + 1] += 1
        for column in range(matrix.cols):
            starts[column + 1] += starts[column]
        key = (matrix.rows, matrix.cols, *starts, *(row for row, _ in matrix.entries))
    return patterns.setdefault(key, len(patterns))


def _harmless(line: str) -> str:
    """A line that cannot end the comment it stands in."""
    return line.replace("*/", "* /").replace("/*", "/ *")


def _comment(item: Routine, source: Program | None) -> Iterable[str]:
    program = source or item.program
    yield program.summary or item.name
    if source is not None:
        if source.formula:
            yield source.formula
        for word, ports in (("arg", source.inputs), ("res", source.outputs)):
            for place, port in enumerate(ports):
                shape = "x".join(map(str, port.shape)) or "scalar"
                facts = ", ".join(part for part in (shape, port.unit, port.frame, port.meaning) if part)
                yield f"{word}[{place}] {port.name}: {facts}"
