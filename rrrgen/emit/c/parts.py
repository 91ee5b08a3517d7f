"""Printing of a long function as static functions for its parts and one that calls them."""

from __future__ import annotations

import re
from dataclasses import dataclass

from rrrgen.emit.c.division import Division
from rrrgen.emit.c.header_comments import declaration, function_name, input_parameter, output_parameter
from rrrgen.emit.c.language import CTarget, Dialect, SinCos
from rrrgen.emit.interface import Text
from rrrgen.emit.printing import FunctionBody, Names
from rrrgen.program import Port, Program


@dataclass(frozen=True)
class FunctionPart:
    """The texts of one static function: prototype and lines of its body."""

    prototype: str
    body: tuple[str, ...]


def print_in_parts(
    program: Program, division: Division, dialect: Dialect, sincos: SinCos
) -> tuple[tuple[FunctionPart, ...], list[str]]:
    """The parts of a long function, and the lines of the body of the function itself."""
    target = CTarget(dialect, sincos)
    ports = (*program.inputs, *program.outputs)
    shared = Names(target.reserved, [port.name for port in ports]).from_hint("shared")
    printed = _DividedBody(program, target, division, shared)
    parts, calls = [], []
    for k, lines in enumerate(printed.parts, 1):
        name = f"{function_name(program, dialect)}_part_{k}"
        used = set(re.findall(r"\w+", "\n".join(lines), flags=re.ASCII))
        inputs = [port for port in program.inputs if port.name in used]
        outputs = [port for port in program.data_outputs if port.name in used]
        array = Port(shared, (division.size,))
        writes = any(line.startswith(f"{shared}[") for line in lines)
        parameters = [
            *(input_parameter(port, dialect) for port in inputs),
            output_parameter(array, dialect) if writes else input_parameter(array, dialect),
            *(output_parameter(port, dialect) for port in outputs),
        ]
        parts.append(FunctionPart(declaration(f"static void {name}(", parameters), tuple(lines)))
        calls.append(f"{name}({', '.join(port.name for port in (*inputs, array, *outputs))});")
    head = f"{dialect.real_type} {shared}[{division.size}]; /* values that several parts need */"
    return tuple(parts), [head, *printed.unused, *calls, *printed.lines]


class _DividedBody(FunctionBody):
    """The statements of a divided function: of the ``parts``, and in ``lines`` what the function reports behind them.

    ``unused`` are the statements about inputs that nothing reads.
    """

    def __init__(self, program: Program, target: CTarget, division: Division, shared: str) -> None:
        self.parts: list[list[str]] = []
        self.unused: list[str] = []
        self._division, self._shared = division, shared
        self._stored: set[int] = set()
        super().__init__(program, target, [shared])

    def _visit(self, index: int) -> None:
        if index in self._division.starts[:-1]:
            self._begin(self._division.starts.index(index))
        super()._visit(index)

    def _begin(self, part: int) -> None:
        """End the part before, and take from the shared array what this one needs from earlier ones."""
        if part == 0:
            self.unused = self.lines
        else:
            self._end(part)
        self.lines = []
        for node in self._division.loaded[part]:
            self.lines.append(self.target.declaration(self.texts[node].code, self._element(node)))

    def _end(self, part: int) -> None:
        """Store what later parts need and has no local variable yet: it stood in an expression to come."""
        for node in self._division.slots:
            if node < self._division.starts[part] and node not in self._stored:
                self._settle(node)
        self.parts.append(self.lines)

    def _declare(self, index: int, text: Text) -> Text:
        declared = super()._declare(index, text)
        self._store(index)
        return declared

    def _declare_trigonometry(self, index: int) -> None:
        fresh = not self.texts[index].code
        super()._declare_trigonometry(index)
        if fresh:
            for node in self._trigonometry[self.program.nodes[index].args[0]].values():
                self._store(node)

    def _store(self, node: int) -> None:
        if node in self._division.slots:
            self._stored.add(node)
            self.lines.append(f"{self._element(node)} = {self.texts[node].code};")

    def _element(self, node: int) -> str:
        return f"{self._shared}[{self._division.slots[node]}]"

    def _finish(self) -> None:
        super()._finish()
        self._end(self._division.parts)
        self.lines = []
        for node in self._division.loaded[-1]:
            self.lines.append(self.target.declaration(self.texts[node].code, self._element(node)))
