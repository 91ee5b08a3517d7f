"""Scalars of emitted straight-line code: hash-consed expressions over floats, folded as they are built.

``0 x``, ``1 x``, ``x + 0`` and arithmetic on constants vanish, so a kernel written once for every geometry shrinks to
the terms that a robot has. Nodes remember the loop level at which they can be computed first.
"""

from __future__ import annotations

from typing import Union

Operand = Union["Scalar", float, int]


class Scalar:
    """One node; ``level`` is the loop depth it needs.

    ``op`` is const, var, add, sub, mul, div, neg or a function: sqrt, fabs, root0, wrap.
    """

    __slots__ = ("args", "level", "op", "pool", "text", "value")

    def __init__(
        self, pool: Pool, op: str, args: tuple[Scalar, ...] = (), *, value: float = 0.0, text: str = "", level: int = 0
    ) -> None:
        self.pool, self.op, self.args, self.value, self.text = pool, op, args, value, text
        self.level: int = max((arg.level for arg in args), default=level)

    def __add__(self, other: Operand) -> Scalar:
        return self.pool.add(self, self.pool.of(other))

    def __radd__(self, other: Operand) -> Scalar:
        return self.pool.add(self.pool.of(other), self)

    def __sub__(self, other: Operand) -> Scalar:
        return self.pool.sub(self, self.pool.of(other))

    def __rsub__(self, other: Operand) -> Scalar:
        return self.pool.sub(self.pool.of(other), self)

    def __mul__(self, other: Operand) -> Scalar:
        return self.pool.mul(self, self.pool.of(other))

    def __rmul__(self, other: Operand) -> Scalar:
        return self.pool.mul(self.pool.of(other), self)

    def __truediv__(self, other: Operand) -> Scalar:
        return self.pool.div(self, self.pool.of(other))

    def __rtruediv__(self, other: Operand) -> Scalar:
        return self.pool.div(self.pool.of(other), self)

    def __neg__(self) -> Scalar:
        return self.pool.neg(self)

    @property
    def is_const(self) -> bool:
        """Whether the node is a number."""
        return self.op == "const"


class Pool:
    """Makes scalars; equal expressions of one pool are one node."""

    def __init__(self) -> None:
        self._nodes: dict[tuple[object, ...], Scalar] = {}

    def of(self, x: Operand) -> Scalar:
        """``x`` as a node."""
        if isinstance(x, Scalar):
            return x
        return self._node("const", (), value=float(x) + 0.0)

    def var(self, text: str, level: int = 0) -> Scalar:
        """A C lvalue or variable, available from loop depth ``level``."""
        return self._node("var", (), text=text, level=level)

    def add(self, x: Scalar, y: Scalar) -> Scalar:
        """The sum."""
        if x.is_const and y.is_const:
            return self.of(x.value + y.value)
        if x.is_const:
            x, y = y, x
        if y.is_const and y.value == 0.0:
            return x
        if y.op == "neg":
            return self.sub(x, y.args[0])
        if x.op == "neg":
            return self.sub(y, x.args[0])
        if y.is_const and y.value < 0.0:
            return self._node("sub", (x, self.of(-y.value)))
        return self._node("add", (x, y))

    def sub(self, x: Scalar, y: Scalar) -> Scalar:
        """The difference."""
        if x is y:
            return self.of(0.0)
        if y.is_const:
            return self.add(x, self.of(-y.value))
        if x.is_const and x.value == 0.0:
            return self.neg(y)
        if y.op == "neg":
            return self.add(x, y.args[0])
        return self._node("sub", (x, y))

    def mul(self, x: Scalar, y: Scalar) -> Scalar:
        """The product; signs move outwards, constants to the front."""
        if x.is_const and y.is_const:
            return self.of(x.value * y.value)
        if y.is_const:
            x, y = y, x
        if x.is_const:
            if x.value in (0.0, 1.0):
                return y if x.value else x
            if x.value < 0.0:
                return self.neg(self.mul(self.of(-x.value), y))
            if y.op == "mul" and y.args[0].is_const:
                return self.mul(self.of(x.value * y.args[0].value), y.args[1])
        if x.op == "neg":
            return self.neg(self.mul(x.args[0], y))
        if y.op == "neg":
            return self.neg(self.mul(x, y.args[0]))
        return self._node("mul", (x, y))

    def div(self, x: Scalar, y: Scalar) -> Scalar:
        """The quotient; division by a constant becomes a product."""
        if y.is_const:
            return self.mul(self.of(1.0 / y.value), x)
        if x.is_const and x.value == 0.0:
            return x
        if x.op == "neg":
            return self.neg(self.div(x.args[0], y))
        return self._node("div", (x, y))

    def neg(self, x: Scalar) -> Scalar:
        """The negative."""
        if x.is_const:
            return self.of(-x.value)
        if x.op == "neg":
            return x.args[0]
        if x.op == "sub":
            return self.sub(x.args[1], x.args[0])
        return self._node("neg", (x,))

    def call(self, function: str, x: Scalar) -> Scalar:
        """``sqrt`` of what cannot be negative, ``root0`` (0 for negative x) or ``wrap`` (to (-pi, pi]) of ``x``."""
        if x.is_const and function in ("sqrt", "root0"):
            return self.of(max(x.value, 0.0) ** 0.5)
        if function == "sqrt" and x.op == "mul" and x.args[0] is x.args[1]:
            return self._node("fabs", (x.args[0],))
        return self._node(function, (x,))

    def _node(self, op: str, args: tuple[Scalar, ...], *, value: float = 0.0, text: str = "", level: int = 0) -> Scalar:
        key = (op, value, text, *map(id, args))
        if op in ("add", "mul"):
            key = (op, *sorted(map(id, args)))
        node = self._nodes.get(key)
        if node is None:
            node = self._nodes[key] = Scalar(self, op, args, value=value, text=text, level=level)
        return node
