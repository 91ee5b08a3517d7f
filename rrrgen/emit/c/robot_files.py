"""The C of a robot as files: headers, sources, joint macros, build files and README."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING, Any

from rrrgen.base.templates import render
from rrrgen.derive.functions.table import ARGUMENT_ORDER, find
from rrrgen.emit import Real
from rrrgen.emit.c.division import divide
from rrrgen.emit.c.header_comments import explanation, prototype
from rrrgen.emit.c.language import Dialect, LibmSinCos, SinCos, Trig, nonfinite_function, print_body, sincos_strategy
from rrrgen.emit.c.parts import FunctionPart, print_in_parts
from rrrgen.emit.c.stack import STACK_RULE
from rrrgen.emit.description import facts, large_angles, parameter_lines, programs_of, title
from rrrgen.emit.interface import Rounding, SelfTestCheck
from rrrgen.emit.printing import columns, wrap
from rrrgen.program import Failure, Op, Program, count_operations, nominal_name
from rrrgen.robot.identity import Identity
from rrrgen.robot.spec import RobotSpec, joint_units

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel


# ------------------------------------------------------------------------------------------------------------------
# Macros of the emitted header with the names, units and limits of the joints, as initializers of arrays.
# ------------------------------------------------------------------------------------------------------------------

_LINE = 116


def joint_macros(spec: RobotSpec, dialect: Dialect) -> list[str]:
    """The lines of the macros ``<NAME>_JOINT_NAMES``, ``_Q_UNITS``, ``_Q_MIN``, ``_Q_MAX`` and so on."""
    units = [joint_units(joint) for joint in spec.joints]
    limits = [joint.limits for joint in spec.joints]
    rows = {
        "JOINT_NAMES": [_quote(joint.name) for joint in spec.joints],
        "Q_UNITS": [_quote(unit["unit"]) for unit in units],
        "TAU_UNITS": [_quote(unit["torque_unit"]) for unit in units],
        "Q_MIN": [_number(limit.lower, dialect, "(-INFINITY)") for limit in limits],
        "Q_MAX": [_number(limit.upper, dialect) for limit in limits],
        "DQ_MAX": [_number(limit.velocity, dialect) for limit in limits],
        "DDQ_MAX": [_number(limit.acceleration, dialect) for limit in limits],
        "TAU_MAX": [_number(limit.torque, dialect) for limit in limits],
    }
    return [line for name, values in rows.items() for line in _macro(f"{dialect.macro}_{name}", values)]


def _macro(name: str, values: list[str]) -> list[str]:
    """Print the macro ``#define name {values}``, continued over lines where it is long."""
    lines = [f"#define {name} {{{values[0]}"]
    for value in values[1:]:
        if len(lines[-1]) + len(value) > _LINE:
            lines[-1] += ", \\"
            lines.append(f"    {value}")
        else:
            lines[-1] += f", {value}"
    return [*lines[:-1], lines[-1] + "}"]


def _quote(text: str) -> str:
    return f'"{text}"'


def _number(value: float | None, dialect: Dialect, unlimited: str = "INFINITY") -> str:
    return f"({dialect.real_type}){unlimited}" if value is None else dialect.literal(Fraction(str(value)))


# ------------------------------------------------------------------------------------------------------------------
# The header and the source files of a robot.
# ------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Function:
    """The texts of one C function that the templates put together: prototype, lines of comment, lines of body.

    A long function calls ``parts``, static functions that stand before it.
    """

    prototype: str
    explanation: tuple[str, ...]
    body: tuple[str, ...]
    parts: tuple[FunctionPart, ...] = ()


def header_and_sources(
    model: DerivedModel,
    identity: Identity,
    dialect: Dialect,
    sincos: SinCos | None = None,
    rounding: Rounding | None = None,
) -> dict[str, str]:
    """Print ``<name>.h``, ``<name>.c`` and those of the :data:`FURTHER_SOURCES` for which there are functions.

    The header states the bounds ``rounding`` of rounding errors, if they were proven.
    """
    sincos = sincos or LibmSinCos()
    programs = programs_of(model)
    functions = print_functions(programs, dialect, sincos, rounding)
    failures = failures_of(programs.values(), dialect)
    header = render(
        "c/header.h.j2",
        **naming(dialect, identity),
        failures=failures,
        functions=functions.values(),
        opening=_opening(model, identity, dialect, sincos),
        joints=joint_macros(model.spec, dialect),
        n=model.spec.n,
        b=model.beta_size,
        argument_order=ARGUMENT_ORDER,
        drives=bool(model.drive_inertia_nominal),
    )
    files = {f"{dialect.prefix}.h": header}
    for part, names in source_parts(programs.values()).items():
        files[f"{dialect.prefix}{part}.c"] = render(
            "c/source.c.j2",
            **naming(dialect, identity),
            stem=f"{dialect.prefix}{part}",
            failures=() if part else failures,
            functions=[functions[name] for name in names],
            preamble=preamble([programs[name] for name in names], dialect, sincos),
        )
    return files


