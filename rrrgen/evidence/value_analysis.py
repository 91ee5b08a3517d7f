"""Run-time errors of emitted C, by the value analysis EVA of Frama-C: indices, pointers, conversions, numbers.

Model functions are analysed over the box of the robot file's limits, where every number that is not finite counts as an
alarm. The controller is analysed from every state that it can have, with any bits in its input, NaN and infinity
included: whether an operation fails, and whether all numbers of its output and of the next state are finite. Its
parameters are within the ranges of their table, which ``_check`` sees to; ``_check`` itself is analysed with any bits.
The model functions that it calls are analysed by themselves, with any bits in their inputs; in a tick
a function stands in for each that writes any bits, so that what is shown does not depend on what they compute.

Forward dynamics, its derivatives and the dynamics of elastic joints factorize M. That the entries of the factors are
bounded follows from relations between them, so that for many joints EVA cannot exclude that a divisor is zero or that a
number overflows. There it takes bounds of pivots and factors as they are, which
:func:`rrrgen.evidence.factorization.factorization_facts` proves where the status is ok and no pivot is below
2^-50 kg m^2 (kg), smaller than the inertia of any arm; the row says so.

EVA knows no relations between variables. Where the code relies on one, the analysed text says the same in another way:
the bits that show whether numbers are finite are read as comparisons (a test holds that both agree), ``fabs`` as a
choice, ``tanh`` by its bounds, and sines and cosines by the proven ones of the kernel, which has a row of its own; the
kernel's own range is read as two comparisons. The modes are analysed one by one.
"""

from __future__ import annotations

import csv
import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from rrrgen.controller.files import standalone_files
from rrrgen.controller.layout import COUNTERS, structs
from rrrgen.controller.programs import called_programs, own_programs
from rrrgen.controller.proposals import proposals
from rrrgen.emit.c.function_files import function_files
from rrrgen.emit.c.header_comments import prototype
from rrrgen.emit.c.ik.files import sources
from rrrgen.emit.c.language import RANGE, Dialect, InlineSinCos
from rrrgen.emit.controller.differential_ik import declaration, differential_ik_files
from rrrgen.evidence.boxes import PortRange, Ranges, box_of, nominal_beta
from rrrgen.evidence.factorization import LEAST_PIVOT, Fact, factorization_facts
from rrrgen.evidence.rounding import NoBoundError
from rrrgen.ik.classify import plan as make_plan
from rrrgen.program import Builder, Op, Port, Role

if TYPE_CHECKING:
    from rrrgen.base.parallel import Tell
    from rrrgen.controller.layout import StructLayout
    from rrrgen.controller.table import ControllerUnit, Field
    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.emit.c.language import SinCos
    from rrrgen.ik.plan import SolverPlan
    from rrrgen.program import Program
    from rrrgen.robot.spec import RobotSpec

COMMON = ("-machdep", "gcc_x86_64", "-cpp-extra-args=-I. -include stated.h", "-eva")
"""Options of every analysis."""

OPTIONS = (
    *("-eva-precision", "3", "-eva-auto-loop-unroll", "200", "-eva-split-return", "auto"),
    *("-eva-interprocedural-splits", "-eva-no-show-progress"),
)
"""Options of all other analyses, and of model functions about which something stays open with fewer states."""

STATED = """#include <math.h>
/*@ assigns \\result \\from x;
    behavior number: assumes \\is_finite(x);
        ensures \\is_finite(\\result) && -1.0 <= \\result <= 1.0; */
double stated_tanh(double x);
/*@ assigns \\result \\from x;
    behavior number: assumes \\is_finite(x);
        ensures \\is_finite(\\result) && -1.0000000000000003 <= \\result <= 1.0000000000000003; */
double stated_sine(double x);
#define tanh(x) stated_tanh(x)
#define sin(x) stated_sine(x)
#define cos(x) stated_sine(x)
#define fabs(x) (((x) < 0) ? -(x) : (x))
"""
"""What is stated about the C library beside EVA's own specifications."""

LARGEST = "1.7976931348623157e308"
_FAR = 1e12  # what the controller takes infinite parameters for


class Alarm(NamedTuple):
    """Something that the analysis could not exclude or show: where, of which kind, and the property that is open."""

    file: str
    line: int
    kind: str
    property: str


