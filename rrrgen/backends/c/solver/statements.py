"""Statements of emitted C between loops: every value is computed once, as far outside as it can be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import prod
from typing import ClassVar

from rrrgen.ik.recording.scalar import Scalar

_FUNCTIONS = {"sqrt": "SQRT", "fabs": "FABS", "root0": "ik_root0", "wrap": "ik_wrap"}
"""Functions of one scalar under their names in the kernels."""


@dataclass(frozen=True)
class Loop:
    """One loop over the roots of a choice; ``level`` is the number of loops that its count depends on."""

    variable: str
    count: str
    most: int
    level: int


def position(loops: Sequence[Loop]) -> tuple[list[str], int]:
    """Terms of the index of a turn of ``loops``, and the number of turns."""
    terms = []
    for k, loop in enumerate(loops):
        stride = prod(inner.most for inner in loops[k + 1 :])
        terms.append(loop.variable if stride == 1 else f"{stride} * {loop.variable}")
    return terms, prod(loop.most for loop in loops)


@dataclass
class Statement:
    """Text at a loop level; ``{0}``, ``{1}`` ... are replaced by the operands."""

    level: int
    lines: tuple[str, ...]
    operands: tuple[Scalar, ...]
    defines: Scalar | None = None
    """The one variable of a plain definition, which can be left out where nothing uses it."""


@dataclass(frozen=True)
class CBody:
    """The finished body of the branch function, and the functions of the templates that it needs."""

    text: str
    needs: frozenset[str]


def opening(loop: Loop, count: str = "") -> str:
    """The line that opens a loop."""
    return f"for (int {loop.variable} = 0; {loop.variable} < {count or loop.count}; ++{loop.variable}) {{"


class _Printer:
    """Places expressions: shared or hoisted ones get a name at their own level, the rest are written in place."""

    ORDER: ClassVar[dict[str, int]] = {"add": 1, "sub": 1, "neg": 2, "mul": 3, "div": 3}

    def __init__(self, items: list[Statement], loops: list[Loop], taken: set[str]) -> None:
        self.items, self.loops, self.taken = items, loops, taken
        self.blocks: list[list[str]] = [[] for _ in range(len(loops) + 1)]
        self.named: dict[int, str] = {}
        self.uses: dict[int, int] = {}
        self.serial = 0

    def text(self) -> str:
        """The nested loops."""
        for item in self.items:
            for operand in item.operands:
                self._count(operand)
        for item in self.items:
            rendered = [self._render(operand, item.level, 0) for operand in item.operands]
            self.blocks[item.level] += [_fill(line, rendered) for line in item.lines]
        lines: list[str] = []
        for depth, block in enumerate(self.blocks):
            lines += ["    " * (depth + 1) + line for line in block]
            if depth < len(self.loops):
                lines.append("    " * (depth + 1) + opening(self.loops[depth]))
        for depth in reversed(range(len(self.loops))):
            lines.append("    " * (depth + 1) + "}")
        return "\n".join(lines)

    def _count(self, node: Scalar) -> None:
        self.uses[id(node)] = self.uses.get(id(node), 0) + 1
        if self.uses[id(node)] == 1:
            for arg in node.args:
                self._count(arg)

    def _render(self, node: Scalar, level: int, strength: int) -> str:
        if node.op == "var":
            return node.text
        if node.op == "const":
            text = repr(node.value)
            return f"(REAL){text}" if node.value >= 0 else f"-(REAL){text[1:]}"
        trivial = node.op == "neg" and node.args[0].op == "var"
        if id(node) not in self.named and not trivial and (self.uses[id(node)] > 1 or node.level < level):
            expression = self._expression(node, node.level, 0)
            self.serial += 1
            while f"t{self.serial}" in self.taken:
                self.serial += 1
            name = self.named[id(node)] = f"t{self.serial}"
            self.blocks[node.level].append(f"const REAL {name} = {expression};")
        if id(node) in self.named:
            return self.named[id(node)]
        return self._expression(node, level, strength)

    def _expression(self, node: Scalar, level: int, strength: int) -> str:
        if node.op in _FUNCTIONS:
            return f"{_FUNCTIONS[node.op]}({self._render(node.args[0], level, 0)})"
        own = self.ORDER[node.op]
        if node.op == "neg":
            text = f"-{self._render(node.args[0], level, 4)}"
        else:
            sign = {"add": "+", "sub": "-", "mul": "*", "div": "/"}[node.op]
            left = self._render(node.args[0], level, own)
            right = self._render(node.args[1], level, own + (node.op in ("sub", "div", "mul")))
            text = f"{left} {sign} {right}"
        return f"({text})" if own < strength else text


def printed(items: list[Statement], loops: list[Loop], taken: set[str]) -> str:
    """The statements between their loops, without definitions that nothing uses.

    ``taken`` are the names in use already.
    """
    return _Printer(_live(items), loops, taken).text()


def _live(items: list[Statement]) -> list[Statement]:
    """Without the definitions that nothing uses."""
    used: set[int] = set()

    def use(node: Scalar) -> None:
        if id(node) not in used:
            used.add(id(node))
            for arg in node.args:
                use(arg)

    kept = []
    for item in reversed(items):
        if item.defines is None or id(item.defines) in used:
            kept.append(item)
            for operand in item.operands:
                use(operand)
    return kept[::-1]


def _fill(line: str, operands: list[str]) -> str:
    for i, text in enumerate(operands):
        line = line.replace(f"{{{i}}}", text)
    return line
