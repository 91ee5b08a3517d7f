"""Choosing the cheapest of several equivalent programs, by counted operations."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from rrrgen.program import Program, count_operations
from rrrgen.program.passes import Pass, PassReport
from rrrgen.program.passes.common_factors import Collect
from rrrgen.program.passes.doubling import DoubleByAddition
from rrrgen.program.passes.rewriting import MAX_PAIRS, MAX_TERMS, CutSet, ExpandAndFactor, SeenExpansions


class PassLog:
    """Collects a report of every pass that changed a program."""

    def __init__(self) -> None:
        self.reports: list[PassReport] = []

    def note(self, name: str, function: str, before: Program, after: Program) -> Program:
        """Report the pass ``name`` if it changed the program; returns ``after``."""
        if before is not after:
            self.reports.append(PassReport(name, function, count_operations(before), count_operations(after)))
        return after


@dataclass(frozen=True)
class Weights:
    """The cost of a program: the weighted sum of its operations; ties go to fewer multiplications, then fewer nodes.

    ``sincos`` is the weight of one angle (sine and cosine), ``div`` the additional weight of a division. Doubling the
    weights changes no program of the bundled robots; 20 for an angle costs 0.02 % on average and 15 % in the worst
    function, where one angle is traded for too many other operations.
    """

    sincos: int = 40
    div: int = 10

    def __call__(self, program: Program) -> tuple[int, int, int]:
        """The cost of ``program`` as a tuple to compare; smaller is cheaper."""
        count = count_operations(program)
        weighted = self.sincos * count.sincos + count.total + self.div * count.div
        return (weighted, count.mul, len(program.nodes))


@dataclass(frozen=True)
class Choice:
    """A candidate of the search: one of the equivalent programs, by its index, and how far it is expanded.

    ``cut_set`` names the nodes at which the expansion into polynomials stops; None takes the program unexpanded.
    """

    variant: int
    cut_set: CutSet | None


# The options below lie on plateaus of `python -m bench.measurements.pass_options`: the weighted operations of all
# functions of the bundled robots, one option changed at a time. Percentages are the average loss, in parentheses the
# loss of the worst function.

_MAX_OPERATIONS = {CutSet.NOTHING: 200, CutSet.SUMS: 230, CutSet.SCALED: 200, CutSet.LOCAL: sys.maxsize}
"""Operations of the longest program that is expanded with each cut set. Doubling changes nothing; halving costs 0.06 %
(15 %), 0.02 % (13 %) and 0.03 % (2 %). Leaving out the local expansion, which suits programs of any length, costs 1.3 %
(59 %)."""

_MAX_COST_RATIO = {CutSet.NOTHING: 1.3, CutSet.SUMS: 1.3, CutSet.SCALED: 1.3, CutSet.LOCAL: 1.2}
"""Skip an expansion when its program costs more than this multiple of the best one. 3 changes nothing; 1.1 costs 0.06 %
(15 %), 1.0 costs 0.13 % (15 %)."""


@dataclass(frozen=True)
class Cheapest:
    """Chooses among equivalent programs: each with common factors collected, and expansions of the cheapest ones.

    The ``expanded_variants`` cheapest are expanded, each with every cut set for which it has at most ``max_operations``
    operations and costs at most ``max_cost_ratio`` times the best program found so far. ``max_terms`` and ``max_pairs``
    bound the size of an expansion (:class:`~rrrgen.program.passes.rewriting.ExpandAndFactor`).
    """

    max_operations: Mapping[CutSet, int] = field(default_factory=_MAX_OPERATIONS.copy)
    max_cost_ratio: Mapping[CutSet, float] = field(default_factory=_MAX_COST_RATIO.copy)
    expanded_variants: int = 2  # one costs 0.07 % and saves a quarter of the time, three save 0.007 %
    max_terms: int = MAX_TERMS
    max_pairs: int = MAX_PAIRS
    cost: Weights = field(default_factory=Weights)

    def choices(self, variants: Sequence[Program]) -> list[Choice]:
        """List the candidates to try: every variant as it is, and expansions of the cheapest ones.

        A full expansion is the same from every variant, so it is listed for one variant only.
        """
        result = [Choice(index, None) for index in range(len(variants))]
        for index in sorted(range(len(variants)), key=lambda k: self.cost(variants[k]))[: self.expanded_variants]:
            total = count_operations(variants[index]).total
            whole = any(choice.cut_set is CutSet.NOTHING for choice in result)
            cut_sets = [cut_set for cut_set in CutSet if total <= self.max_operations[cut_set]]
            result += [Choice(index, cut_set) for cut_set in cut_sets if cut_set is not CutSet.NOTHING or not whole]
        return result

    def __call__(
        self, variants: Sequence[Program], name: str, log: PassLog, trials: Sequence[Choice] | None = None
    ) -> tuple[Program, Choice]:
        """The cheapest program among ``trials`` (default: all :meth:`choices`), and the choice that gave it.

        ``variants`` are the equivalent programs, ``name`` the function they compute; passes are reported to ``log``.
        """
        collect: Pass = Collect()
        collected = [collect(variant) for variant in variants]
        best, factors, taken = collected[0], collected[0], Choice(0, None)
        costs = [self.cost(program) for program in collected]
        least = costs[0]
        seen = SeenExpansions()
        for trial in self.choices(collected) if trials is None else trials:
            program, cost = collected[trial.variant], costs[trial.variant]
            expanded = program
            if trial.cut_set is not None:
                if trials is None and cost[0] > self.max_cost_ratio[trial.cut_set] * least[0]:
                    continue
                attempt = self._expand(trial.cut_set).attempt(program, seen)
                if attempt is None:
                    continue
                expanded, program = attempt, collect(attempt)
                cost = self.cost(program)
            if cost < least:
                best, least, factors, taken = program, cost, expanded, trial
        log.note("choose recursion", name, variants[0], variants[taken.variant])
        log.note("collect factors", name, variants[taken.variant], collected[taken.variant])
        log.note("expand and factor", name, collected[taken.variant], factors)
        log.note("collect factors", name, factors, best)
        return log.note("double by addition", name, best, DoubleByAddition()(best)), taken

    def _expand(self, cut_set: CutSet) -> ExpandAndFactor:
        return ExpandAndFactor(cut_set, self.max_terms, self.max_pairs)
