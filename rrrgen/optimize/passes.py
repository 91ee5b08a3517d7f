"""The order of the passes, and the choice between equivalent programs by counted cost."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from rrrgen.derive.derived_model import DerivedModel, PassReport
from rrrgen.derive.functions.derivatives import differentiated, from_inverse_dynamics
from rrrgen.derive.functions.dynamic_functions import forward_dynamics
from rrrgen.derive.functions.recording import Recording
from rrrgen.optimize.collecting import collect
from rrrgen.optimize.doubling import double_by_addition
from rrrgen.optimize.expansion import Cutting
from rrrgen.optimize.folding import fold
from rrrgen.optimize.rewriting import Tried, factored
from rrrgen.parallel_map import side_by_side
from rrrgen.program import Program, Role, count_operations

LARGEST = {Cutting.NOTHING: 200, Cutting.SUMS: 230, Cutting.SCALED: 200, Cutting.LOCAL: sys.maxsize}
"""Up to how many operations a program is worth an expansion; the largest ones are factored locally only."""

SHORT = 115
"""A program of inverse dynamics up to this long is worth deriving its derivatives from."""

HOPELESS = {Cutting.LOCAL: 1.2, Cutting.SUMS: 1.3, Cutting.SCALED: 1.3, Cutting.NOTHING: 1.3}
"""A recursion this many times as dear as the best program found is not expanded: that saves less, locally a tenth."""

STRIPPED = 0.8
"""Where folding numbers in leaves no more than this share of the operations, zeros among the numbers made another
program of it, and the cheapest way to that one is looked for anew."""


class _Log:
    """Collects what each pass did."""

    def __init__(self) -> None:
        self.reports: list[PassReport] = []

    def note(self, name: str, function: str, before: Program, after: Program) -> Program:
        """Record a pass that changed something, and hand its result on."""
        if before is not after:
            self.reports.append(PassReport(name, function, count_operations(before), count_operations(after)))
        return after


@dataclass(frozen=True)
class _Cheapest:
    """One function at its cheapest, its nominal twin where it has one, and what the passes did."""

    program: Program
    twin: Program | None
    reports: list[PassReport]


def optimize_model(derived: DerivedModel, jobs: int = 1) -> DerivedModel:
    """The cheapest program of every function, then the nominal twins, by up to ``jobs`` processes."""
    found = _function_by_function(derived, jobs)
    programs: dict[str, Program] = {}
    for name in derived.alternatives:
        programs[name] = found[name].program
        if (twin := found[name].twin) is not None:
            programs[twin.name] = twin
        if name == "inverse_dynamics":
            _add_forward_dynamics(derived, programs)
    reports = tuple(report for name in derived.alternatives for report in found[name].reports)
    return replace(derived, programs=programs, passes=reports)


def _function_by_function(derived: DerivedModel, jobs: int) -> dict[str, _Cheapest]:
    """Every function on its own, and those in one turn that may be derived from each other; the longest first."""
    chain = [name for name in ("inverse_dynamics", *_SOURCES) if name in derived.alternatives]
    groups = [chain, *([name] for name in derived.alternatives if name not in chain)]
    groups.sort(key=lambda names: -sum(count_operations(derived.alternatives[name][0]).total for name in names))
    found = side_by_side(lambda names: _in_turn(derived, names), groups, jobs)
    return {name: one for group in found for name, one in group.items()}


def _in_turn(derived: DerivedModel, names: Sequence[str]) -> dict[str, _Cheapest]:
    """The functions ``names``, one after the other: each may be derived from those before it."""
    found: dict[str, _Cheapest] = {}
    for name in names:
        log = _Log()
        ways = derived.alternatives[name]
        ways = (*ways, *_by_chain_rule(derived, ways[0], found))
        program, choice = cheapest(ways, name, log)
        found[name] = _Cheapest(program, _twin(derived, ways, choice, program, log), log.reports)
    return found


_SOURCES = {
    "inverse_dynamics_derivatives": "inverse_dynamics",
    "forward_dynamics_derivatives": "inverse_dynamics_derivatives",
}
"""What a function may be derived from by the chain rule."""


def _by_chain_rule(derived: DerivedModel, like: Program, known: Mapping[str, _Cheapest]) -> list[Program]:
    """Derivatives from programs that are optimized already, where inverse dynamics is a short closed form."""
    source, first = known.get(_SOURCES.get(like.name, "")), known.get("inverse_dynamics")
    if source is None or first is None or count_operations(first.program).total > SHORT:
        return []
    if like.name == "inverse_dynamics_derivatives":
        return [differentiated(source.program, like)]
    return [from_inverse_dynamics(Recording(derived.model, derived.parametrization), source.program)]


def cost(program: Program) -> tuple[int, int, int]:
    """What programs are compared by: angles weigh most, then operations, then multiplications."""
    count = count_operations(program)
    return (40 * count.sincos + count.total + 10 * count.div, count.mul, len(program.nodes))


@dataclass(frozen=True)
class Choice:
    """One way to a program: which of the equivalent recursions, and where its expansion stops (None: not expanded)."""

    way: int
    cutting: Cutting | None


def choices(ways: Sequence[Program]) -> list[Choice]:
    """All ways worth trying: every recursion, and the expansions of the two cheapest.

    Expanding everything gives the same from any recursion, so that is done from one.
    """
    result = [Choice(index, None) for index in range(len(ways))]
    for index in sorted(range(len(ways)), key=lambda k: cost(ways[k]))[:2]:
        total = count_operations(ways[index]).total
        whole = any(choice.cutting is Cutting.NOTHING for choice in result)
        cuttings = [cutting for cutting in Cutting if total <= LARGEST[cutting]]
        result += [Choice(index, cutting) for cutting in cuttings if cutting is not Cutting.NOTHING or not whole]
    return result


def cheapest(
    ways: Sequence[Program], name: str, log: _Log, trials: Sequence[Choice] | None = None
) -> tuple[Program, Choice]:
    """The cheapest program found by ``trials`` (all choices by default), and the choice that gave it."""
    collected = [collect(way) for way in ways]
    best, factors, taken = collected[0], collected[0], Choice(0, None)
    tried = Tried()
    for trial in choices(collected) if trials is None else trials:
        way = collected[trial.way]
        if trials is None and trial.cutting and cost(way)[0] > HOPELESS[trial.cutting] * cost(best)[0]:
            continue
        found = way if trial.cutting is None else factored(way, trial.cutting, tried)
        if found is None:
            continue
        program = way if trial.cutting is None else collect(found)
        if cost(program) < cost(best):
            best, factors, taken = program, found, trial
    log.note("choose recursion", name, ways[0], ways[taken.way])
    log.note("collect factors", name, ways[taken.way], collected[taken.way])
    log.note("expand and factor", name, collected[taken.way], factors)
    log.note("collect factors", name, factors, best)
    return log.note("double by addition", name, best, double_by_addition(best)), taken


def _twin(derived: DerivedModel, ways: Sequence[Program], choice: Choice, best: Program, log: _Log) -> Program | None:
    """``<function>_nominal`` with the file's base parameters and drive inertias folded in, where it takes any."""
    known = derived.nominal
    if Role.BASE_PARAMETERS not in known or not best.takes(Role.BASE_PARAMETERS):
        return None
    name = f"{best.name}_nominal"
    first = log.note("fold parameters", name, best, fold(best, known))
    if count_operations(first).total <= STRIPPED * count_operations(best).total:
        twin, _ = cheapest([first, *(fold(way, known) for way in ways)], name, log)
    else:
        folded = [first, fold(ways[choice.way], known)]
        twin, _ = cheapest(folded, name, log, [Choice(0, None), Choice(1, None), Choice(1, choice.cutting)])
    summary = best.summary.rstrip(".") + ", with the parameters of the robot file."
    return twin.described(name=name, summary=summary)


def _add_forward_dynamics(derived: DerivedModel, programs: dict[str, Program]) -> None:
    """Forward dynamics from the cheapest mass matrix and bias torques, with both sets of parameters."""
    recording = Recording(derived.model, derived.parametrization)
    program = forward_dynamics(recording, programs["mass_matrix"], programs["bias"])
    programs["forward_dynamics"] = program
    if "mass_matrix_nominal" in programs:
        recording = Recording(derived.model, derived.parametrization)
        twin = forward_dynamics(recording, programs["mass_matrix_nominal"], programs["bias_nominal"])
        programs["forward_dynamics_nominal"] = twin.described(
            name="forward_dynamics_nominal",
            summary=program.summary.rstrip(".") + ", with the parameters of the robot file.",
        )