def failures_of(programs: Iterable[Program], dialect: Dialect) -> list[tuple[str, Failure]]:
    """The distinct failures of all functions, as (enumerator, failure), to be numbered from 1."""
    failures = [failure for program in programs if program.status is not None for failure in program.status.failures]
    return [(dialect.failure(failure), failure) for failure in {failure.name: failure for failure in failures}.values()]


NOMINAL, DERIVATIVES = "_nominal", "_derivatives"

FURTHER_SOURCES = {NOMINAL: "functions with the numbers of the robot file", DERIVATIVES: "derivatives"}
"""Contents of the separate source files, by the suffix of their names. A project can leave these files out, and compile
them in parallel."""

LONG = ("hessian", "tensors")
"""Groups whose functions are so long that each has a source file of its own: compilers take seconds for it."""


def source_parts(programs: Iterable[Program]) -> dict[str, list[str]]:
    """The functions of each source file, by the suffix of its name ("" for the main file)."""
    parts: dict[str, list[str]] = {"": []}
    for program in programs:
        specialized = NOMINAL if program.specializes else ""
        part = DERIVATIVES if program.function.endswith(DERIVATIVES) else specialized
        entry = find(program.function)
        if entry is not None and entry.group in LONG:
            part = f"_{program.name}"
        parts.setdefault(part, []).append(program.name)
    return parts


def naming(dialect: Dialect, identity: Identity) -> dict[str, object]:
    """The variables that all C templates share."""
    return {"prefix": dialect.prefix, "macro": dialect.macro, "real": dialect.real, "identity": identity}


def preamble(programs: Iterable[Program], dialect: Dialect, sincos: SinCos) -> str:
    """The C text of the static functions that the ``programs`` call; empty if there are none, to avoid a warning."""
    programs = list(programs)
    parts = [sincos.preamble(dialect) if any(count_operations(program).sincos for program in programs) else ""]
    if any(node.op is Op.NONFINITE for program in programs for node in program.nodes):
        parts.append(nonfinite_function(dialect))
    return "\n\n".join(filter(None, parts))


def print_functions(
    programs: Mapping[str, Program], dialect: Dialect, sincos: SinCos, rounding: Rounding | None = None
) -> dict[str, Function]:
    """The prototype, comment and body of every program, by name."""
    sentences = {name: statement.sentence for name, statement in (rounding or {}).items()}

    def print_function(name: str, program: Program) -> Function:
        comment = tuple(explanation(program, dialect, rounding=sentences.get(name, "")))
        division = divide(program)
        if division is None:
            return Function(prototype(program, dialect), comment, tuple(print_body(program, dialect, sincos)))
        parts, body = print_in_parts(program, division, dialect, sincos)
        return Function(prototype(program, dialect), comment, tuple(body), parts)

    return {name: print_function(name, program) for name, program in programs.items()}


def _sources(prefix: str, model: DerivedModel) -> str:
    parts = source_parts(model.programs.values())
    alone = [f"{prefix}{part}.c" for part in parts if part and part not in FURTHER_SOURCES]
    return "; ".join(
        [
            *(
                f"{FURTHER_SOURCES[part]} in {prefix}{part}.c" if part else f"{prefix}.c"
                for part in parts
                if part in ("", *FURTHER_SOURCES)
            ),
            *([f"one function each in {', '.join(alone)}"] if alone else []),
        ]
    )


def _opening(model: DerivedModel, identity: Identity, dialect: Dialect, sincos: SinCos) -> list[str]:
    """The opening comment of the header: content, conventions, rules, base parameters."""
    spec, macro = model.spec, dialect.macro
    lines = [f"{dialect.prefix}.h: {title(spec)}", ""]
    lines += [*wrap(spec.description), ""] if spec.description else []
    (first, generated), *others = facts(model, identity).items()
    rows = [
        (first, generated),
        ("Sources", _sources(dialect.prefix, model)),
        *others,
        ("Precision", f"{dialect.real}; the typedef {dialect.real_type} is the only switch"),
        ("Sine, cosine", sincos.description(dialect)),
        *large_angles(programs_of(model), dialect.real).items(),
        ("Stack", STACK_RULE),
    ]
    lines += [*columns(rows, indent=""), ""]
    lines += wrap(
        "Matrices are row-major. Outputs are fully written and must not overlap each other or the inputs; inputs may "
        "overlap each other. No function has state, allocates, or fails silently; all may be called from several "
        "threads at once."
    )
    return [*lines, "", *parameter_lines(model, f"{macro}_B")]


# ------------------------------------------------------------------------------------------------------------------
# The C backend: header, sources and self-test of a robot.
# ------------------------------------------------------------------------------------------------------------------

Files = dict[str, str]


def _nothing() -> tuple[Files, Sequence[SelfTestCheck]]:
    return {}, ()


