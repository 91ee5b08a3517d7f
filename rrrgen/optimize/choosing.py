"""The cheapest of equivalent programs, by counted operations."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from rrrgen.derive.derived_model import PassReport
from rrrgen.optimize.collecting import Collect
from rrrgen.optimize.doubling import DoubleByAddition
from rrrgen.optimize.expansion import Cutting
from rrrgen.optimize.interface import Pass
from rrrgen.optimize.rewriting import MAX_PAIRS, MAX_TERMS, ExpandAndFactor, SeenExpansions
from rrrgen.program import Program, count_operations


class Log:
    """Collects what each pass did."""

    def __init__(self) -> None:
        self.reports: list[PassReport] = []

    def note(self, name: str, function: str, before: Program, after: Program) -> Program:
        """Record a pass that changed something, and hand its result on."""
        if before is not after:
            self.reports.append(PassReport(name, function, count_operations(before), count_operations(after)))
        return after


@dataclass(frozen=True)
class Weights:
    """What programs are compared by: the weighted sum of their operations, then multiplications, then nodes.

    Twice the weights change no program of the bundled robots; with 20 for an angle some trade one for too many other
    operations (0.02 % on average, 15 % in the worst function).
    """

    sincos: int = 40
    div: int = 10

    def __call__(self, program: Program) -> tuple[int, int, int]:
        """The cost of ``program``; smaller is cheaper."""
        count = count_operations(program)
        weighted = self.sincos * count.sincos + count.total + self.div * count.div
        return (weighted, count.mul, len(program.nodes))


@dataclass(frozen=True)
class Choice:
    """One way to a program: which of the equivalent recursions, and where its expansion stops (None: not expanded)."""

    way: int
    cutting: Cutting | None


# The options below stand on plateaus of `python -m bench.measurements.pass_options`: the weighted operations of all
# functions of the bundled robots, one option changed at a time. Percentages are averages; in parentheses stands the
# function that loses most.

_LARGEST = {Cutting.NOTHING: 200, Cutting.SUMS: 230, Cutting.SCALED: 200, Cutting.LOCAL: sys.maxsize}
"""Twice as many change nothing; half as many cost 0.06 % (15 %), 0.02 % (13 %) and 0.03 % (2 %). Without the local
expansion, which suits programs of any length, it would be 1.3 % (59 %)."""

_HOPELESS = {Cutting.NOTHING: 1.3, Cutting.SUMS: 1.3, Cutting.SCALED: 1.3, Cutting.LOCAL: 1.2}
"""3 changes nothing; 1.1 costs 0.06 % (15 %), 1.0 costs 0.13 % (15 %)."""


@dataclass(frozen=True)
class Cheapest:
    """Chooses among equivalent programs: every recursion with its factors collected, and expansions of the cheapest.

    ``expanded_ways`` of the recursions are expanded, each with every cutting for which it has at most ``largest``
    operations and costs at most ``hopeless`` times the best program found so far. ``max_terms`` and ``max_pairs`` are
    those of :class:`~rrrgen.optimize.rewriting.ExpandAndFactor`.
    """

    largest: Mapping[Cutting, int] = field(default_factory=_LARGEST.copy)
    hopeless: Mapping[Cutting, float] = field(default_factory=_HOPELESS.copy)
    expanded_ways: int = 2  # one costs 0.07 % and saves a quarter of the time, three save 0.007 %
    max_terms: int = MAX_TERMS
    max_pairs: int = MAX_PAIRS
    cost: Weights = field(default_factory=Weights)

    def choices(self, ways: Sequence[Program]) -> list[Choice]:
        """All ways worth trying. Expanding everything gives the same from any recursion, so that is done from one."""
        result = [Choice(index, None) for index in range(len(ways))]
        for index in sorted(range(len(ways)), key=lambda k: self.cost(ways[k]))[: self.expanded_ways]:
            total = count_operations(ways[index]).total
            whole = any(choice.cutting is Cutting.NOTHING for choice in result)
            cuttings = [cutting for cutting in Cutting if total <= self.largest[cutting]]
            result += [Choice(index, cutting) for cutting in cuttings if cutting is not Cutting.NOTHING or not whole]
        return result

    def __call__(
        self, ways: Sequence[Program], name: str, log: Log, trials: Sequence[Choice] | None = None
    ) -> tuple[Program, Choice]:
        """The cheapest program found by ``trials`` (all choices by default), and the choice that gave it."""
        collect: Pass = Collect()
        collected = [collect(way) for way in ways]
        best, factors, taken = collected[0], collected[0], Choice(0, None)
        seen = SeenExpansions()
        for trial in self.choices(collected) if trials is None else trials:
            way = collected[trial.way]
            if trials is None and trial.cutting and self._is_hopeless(way, trial.cutting, best):
                continue
            found = way if trial.cutting is None else self._expand(trial.cutting).attempt(way, seen)
            if found is None:
                continue
            program = way if trial.cutting is None else collect(found)
            if self.cost(program) < self.cost(best):
                best, factors, taken = program, found, trial
        log.note("choose recursion", name, ways[0], ways[taken.way])
        log.note("collect factors", name, ways[taken.way], collected[taken.way])
        log.note("expand and factor", name, collected[taken.way], factors)
        log.note("collect factors", name, factors, best)
        return log.note("double by addition", name, best, DoubleByAddition()(best)), taken

    def _is_hopeless(self, way: Program, cutting: Cutting, best: Program) -> bool:
        return self.cost(way)[0] > self.hopeless[cutting] * self.cost(best)[0]

    def _expand(self, cutting: Cutting) -> ExpandAndFactor:
        return ExpandAndFactor(cutting, self.max_terms, self.max_pairs)
