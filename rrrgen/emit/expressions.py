"""Printing of a program as definitions and one expression per result, and Python as a language to print it in.

For languages that put results together once all definitions stand: CasADi (Python and C) and JAX.
"""

from __future__ import annotations

import keyword
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from rrrgen.emit.interface import PRODUCT, Target, Text
from rrrgen.emit.printing import Names, Statements, decimal
from rrrgen.program import Op, Port, Program
from rrrgen.robot.spec import KEYWORDS, ROBOT_RESERVED

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


@dataclass(frozen=True)
class PythonTarget:
    """Python as a target of the shared printer: assignments of expressions over the symbols or arrays of a library.

    ``calls`` names the library's function for every operation that is no arithmetic. Where ``whole``, whole numbers
    are written as integers.
    """

    calls: Mapping[Op, str]
    reserved: frozenset[str] = RESERVED
    whole: bool = False
    explicit: bool = False

    def literal(self, value: Fraction | int) -> str:
        """The text of a number: the decimal of the nearest double, or an integer."""
        exact = self.whole and value.denominator == 1 and abs(value.numerator) < 2**53
        return str(value.numerator) if exact else decimal(value)

    def declaration(self, name: str, value: str) -> str:
        """The assignment that defines a local."""
        return f"{name} = {value}"

    def call(self, op: Op, argument: str) -> str:
        """The call of the library's function for an operation."""
        return f"{self.calls[op]}({argument})"

    def sign(self, x: Text) -> Text:
        """The call of the library's sign, which is 0 at 0."""
        return Text(f"{self.calls[Op.SIGN]}({x.code})")

    def minimum(self, x: Text, y: Text) -> Text:
        """The call of the library's smaller of two numbers."""
        return Text(f"{self.calls[Op.MIN]}({x.code}, {y.code})")

    def select(self, condition: Text, positive: Text, otherwise: Text) -> Text:
        """The call of the library's choice: ``positive`` where ``condition > 0``, else ``otherwise``."""
        return Text(f"{self.calls[Op.SELECT]}({condition.within(PRODUCT)} > 0, {positive.code}, {otherwise.code})")

    def sincos(self, angle: str, sine: str | None, cosine: str | None) -> list[str]:
        """Assignments of sine and cosine, one call for each that is used."""
        wanted = ((Op.SIN, sine), (Op.COS, cosine))
        return [self.declaration(name, self.call(op, angle)) for op, name in wanted if name is not None]


def element_names(names: Names, port: Port, rows: int, cols: int) -> list[str]:
    """Local names of the elements of a port that is seen as a matrix, such as q1, q2 or T_1_1, T_1_2."""
    if cols == 1:
        return [names.from_hint(f"{port.name}{k + 1}") for k in range(rows)]
    return [names.from_hint(f"{port.name}_{r + 1}_{c + 1}") for r in range(rows) for c in range(cols)]


_LINE = 116
_GLUED = "\0=\0"
_RETURN, _GLUED_RETURN = "return ", "return\0"


def fold(text: str) -> list[str]:
    """Break ``text`` into lines of at most 116 characters, at spaces inside its brackets.

    It is never broken around ``=`` or after ``return``; lines are longer where there is no other space.
    """
    if len(text) <= _LINE:
        return [text]
    first = len(text) - len(text.lstrip())
    whole = text.strip().replace(" = ", _GLUED)
    if whole.startswith(_RETURN):
        whole = whole.replace(_RETURN, _GLUED_RETURN, 1)
    lines = textwrap.wrap(whole, _LINE - first - 4, break_long_words=False, break_on_hyphens=False)
    lines = [" " * first + lines[0], *(" " * (first + 4) + line for line in lines[1:])]
    return [line.replace(_GLUED, " = ").replace(_GLUED_RETURN, _RETURN) for line in lines]


def escape_docstring(text: str) -> str:
    """Escape ``text`` for use inside a docstring."""
    return text.replace("\\", "\\\\").replace('"""', "'''")
