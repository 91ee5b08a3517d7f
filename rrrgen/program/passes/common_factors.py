"""The pass that factors out common factors of sums: ``x a + ... + x b`` becomes ``x (a + b) + ...``.

It does so only for products that nothing else in the program uses.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from rrrgen.program import Builder, Op, Program, Value
from rrrgen.program.program import count_operations, uses

SUMS = (Op.ADD, Op.SUB, Op.NEG)
SUMS_AND_PRODUCTS = (*SUMS, Op.MUL)

Factors: TypeAlias = tuple[int, ...]
"""The factors of one term of a sum, as node indices: both operands of a product that only this sum uses, otherwise the
one node that is added."""

Term: TypeAlias = tuple[int, Factors]
"""One term of a sum: its sign, +1 or -1, and its factors."""


@dataclass(frozen=True)
class Collect:
    """Factors out common factors of sums, in rounds, for as long as that saves operations."""

    def __call__(self, program: Program) -> Program:
        """Factor out common factors of the sums in ``program``; returns the rewritten program."""
        total = None
        while (collection := _Collection(program)).finds_any():
            before = count_operations(program).total if total is None else total
            collected = collection.run()
            total = count_operations(collected).total
            if total >= before:
                break
            program = collected
        return program


class _Collection:
    """One round of collecting factors. A sum used only by another sum is merged into it."""

    def __init__(self, program: Program) -> None:
        self.program = program
        self.uses = uses(program)
        self.merged = self._merged_nodes()
        self.builder = Builder()
        self.inputs = [self.builder.input(port) for port in program.inputs]
        self.values: dict[int, Value] = {}

    def finds_any(self) -> bool:
        """Whether any sum contains two products with a common factor."""
        whole: dict[int, int] = {}
        seen: set[tuple[int, int]] = set()
        for k in sorted(self.merged, reverse=True):
            user = self.merged[k]
            whole[k] = whole.get(user, user)
            node = self.program.nodes[k]
            if node.op is Op.MUL:
                factors = {(whole[k], factor) for factor in node.args}
                if not factors.isdisjoint(seen):
                    return True
                seen |= factors
        return False

    def run(self) -> Program:
        """The program with factors collected: every node recorded again, except those merged into a sum."""
        program = self.program
        for k in range(len(program.nodes)):
            if k not in self.merged:
                self._value(k)
        return self.builder.rewritten(program, [[self.values[k] for k in row] for row in program.results])

    def _merged_nodes(self) -> dict[int, int]:
        """Map each sum or product that is used once, by a sum, to that sum."""
        nodes = self.program.nodes
        uses = self.uses
        return {
            arg: k
            for k, (op, args, _) in enumerate(nodes)
            if op in SUMS
            for arg in args
            if uses[arg] == 1 and nodes[arg][0] in SUMS_AND_PRODUCTS
        }

    def _value(self, k: int) -> Value:
        if k not in self.values:
            self.values[k] = self._record(k)
            if k in self.program.labels:
                self.builder.label(self.values[k], self.program.labels[k])
        return self.values[k]

    def _record(self, k: int) -> Value:
        node = self.program.nodes[k]
        if node.op is Op.INPUT:
            port, element = node.place
            return self.inputs[port][element]
        if node.op is Op.CONST:
            return node.number
        if node.op in SUMS:
            return self._sum(self._terms(k, 1))
        value: Value = getattr(self.builder, node.op.value)(*(self._value(arg) for arg in node.args))
        return value

    def _terms(self, k: int, sign: int) -> list[Term]:
        """The terms of ``sign`` (+1 or -1) times sum ``k``, including those of the sums merged into it."""
        node, terms = self.program.nodes[k], []
        signs = (-sign,) if node.op is Op.NEG else (sign, sign if node.op is Op.ADD else -sign)
        for arg, arg_sign in zip(node.args, signs, strict=True):
            terms += self._part(arg, arg_sign)
        return terms

    def _part(self, k: int, sign: int) -> list[Term]:
        node = self.program.nodes[k]
        if self.uses[k] == 1 and node.op in SUMS:
            return self._terms(k, sign)
        return [(sign, node.args if self.uses[k] == 1 and node.op is Op.MUL else (k,))]

    def _sum(self, terms: list[Term]) -> Value:
        """Record the sum of ``terms``, factoring out common factors, the most frequent first."""
        collected: list[Value] = []
        while (factor := _most_shared(terms)) is not None:
            inside: list[Term] = []
            for sign, factors in terms:
                if factor in factors and len(factors) == 2:
                    inside += self._part(factors[factors[0] == factor], sign)
            terms = [(s, factors) for s, factors in terms if factor not in factors or len(factors) == 1]
            collected.append(self._sum(inside) * self._value(factor))
        total: Value = 0
        for sign, factors in sorted(terms, key=lambda term: -term[0]):
            value = self._value(factors[0])
            for other in factors[1:]:
                value = value * self._value(other)
            total = total + value if sign > 0 else total - value
        for value in collected:
            total = total + value
        return total


def _most_shared(terms: list[Term]) -> int | None:
    """The factor that occurs in the most products; None if none occurs in two."""
    count: dict[int, int] = {}
    for _, factors in terms:
        if len(factors) == 2:
            for factor in dict.fromkeys(factors):
                count[factor] = count.get(factor, 0) + 1
    best = max(count, key=lambda factor: count[factor], default=None)
    return best if best is not None and count[best] > 1 else None
