"""The pass that makes constants of a program equal to lengths of the robot file, so that readers recognize them.

``a (x + b y)`` becomes ``a x + (a b) y`` if the number a b is a length of the file.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

from rrrgen.program import Builder, Op, Program, Value
from rrrgen.program.counts import count_operations
from rrrgen.program.ir import uses
from rrrgen.program.nodes import Node
from rrrgen.robot.robot_spec import RobotSpec


@dataclass(frozen=True)
class SpellLengths:
    """Multiplies a constant into a sum if a constant in the sum then is a length of the robot file, at no extra cost.

    ``lengths`` are the magnitudes of the lengths of the robot file, m.
    """

    lengths: frozenset[Fraction]

    def __call__(self, program: Program) -> Program:
        """The rewritten ``program``, or ``program`` itself if nothing changes or operations would be added."""
        spelled = _Spelling(program, self.lengths).run()
        return (
            program if spelled is None or count_operations(spelled).total > count_operations(program).total else spelled
        )


def lengths_of(spec: RobotSpec) -> frozenset[Fraction]:
    """The magnitudes of all lengths of the robot file, m: a and d of the rows, translations of base and tool."""
    rows = [length for row in spec.rows for length in (row.a, row.d)]
    values = [spec.nominal(length) for length in (*rows, *spec.base.translation, *spec.tool.translation)]
    return frozenset(abs(Fraction(int(x.p), int(x.q))) for x in values if x.is_Rational and x != 0)


class _Spelling:
    """Records a program again, with constants multiplied into those sums in which a length of the file appears."""

    def __init__(self, program: Program, lengths: frozenset[Fraction]) -> None:
        self.program, self.lengths = program, lengths
        self.uses = uses(program)
        self.builder = Builder()
        self.inputs = [self.builder.input(port) for port in program.inputs]
        self.values: dict[int, Value] = {}
        self.found = False

    def run(self) -> Program | None:
        """The new program; None if no constant was taken into a sum."""
        results = [[self._value(k) for k in row] for row in self.program.results]
        return self.builder.rewritten(self.program, results) if self.found else None

    def _value(self, k: int) -> Value:
        if k not in self.values:
            self.values[k] = self._recorded(self.program.nodes[k])
            if k in self.program.labels:
                self.builder.label(self.values[k], self.program.labels[k])
        return self.values[k]

    def _recorded(self, node: Node) -> Value:
        if node.op is Op.INPUT:
            port, element = node.place
            return self.inputs[port][element]
        if node.op is Op.CONST:
            return node.number
        factor, rest = self._factor(node)
        if rest is not None:
            return self._scaled(factor, rest)
        operation: Callable[..., Value] = getattr(self.builder, node.op.value)
        return operation(*(self._value(arg) for arg in node.args))

    def _factor(self, node: Node) -> tuple[Fraction, int | None]:
        """Split ``node`` into a constant and the node that it multiplies; (1, None) if it is no such product."""
        if node.op is Op.MUL and self.program.nodes[node.args[0]].op is Op.CONST:
            return Fraction(self.program.nodes[node.args[0]].number), node.args[1]
        return Fraction(1), None

    def _scaled(self, factor: Fraction, k: int) -> Value:
        """Record ``factor`` times node k, multiplied into each term if k is a sum in which a length then appears."""
        node = self.program.nodes[k]
        if node.op not in (Op.ADD, Op.SUB) or self.uses[k] != 1 or not self._gains(factor, node):
            return self.builder.mul(factor, self._value(k))
        self.found = True
        terms = [self._term(factor, arg) for arg in node.args]
        return self.builder.add(*terms) if node.op is Op.ADD else self.builder.sub(*terms)

    def _gains(self, factor: Fraction, node: Node) -> bool:
        """Whether, in some term of the sum ``node``, ``factor`` times the term's constant is a length of the file."""
        own = [self._own(arg) for arg in node.args]
        ratios = [c for c in own if c is not None]
        return any(abs(c) not in self.lengths and abs(factor * c) in self.lengths for c in ratios)

    def _own(self, k: int) -> Fraction | None:
        factor, rest = self._factor(self.program.nodes[k])
        return None if rest is None or self.uses[k] != 1 else factor

    def _term(self, factor: Fraction, k: int) -> Value:
        if self._own(k) is None:
            return self.builder.mul(factor, self._value(k))
        own, rest = self._factor(self.program.nodes[k])
        assert rest is not None
        return self._scaled(factor * own, rest)