LIMIT = 900.0
"""Seconds after which the analysis of one function is given up."""


class TooLongError(Exception):
    """An analysis has not come to an end within :data:`LIMIT`."""


def is_available() -> bool:
    """Whether Frama-C is installed."""
    return shutil.which("frama-c") is not None


def alarms(
    directory: Path,
    files: Mapping[str, str],
    main: str,
    special: str = "none",
    apart: Mapping[str, int] | None = None,
    options: Sequence[str] = (),
) -> list[Alarm]:
    """What stays open when ``main`` of the C ``files`` is analysed in ``directory``, in which they are written.

    Files whose names end with ``.c`` are sources, unless others include them. ``special`` says which floating-point
    values are alarms: "none" or "non-finite". In the functions ``apart`` so many states are kept apart. Raises
    RuntimeError where the analysis fails, TooLongError where it takes longer than :data:`LIMIT`.
    """
    for name, text in {**files, "stated.h": STATED}.items():
        (directory / name).write_text(text, encoding="utf-8", newline="\n")
    included = {name for name in files if any(f'#include "{name}"' in text for text in files.values())}
    sources = [name for name in sorted(files) if name.endswith(".c") and name not in included]
    report = directory / f"{main}.csv"
    command = ["frama-c", *sources, "-main", main, "-warn-special-float", special, *COMMON, *(options or OPTIONS)]
    command += ["-eva-slevel-function", ",".join(f"{name}:{count}" for name, count in apart.items())] if apart else []
    command += ["-then", "-report-csv", report.name]
    place = {**os.environ, "PWD": str(directory.resolve())}  # Frama-C believes this variable more than the system
    try:
        done = subprocess.run(
            command, cwd=directory, env=place, capture_output=True, text=True, check=False, timeout=LIMIT
        )
    except subprocess.TimeoutExpired:
        raise TooLongError(f"the analysis did not come to an end in {LIMIT / 60.0:g} minutes") from None
    if done.returncode != 0 or not report.is_file():
        raise RuntimeError(f"frama-c, {main}: {done.stdout[-2000:]}{done.stderr[-2000:]}")
    with report.open(encoding="utf-8", newline="") as lines:
        rows = list(csv.DictReader(lines, delimiter="\t"))
    return [
        Alarm(row["file"], int(row["line"]), row["property kind"], row["property"])
        for row in rows
        if row["directory"] != "FRAMAC_SHARE/libc" and not _is_settled(row)
    ]


def _is_settled(row: Mapping[str, str]) -> bool:
    """Whether a property holds. What is never reached holds too, except for what the driver wants to be shown."""
    if row["status"] == "Dead":
        return row["property kind"] != "user assertion"
    return row["status"] in ("Valid", "Considered valid")


# ---------------------------------------------------------------------------------------------------------------------
# Model functions
# ---------------------------------------------------------------------------------------------------------------------


def function_alarms(
    program: Program,
    box: Mapping[str, PortRange],
    directory: Path,
    sincos: SinCos | None = None,
    facts: Sequence[Fact] = (),
    options: Sequence[str] = (),
) -> list[Alarm]:
    """What stays open about a model function, for all inputs in the ``box``, which has all of its input ports.

    Sines and cosines are those of ``sincos``, by default of the C library, whose bounds are stated. ``facts`` are
    bounds of nodes that EVA takes as they are, proven elsewhere; ``options`` replace :data:`OPTIONS`.
    """
    names = {fact.node: f"factor_{fact.node}" for fact in facts}
    program = program.with_fields(labels={**program.labels, **names})
    lines, post, given = [], [], []
    for port in program.inputs:
        lines.append(f"double {port.name}[{port.size}];")
        bounds = zip(box[port.name].lower, box[port.name].upper, strict=True)
        lines += [f"{port.name}[{k}] = {_interval(low, high)};" for k, (low, high) in enumerate(bounds)]
        given.append(port.name if port.shape else f"{port.name}[0]")
    for port in program.data_outputs:
        lines.append(f"double {port.name}_[{port.size}];")
        given.append(f"{port.name}_")
        post += [f"/*@ assert \\is_finite({port.name}_[{k}]); */" for k in range(port.size)]
    call = f"(void)analysed_{program.name}({', '.join(given)});"
    body = "\n    ".join([*lines, call, *post])
    driver = f'#include "analysed.h"\n#include "__fc_builtin.h"\nvoid analysed(void)\n{{\n    {body}\n}}\n'
    files = function_files("analysed", "one function", [program], "double", sincos)
    files["analysed.c"] = _with_facts(files["analysed.c"], names, facts)
    return alarms(directory, {**files, "driver.c": driver}, "analysed", "non-finite", options=options)


