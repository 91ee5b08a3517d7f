"""Readable text of a recorded solver, for people and for the comparison of solvers in tests.

    inverse kinematics of 3 joints: at most 4 solutions
      px, py, pz = target
      for each of up to 2 roots of pair(-py, px, 0.259), shoulder: c1, s1
        ux = px*c1 + py*s1
        ...

What depends on a choice of a root is indented below it. An expression used more than once gets a number (%1, %2, ...)
at the outermost depth at which it is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count

from rrrgen.ik.recording.scalar import Scalar
from rrrgen.ik.recording.steps import Residual, Step
from rrrgen.program import Op

_SIGNS = {Op.ADD: (" + ", 1, 1), Op.SUB: (" - ", 1, 2), Op.MUL: ("*", 2, 2), Op.DIV: ("/", 2, 3)}
"""For each operation: its symbol, its precedence, and the least precedence that its right operand has without
parentheses."""


def text_of(n: int, steps: Sequence[Step], rows: int) -> str:
    """Print the ``steps`` of an arm with ``n`` joints and at most ``rows`` solutions; ends with a line feed."""
    return "\n".join([f"inverse kinematics of {n} joints: at most {rows} solutions", *_Writer(steps).lines()]) + "\n"


class _Writer:
    def __init__(self, steps: Sequence[Step]) -> None:
        self._steps = steps
        self._uses: dict[int, int] = {}
        self._named: dict[int, str] = {}
        self._numbers = count(1)
        depth = sum(step.stage is not None for step in steps)
        self._blocks: list[list[str]] = [[] for _ in range(depth + 1)]

    def lines(self) -> list[str]:
        """Lines of the text: one block for each depth of choices, indented by its depth."""
        for step in self._steps:
            for operand in step.operands:
                self._count(operand)
        depth = 0
        for step in self._steps:
            depth += self._write(step, depth)
        return [f"{'  ' * (k + 1)}{line}" for k, block in enumerate(self._blocks) for line in block]

    def _count(self, node: Scalar) -> None:
        self._uses[id(node)] = self._uses.get(id(node), 0) + 1
        if self._uses[id(node)] == 1:
            for arg in node.args:
                self._count(arg)

    def _write(self, step: Step, depth: int) -> bool:
        """Write one step at the depth at which its operands are known; returns whether it selects a root."""
        level = depth if isinstance(step, Residual) else max((x.level for x in step.operands), default=0)
        operands = [self._text(operand, 0) for operand in step.operands]
        results = ", ".join(result.text for result in step.results)
        if step.kind == "name":
            self._blocks[level].append(f"{results} = {operands[0]}")
            return False
        what = f"{step.kind}({', '.join(operands)})" if operands else step.kind
        if step.stage is None:
            self._blocks[level].append(f"{results} = {what}" if results else what)
            return False
        stage = step.stage
        self._blocks[depth].append(f"for each of up to {stage.most} roots of {what}, {stage.label}: {results}")
        return True

    def _text(self, node: Scalar, strength: int) -> str:
        if node.op is Op.INPUT:
            return node.text
        if node.is_const:
            return f"{node.value:.12g}" if node.value >= 0 else f"({node.value:.12g})"
        if id(node) not in self._named and self._uses[id(node)] > 1 and node.op is not Op.NEG:
            text = self._expression(node, 0)
            self._named[id(node)] = f"%{next(self._numbers)}"
            self._blocks[node.level].append(f"{self._named[id(node)]} = {text}")
        return self._named.get(id(node)) or self._expression(node, strength)

    def _expression(self, node: Scalar, strength: int) -> str:
        if node.op is Op.NEG:
            return f"-{self._text(node.args[0], 3)}"
        if node.op not in _SIGNS:
            return f"{node.op.value}({self._text(node.args[0], 0)})"
        sign, own, right = _SIGNS[node.op]
        text = f"{self._text(node.args[0], own)}{sign}{self._text(node.args[1], right)}"
        return f"({text})" if own < strength else text
