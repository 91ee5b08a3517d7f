"""Rewriting a program: expand it into polynomials, factor them, record the result."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from rrrgen.program import Builder, Op, Program, Value
from rrrgen.program.passes.expansion import CutSet, Expansion, TooLargeError
from rrrgen.program.passes.factoring import Factoring, Polynomial

Expanded: TypeAlias = tuple[list[int], list[Polynomial], list[tuple[int, Polynomial]]]
"""An expansion: literals, polynomials of the results, and (literal, polynomial) of the parts cut off."""


# Losses are measured as for rrrgen.program.passes.cheapest.Cheapest; doubling either limit changes nothing.

MAX_TERMS = 100
"""Largest number of terms of one polynomial. Halving costs 0.26 % (25 % of one function)."""

MAX_PAIRS = 1500
"""Largest number of pairs of terms in all polynomials together. Halving costs 0.10 % (25 % of one function)."""


class SeenExpansions:
    """The expansions factored so far among equivalent programs, so that none is factored twice."""

    def __init__(self) -> None:
        self._whole = False
        self._expanded: dict[int, list[Expanded]] = {}

    def check_and_add(self, program: Program, expansion: Expansion, polynomials: list[Polynomial]) -> bool:
        """Whether this expansion was seen before; adds it if not. Full expansions of equivalent programs are equal."""
        expanded = (expansion.literals, polynomials, list(expansion.cuts.items()))
        others = self._expanded.setdefault(id(program), [])
        if expanded in others or (expansion.whole and self._whole):
            return True
        others.append(expanded)
        self._whole = self._whole or expansion.whole
        return False


@dataclass(frozen=True)
class ExpandAndFactor:
    """Expands a program into polynomials down to ``cut_set`` and factors them.

    The program stays as it is if a polynomial has more than ``max_terms`` terms, or if all polynomials together have
    more than ``max_pairs`` pairs of terms, since the search examines every pair (no limit with ``CutSet.LOCAL``).
    """

    cut_set: CutSet
    max_terms: int = MAX_TERMS
    max_pairs: int = MAX_PAIRS

    def __call__(self, program: Program) -> Program:
        """Expand and factor ``program``; the result may have more operations than before."""
        return self.attempt(program) or program

    def attempt(self, program: Program, seen: SeenExpansions | None = None) -> Program | None:
        """Expand and factor ``program``; None if the expansion is too large or among ``seen``."""
        expansion = Expansion(program, self.cut_set, self.max_terms)
        try:
            polynomials = expansion.results()
        except TooLargeError:
            return None
        results = len(polynomials)
        pairs = sum(len(p) * (len(p) - 1) // 2 for p in [*polynomials, *expansion.cuts.values()])
        if self.cut_set is not CutSet.LOCAL and pairs > self.max_pairs:
            return None
        if seen is not None and seen.check_and_add(program, expansion, polynomials):
            return None
        search = Factoring(polynomials + list(expansion.cuts.values()), len(expansion.literals))
        search.run()
        return _Recorder(expansion, search, results).program()


class _Recorder:
    """Records the factored polynomials as a program.

    The first ``results`` polynomials of ``search`` are the elements of the outputs. The next ones define the nodes at
    which ``expansion`` stops, the rest the common divisors that the search extracted.
    """

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
        """The rewritten program. The status is recorded before the other outputs, all of which need its pivots.

        Recorded last, it changes the instructions of the derivatives of forward dynamics by -2 to +2 %.
        """
        program = self._expansion.program
        values = iter([self._polynomial(p) for p in self._results])
        rows = {output: [next(values) for _ in range(program.outputs[output].size)] for output in program.status_first}
        return self._builder.rewritten(program, [rows[output] for output in range(len(rows))])

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
        """The value of a literal that is a node of the original program."""
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
        """The recorded value of node ``index``, an operand of a node that is recorded unexpanded, such as a sine."""
        position = self._expansion.position(index)
        return self._original(index) if position is None else self._literal(position)