@dataclass(frozen=True)
class CBackend:
    """Prints header, sources and self-test; ``trig`` is the source of sines and cosines.

    ``beside`` is a function that returns further C files of the robot, and checks of these for the self-test. It is
    called in the process that prints the self-test, since both need NumPy. ``rounding`` are the bounds of
    rounding errors that the header states.
    """

    trig: Trig = "inline"
    beside: Callable[[], tuple[Files, Sequence[SelfTestCheck]]] = _nothing
    rounding: Rounding = field(default_factory=dict)

    def files(self, model: DerivedModel, identity: Identity, real: Real) -> Files:
        """Print all files: ``<name>.h``, ``<name>.c`` with further sources, and ``<name>_selftest.c``."""
        return self.assemble(model, identity, [task() for task in self.tasks(model, identity, real)])

    def tasks(self, model: DerivedModel, identity: Identity, real: Real) -> list[Callable[[], Files]]:
        """List the two independent tasks: one prints header and sources, the other the self-test."""
        return [partial(self.sources, model, identity, real), partial(self._selftest, model, identity, real)]

    def assemble(self, model: DerivedModel, identity: Identity, results: Sequence[Files]) -> Files:
        """The union of the files of all tasks."""
        return {name: text for files in results for name, text in files.items()}

    def sources(self, model: DerivedModel, identity: Identity, real: Real) -> Files:
        """Header and sources without the self-test."""
        dialect = Dialect(model.spec.name, real)
        files = header_and_sources(model, identity, dialect, sincos_strategy(self.trig), self.rounding)
        if "path_dynamics" in model.programs:
            from rrrgen.emit.c.path_timing import timing_files

            files |= timing_files(model.programs["path_dynamics"], dialect)
        return files

    def _selftest(self, model: DerivedModel, identity: Identity, real: Real) -> Files:
        from rrrgen.emit.c.self_test import selftest  # its golden vectors need NumPy

        files, checks = self.beside()
        dialect = Dialect(model.spec.name, real)
        if "path_dynamics" in model.programs:
            from rrrgen.emit.c.path_timing import timing_check

            checks = [*checks, timing_check(model.programs["path_dynamics"], dialect)]
        return selftest(model, identity, dialect, checks) | files


# ------------------------------------------------------------------------------------------------------------------
# Files that accompany the emitted C: CMake and pkg-config files to build and find it, and a README.
# ------------------------------------------------------------------------------------------------------------------


def build_files(
    files: Iterable[str],
    model: DerivedModel,
    identity: Identity,
    real: Real,
    languages: Sequence[tuple[str, str]] = (),
) -> dict[str, str]:
    """Print ``CMakeLists.txt``, ``<name>.pc`` and ``README.md`` for the emitted ``files`` (paths below the output).

    ``languages`` are files or folders of other languages among them, each with a description for the README.
    """
    names = sorted(files)
    prefix = model.spec.name
    values: dict[str, Any] = {
        "prefix": prefix,
        "macro": Dialect(prefix, real).macro,
        "identity": identity,
        "version": identity.tool_version,
        "headers": [name for name in names if name.endswith((".h", ".hpp")) and "/" not in name],
        "casadi": [name for name in names if name.startswith("casadi/") and name.endswith(".c")],
        "selftests": [name for name in names if name.endswith("_selftest.c")],
        "sources": sources(names),
    }
    return {
        "CMakeLists.txt": render("c/CMakeLists.txt.j2", **values),
        f"{prefix}.pc": render("c/pkgconfig.pc.j2", **values),
        "README.md": render("c/README.md.j2", **values, **_contents(model, names, real), languages=languages),
    }


FURTHER_FUNCTIONS = {
    "controller": "the controller as one unit: modes, observer, faults, one call a period",
    "differential_ik": "joint speeds for a velocity of the tip, within all limits",
    "fourier": "a Fourier series whose coefficients the caller owns",
    "timing": "time-optimal timing of a path",
    "tool_ik": "inverse kinematics with the tool as an input",
}
"""Stem of files beside the model -> what is in them."""


def sources(names: Iterable[str]) -> list[str]:
    """The C files of the library among the emitted files: all but self-tests and those of CasADi."""
    c_files = [name for name in names if name.endswith(".c") and "/" not in name]
    return sorted(name for name in c_files if not name.endswith("_selftest.c"))


def _contents(model: DerivedModel, names: list[str], real: Real) -> dict[str, Any]:
    """The variables of the README's template: which parts were emitted, and which functions exist."""
    name = model.spec.name
    return {
        "title": title(model.spec),
        "real": real,
        "nominal": nominal_name("inverse_dynamics") in model.programs,
        "drives": bool(model.drive_inertia_nominal),
        "solver": f"{name}_ik.h" in names,
        "any_gravity": f"{name}_any_gravity.h" in names,
        "beside": [(stem, what) for stem, what in FURTHER_FUNCTIONS.items() if f"{name}_{stem}.h" in names],
        "law": _law(model),
        "friction": "friction" in model.programs,
    }


def _law(model: DerivedModel) -> dict[str, int] | None:
    """Sizes, by argument, of the control law in the example of the README; None where the example does not fit.

    The example is computed-torque control with smooth friction. It does not fit a robot without nominal inertia, or
    one whose friction takes further arguments.
    """
    law = model.programs.get(nominal_name("computed_torque"))
    friction = model.programs.get("smooth_friction")
    if law is None or friction is None or [port.name for port in friction.inputs] != ["dq", "friction", "width"]:
        return None
    return {port.name: port.size for port in law.inputs}
