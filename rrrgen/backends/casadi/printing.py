"""Straight-line text of a program: one assignment per shared value, everything used once folded into its user.

The order of the arithmetic is the program's: parentheses stay wherever leaving them out would change the grouping.
"""

from __future__ import annotations

import keyword
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction

from rrrgen.backends.casadi.derivatives import input_place
from rrrgen.program import Op, Program
from rrrgen.program.ir import uses
from rrrgen.robotfile.names import KEYWORDS, ROBOT_RESERVED

_SUM, _PRODUCT, _ATOM = 1, 2, 3
_LOCAL = ("arg", "res", "iw", "w", "mem", "ca", "gamma", "y0", "y1", "yn", "j0", "j1", "jn")
_RESERVED = KEYWORDS | ROBOT_RESERVED | frozenset(_LOCAL)


@dataclass(frozen=True)
class Dialect:
    """How a language writes constants, functions, and the conditional."""

    constant: Callable[[Fraction], str]
    functions: dict[Op, str]
    select: str  # with {condition}, {positive}, {otherwise}
    width: int = 56  # longest right-hand side that single-use values are folded into


@dataclass(frozen=True)
class Listing:
    """``assignments`` (name, expression) in order, then one expression per element of every output."""

    assignments: tuple[tuple[str, str], ...]
    results: tuple[tuple[str, ...], ...]
    used_inputs: frozenset[tuple[int, int]]  # (port, element)


class Names:
    """Identifiers, each given out once."""

    def __init__(self, taken: Iterable[str] = ()) -> None:
        self._taken = set(taken)
        self._count = 0

    def claim(self, wish: str) -> str:
        """``wish``, made an identifier and, if it is taken, numbered."""
        base = re.sub(r"\W", "_", wish, flags=re.ASCII)
        if not base or base[0].isdigit() or base[0] == "_":
            base = f"v{base}"
        name, number = base, 1
        while name in self._taken or name in _RESERVED or keyword.iskeyword(name):
            number += 1
            name = f"{base}_{number}"
        self._taken.add(name)
        return name

    def fresh(self) -> str:
        """The next t1, t2, ... that is free."""
        while True:
            self._count += 1
            name = f"t{self._count}"
            if name not in self._taken:
                self._taken.add(name)
                return name


def listing(program: Program, elements: Sequence[Sequence[str]], names: Names, dialect: Dialect) -> Listing:
    """Write ``program`` in ``dialect``; ``elements[port][element]`` are the names of its inputs."""
    readers = uses(program)
    assignments: list[tuple[str, str]] = []
    texts: list[tuple[str, int]] = []
    used: set[tuple[int, int]] = set()
    for index, node in enumerate(program.nodes):
        if node.op is Op.INPUT:
            port, element = input_place(node)
            used.add((port, element))
            texts.append((elements[port][element], _ATOM))
            continue
        if node.op is Op.CONST:
            text = dialect.constant(node.value)  # type: ignore[arg-type]
            texts.append((text, _SUM if text.startswith("-") else _ATOM))
            continue
        text, strength = _operation(node.op, [texts[a] for a in node.args], dialect)
        if readers[index] != 1 or index in program.labels or len(text) > dialect.width:
            name = names.claim(program.labels[index]) if index in program.labels else names.fresh()
            assignments.append((name, text))
            text, strength = name, _ATOM
        texts.append((text, strength))
    results = tuple(tuple(texts[index][0] for index in row) for row in program.results)
    return Listing(tuple(assignments), results, frozenset(used))


def _operation(op: Op, operands: Sequence[tuple[str, int]], dialect: Dialect) -> tuple[str, int]:
    if op is Op.SELECT:
        condition, positive, otherwise = (text for text, _ in operands)
        return dialect.select.format(condition=condition, positive=positive, otherwise=otherwise), _ATOM
    if op in dialect.functions:
        return f"{dialect.functions[op]}({operands[0][0]})", _ATOM
    first = operands[0]
    if op is Op.NEG:
        return f"-{_inside(first, _PRODUCT)}", _SUM
    second = operands[1]
    if op is Op.ADD:
        return f"{first[0]} + {_inside(second, _PRODUCT)}", _SUM
    if op is Op.SUB:
        return f"{first[0]} - {_inside(second, _PRODUCT)}", _SUM
    sign = "*" if op is Op.MUL else "/"
    return f"{_inside(first, _PRODUCT)}{sign}{_inside(second, _ATOM)}", _PRODUCT


def _inside(operand: tuple[str, int], needed: int) -> str:
    text, strength = operand
    return text if strength >= needed else f"({text})"
