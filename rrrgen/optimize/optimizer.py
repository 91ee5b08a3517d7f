"""All functions of a robot at their cheapest: which passes run on which function, in what order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from rrrgen.derive.derived_model import DerivedModel, PassReport, RecordedModel
from rrrgen.derive.functions.from_programs import SOURCES, as_nominal, by_chain_rule, with_forward_dynamics
from rrrgen.optimize.choosing import Cheapest, Choice, Log
from rrrgen.optimize.folding import Fold
from rrrgen.parallel_map import side_by_side
from rrrgen.program import Program, Role, count_operations


@dataclass(frozen=True)
class _Optimized:
    """One function at its cheapest, its nominal specialization where it has one, and what the passes did."""

    program: Program
    nominal: Program | None
    reports: list[PassReport]


@dataclass(frozen=True)
class Optimizer:
    """Takes every function to its cheapest program and adds the nominal specializations.

    ``short``: derivatives are also tried by the chain rule where inverse dynamics has at most so many operations.
    ``stripped``: where folding numbers in leaves no more than this share of the operations, zeros among the numbers
    made another program of it, and the cheapest way to that one is looked for anew. Both are measured as the options of
    :class:`~rrrgen.optimize.choosing.Cheapest` are.
    """

    cheapest: Cheapest = field(default_factory=Cheapest)
    short: int = 115  # half as many cost 0.15 % (25 % of one function), twice as many change nothing
    stripped: float = 0.8  # 0.6 costs 0.17 % (19 % of one function); 1 saves 0.02 % for a tenth more time

    def __call__(self, recorded: RecordedModel, jobs: int = 1) -> DerivedModel:
        """The programs of ``recorded``, optimized by up to ``jobs`` processes; the result does not depend on them."""
        found = self._function_by_function(recorded, jobs)
        programs: dict[str, Program] = {}
        for name in recorded.alternatives:
            programs[name] = found[name].program
            if (nominal := found[name].nominal) is not None:
                programs[nominal.name] = nominal
            if name == "inverse_dynamics":
                programs |= with_forward_dynamics(recorded.derivation, programs)
        passes = tuple(report for name in recorded.alternatives for report in found[name].reports)
        return recorded.optimized(programs, passes)

    def _function_by_function(self, recorded: RecordedModel, jobs: int) -> dict[str, _Optimized]:
        """Every function on its own, and those in one turn that may be derived from each other; the longest first."""
        ways = recorded.alternatives
        chain = [name for name in ("inverse_dynamics", *SOURCES) if name in ways]
        groups = [chain, *([name] for name in ways if name not in chain)]
        groups.sort(key=lambda names: -sum(count_operations(ways[name][0]).total for name in names))
        found = side_by_side(lambda names: self._in_turn(recorded, names), groups, jobs)
        return {name: one for group in found for name, one in group.items()}

    def _in_turn(self, recorded: RecordedModel, names: Sequence[str]) -> dict[str, _Optimized]:
        """The functions ``names``, one after the other: each may be derived from those before it."""
        found: dict[str, _Optimized] = {}
        for name in names:
            log = Log()
            ways = recorded.alternatives[name]
            if (source := self._source(name, found)) is not None:
                ways = (*ways, by_chain_rule(recorded, name, source))
            program, choice = self.cheapest(ways, name, log)
            found[name] = _Optimized(program, self._specialized(recorded, ways, choice, program, log), log.reports)
        return found

    def _source(self, name: str, known: Mapping[str, _Optimized]) -> Program | None:
        """The optimized program to differentiate, where inverse dynamics is a short closed form."""
        source, first = known.get(SOURCES.get(name, "")), known.get("inverse_dynamics")
        if source is None or first is None or count_operations(first.program).total > self.short:
            return None
        return source.program

    def _specialized(
        self, recorded: RecordedModel, ways: Sequence[Program], choice: Choice, best: Program, log: Log
    ) -> Program | None:
        """``<function>_nominal`` with the file's base parameters and drive inertias in it, if it takes any."""
        fold = Fold(recorded.nominal)
        if Role.BASE_PARAMETERS not in fold.known or not best.takes(Role.BASE_PARAMETERS):
            return None
        name = f"{best.name}_nominal"
        first = log.note("fold parameters", name, best, fold(best))
        if count_operations(first).total <= self.stripped * count_operations(best).total:
            nominal, _ = self.cheapest([first, *map(fold, ways)], name, log)
        else:
            trials = [Choice(0, None), Choice(1, None), Choice(1, choice.cutting)]
            nominal, _ = self.cheapest([first, fold(ways[choice.way])], name, log, trials)
        return as_nominal(nominal, best.name, best.summary)
