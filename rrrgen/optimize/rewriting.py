"""Rewriting a program: expanded into polynomials, factored, recorded anew."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from rrrgen.optimize.expansion import Cutting, Expansion, TooLargeError
from rrrgen.optimize.factoring import Factoring, Polynomial
from rrrgen.program import Builder, Op, Program, Value

Expanded: TypeAlias = tuple[list[int], list[Polynomial], list[tuple[int, Polynomial]]]
"""Literals, results, parts that are cut off."""


# Measured as the options of rrrgen.optimize.choosing.Cheapest: twice as many change nothing.

MAX_TERMS = 100
"""Half as many cost 0.26 % (25 % of one function)."""

MAX_PAIRS = 1500
"""Half as many cost 0.10 % (25 % of one function)."""


class SeenExpansions:
    """Expansions of equivalent programs, so that none is factored twice."""

    def __init__(self) -> None:
        self._whole = False
        self._expanded: dict[int, list[Expanded]] = {}

    def check_and_add(self, program: Program, expansion: Expansion, polynomials: list[Polynomial]) -> bool:
        """Whether this expansion was seen before. Expanded as a whole, equivalent programs are equal."""
        expanded = (expansion.literals, polynomials, list(expansion.cuts.items()))
        others = self._expanded.setdefault(id(program), [])
        if expanded in others or (expansion.whole and self._whole):
            return True
        others.append(expanded)
        self._whole = self._whole or expansion.whole
        return False


@dataclass(frozen=True)
class ExpandAndFactor:
    """Expands a program into polynomials as far as ``cutting`` lets it, and factors those.

    A polynomial of more than ``max_terms`` terms, or, unless the expansion is local, more than ``max_pairs`` pairs of
    terms in all polynomials together, leave the program as it is: the search looks at every pair.
    """

    cutting: Cutting
    max_terms: int = MAX_TERMS
    max_pairs: int = MAX_PAIRS

    def __call__(self, program: Program) -> Program:
        """``program`` expanded and factored, which may take more operations than it did."""
        return self.attempt(program) or program

    def attempt(self, program: Program, seen: SeenExpansions | None = None) -> Program | None:
        """The same, or None where the expansion is too large or was ``seen`` before."""
        expansion = Expansion(program, self.cutting, self.max_terms)
        try:
            polynomials = expansion.results()
        except TooLargeError:
            return None
        results = len(polynomials)
        pairs = sum(len(p) * (len(p) - 1) // 2 for p in [*polynomials, *expansion.cuts.values()])
        if self.cutting is not Cutting.LOCAL and pairs > self.max_pairs:
            return None
        if seen is not None and seen.check_and_add(program, expansion, polynomials):
            return None
        search = Factoring(polynomials + list(expansion.cuts.values()), len(expansion.literals))
        search.run()
        return _Recorder(expansion, search, results).program()


class _Recorder:
    """Records what the search found: first the program's ``results``, then the cuts of the expansion."""

    def __init__(self, expansion: Expansion, search: Factoring, results: int) -> None:
        final = search.polynomials
        self._expansion = expansion
        self._results = final[:results]
        self._definitions = {search.first + k: p for k, p in enumerate(final[search.count :])}
        self._definitions |= dict(zip(expansion.cuts, final[results : search.count], strict=True))
        self._builder = Builder()
        self._inputs = [self._builder.input(port) for port in expansion.program.inputs]
        self._literals: dict[int, Value] = {}
        self._originals: dict[int, Value] = {}

    def program(self) -> Program:
        """The rewritten program."""
        program = self._expansion.program
        values = iter([self._polynomial(p) for p in self._results])
        return self._builder.rewritten(program, [[next(values) for _ in range(port.size)] for port in program.outputs])

    def _polynomial(self, p: Polynomial) -> Value:
        total: Value = 0
        for monomial, coefficient in sorted(p.items(), key=lambda item: (item[1] < 0, item[0])):
            term: Value = coefficient if coefficient > 0 else -coefficient
            for k in monomial:
                term = term * self._literal(k)
            total = total + term if coefficient > 0 else total - term
        return total

    def _literal(self, k: int) -> Value:
        if k not in self._literals:
            defined = self._definitions.get(k)
            value = self._original(self._expansion.literals[k]) if defined is None else self._polynomial(defined)
            self._literals[k] = value
        return self._literals[k]

    def _original(self, index: int) -> Value:
        """A literal's own node, recorded as in the program."""
        if index not in self._originals:
            value = self._originals[index] = self._recorded(index)
            labels = self._expansion.program.labels
            if index in labels:
                self._builder.label(value, labels[index])
        return self._originals[index]

    def _recorded(self, index: int) -> Value:
        node = self._expansion.program.nodes[index]
        if node.op is Op.INPUT:
            port, element = node.place
            return self._inputs[port][element]
        if node.op is Op.CONST:
            return node.number
        value: Value = getattr(self._builder, node.op.value)(*(self._operand(arg) for arg in node.args))
        return value

    def _operand(self, index: int) -> Value:
        """An operand of a literal: itself a literal, or a polynomial of its own."""
        position = self._expansion.position(index)
        return self._original(index) if position is None else self._literal(position)