def _with_facts(text: str, names: Mapping[int, str], facts: Sequence[Fact]) -> str:
    """The C ``text`` with the facts, as EVA reads them, behind the declarations of the nodes that they wait for."""
    for after in dict.fromkeys(fact.after for fact in facts):
        (declared,) = re.findall(rf"^    const analysed_real {names[after]} = .*;\n", text, re.MULTILINE)
        admitted = "".join(
            f"    /*@ admit {fact.low!r} <= {names[fact.node]} <= {fact.high!r}; */\n"
            for fact in facts
            if fact.after == after
        )
        text = text.replace(declared, declared + admitted)
    return text


def kernel_alarms(directory: Path) -> list[Alarm]:
    """What stays open about the kernel of sine and cosine within its range."""
    b = Builder()
    (x,) = b.input(Port("x", (1,)))
    program = b.program("kernel", [(Port("sine", (1,)), [b.sin(x)]), (Port("cosine", (1,)), [b.cos(x)])])
    farthest = float(RANGE["double"])
    box = {"x": PortRange((-farthest,), (farthest,), "the range of the kernel")}
    return function_alarms(program, box, directory, InlineSinCos())


def _interval(low: float, high: float) -> str:
    return f"Frama_C_double_interval({low!r}, {high!r})"


# ---------------------------------------------------------------------------------------------------------------------
# Inverse kinematics
# ---------------------------------------------------------------------------------------------------------------------


PARTS = {"error": ("e", "J"), "step": ("d",), "branches": ("found",)}
"""The functions inside a solver that are analysed by themselves, and those of their arguments that are results only."""

FAST_OPTIONS = ("-eva-precision", "0", "-eva-auto-loop-unroll", "16", "-eva-no-show-progress")
"""Options for inverse kinematics, and for model functions at first: loops over joints, entries of poses and rows are
unrolled, searches are not."""

PART_OPTIONS = ("-eva-precision", "0", "-eva-auto-loop-unroll", "64", "-eva-no-show-progress")
"""Options for the functions :data:`PARTS`: loops over the angles of all branches are unrolled too."""

_APART = 200  # states kept apart where solutions are sorted or dropped, by how many there are


def solver_alarms(spec: RobotSpec, plan: SolverPlan, directory: Path) -> list[Alarm]:
    """What stays open about the inverse kinematics with any bits in its target, reference and options, in double.

    The functions :data:`PARTS` are analysed by themselves with any bits in their arguments; in the analysis of the
    whole, stand-ins that write any bits replace them, so that it holds whatever they compute. The caller's result holds
    numbers before, since EVA does not see that rows beyond the count are never read.
    """
    files, name = sources(spec), spec.name
    source, macro = f"{name}_ik.c", name.upper()
    parts = [_part(files[source], name, which) for which in PARTS]
    heading = f'#include <limits.h>\n#include "__fc_builtin.h"\n#include "{source}"\n'
    given = "target, ref, " + ("ref[0], " if plan.redundancy else "")
    driver = (
        f"{heading}static double target[{macro}_IK_TARGET];\nstatic double ref[{macro}_IK_JOINTS];\n"
        f"static {name}_ik_solutions found;\n\n"
        "void analysed(void)\n{\n"
        "    Frama_C_make_unknown((char *)&target, sizeof target);\n"
        "    Frama_C_make_unknown((char *)&ref, sizeof ref);\n"
        f"    (void){name}_inverse_kinematics({given}Frama_C_unsigned_int_interval(0u, UINT_MAX), &found);\n"
        f"    /*@ assert 0 <= found.count <= {macro}_IK_ROWS; */\n}}\n"
    )
    whole = files[source]
    for part in parts:
        whole = whole.replace(part.text, part.stand_in(macro))
    apart = {f"{name}_ik_{function}": _APART for function in ("sort", "finish")}
    open_ = alarms(
        directory, {**files, source: whole, "driver.c": driver}, "analysed", apart=apart, options=FAST_OPTIONS
    )
    for part in parts:
        text = heading + part.driver(macro)
        open_ += alarms(directory, {**files, "driver.c": text}, "analysed", options=PART_OPTIONS)
    return open_


