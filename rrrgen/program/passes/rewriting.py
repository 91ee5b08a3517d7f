"""Rewriting a program: expand it into polynomials, factor them, record the result."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from fractions import Fraction
from itertools import pairwise
from typing import TypeAlias

from rrrgen.program import Builder, Op, Program, Role, Value
from rrrgen.program.builder import drop_residue
from rrrgen.program.passes.factoring import Factoring, Monomial, Polynomial
from rrrgen.program.program import Node, uses

# ------------------------------------------------------------------------------------------------------------------
# Expanding a program into polynomials whose variables, the literals, are inputs, sums of inputs, sines and cosines.
# ------------------------------------------------------------------------------------------------------------------

_TERMS_BEFORE_COLLECTING = 4
"""Bound on a product of two polynomials before equal monomials are added up, as a multiple of the largest number of
terms allowed in a result. With 1 and with 16 the programs of the bundled robots are the same."""


class TooLargeError(Exception):
    """The expansion has more terms than the factoring search can handle."""


class CutSet(Enum):
    """How far a program is expanded: the nodes that are kept and become variables of the polynomials."""

    NOTHING = "expand everything"
    SUMS = "keep sums that depend on configuration and parameters"
    SCALED = "keep such sums, and scaled sines and cosines too"
    LOCAL = "keep every sum that is used more than once"


class Expansion:
    """Polynomials of a program's results in its literals, with ``s**2 = 1 - c**2`` applied.

    A literal is a node that is not expanded: an input, a sine or cosine, another function of inputs, or a sum of inputs
    (such as the absolute rates of parallel axes). The nodes that ``cut_set`` selects, parts that depend only on
    configuration and parameters, are literals too; ``cuts`` maps them to polynomials of their own. ``max_terms`` bounds
    the terms of one polynomial.
    """

    def __init__(self, program: Program, cut_set: CutSet, max_terms: int) -> None:
        self.program = program
        self.max_terms = max_terms
        self._whole, self._scaled, self._local = (
            cut_set is kind for kind in (CutSet.NOTHING, CutSet.SCALED, CutSet.LOCAL)
        )
        self.stages = _stages(program)
        self.uses = uses(program)
        self.cuts: dict[int, Polynomial] = {}
        self.literals: list[int] = []
        self._position: dict[int, int] = {}
        self._sine_of: dict[int, int] = {}
        self._values: dict[int, Polynomial] = {}
        self._pair_sines()
        self._roots = self._operands_of_functions()

    def _pair_sines(self) -> None:
        cosines = {node.args[0]: k for k, node in enumerate(self.program.nodes) if node.op is Op.COS}
        for k, node in enumerate(self.program.nodes):
            if node.op is Op.SIN and node.args[0] in cosines:
                self._sine_of[self._literal(k)] = self._literal(cosines[node.args[0]])

    def _operands_of_functions(self) -> set[int]:
        """The operands of functions, quotients and selections; each gets a polynomial of its own, as outputs do."""
        roots: set[int] = set()
        for node in self.program.nodes:
            if node.op not in (Op.ADD, Op.SUB, Op.MUL, Op.NEG):
                roots.update(node.args)
        nodes = self.program.nodes
        return {k for k in roots if nodes[k].op is not Op.CONST and not self._is_literal(nodes[k])}

    def _literal(self, node: int) -> int:
        if node not in self._position:
            self._position[node] = len(self.literals)
            self.literals.append(node)
        return self._position[node]

    def position(self, node: int) -> int | None:
        """The number of the literal that stands for ``node``; None if it is not a literal."""
        return self._position.get(node)

    def _is_literal(self, node: Node) -> bool:
        if node.op in (Op.ADD, Op.SUB):
            return all(self._is_sum_of_inputs(arg) for arg in node.args)
        return node.op not in (Op.CONST, Op.MUL, Op.NEG)

    def _is_sum_of_inputs(self, index: int) -> bool:
        node = self.program.nodes[index]
        if node.op in (Op.ADD, Op.SUB):
            return all(self._is_sum_of_inputs(arg) for arg in node.args)
        return node.op is Op.INPUT

    @property
    def whole(self) -> bool:
        """Whether the expansion is full: it stops at no nodes except the operands of functions."""
        return all(self.literals[literal] in self._roots for literal in self.cuts)

    def results(self) -> list[Polynomial]:
        """One polynomial per element of the outputs, the status first.

        Raises TooLargeError if one exceeds ``max_terms`` terms.
        """
        for k, node in enumerate(self.program.nodes):
            self._values[k] = self._value(k, node)
            if len(self._values[k]) > self.max_terms:
                raise TooLargeError
        for k in sorted(self._roots):
            self.cuts[self._literal(k)] = self._values[k]
        return [self._values[index] for output in self.program.status_first for index in self.program.results[output]]

    def _value(self, k: int, node: Node) -> Polynomial:
        if node.op is Op.CONST:
            return {(): node.number} if node.number else {}
        if self._is_literal(node):
            return {(self._literal(k),): 1}
        args = [self._operand(arg, self.stages[k]) for arg in node.args]
        if node.op is Op.NEG:
            return {m: -c for m, c in args[0].items()}
        if node.op is Op.MUL:
            return self._product(args[0], args[1])
        return _sum(args[0], args[1], 1 if node.op is Op.ADD else -1)

    def _operand(self, index: int, stage: int) -> Polynomial:
        """The polynomial of node ``index`` as an operand of an operation of this ``stage`` (:func:`_stages`).

        It is a single literal where the expansion stops at the node.
        """
        if not self._cuts_off(index, stage):
            return self._values[index]
        node = self.program.nodes[index]
        if node.op in (Op.ADD, Op.SUB) and any(self.stages[arg] == 0 for arg in node.args):
            first, second = (self._operand(arg, stage) for arg in node.args)
            return _sum(first, second, 1 if node.op is Op.ADD else -1)
        if node.op is Op.NEG:
            return {m: -c for m, c in self._operand(node.args[0], stage).items()}
        literal = self._literal(index)
        if index in self._roots:
            self.cuts[literal] = self._values[index]
            return {(literal,): 1}
        alone = {m: c for m, c in self._values[index].items() if all(self._of_parameters(k) for k in m)}
        self.cuts[literal] = {m: c for m, c in self._values[index].items() if m not in alone}
        return {(literal,): 1, **alone}

    def _cuts_off(self, index: int, stage: int) -> bool:
        """Whether the expansion stops at node ``index`` when an operation of this ``stage`` uses it.

        A local expansion stops at every shared sum, any other one at quantities of q alone: at a sum that is shared or
        used with velocities, and, if ``_scaled``, at a shared multiple of one term.
        """
        if self._local:
            return self.uses[index] > 1 and len(self._values[index]) > 1
        if self._whole or self.stages[index] != 1:
            return False
        value = self._values[index]
        if len(value) > 1:
            return stage == 2 or self.uses[index] > 1
        scaled = any(abs(c) != 1 for c in value.values())
        return self._scaled and scaled and self.uses[index] > 1

    def _of_parameters(self, literal: int) -> bool:
        return self.stages[self.literals[literal]] == 0

    def _product(self, x: Polynomial, y: Polynomial) -> Polynomial:
        if len(x) * len(y) > _TERMS_BEFORE_COLLECTING * self.max_terms:
            raise TooLargeError
        total: Polynomial = {}
        for m, c in x.items():
            for n, d in y.items():
                _accumulate(total, tuple(sorted(m + n)) if m and n else m or n, c * d)
        return self._reduce(total)

    def _reduce(self, value: Polynomial) -> Polynomial:
        """Apply ``s**2 = 1 - c**2`` until no square of a sine is left."""
        while True:
            monomial = next((m for m in value if self._squared_sine(m) is not None), None)
            if monomial is None:
                return value
            sine = self._squared_sine(monomial)
            assert sine is not None
            coefficient = value.pop(monomial)
            rest = list(monomial)
            rest.remove(sine)
            rest.remove(sine)
            cosine = self._sine_of[sine]
            _accumulate(value, tuple(rest), coefficient)
            _accumulate(value, tuple(sorted([*rest, cosine, cosine])), -coefficient)

    def _squared_sine(self, monomial: Monomial) -> int | None:
        for a, b in pairwise(monomial):
            if a == b and a in self._sine_of:
                return a
        return None


def _sum(x: Polynomial, y: Polynomial, sign: int) -> Polynomial:
    total = dict(x)
    for m, c in y.items():
        _accumulate(total, m, c if sign > 0 else -c)
    return total


def _stages(program: Program) -> list[int]:
    """Classify every node: 0 if it is constant while the robot moves, 1 if it depends on q, 2 if on velocities too."""
    stages: list[int] = []
    for node in program.nodes:
        if node.op is Op.INPUT:
            role = program.inputs[node.place[0]].role
            stages.append(0 if role.is_parameter else 1 if role is Role.POSITION else 2)
        else:
            stages.append(max((stages[arg] for arg in node.args), default=0))
    return stages


def _accumulate(total: Polynomial, monomial: Monomial, coefficient: Fraction | int) -> None:
    """Add a term; residue, also of products, is dropped.

    A term of 1e-32 beside one of 1 would be factored as ``1e-32 (x + 1e32 y)``, which the builder takes for zero.
    """
    if value := drop_residue(total[monomial] + coefficient if monomial in total else coefficient):
        total[monomial] = value
    else:
        total.pop(monomial, None)


# ------------------------------------------------------------------------------------------------------------------
# Rewriting a program
# ------------------------------------------------------------------------------------------------------------------

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
        return _PolynomialRecorder(expansion, search, results).program()


class _PolynomialRecorder:
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
            value = self._originals[index] = self._record_node(index)
            labels = self._expansion.program.labels
            if index in labels:
                self._builder.label(value, labels[index])
        return self._originals[index]

    def _record_node(self, index: int) -> Value:
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
