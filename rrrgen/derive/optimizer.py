"""The optimizer: runs the passes on every function of a robot, in a fixed order."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import partial
from itertools import chain

from rrrgen.base.parallel import Tell, parallel_map
from rrrgen.derive.derived_model import Derivation, DerivedModel, RecordedModel
from rrrgen.derive.functions.table import TABLE, combine, get_function, with_sources
from rrrgen.program import Builder, Op, Program, Role, Value, nominal_name, specialization
from rrrgen.program.guard import add_guard
from rrrgen.program.passes import PassReport
from rrrgen.program.passes.cheapest import Cheapest, Choice, PassLog
from rrrgen.program.passes.folding import Fold
from rrrgen.program.passes.rewriting import CutSet
from rrrgen.program.program import Node, count_operations, uses
from rrrgen.robot.spec import RobotSpec

# ------------------------------------------------------------------------------------------------------------------
# The pass that makes constants of a program equal to lengths of the robot file, so that readers recognize them.
#
# ``a (x + b y)`` becomes ``a x + (a b) y`` if the number a b is a length of the file.
# ------------------------------------------------------------------------------------------------------------------


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
    """The magnitudes of all lengths of the robot file, m: a and d of the rows, translations of base and tools."""
    rows = [length for row in spec.rows for length in (row.a, row.d, row.b)]
    fixed = [T.translation for T in (spec.base, spec.tool, *(tip.tool for tip in spec.tips.values()))]
    values = [spec.nominal(length) for length in (*rows, *chain.from_iterable(fixed))]
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
            self.values[k] = self._record_node(self.program.nodes[k])
            if k in self.program.labels:
                self.builder.label(self.values[k], self.program.labels[k])
        return self.values[k]

    def _record_node(self, node: Node) -> Value:
        if node.op is Op.INPUT:
            port, element = node.place
            return self.inputs[port][element]
        if node.op is Op.CONST:
            return node.number
        factor, rest = self._factor(node)
        if rest is not None:
            return self._record_multiple(factor, rest)
        operation: Callable[..., Value] = getattr(self.builder, node.op.value)
        return operation(*(self._value(arg) for arg in node.args))

    def _factor(self, node: Node) -> tuple[Fraction, int | None]:
        """Split ``node`` into a constant and the node that it multiplies; (1, None) if it is no such product."""
        if node.op is Op.MUL and self.program.nodes[node.args[0]].op is Op.CONST:
            return Fraction(self.program.nodes[node.args[0]].number), node.args[1]
        return Fraction(1), None

    def _record_multiple(self, factor: Fraction, k: int) -> Value:
        """Record ``factor`` times node k, multiplied into each term if k is a sum in which a length then appears."""
        node = self.program.nodes[k]
        if node.op not in (Op.ADD, Op.SUB) or self.uses[k] != 1 or not self._gains(factor, node):
            return self.builder.mul(factor, self._value(k))
        self.found = True
        terms = [self._term(factor, arg) for arg in node.args]
        return self.builder.add(*terms) if node.op is Op.ADD else self.builder.sub(*terms)

    def _gains(self, factor: Fraction, node: Node) -> bool:
        """Whether, in some term of the sum ``node``, ``factor`` times the term's constant is a length of the file."""
        constants = [self._own(arg) for arg in node.args]
        ratios = [c for c in constants if c is not None]
        return any(abs(c) not in self.lengths and abs(factor * c) in self.lengths for c in ratios)

    def _own(self, k: int) -> Fraction | None:
        factor, rest = self._factor(self.program.nodes[k])
        return None if rest is None or self.uses[k] != 1 else factor

    def _term(self, factor: Fraction, k: int) -> Value:
        if self._own(k) is None:
            return self.builder.mul(factor, self._value(k))
        constant, rest = self._factor(self.program.nodes[k])
        assert rest is not None
        return self._record_multiple(factor * constant, rest)


# ------------------------------------------------------------------------------------------------------------------
# The optimizer
# ------------------------------------------------------------------------------------------------------------------

_KINEMATIC = (Role.POSITION, Role.VELOCITY)
"""The inputs of kinematic functions, whose constants are lengths. Constants of other functions are mostly products with
inertial parameters."""