class _Argument(NamedTuple):
    """A parameter of a C function: its type without qualifiers and stars, whether a pointer, its extents, constancy."""

    name: str
    type: str
    pointer: bool
    extents: tuple[str, ...]
    constant: bool


@dataclass(frozen=True)
class _Part:
    """A function of a solver: its ``text``, what stands in front of its body, its result's type and its arguments."""

    robot: str
    which: str
    text: str
    head: str
    result: str
    arguments: tuple[_Argument, ...]

    def stand_in(self, macro: str) -> str:
        """The function with a body that writes any bits to its results and returns any value that it may."""
        body = []
        for argument in self.arguments:
            if argument.constant or not (argument.pointer or argument.extents):
                continue
            if argument.type == f"{self.robot}_ik_solutions":
                body += [_unknown(f"{argument.name}->{field}") for field in _ROWS_OF_RESULT]
            elif argument.type == "int":
                body.append(f"*{argument.name} = Frama_C_interval(INT_MIN, INT_MAX);")
            else:
                body.append(
                    f"Frama_C_make_unknown((char *){argument.name}, {' * '.join(argument.extents)} * sizeof(double));"
                )
        if self.result == "int":
            body.append(f"return Frama_C_interval(0, {macro}_IK_ROWS);")
        elif self.result != "void":
            body += [f"{self.result} any;", _unknown("any"), "return any;"]
        lines = "\n    ".join(body)
        rest = "\n" * (self.text.count("\n") - self.head.count("\n") - len(body) - 2)  # later lines keep their numbers
        return f"{self.head}{{\n    {lines}\n}}\n{rest}"

    def driver(self, macro: str) -> str:
        """A driver that calls the function with any bits, and shows what its stand-in supposes of its results."""
        lines, shown, given = [], [], []
        for argument in self.arguments:
            result = argument.name in PARTS[self.which]
            given.append(f"&{argument.name}" if argument.pointer and argument.type != self._real else argument.name)
            if argument.type == f"{self.robot}_ik_solutions":
                lines.append(f"static {argument.type} {argument.name};")
                continue
            extents = argument.extents
            if argument.pointer and argument.type == self._real:
                extents = (f"{macro}_IK_TARGET" if argument.name == "T" else f"{macro}_IK_JOINTS",)
            lines.append(f"{argument.type} {argument.name}{''.join(f'[{extent}]' for extent in extents)};")
            if result and extents:
                every = "".join(f"[0 .. {extent} - 1]" for extent in extents)
                shown.append(f"/*@ assert \\initialized(&{argument.name}{every}); */")
            elif not result:
                lines.append(_unknown(argument.name))
        call = f"{self.robot}_ik_{self.which}({', '.join(given)});"
        if self.result == "int":
            call = f"const int rows = {call}"
            shown.append(f"/*@ assert 0 <= rows <= {macro}_IK_ROWS; */")
        body = "\n    ".join([*lines, call if self.result == "int" else f"(void){call}", *shown])
        return f"void analysed(void)\n{{\n    {body}\n}}\n"

    @property
    def _real(self) -> str:
        return f"{self.robot}_ik_real"


_ROWS_OF_RESULT = ("q", "flags", "branch", "residual")


def _unknown(name: str) -> str:
    return f"Frama_C_make_unknown((char *)&{name}, sizeof {name});"


def _part(source: str, robot: str, which: str) -> _Part:
    """The function ``which`` of the solver ``source`` of a robot."""
    definition = re.search(
        rf"^static (\w+) {robot}_ik_{which}\(([^)]*)\)\n\{{\n.*?^\}}\n", source, re.MULTILINE | re.DOTALL
    )
    assert definition is not None, which
    written = set(re.findall(r"\bfound->(\w+)", definition[0]))
    assert written <= set(_ROWS_OF_RESULT), written
    arguments = []
    for text in definition[2].split(","):
        declared = re.match(r"\s*(const )?(\w+) (\*?)(\w+)((?:\[\w+\])*)$", text.strip())
        assert declared is not None, text
        extents = tuple(re.findall(r"\[(\w+)\]", declared[5]))
        arguments.append(_Argument(declared[4], declared[2], bool(declared[3]), extents, bool(declared[1])))
    head = definition[0][: definition[0].index("{\n")]
    return _Part(robot, which, definition[0], head, definition[1], tuple(arguments))


