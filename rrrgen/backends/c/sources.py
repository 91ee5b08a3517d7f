"""The header and the source files of a robot."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING

from rrrgen.backends import Identity
from rrrgen.backends.c.dialect import Dialect
from rrrgen.backends.c.printer import print_body
from rrrgen.backends.c.signature import explanation, prototype
from rrrgen.backends.c.trigonometry import LibmSinCos, SinCos
from rrrgen.backends.comments import columns, plain, wrapped
from rrrgen.backends.printing import decimal
from rrrgen.derive.functions.recording import drive_inertia_meaning
from rrrgen.derive.parameter_listing import listing
from rrrgen.model.drive_text import coupling_equations, motor_facts
from rrrgen.program import Builder, Port, Program, Role, Status, count_operations
from rrrgen.resources import render

if TYPE_CHECKING:
    import sympy as sp

    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.robotfile.robot_spec import RobotSpec


@dataclass(frozen=True)
class Function:
    """One emitted function, ready for the templates."""

    prototype: str
    explanation: tuple[str, ...]
    body: tuple[str, ...]


def programs_of(model: DerivedModel) -> dict[str, Program]:
    """The programs that are emitted: the model's own, and the nominal parameters where the file gives links."""
    programs = {name: program.described(name=name) for name, program in model.programs.items()}
    if model.beta_nominal is not None:
        programs["nominal_parameters"] = _nominal_parameters(model)
    return programs


def _nominal_parameters(model: DerivedModel) -> Program:
    assert model.beta_nominal is not None
    meaning = "base parameters; the header lists them"
    port = Port("beta", (len(model.beta_nominal),), "mixed", "", meaning, Role.BASE_PARAMETERS)
    outputs = [(port, model.beta_nominal)]
    if model.drive_inertia_nominal is not None:
        meaning = drive_inertia_meaning(model.spec)
        shape = (len(model.drive_inertia_nominal),)
        port = Port("Ia", shape, "kg m^2 | kg", "joint", meaning, Role.DRIVE_INERTIA)
        outputs.append((port, model.drive_inertia_nominal))
    summary = "The nominal values of the parameters that the other functions take at run time."
    return Builder().program("nominal_parameters", outputs, summary)


def header_and_sources(
    model: DerivedModel, identity: Identity, dialect: Dialect, sincos: SinCos | None = None
) -> dict[str, str]:
    """``<name>.h``, ``<name>.c`` and the sources beside it (:data:`BESIDE`), as far as there are functions for them."""
    sincos = sincos or LibmSinCos()
    programs = programs_of(model)
    functions = print_functions(programs, dialect, sincos)
    failures = _failures(programs.values(), dialect)
    header = render(
        "c/header.h.j2",
        **naming(dialect, identity),
        failures=failures,
        functions=functions.values(),
        opening=_opening(model, identity, dialect, sincos),
        n=model.spec.n,
        b=len(model.base_parameters),
    )
    files = {f"{dialect.prefix}.h": header}
    for part, names in _parts(programs).items():
        files[f"{dialect.prefix}{part}.c"] = render(
            "c/source.c.j2",
            **naming(dialect, identity),
            stem=f"{dialect.prefix}{part}",
            failures=() if part else failures,
            functions=[functions[name] for name in names],
            preamble=preamble([programs[name] for name in names], dialect, sincos),
        )
    return files


def _failures(programs: Iterable[Program], dialect: Dialect) -> list[tuple[str, Status]]:
    """What can go wrong in any of the functions, each once: its enumerator, numbered from 1, and what it means."""
    return list({dialect.failure(p.status): p.status for p in programs if p.status is not None}.items())


BESIDE = {"_nominal": "functions with the numbers of the robot file", "_derivatives": "derivatives"}
"""Sources of their own, for who leaves such functions out, and for compilers that run side by side."""


def _parts(programs: Iterable[str]) -> dict[str, list[str]]:
    """What is added to the robot's name for a source file, and the functions in it."""
    parts: dict[str, list[str]] = {"": []}
    for name in programs:
        stem = name.removesuffix("_nominal")
        part = "_derivatives" if stem.endswith("_derivatives") else "" if stem == name else "_nominal"
        parts.setdefault(part, []).append(name)
    return parts