_ROOT = "inverse_dynamics"
"""The function that all functions that are derived by differentiation go back to."""


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
        functions = self._function_by_function(recorded, jobs, tell)
        made: dict[str, dict[str, Program]] = {}
        for name, one in functions.items():
            made[name] = {name: add_guard(one.program)}
            if one.nominal is not None:
                made[name][one.nominal.name] = add_guard(one.nominal)
        self._combine_all(recorded, made, jobs, tell)
        programs = {program_name: program for name in recorded.wanted for program_name, program in made[name].items()}
        passes = tuple(report for name in recorded.alternatives for report in functions[name].reports)
        return recorded.make_derived_model(programs, passes)

    def _combine_all(
        self, recorded: RecordedModel, made: dict[str, dict[str, Program]], jobs: int, tell: Tell | None
    ) -> None:
        """Make the functions that are made only of programs of others, and add them to ``made``, by their names.

        Those whose sources are known are made at the same time.
        """
        missing = [f for f in with_sources([get_function(name) for name in recorded.wanted]) if f.name not in made]
        while missing:
            ready = [f.name for f in missing if made.keys() >= {*f.of}]
            known = {name: program for programs in made.values() for name, program in programs.items()}
            tasks = partial(self._combine_function, recorded, known)
            made |= zip(ready, parallel_map(tasks, ready, jobs, tell, "combining functions"), strict=True)
            missing = [f for f in missing if f.name not in made]

    def _combine_function(
        self, recorded: RecordedModel, programs: Mapping[str, Program], name: str
    ) -> dict[str, Program]:
        """The function ``name`` as :func:`combine_programs` makes it, its specialization the cheapest of both ways."""
        made, special = combine_programs(name, recorded.derivation, programs), nominal_name(name)
        if get_function(name).differentiated and special in made:
            ways = [made[special], Fold(recorded.nominal)(made[name])]
            trials = [Choice(0, None), Choice(1, None), Choice(1, CutSet.LOCAL)]
            made[special] = as_nominal(self.cheapest(ways, special, PassLog(), trials)[0], name, made[name].summary)
        return made

    def _function_by_function(self, recorded: RecordedModel, jobs: int, tell: Tell | None) -> dict[str, _Optimized]:
        """Optimize the functions in up to ``jobs`` processes; functions that are derived from each other share one."""
        variants = recorded.alternatives
        chain = [f.name for f in TABLE if f.name in variants and (f.of or f.name == _ROOT)]
        groups = [chain, *([name] for name in variants if name not in chain)]
        groups.sort(key=lambda names: -sum(count_operations(variants[name][0]).total for name in names))
        optimized_groups = parallel_map(partial(self._in_turn, recorded), groups, jobs, tell, "simplifying functions")
        return {name: one for group in optimized_groups for name, one in group.items()}

    def _in_turn(self, recorded: RecordedModel, names: Sequence[str]) -> dict[str, _Optimized]:
        """Optimize the functions ``names`` in order: each may be derived from those before it."""
        functions: dict[str, _Optimized] = {}
        for name in names:
            log = PassLog()
            variants = recorded.alternatives[name]
            if (source := self._source(name, functions)) is not None:
                variants = (*variants, combine(name, recorded.derivation.recording(), [source]))
            program, choice = self.cheapest(variants, name, log)
            if program.takes(Role.POSITION) and all(port.role in _KINEMATIC for port in program.inputs):
                program = SpellLengths(lengths_of(recorded.spec))(program)
            functions[name] = _Optimized(
                program, self._specialize(recorded, variants, choice, program, log), log.reports
            )
        return functions

    def _source(self, name: str, known: Mapping[str, _Optimized]) -> Program | None:
        """The optimized program that ``name`` is the derivative of; None if inverse dynamics is too long for that."""
        of = get_function(name).of
        source, first = known.get(of[0]) if of else None, known.get(_ROOT)
        if source is None or first is None or count_operations(first.program).total > self.max_chain_rule:
            return None
        return source.program

    def _specialize(
        self, recorded: RecordedModel, variants: Sequence[Program], choice: Choice, best: Program, log: PassLog
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


def combine_programs(function: str, derivation: Derivation, programs: Mapping[str, Program]) -> dict[str, Program]:
    """Make ``function`` from the optimized ``programs`` of the functions that the table says it is made of.

    Returns it by name, and also its nominal specialization if all those functions have one.
    """
    of = get_function(function).of
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
    return program.with_fields(name=nominal_name(function), summary=words, specializes=function)