def differential_alarms(name: str, n: int, directory: Path) -> list[Alarm]:
    """What stays open about differential inverse kinematics of ``n`` joints with any bits in its inputs, in double."""
    function = f"{name}_differential_ik"
    ports = {port.name: port.size for port in declaration(n).inputs}
    lines = [f"static double {port}[{size}];" for port, size in ports.items()]
    unknown = [f"Frama_C_make_unknown((char *)&{port}, sizeof {port});" for port in ports]
    given = ", ".join(f"{port.name}" if port.shape else f"{port.name}[0]" for port in declaration(n).inputs)
    driver = "\n".join(
        [
            *(f'#include "{function}.c"', '#include "__fc_builtin.h"', *lines, f"static double speeds[{n}];"),
            *("", "void analysed(void)", "{", *(f"    {line}" for line in unknown)),
            f"    (void){function}({given}, speeds);",
            "}\n",
        ]
    )
    return alarms(directory, {**differential_ik_files(name, n, "double"), "driver.c": driver}, "analysed")


# ---------------------------------------------------------------------------------------------------------------------
# The controller
# ---------------------------------------------------------------------------------------------------------------------

ENTRIES = ("step", "start", "checks", "called")
"""What is analysed: a tick; init, set and reset with parameters in their ranges; all functions with any parameters; the
model functions that the controller calls."""

APART = (400, 5000)
"""States that are kept apart in a tick. Neither number settles more than the other for all units; what one analysis
settles is settled."""


def controller_alarms(unit: ControllerUnit, directory: Path, entry: str) -> list[Alarm]:
    """What stays open about one of :data:`ENTRIES` of the controller, in double."""
    files = {name: text for name, text in standalone_files(unit, "double").items() if not name.endswith(".json")}
    prefix = f"{unit.model.spec.name.removesuffix('_any_gravity')}_controller"
    if entry == "called":
        files = {
            name: _BOUND.sub(r"!\1 || !((x == x) && (x >= -\2) && (x <= \2))", text) for name, text in files.items()
        }
        return alarms(directory, {**files, "driver.c": _calls(unit)}, entry)
    files[f"{prefix}.c"] = _readable(files[f"{prefix}.c"], prefix)
    if entry == "step":
        files |= {f"{name}.c": _stand_ins(name, programs) for name, programs in _programs_by_file(unit).items()}
    files["driver.c"] = _driver(unit, prefix, entry)
    open_: list[Alarm] = []
    for count in APART:
        raised_alarms = alarms(directory, files, entry, apart={f"{prefix}_step": count, f"{prefix}_with_sample": count})
        open_ = [alarm for alarm in raised_alarms if count == APART[0] or alarm in open_]
        if not open_:
            break
    return open_


_BOUND = re.compile(r"!\((\w+) && \(fabs\(x\) <= (\(\w+\)[0-9.e+]+)\)\)")
"""The condition for angles outside the range of the emitted sines; fabs hides from EVA that x is a number inside it."""


def _programs_by_file(unit: ControllerUnit) -> dict[str, list[Program]]:
    """The model functions that the controller calls, by the name of the file that has them."""
    laws = own_programs(unit)
    of_model = [program for program in called_programs(unit) if program.name not in laws]
    robot = unit.model.spec.name
    programs_by_file = {robot: of_model, f"{robot.removesuffix('_any_gravity')}_controller_laws": list(laws.values())}
    return {name: programs for name, programs in programs_by_file.items() if programs}


def _stand_ins(name: str, programs: Sequence[Program]) -> str:
    """The source of a file whose functions write any bits and return any status."""
    functions = []
    for program in programs:
        body = [f"Frama_C_make_unknown((char *){p.name}, {8 * p.size}u);" for p in program.data_outputs]
        body += [f"return ({name}_status)Frama_C_interval(0, 99);"] if program.status else []
        lines = "\n    ".join(body)
        functions.append(f"{prototype(program, Dialect(name, 'double'))}\n{{\n    {lines}\n}}\n")
    return f'#include "{name}.h"\n#include "__fc_builtin.h"\n\n' + "\n".join(functions)


