"""Expressions of a recorded solver: a directed graph in which equal expressions are the same node.

The operations are those of :class:`rrrgen.program.Op`. Constants are floats, or exact SymPy expressions in the link
lengths where the record is made for reading.

Expressions are simplified while they are built: ``0 x``, ``1 x``, ``x + 0`` and arithmetic on constants are folded, so
equations written once for every geometry reduce to the terms of the robot at hand. Each node knows its ``level``, the
depth of nested root choices at which its value is first known.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Union

from rrrgen.program import Op

Constant = Any
"""A constant in an expression: a float, or an exact SymPy expression."""

Operand = Union["SolverScalar", Constant]


class SolverScalar:
    """One node of an expression.

    ``op`` is CONST (a number ``value``), INPUT (a variable with the name ``text``), or an operation on ``args``.
    ``level`` is the innermost choice of a root that the node depends on, 0 if none.
    """

    __slots__ = ("args", "level", "op", "pool", "text", "value")

    def __init__(
        self,
        pool: Pool,
        op: Op,
        args: tuple[SolverScalar, ...] = (),
        *,
        value: Constant = 0.0,
        text: str = "",
        level: int = 0,
    ) -> None:
        self.pool, self.op, self.args, self.value, self.text = pool, op, args, value, text
        self.level: int = max((arg.level for arg in args), default=level)

    def __add__(self, other: Operand) -> SolverScalar:
        return self.pool.add(self, self.pool.of(other))

    def __radd__(self, other: Operand) -> SolverScalar:
        return self.pool.add(self.pool.of(other), self)

    def __sub__(self, other: Operand) -> SolverScalar:
        return self.pool.sub(self, self.pool.of(other))

    def __rsub__(self, other: Operand) -> SolverScalar:
        return self.pool.sub(self.pool.of(other), self)

    def __mul__(self, other: Operand) -> SolverScalar:
        return self.pool.mul(self, self.pool.of(other))

    def __rmul__(self, other: Operand) -> SolverScalar:
        return self.pool.mul(self.pool.of(other), self)

    def __truediv__(self, other: Operand) -> SolverScalar:
        return self.pool.div(self, self.pool.of(other))

    def __rtruediv__(self, other: Operand) -> SolverScalar:
        return self.pool.div(self.pool.of(other), self)

    def __neg__(self) -> SolverScalar:
        return self.pool.neg(self)

    @property
    def is_const(self) -> bool:
        """Whether the node is a number."""
        return self.op is Op.CONST

    @property
    def is_plain(self) -> bool:
        """Whether the node is a number, a variable or a negated variable, which needs no name of its own."""
        return self.op in (Op.CONST, Op.INPUT) or (self.op is Op.NEG and self.args[0].op is Op.INPUT)


def _to_float(x: Any) -> float:
    return float(x) + 0.0


class Pool:
    """Factory of scalars that returns the same node for equal expressions.

    ``number`` converts numbers to the constants of the pool, floats by default.
    """

    def __init__(self, number: Callable[[Any], Constant] = _to_float) -> None:
        self._nodes: dict[tuple[object, ...], SolverScalar] = {}
        self._number = number

    def of(self, x: Operand) -> SolverScalar:
        """Return the node of the number ``x``; an ``x`` that is a node already is returned as it is."""
        if isinstance(x, SolverScalar):
            return x
        return self._node(Op.CONST, (), value=self._number(x))

    def var(self, text: str, level: int = 0) -> SolverScalar:
        """A variable with the name ``text``, known from loop depth ``level`` on."""
        return self._node(Op.INPUT, (), text=text, level=level)

    def add(self, x: SolverScalar, y: SolverScalar) -> SolverScalar:
        """The sum ``x + y``, simplified."""
        if x.is_const and y.is_const:
            return self.of(x.value + y.value)
        if x.is_const:
            x, y = y, x
        if y.is_const and y.value == 0:
            return x
        if y.op is Op.NEG:
            return self.sub(x, y.args[0])
        if x.op is Op.NEG:
            return self.sub(y, x.args[0])
        if y.is_const and _is_negative(y.value):
            return self._node(Op.SUB, (x, self.of(-y.value)))
        return self._node(Op.ADD, (x, y))

    def sub(self, x: SolverScalar, y: SolverScalar) -> SolverScalar:
        """The difference ``x - y``, simplified."""
        if x is y:
            return self.of(0.0)
        if y.is_const:
            return self.add(x, self.of(-y.value))
        if x.is_const and x.value == 0:
            return self.neg(y)
        if y.op is Op.NEG:
            return self.add(x, y.args[0])
        return self._node(Op.SUB, (x, y))

    def mul(self, x: SolverScalar, y: SolverScalar) -> SolverScalar:
        """The product ``x y``, simplified: signs move outwards, constants to the front."""
        if x.is_const and y.is_const:
            return self.of(x.value * y.value)
        if y.is_const:
            x, y = y, x
        if x.is_const:
            if x.value == 0 or x.value == 1:
                return x if x.value == 0 else y
            if _is_negative(x.value):
                return self.neg(self.mul(self.of(-x.value), y))
            if y.op is Op.MUL and y.args[0].is_const:
                return self.mul(self.of(x.value * y.args[0].value), y.args[1])
        if x.op is Op.NEG:
            return self.neg(self.mul(x.args[0], y))
        if y.op is Op.NEG:
            return self.neg(self.mul(x, y.args[0]))
        return self._node(Op.MUL, (x, y))

    def div(self, x: SolverScalar, y: SolverScalar) -> SolverScalar:
        """The quotient ``x / y``, simplified: division by a constant becomes a product."""
        if y.is_const:
            return self.mul(self.of(1 / y.value), x)
        if x.is_const and x.value == 0:
            return x
        if x.op is Op.NEG:
            return self.neg(self.div(x.args[0], y))
        return self._node(Op.DIV, (x, y))

    def neg(self, x: SolverScalar) -> SolverScalar:
        """The negative ``-x``, simplified."""
        if x.is_const:
            return self.of(-x.value)
        if x.op is Op.NEG:
            return x.args[0]
        if x.op is Op.SUB:
            return self.sub(x.args[1], x.args[0])
        return self._node(Op.NEG, (x,))

    def sqrt(self, x: SolverScalar) -> SolverScalar:
        """The square root of an ``x`` that cannot be negative; ``sqrt(a a)`` becomes ``|a|``."""
        if x.is_const and isinstance(x.value, float):
            return self.of(max(x.value, 0.0) ** 0.5)
        if x.op is Op.MUL and x.args[0] is x.args[1]:
            return self._node(Op.ABS, x.args[:1])
        return self._node(Op.SQRT, (x,))

    def clamped_sqrt(self, x: SolverScalar) -> SolverScalar:
        """The square root of ``x``, or 0 where rounding makes ``x`` negative."""
        root = self.sqrt(x)
        return self._node(Op.SELECT, (x, root, self.of(0.0))) if root.op is Op.SQRT else root

    def _node(
        self, op: Op, args: tuple[SolverScalar, ...], *, value: Constant = 0.0, text: str = "", level: int = 0
    ) -> SolverScalar:
        key = (op, value, text, *map(id, args))
        if op is Op.ADD or op is Op.MUL:
            key = (op, *sorted(map(id, args)))
        node = self._nodes.get(key)
        if node is None:
            node = self._nodes[key] = SolverScalar(self, op, args, value=value, text=text, level=level)
        return node


def _is_negative(x: Constant) -> bool:
    """Whether a number is below zero, or an expression is written with a sign in front."""
    return x < 0.0 if isinstance(x, float) else bool(x.could_extract_minus_sign())


def collect(value: SolverScalar, ids: set[int]) -> None:
    """Add the ids of ``value`` and of everything that it depends on to ``ids``."""
    if id(value) not in ids:
        ids.add(id(value))
        for arg in value.args:
            collect(arg, ids)


def fresh_name(hint: str, taken: set[str]) -> str:
    """``hint``, or with the first number behind it that makes a name outside ``taken``, to which the name is added."""
    text, serial = hint, 1
    while text in taken:
        serial += 1
        text = f"{hint}_{serial}"
    taken.add(text)
    return text
