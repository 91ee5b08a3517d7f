"""Closed forms with named intermediate results, for functions that would fill pages when expanded."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import count

import sympy as sp

from rrrgen.program import Op, Program
from rrrgen.program.nodes import reachable
from rrrgen.program.polynomials import to_expression

LETTER = "t"
"""Intermediate results are called t1, t2, ..."""


@dataclass(frozen=True)
class SharedForm:
    """A matrix whose entries use intermediate results: ``definitions`` in order of evaluation, then ``matrix``.

    A definition (symbol, expression) uses inputs, parameters and earlier symbols only. Substituted from the last to the
    first, the definitions turn ``matrix`` into the expanded closed form.
    """

    definitions: tuple[tuple[sp.Symbol, sp.Expr], ...]
    matrix: sp.Matrix

    @property
    def free_symbols(self) -> set[sp.Symbol]:
        """The symbols of the function itself, without those of the definitions."""
        parts = [self.matrix, *(value for _, value in self.definitions)]
        return set().union(*(part.free_symbols for part in parts)) - {symbol for symbol, _ in self.definitions}


def shared_form(
    program: Program,
    results: Sequence[int],
    shape: tuple[int, int],
    inputs: Sequence[Sequence[sp.Expr]],
    angles: Mapping[int, sp.Expr],
) -> SharedForm:
    """Write the nodes ``results`` of ``program`` as a matrix of ``shape``, with names for values used more than once.

    ``inputs`` holds one symbol per element of every input, ``angles`` the expression of every node that is the argument
    of a sine or cosine. Sines and cosines stay whole: they are part of the notation.
    """
    needed = [k for k in reachable(program.nodes, results) if k not in angles]
    uses = _uses(program, needed, results)
    taken = {str(symbol) for port in inputs for symbol in port}
    names = (name for k in count(1) if (name := f"{LETTER}{k}") not in taken)
    definitions: list[tuple[sp.Symbol, sp.Expr]] = []
    values: dict[int, sp.Expr] = {}
    for k in needed:
        node = program.nodes[k]
        if node.op is Op.INPUT:
            port, element = node.place
            value = inputs[port][element]
        elif node.op is Op.CONST:
            value = to_expression(node.number)
        elif node.op in (Op.SIN, Op.COS):
            value = (sp.sin if node.op is Op.SIN else sp.cos)(angles[node.args[0]])
        else:
            value = _OPERATIONS[node.op](*(values[arg] for arg in node.args))
            if uses[k] > 1 and not _is_short(value):
                symbol = sp.Symbol(next(names), real=True)
                definitions.append((symbol, value))
                value = symbol
        values[k] = value
    return SharedForm(tuple(definitions), sp.Matrix(*shape, [values[k] for k in results]))


def _uses(program: Program, needed: Iterable[int], results: Sequence[int]) -> Counter[int]:
    """Count how often each node is printed; x + x, printed as 2*x, counts once, and so do equal entries."""
    nodes = (program.nodes[k] for k in needed)
    used = Counter(arg for node in nodes for arg in (set(node.args) if node.op is Op.ADD else node.args))
    return used + Counter(set(results))


def _is_short(value: sp.Expr) -> bool:
    """Whether ``value`` is so short that naming it gains nothing: a symbol, number or sine, or its negative."""
    _, rest = value.as_coeff_Mul()
    return bool((rest.is_Atom or rest.is_Function) and value in (rest, -rest))


_OPERATIONS: dict[Op, Callable[..., sp.Expr]] = {
    Op.ADD: lambda x, y: x + y,
    Op.SUB: lambda x, y: x - y,
    Op.MUL: lambda x, y: x * y,
    Op.DIV: lambda x, y: x / y,
    Op.NEG: lambda x: -x,
}