def _calls(unit: ControllerUnit) -> str:
    """A driver that calls the model functions of the controller with any bits."""
    called = _programs_by_file(unit)
    lines = [f'#include "{name}.h"' for name in called]
    lines += ['#include "__fc_builtin.h"', "void called(void)", "{"]
    for name, programs in called.items():
        for program in programs:
            given = []
            lines.append("    {")
            for port in program.inputs:
                lines.append(f"        double {port.name}[{port.size}];")
                lines.append(f"        Frama_C_make_unknown((char *){port.name}, sizeof {port.name});")
                given.append(port.name if port.shape else f"{port.name}[0]")
            for port in program.data_outputs:
                lines.append(f"        double {port.name}_[{port.size}];")
                given.append(f"{port.name}_")
            lines += [f"        (void){name}_{program.name}({', '.join(given)});", "    }"]
    return "\n".join([*lines, "}", ""])


def _readable(text: str, prefix: str) -> str:
    """The controller's source with finiteness read by comparisons, and one analysis for each mode."""
    start = text.index(f"static int {prefix}_finite(")
    end = text.index("\n}\n", start) + 3
    law = text.index(f"if ({prefix}_referenced(input, mode) == 0)")
    finite = (
        f"static int {prefix}_finite(const {prefix}_real *x, size_t count)\n"
        "{\n    size_t k;\n\n    for (k = 0; k < count; ++k) {\n"
        "        if (!((x[k] == x[k]) && (x[k] > -INFINITY) && (x[k] < INFINITY))) {\n            return 0;\n"
        "        }\n    }\n    return 1;\n}\n"
    )
    return f"{text[:start]}{finite}{text[end:law]}/*@ split mode; */\n    {text[law:]}"


def _driver(unit: ControllerUnit, prefix: str, entry: str) -> str:
    laid = structs(unit, "double", proposals(unit))
    parameters = [_parameter(place.field) for place in laid.parameters.places if place.field.name != "reserved"]
    memory = [_set(f"state.memory.{place.field.name}", place.field, _any_number()) for place in laid.memory.places]
    derived = [
        _set(f"state.{f.name}", f, _any_number() if f.name == "beta_loaded" else _interval(0.0, 1.0))
        for f in (place.field for place in laid.derived.places)
        if not f.integer
    ]
    kept = [*_finite("state.memory", laid.memory), *_finite("state", laid.derived)]
    counters = [f"state.{field.name} = {_COUNTERS[field.name]};" for field in COUNTERS if field.name in _COUNTERS]
    ranges = [
        "/*@ assert 0 <= state.phase <= 3; */",
        "/*@ assert -1 <= state.mode <= 31; */",
        "/*@ assert 0 <= state.good <= 1000000000; */",
        "/*@ assert 0 <= state.bad <= 1000000000; */",
    ]
    shares = [
        f"/*@ assert 0.0 <= state.{f.name}{'[0]' if f.array else ''} <= 1.0; */"
        for f in (place.field for place in laid.derived.places)
        if not f.integer and f.name != "beta_loaded"
    ]
    macro = prefix.upper()
    whole = [f"given.size = sizeof(given); given.abi = {macro}_ABI; given.model = {macro}_MODEL;", *parameters]
    unknown = "Frama_C_make_unknown((char *)&{0}, sizeof {0});"
    started = [*kept, *shares, *ranges]
    mains = {
        "step": [
            *whole,
            "state.params = given;",
            f"{prefix}_without_infinity(&state.params);",
            *memory,
            *derived,
            unknown.format("state.magic"),
            unknown.format("state.sample"),
            *counters,
            unknown.format("input"),
            f"(void){prefix}_step(&state, &input, &output);",
            *_finite("output", laid.output),
            *_finite("state.memory", laid.memory),
            *ranges,
        ],
        "start": [
            *whole,
            unknown.format("input"),
            f"if ({prefix}_init(&state, &given, &input) == 0) {{",
            *started,
            f"(void){prefix}_set(&state, &given);",
            *started,
            *counters,
            f"(void){prefix}_reset(&state, &input);",
            *started,
            "}",
        ],
        "checks": [
            f"{prefix}_default(&given);",
            unknown.format("given"),
            unknown.format("input"),
            f"(void){prefix}_check(&given);",
            f"(void){prefix}_init(&state, &given, &input);",
            f"(void){prefix}_set(&state, &given);",
            f"(void){prefix}_field_name(Frama_C_interval(INT_MIN, INT_MAX), text);",
            f"(void){prefix}_status_text(Frama_C_unsigned_int_interval(0u, UINT_MAX));",
        ],
    }
    body = "\n    ".join(mains[entry])
    return (
        f'#include "{prefix}.c"\n#include "__fc_builtin.h"\n#include <limits.h>\n'
        f"static {prefix}_params given;\nstatic {prefix}_state state;\nstatic {prefix}_input input;\n"
        f"static {prefix}_output output;\nstatic char text[64];\n\n"
        f"void {entry}(void)\n{{\n    int k;\n    {body}\n}}\n"
    )


