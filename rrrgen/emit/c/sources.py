"""The header and the source files of a robot."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rrrgen.base.templates import render
from rrrgen.derive.functions.table import ARGUMENT_ORDER
from rrrgen.derive.parameters.listing import listing
from rrrgen.emit.c.dialect import Dialect
from rrrgen.emit.c.header_comments import explanation, prototype
from rrrgen.emit.c.joints import joint_macros
from rrrgen.emit.c.printer import print_body
from rrrgen.emit.c.stack import STACK_RULE
from rrrgen.emit.c.trigonometry import LibmSinCos, SinCos
from rrrgen.emit.comments import columns, mathematics, wrapped
from rrrgen.emit.description import facts, large_angles, programs_of, title
from rrrgen.program import Failure, Op, Program, count_operations
from rrrgen.robot.identity import Identity

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel


@dataclass(frozen=True)
class Function:
    """The texts of one C function that the templates put together: prototype, lines of comment, lines of body."""

    prototype: str
    explanation: tuple[str, ...]
    body: tuple[str, ...]


def header_and_sources(
    model: DerivedModel, identity: Identity, dialect: Dialect, sincos: SinCos | None = None
) -> dict[str, str]:
    """Print ``<name>.h``, ``<name>.c`` and those further sources (:data:`BESIDE`) for which there are functions."""
    sincos = sincos or LibmSinCos()
    programs = programs_of(model)
    functions = print_functions(programs, dialect, sincos)
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
    failures = [each for program in programs if program.status is not None for each in program.status.failures]
    return [(dialect.failure(each), each) for each in {each.name: each for each in failures}.values()]


NOMINAL, DERIVATIVES = "_nominal", "_derivatives"

BESIDE = {NOMINAL: "functions with the numbers of the robot file", DERIVATIVES: "derivatives"}
"""Contents of the separate source files, by the suffix of their names. A project can leave these files out, and compile
them in parallel."""


def source_parts(programs: Iterable[Program]) -> dict[str, list[str]]:
    """The functions of each source file, by the suffix of its name ("" for the main file)."""
    parts: dict[str, list[str]] = {"": []}
    for program in programs:
        specialized = NOMINAL if program.specializes else ""
        part = DERIVATIVES if program.function.endswith(DERIVATIVES) else specialized
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


def nonfinite_function(dialect: Dialect) -> str:
    """The C text of the static function ``dialect.nonfinite``, by the bits of a number.

    Under ``-ffast-math`` compilers take comparisons and arithmetic with NaN for impossible, but not integers.
    """
    return render("c/nonfinite.c.j2", prefix=dialect.prefix, real=dialect.real).rstrip("\n")


def print_functions(programs: Mapping[str, Program], dialect: Dialect, sincos: SinCos) -> dict[str, Function]:
    """The prototype, comment and body of every program, by name."""
    return {
        name: Function(
            prototype=prototype(program, dialect),
            explanation=tuple(explanation(program, dialect)),
            body=tuple(print_body(program, dialect, sincos)),
        )
        for name, program in programs.items()
    }


def _sources(prefix: str, model: DerivedModel) -> str:
    return "; ".join(
        f"{BESIDE[part]} in {prefix}{part}.c" if part else f"{prefix}.c"
        for part in source_parts(model.programs.values())
    )


def _opening(model: DerivedModel, identity: Identity, dialect: Dialect, sincos: SinCos) -> list[str]:
    """The opening comment of the header: content, conventions, rules, base parameters."""
    spec, macro = model.spec, dialect.macro
    lines = [f"{dialect.prefix}.h: {title(spec)}", ""]
    lines += [*wrapped(spec.description), ""] if spec.description else []
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
    lines += wrapped(
        "Matrices are row-major. Outputs are fully written and must not overlap each other or the inputs; inputs may "
        "overlap each other. No function has state, allocates, or fails silently; all may be called from several "
        "threads at once."
    )
    parameters = listing(model)
    lines += ["", *wrapped(parameters.heading(f"beta[{macro}_B]"))]
    lines += columns(
        [(f"beta[{k}]", p.name, p.unit or "-", mathematics(p.expression)) for k, p in enumerate(parameters.beta)]
    )
    return lines
