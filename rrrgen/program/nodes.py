"""Nodes, the definitions that make up a program: an operation on earlier nodes, an input element, or a constant."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from typing import ClassVar, NamedTuple, cast


class Op:
    """The operations of the representation: one object per operation, compared by identity.

    Not an Enum: before Python 3.12, access to an Enum member takes as long as recording a whole node.
    """

    __slots__ = ("value",)

    INPUT: ClassVar[Op]  # value = (port index, element index)
    CONST: ClassVar[Op]  # value = int, or Fraction where it is not whole
    ADD: ClassVar[Op]
    SUB: ClassVar[Op]
    MUL: ClassVar[Op]
    DIV: ClassVar[Op]
    NEG: ClassVar[Op]
    SIN: ClassVar[Op]
    COS: ClassVar[Op]
    SQRT: ClassVar[Op]
    ABS: ClassVar[Op]
    SIGN: ClassVar[Op]  # -1, 0 or +1
    EXP: ClassVar[Op]
    TANH: ClassVar[Op]
    MIN: ClassVar[Op]
    NONFINITE: ClassVar[Op]  # 0 of a finite number, 1 of an infinite one, 2 of NaN, whatever the compiler assumes
    SELECT: ClassVar[Op]  # first operand > 0 ? second : third

    def __init__(self, value: str) -> None:
        self.value = value
        setattr(Op, value.upper(), self)

    def __repr__(self) -> str:
        return f"Op.{self.value.upper()}"

    def __reduce__(self) -> tuple[object, ...]:
        return getattr, (Op, self.value.upper())


ARITY = {
    Op("input"): 0,
    Op("const"): 0,
    Op("add"): 2,
    Op("sub"): 2,
    Op("mul"): 2,
    Op("div"): 2,
    Op("neg"): 1,
    Op("sin"): 1,
    Op("cos"): 1,
    Op("sqrt"): 1,
    Op("abs"): 1,
    Op("sign"): 1,
    Op("exp"): 1,
    Op("tanh"): 1,
    Op("min"): 2,
    Op("nonfinite"): 1,
    Op("select"): 3,
}
"""Number of operands of each operation."""


class Node(NamedTuple):
    """One definition: ``op`` applied to the nodes ``args``; inputs and constants have a ``value`` instead."""

    op: Op
    args: tuple[int, ...] = ()
    value: object = None

    @property
    def place(self) -> tuple[int, int]:
        """Input port and element (row-major) that an INPUT node reads."""
        return cast("tuple[int, int]", self.value)

    @property
    def number(self) -> Fraction | int:
        """The value of a CONST node."""
        return cast("Fraction | int", self.value)


def reachable(nodes: Sequence[Node], roots: Iterable[int]) -> list[int]:
    """The indices of all nodes that ``roots`` depend on, roots included, ascending."""
    needed = bytearray(len(nodes))
    for index in roots:
        needed[index] = 1
    for index in range(needed.rfind(1), -1, -1):  # operands precede their users
        if needed[index]:
            for arg in nodes[index][1]:
                needed[arg] = 1
    return [index for index, is_needed in enumerate(needed) if is_needed]