_COUNTERS = {
    "phase": "Frama_C_interval(0, 3)",
    "mode": "Frama_C_interval(-1, 31)",
    "good": "Frama_C_interval(0, 1000000000)",
    "bad": "Frama_C_interval(0, 1000000000)",
    "observing": "Frama_C_interval(0, 1)",
    "yielding": "Frama_C_interval(0, 1)",
    "blending": "Frama_C_interval(0, 1)",
}


def _any_number() -> str:
    return f"Frama_C_double_interval(-{LARGEST}, {LARGEST})"


def _set(target: str, field: Field, value: str) -> str:
    return (
        f"for (k = 0; k < {field.count}; ++k) {{ {target}[k] = {value}; }}" if field.array else f"{target} = {value};"
    )


def _parameter(field: Field) -> str:
    if field.integer:
        return _set(f"given.{field.name}", field, f"Frama_C_interval({int(field.low)}, {int(field.high)})")
    low = -_FAR if field.infinite and field.low < 0.0 else field.low
    high = _FAR if field.infinite else field.high
    return _set(f"given.{field.name}", field, _interval(low, high))


def _finite(owner: str, struct: StructLayout) -> list[str]:
    """Assertions that all numbers of a struct are finite."""
    return [
        f"for (k = 0; k < {field.count}; ++k) {{ /*@ assert \\is_finite({owner}.{field.name}[k]); */ }}"
        if field.array
        else f"/*@ assert \\is_finite({owner}.{field.name}); */"
        for field in (place.field for place in struct.places)
        if not field.integer
    ]


# ---------------------------------------------------------------------------------------------------------------------
# The certificate
# ---------------------------------------------------------------------------------------------------------------------


def analysed_with_eva(
    model: DerivedModel,
    unit: ControllerUnit | None,
    ranges: Ranges,
    tell: Tell | None = None,
    differential: bool = False,
) -> tuple[dict[str, Any], list[tuple[str, str]]]:
    """The certificate's entry about run-time errors of model functions, inverse kinematics and the controller.

    Returns it with what was not analysed and the reason. ``differential`` says whether the files hold differential
    inverse kinematics. ``tell(done, total, message)`` is called as the work proceeds; it takes seconds for each model
    function, minutes for inverse kinematics and for the controller.
    """
    if not is_available():
        return {}, [("run-time errors", "Frama-C is not installed")]
    skipped: list[tuple[str, str]] = []
    analyses: list[tuple[str, list[Alarm]]] = []

    def analyse(what: str, analysis: Callable[[Path], tuple[str, list[Alarm]]]) -> None:
        """Add the row of an analysis in a folder of its own, or the reason why there is none."""
        try:
            with tempfile.TemporaryDirectory(prefix="rrrgen-eva-") as folder:
                analyses.append(analysis(Path(folder)))
        except TooLongError as reason:
            skipped.append((f"run-time errors of {what}", str(reason)))

    kernel = "kernel of sine and cosine"
    analyse(kernel, partial(_analysis_row, kernel, kernel_alarms))
    for done, (name, program) in enumerate(model.programs.items()):
        if tell is not None:
            tell(done, len(model.programs), f"run-time errors of {name}")
        box = box_of(program, model.spec, nominal_beta(model), ranges)
        missing = [port.name for port in program.inputs if port.name not in box]
        if missing:
            skipped.append((f"run-time errors of {name}", f"no range of {', '.join(missing)} is known"))
            continue
        analyse(name, partial(_of_function, model, name, box))
    plan, spec = make_plan(model.spec), model.spec
    further: dict[str, Callable[[Path], list[Alarm]]] = {}
    if plan.general:
        skipped.append(("run-time errors of inverse_kinematics", "the general solver is too long for the analysis"))
    elif plan.solvable:
        further["inverse_kinematics"] = partial(solver_alarms, spec, plan)
    if differential:
        further["differential_ik"] = partial(differential_alarms, spec.name, spec.n)
    if unit is not None:
        further |= {f"controller, {entry}": partial(controller_alarms, unit, entry=entry) for entry in ENTRIES}
    for what, analysis in further.items():
        if tell is not None:
            tell(0, 0, f"run-time errors of {what}")
        analyse(what, partial(_analysis_row, what, analysis))
    return {"run_time_errors": run_time_errors_entry(analyses)}, skipped


