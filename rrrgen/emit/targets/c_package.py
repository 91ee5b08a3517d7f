"""Emitted C of a robot together with the data that export targets need to wrap it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import takewhile
from typing import Any, NamedTuple

from rrrgen.base.templates import render
from rrrgen.derive import derive_once
from rrrgen.derive.derived_model import DerivedModel
from rrrgen.derive.functions.friction import friction_parameters
from rrrgen.derive.functions.table import GROUPS, find
from rrrgen.emit import Real
from rrrgen.emit.c.ik.files import sources as solver_sources
from rrrgen.emit.c.language import Dialect
from rrrgen.emit.c.path_timing import further_inputs
from rrrgen.emit.c.robot_files import CBackend, Files
from rrrgen.emit.controller.differential_ik import Declaration, declaration
from rrrgen.emit.controller.template_files import files_beside
from rrrgen.emit.description import programs_of
from rrrgen.emit.printing import plain, port_text, wrap
from rrrgen.emit.targets.interface import UnitCode
from rrrgen.ik.classify import plan as make_plan
from rrrgen.ik.plan import SolverPlan
from rrrgen.program import Program
from rrrgen.robot.file.fields import EMIT
from rrrgen.robot.identity import Identity, identify
from rrrgen.robot.model.drives import stated_at_joints
from rrrgen.robot.spec import RobotSpec

FURTHER = (
    *("control", "controller", "elastic", "gravity", "hessian"),
    *("observer", "points", "tensors", "timing", "trajectory"),
)
"""Words of :data:`rrrgen.robot.file.fields.EMIT` that name C code, which a package can hold besides the model."""


@dataclass(frozen=True)
class Code:
    """Emitted C code of a robot: ``files`` are headers and sources, ``programs`` the functions in them by name.

    ``identity`` is the hash of the robot with the version of rrrgen, ``dialect`` the way in which C is written,
    ``plan`` the solver of the inverse kinematics. ``declared`` are functions written from templates, in files
    ``<name>_<function>.h`` and ``.c`` of their own; ``further`` are the words of :data:`rrrgen.robot.file.fields.EMIT`
    that the code holds besides the model, ``unit`` is the controller if it is one of them.
    """

    model: DerivedModel
    identity: Identity
    dialect: Dialect
    files: Files
    programs: dict[str, Program]
    plan: SolverPlan
    declared: tuple[Declaration, ...] = ()
    further: tuple[str, ...] = ()
    unit: UnitCode | None = None

    @property
    def sources(self) -> list[str]:
        """Names of the C files to compile."""
        return sorted(name for name in self.files if name.endswith(".c"))

    @property
    def headers(self) -> list[str]:
        """Names of the headers."""
        return sorted(name for name in self.files if name.endswith(".h"))

    @property
    def naming(self) -> dict[str, object]:
        """Template variables common to all targets: names, sizes, functions, files and version."""
        spec = self.model.spec
        return {
            "prefix": self.dialect.prefix,
            "macro": self.dialect.macro,
            "real": self.dialect.real,
            "identity": self.identity,
            "version": self.identity.tool_version,
            "n": spec.n,
            "b": self.model.beta_size,
            "joints": spec.joints,
            "sources": self.sources,
            "headers": self.headers,
            "programs": self.programs,
            "declared": self.declared,
            "further": {word: EMIT[word] for word in self.further},
            "solver": self.plan if self.plan.solvable else None,
            "timing": further_inputs(self.programs["path_dynamics"]) if "path_dynamics" in self.programs else None,
            "fourier": f"{self.dialect.prefix}_fourier.h" in self.files,
            "unit": None if self.unit is None else self.unit.description,
            "drives": bool(self.model.drive_inertia_nominal),
        }


def emitted_code(
    spec: RobotSpec, real: Real = "double", further: Sequence[str] = (), unit: UnitCode | None = None
) -> Code:
    """Emit the C code of ``spec``, inverse kinematics included; the symbolic derivation is cached.

    ``real`` is the C number type, "double" or "float". ``further`` are words of :data:`rrrgen.robot.file.fields.EMIT`:
    groups of functions, and "gravity" for the model with gravity as an input beside it; other words change nothing. The
    files of ``unit`` stand beside those of the model.
    """
    model, identity = derived_model(spec, further)
    groups = ("model", *(group for group in GROUPS if group in further))
    dialect, c = Dialect(spec.name, real), CBackend()
    files = c.sources(model, identity, real) | solver_sources(spec, real)
    files |= files_beside(spec, real, groups)
    declared = (declaration(spec.n),) if "control" in groups else ()
    if "gravity" in further or (unit is not None and "any_gravity" in unit.description["parts"]):
        files |= c.sources(*derived_model(spec.in_any_gravity(), further), real)
    files |= {} if unit is None else {name: text for name, text in unit.files.items() if not name.endswith(".json")}
    return Code(model, identity, dialect, files, programs_of(model), make_plan(spec), declared, tuple(further), unit)


def any_gravity_code(spec: RobotSpec, real: Real = "double", further: Sequence[str] = ()) -> Code:
    """Emit the model of ``spec`` with gravity as an input, for a package that holds it beside the model itself.

    It has no inverse kinematics and none of the functions from templates, which do not feel gravity.
    """
    model, identity = derived_model(spec.in_any_gravity(), further)
    dialect = Dialect(model.spec.name, real)
    files = CBackend().sources(model, identity, real)
    unsolved = replace(make_plan(spec), family="none", reason="the model with its own gravity has the solver")
    return Code(model, identity, dialect, files, programs_of(model), unsolved)


def derived_model(spec: RobotSpec, further: Sequence[str] = ()) -> tuple[DerivedModel, Identity]:
    """The model of ``spec`` with the groups of functions among the words ``further``, from the cache if it is there."""
    return derive_once(spec, ("model", *(group for group in GROUPS if group in further))), identify(spec)


# ------------------------------------------------------------------------------------------------------------------
# Descriptions of the emitted functions for wrappers in other languages, and C loops that call them for many states.
# ------------------------------------------------------------------------------------------------------------------


class Default(NamedTuple):
    """Source of a default argument: result number ``place`` of the C function ``function``, which has no inputs.

    The function returns values of the robot file, such as base parameters; it has ``results`` results in all, and
    ``name`` is that of the one to use. Where no C function returns them, ``values`` holds the numbers of the file.
    """

    function: str
    results: int
    place: int
    name: str
    values: tuple[float, ...] = ()

    @property
    def numbers(self) -> list[str]:
        """The numbers as text; "inf" where there is no limit."""
        return [repr(value) for value in self.values]


def loops(code: Code) -> dict[str, str]:
    """Print the C source ``<name>_calls.c``: for each function a loop over states, all with the same signature."""
    values = {**code.naming, "functions": described_functions(code)}
    return {f"{code.dialect.prefix}_calls.c": render("calls/calls.c.j2", **values)}


def described_functions(code: Code) -> list[dict[str, Any]]:
    """Describe every emitted function for the templates: inputs, defaults from the robot file, texts and results."""
    functions: list[Program | Declaration] = [*code.programs.values(), *code.declared]
    return [_describe(code, function) for function in functions]


def _describe(code: Code, program: Program | Declaration) -> dict[str, Any]:
    defaults = _defaults(code, program)
    return {
        "program": program,
        "inputs": list(program.inputs),
        "defaults": defaults,
        "summary": wrap(program.summary or program.name.replace("_", " ")),
        "formula": [plain(line) for line in program.formula.splitlines()],
        "meanings": [(port.name, port_text(port)) for port in program.inputs],
        "results": [(port.name, port_text(port)) for port in program.data_outputs],
    }


def _defaults(code: Code, program: Program | Declaration) -> dict[str, Default]:
    """The defaults of the last arguments of ``program``, those that the robot file gives, by name."""
    entry = find(program.function) if isinstance(program, Program) else None
    if entry is None:
        return {}
    given = {quantity.name for quantity in entry.arguments if quantity.from_file}
    known = _known_values(code)
    last = list(takewhile(lambda port: port.name in given and port.name in known, reversed(program.inputs)))
    return {port.name: known[port.name] for port in reversed(last)}


def _known_values(code: Code) -> dict[str, Default]:
    """Values of the robot file for arguments, by name."""
    spec = code.model.spec
    limits = [joint.limits.torque for joint in spec.joints]
    numbers = {
        "friction": [float(value) for _, value in friction_parameters(spec)],
        "tau_max": [math.inf if limit is None else float(limit) for limit in limits],
    }
    for name, key, missing in (
        ("rotor_inertia", "inertia", None),
        ("stiffness", "stiffness", None),
        ("damping", "damping", 0.0),
    ):
        values, absent = stated_at_joints(spec, key, missing)
        if not absent:
            numbers[name] = [float(value) for value in values]
    constants = {name: Default("", 0, 0, name, tuple(values)) for name, values in numbers.items()}
    return constants | {default.name: default for default in nominal_values(code).values()}


def nominal_values(code: Code) -> dict[Any, Default]:
    """Map the role of each parameter with values in the robot file to the function that returns these values."""
    defaults: dict[Any, Default] = {}
    for name in ("nominal_parameters", "nominal_friction"):
        outputs = code.programs[name].data_outputs if name in code.programs else ()
        defaults |= {port.role: Default(name, len(outputs), i, port.name) for i, port in enumerate(outputs)}
    return defaults
