"""The optimizer: runs the passes on every function of a robot, in a fixed order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise

from rrrgen.base.parallel import Tell, parallel_map
from rrrgen.derive.derived_model import Derivation, DerivedModel, RecordedModel
from rrrgen.derive.functions.table import FUNCTIONS, TABLE, combine
from rrrgen.derive.lengths import SpellLengths, lengths_of
from rrrgen.program import Program, Role, count_operations, nominal_name, specialization
from rrrgen.program.guard import guarded
from rrrgen.program.passes.cheapest import Cheapest, Choice, Log
from rrrgen.program.passes.folding import Fold
from rrrgen.program.passes.interface import PassReport

_KINEMATIC = (Role.POSITION, Role.VELOCITY)
"""The inputs of kinematic functions, whose constants are lengths. Constants of other functions are mostly products with
inertial parameters."""

_ROOT = "inverse_dynamics"
"""The function that all functions that are derived by differentiation go back to."""

_COMBINED_BEHIND: dict[str, list[str]] = {}
"""Functions that are made only of optimized programs of others, by the function that stands before them in the table.
"""
for _before, _function in pairwise(TABLE):
    if not _function.record:
        _COMBINED_BEHIND.setdefault(_before.name, []).append(_function.name)


@dataclass(frozen=True)
class _Optimized:
    """One optimized function, its nominal specialization (None if it has none), and the reports of the passes."""

    program: Program
    nominal: Program | None
    reports: list[PassReport]


@dataclass(frozen=True)
class Optimizer:
    """Optimizes every function of a robot and adds the nominal specializations.

    ``max_chain_rule``: largest number of operations of inverse dynamics for which its derivatives are also tried by
    differentiating the optimized program. ``search_anew_below``: if at most this share of the operations remains after
    the numbers of the robot file are inserted, zeros among them have changed the structure of the program, and all
    variants are searched again for the specialization. The percentages in the comments are increases of the weighted
    operations over all functions of the bundled robots, in parentheses that of the worst function.
    """

    cheapest: Cheapest = field(default_factory=Cheapest)
    max_chain_rule: int = 115  # halving costs 0.15 % (25 % of one function), doubling changes nothing
    search_anew_below: float = 0.8  # 0.6 costs 0.17 % (19 % of one function); 1 saves 0.02 % for a tenth more time

    def __call__(self, recorded: RecordedModel, jobs: int = 1, tell: Tell | None = None) -> DerivedModel:
        """The optimized model, computed by up to ``jobs`` processes; the result does not depend on their number."""
        found = self._function_by_function(recorded, jobs, tell)
        programs: dict[str, Program] = {}
        for name in recorded.alternatives:
            programs[name] = guarded(found[name].program)
            if (nominal := found[name].nominal) is not None:
                programs[nominal.name] = guarded(nominal)
            for function in _COMBINED_BEHIND.get(name, ()):
                programs |= combined(function, recorded.derivation, programs)
        passes = tuple(report for name in recorded.alternatives for report in found[name].reports)
        return recorded.optimized(programs, passes)

    def _function_by_function(self, recorded: RecordedModel, jobs: int, tell: Tell | None) -> dict[str, _Optimized]:
        """Optimize the functions in up to ``jobs`` processes; functions that are derived from each other share one."""
        variants = recorded.alternatives
        chain = [f.name for f in TABLE if f.name in variants and (f.of or f.name == _ROOT)]
        groups = [chain, *([name] for name in variants if name not in chain)]
        groups.sort(key=lambda names: -sum(count_operations(variants[name][0]).total for name in names))
        found = parallel_map(partial(self._in_turn, recorded), groups, jobs, tell, "simplifying functions")
        return {name: one for group in found for name, one in group.items()}

    def _in_turn(self, recorded: RecordedModel, names: Sequence[str]) -> dict[str, _Optimized]:
        """Optimize the functions ``names`` in order: each may be derived from those before it."""
        found: dict[str, _Optimized] = {}
        for name in names:
            log = Log()
            variants = recorded.alternatives[name]
            if (source := self._source(name, found)) is not None:
                variants = (*variants, combine(name, recorded.derivation.recording(), [source]))
            program, choice = self.cheapest(variants, name, log)
            if program.takes(Role.POSITION) and all(port.role in _KINEMATIC for port in program.inputs):
                program = SpellLengths(lengths_of(recorded.spec))(program)
            found[name] = _Optimized(program, self._specialized(recorded, variants, choice, program, log), log.reports)
        return found

    def _source(self, name: str, known: Mapping[str, _Optimized]) -> Program | None:
        """The optimized program that ``name`` is the derivative of; None if inverse dynamics is too long for that."""
        of = FUNCTIONS[name].of
        source, first = known.get(of[0]) if of else None, known.get(_ROOT)
        if source is None or first is None or count_operations(first.program).total > self.max_chain_rule:
            return None
        return source.program

    def _specialized(
        self, recorded: RecordedModel, variants: Sequence[Program], choice: Choice, best: Program, log: Log
    ) -> Program | None:
        """Replace the base parameters and drive inertias of ``best`` by the numbers of the robot file, and optimize.

        None if the function takes no base parameters, or computes some, or the file gives no values. ``best`` came from
        ``variants`` by ``choice``, which is tried again with the numbers unless these change the structure.
        """
        fold = Fold(recorded.nominal)
        if Role.BASE_PARAMETERS not in fold.known or not best.takes(Role.BASE_PARAMETERS):
            return None
        if any(port.role is Role.BASE_PARAMETERS for port in best.outputs):
            return None
        name = nominal_name(best.name)
        first = log.note("fold parameters", name, best, fold(best))
        if count_operations(first).total <= self.search_anew_below * count_operations(best).total:
            nominal, _ = self.cheapest([first, *map(fold, variants)], name, log)
        else:
            trials = [Choice(0, None), Choice(1, None), Choice(1, choice.cut_set)]
            nominal, _ = self.cheapest([first, fold(variants[choice.variant])], name, log, trials)
        return as_nominal(nominal, best.name, best.summary)


def combined(function: str, derivation: Derivation, programs: Mapping[str, Program]) -> dict[str, Program]:
    """Make ``function`` from the optimized ``programs`` of the functions that the table says it is made of.

    Returns it by name, and also its nominal specialization if all those functions have one.
    """
    of = FUNCTIONS[function].of
    program = combine(function, derivation.recording(), [programs[name] for name in of])
    made = {function: program}
    nominal = [one for name in of if (one := specialization(programs, name)) is not None]
    if len(nominal) == len(of):
        special = as_nominal(combine(function, derivation.recording(), nominal), function, program.summary)
        made[special.name] = special
    return made


def as_nominal(program: Program, function: str, summary: str) -> Program:
    """Rename ``program`` to ``<function>_nominal`` and mark it as the nominal specialization of ``function``."""
    words = summary.rstrip(".") + ", with the parameters of the robot file."
    return program.described(name=nominal_name(function), summary=words, specializes=function)