def _analysis_row(what: str, analysis: Callable[[Path], list[Alarm]], directory: Path) -> tuple[str, list[Alarm]]:
    return what, analysis(directory)


def _of_function(
    model: DerivedModel, name: str, box: Mapping[str, PortRange], directory: Path
) -> tuple[str, list[Alarm]]:
    """The row of a model function and its alarms.

    At first without facts about the factors of M, since the row then supposes nothing. A long function has them at
    once: alarms about its factors make the analysis of what follows very long. What fewer states settle is settled.
    """
    program = model.programs[name]
    known = known_facts(model, name, box)
    attempts: list[list[Fact]] = [known] if known and len(program.nodes) > _LONG else [[], *([known] if known else [])]
    open_: list[Alarm] = []
    for facts in attempts:
        what = f"{name}, {WITH_FACTS}" if facts else name
        for options in (FAST_OPTIONS, OPTIONS):
            open_ = function_alarms(program, box, directory, facts=facts, options=options)
            if not open_:
                return what, []
    return what, open_


_LONG = 1500
"""Nodes of a program from which on facts about the factors of M are given at once."""


WITH_FACTS = f"where the status is ok and no pivot of M is below {LEAST_PIVOT:.1e}"
"""What holds for a function that is analysed with the facts about its factorization."""


def known_facts(model: DerivedModel, name: str, box: Mapping[str, PortRange]) -> list[Fact]:
    """The facts about the factors of M in the function ``name``; none if it has no such factors that are recognised.

    A function with elastic joints factorizes the mass matrix of the links alone: drive inertia, which it does not read,
    is zero there.
    """
    program = model.programs[name]
    mass = model.programs.get("mass_matrix_nominal" if name.endswith("_nominal") else "mass_matrix")
    given = {port.name for port in program.inputs}
    if mass is None or program.status is None or not given.issuperset(port.name for port in mass.inputs):
        return []
    read = {node.place for node in program.nodes if node.op is Op.INPUT}
    bounds: dict[str, tuple[Sequence[float], Sequence[float]]] = {
        port: port_range.bounds for port, port_range in box.items()
    }
    for place, port in enumerate(program.inputs):
        if port.role is Role.BASE_PARAMETERS:
            of_read = [[x if (place, k) in read else 0.0 for k, x in enumerate(row)] for row in bounds[port.name]]
            bounds[port.name] = of_read[0], of_read[1]
    try:
        return factorization_facts(program, mass, bounds)
    except NoBoundError:
        return []


def run_time_errors_entry(analyses: Iterable[tuple[str, Sequence[Alarm]]]) -> dict[str, Any]:
    """The entry ``run_time_errors`` of the certificate: a row for everything that was analysed."""
    rows = [(what, len(open_), "; ".join(f"{a.file}:{a.line} {a.kind}" for a in open_)) for what, open_ in analyses]
    total = sum(count for _, count, _ in rows)

    def options(additions: Sequence[str]) -> str:
        return " ".join((*COMMON, *additions))

    return {
        "summary": f"Frama-C EVA, {options(OPTIONS)}; inverse kinematics, and model functions at first, with "
        f"{options(FAST_OPTIONS)}, parts of inverse kinematics with {options(PART_OPTIONS)}: {total} alarms. Model "
        "functions over the limits of the robot file, with numbers that are not finite as alarms; inverse kinematics "
        "and the controller with any input, and all numbers of the controller's output and state shown to be finite.",
        "alarms": total,
        "headings": ["what", "alarms", "open"],
        "rows": [list(row) for row in rows],
    }
