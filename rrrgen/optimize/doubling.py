"""Doubling by addition: ``2 x`` becomes ``x + x``, which no processor does more slowly than a product."""

from __future__ import annotations

from dataclasses import dataclass

from rrrgen.program import Builder, Node, Op, Program, Scalar, Value
from rrrgen.program.builder import replay


class _Doubling(Builder):
    """Records products by two as additions."""

    def mul(self, x: Value, y: Value) -> Value:
        """x * y, or y + y where x is two (the first factor of a product by a number is the number)."""
        doubles = isinstance(y, Scalar) and not isinstance(x, Scalar) and x == 2
        return self.double(y) if doubles else super().mul(x, y)


@dataclass(frozen=True)
class DoubleByAddition:
    """Turns products by two into additions."""

    def __call__(self, program: Program) -> Program:
        """``program`` with products by two recorded as additions."""
        if not any(node.op is Op.MUL and _is_two(program.nodes[node.args[0]]) for node in program.nodes):
            return program
        builder = _Doubling()
        return builder.rewritten(program, replay(program, builder, [builder.input(port) for port in program.inputs]))


def _is_two(node: Node) -> bool:
    return node.op is Op.CONST and node.value == 2
