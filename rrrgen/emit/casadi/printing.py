"""Printing of a program as definitions and one expression per result, shared by CasADi's Python and C text."""

from __future__ import annotations

import keyword
from collections.abc import Sequence
from dataclasses import dataclass

from rrrgen.emit.interface import Target
from rrrgen.emit.names import Names
from rrrgen.emit.printing import Statements
from rrrgen.program import Op, Program
from rrrgen.robot.names import KEYWORDS, ROBOT_RESERVED

_LOCAL = ("arg", "res", "iw", "w", "mem", "ca", "gamma", "y0", "y1", "yn", "j0", "j1", "jn")
RESERVED = KEYWORDS | ROBOT_RESERVED | frozenset(_LOCAL) | frozenset(keyword.kwlist)
"""Names that local variables must not have, in C or in Python."""


@dataclass(frozen=True)
class Listing:
    """The text of a program: ``statements`` in order, and ``results[k]``, one expression per element of output k.

    ``used_inputs`` are the input elements that the text reads.
    """

    statements: tuple[str, ...]
    results: tuple[tuple[str, ...], ...]
    used_inputs: frozenset[tuple[int, int]]  # (port, element)


def listing(program: Program, elements: Sequence[Sequence[str]], names: Names, target: Target) -> Listing:
    """Write ``program`` for ``target``; ``elements[port][element]`` are the names of its inputs.

    The results are not among the statements: the caller writes them after all definitions, as CasADi requires.
    """
    written = Statements(program, target, names, lambda port, element: elements[port][element])
    written.write()
    results = tuple(tuple(written.texts[index].code for index in row) for row in program.results)
    used = frozenset(node.place for node in program.nodes if node.op is Op.INPUT)
    return Listing(tuple(written.lines), results, used)