def naming(dialect: Dialect, identity: Identity) -> dict[str, object]:
    """What all templates of C know."""
    return {"prefix": dialect.prefix, "macro": dialect.macro, "real": dialect.real, "identity": identity}


def preamble(programs: Iterable[Program], dialect: Dialect, sincos: SinCos) -> str:
    """What stands before the functions; nothing where they have no angles, as compilers warn of what is not used."""
    return sincos.preamble(dialect) if any(count_operations(program).sincos for program in programs) else ""


def print_functions(programs: Mapping[str, Program], dialect: Dialect, sincos: SinCos) -> dict[str, Function]:
    """Every program as prototype, explanation and body."""
    return {
        name: Function(
            prototype=prototype(program, dialect),
            explanation=tuple(explanation(program, dialect)),
            body=tuple(print_body(program, dialect, sincos)),
        )
        for name, program in programs.items()
    }


_CONVENTIONS = {
    "standard": "standard Denavit-Hartenberg: T_i-1_i = Rz(theta) Tz(d) Tx(a) Rx(alpha), joint i about z_i-1",
    "modified": "modified Denavit-Hartenberg: T_i-1_i = Rx(alpha) Tx(a) Rz(theta) Tz(d), joint i about z_i",
}


def _number(value: sp.Expr) -> str:
    """A decimal where it is exact, else the expression."""
    return decimal(Fraction(int(value.p), int(value.q))) if value.is_Rational else plain(str(value))


def _sources(prefix: str, model: DerivedModel) -> str:
    return "; ".join(
        f"{BESIDE[part]} in {prefix}{part}.c" if part else f"{prefix}.c" for part in _parts(model.programs)
    )


def _drive_facts(spec: RobotSpec) -> list[tuple[str, str]]:
    """How coupled drives move the joints, and what is stated of their motors; nothing without coupling."""
    if spec.drives is None:
        return []
    facts = [("Drives", f"coupled; speeds of joints and drives: {', '.join(coupling_equations(spec))}")]
    stated = [f"{motor.name}: {text}" for motor in spec.drives.motors if (text := motor_facts(motor))]
    return [*facts, ("Motors", "; ".join(stated))] if stated else facts


def _opening(model: DerivedModel, identity: Identity, dialect: Dialect, sincos: SinCos) -> list[str]:
    """The first comment of the header: what this is, the conventions, the rules, the base parameters."""
    spec, macro = model.spec, dialect.macro
    structure = " ".join("R" if joint.is_revolute else "P" for joint in spec.joints)
    gravity = ", ".join(_number(component) for component in spec.gravity)
    lines = [f"{dialect.prefix}.h: kinematics and dynamics of {spec.name}, a serial robot with joints {structure}", ""]
    lines += [*wrapped(spec.description), ""] if spec.description else []
    facts = [
        (
            "Generated by",
            f"rrrgen {identity.tool_version}. The generated code belongs to you: use, change and pass it on.",
        ),
        ("Sources", _sources(dialect.prefix, model)),
        ("Model", f"SHA-256 {identity.model_hash} of the normalised robot description"),
        ("Convention", _CONVENTIONS[spec.convention]),
        ("Units", "SI and rad: q rad or m, dq per s, ddq per s^2, tau N m or N, masses kg, inertias kg m^2"),
        ("Gravity", f"acceleration ({gravity}) m/s^2 in the base frame"),
        (
            "Frames",
            "base = before the first joint and the fixed base transform, link i = frame i, tip = after the tool",
        ),
        *_drive_facts(spec),
        ("Precision", f"{dialect.real}; the typedef {dialect.real_type} is the only switch"),
        ("Sine, cosine", sincos.description(dialect)),
    ]
    lines += [*columns(facts, indent=""), ""]
    lines += wrapped(
        "Matrices are row-major. Outputs are fully written and must not overlap each other or the inputs; inputs may "
        "overlap each other. No function has state, allocates, or fails silently; all may be called from several "
        "threads at once."
    )
    parameters = listing(model)
    lines += ["", *wrapped(f"Base parameters beta[{macro}_B]. {parameters.statement}")]
    lines += columns([(f"beta[{k}]", p.name, p.unit or "-", f"{p.expression}") for k, p in enumerate(parameters.rows)])
    return lines
