"""Descriptions of the emitted functions for wrappers in other languages, and C loops that call them for many states."""

from __future__ import annotations

import math
from itertools import takewhile
from typing import Any, NamedTuple

from rrrgen.base.templates import render
from rrrgen.derive.functions.friction import friction_parameters
from rrrgen.derive.functions.table import FUNCTIONS
from rrrgen.emit.comments import plain, wrapped
from rrrgen.emit.controller.differential_ik import Declaration
from rrrgen.emit.targets.code import Code
from rrrgen.program import Port, Program
from rrrgen.robot.model.drive_terms import stated_at_joints


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
    return [_described(code, function) for function in functions]


def _described(code: Code, program: Program | Declaration) -> dict[str, Any]:
    defaults = _defaults(code, program)
    return {
        "program": program,
        "inputs": list(program.inputs),
        "defaults": defaults,
        "summary": wrapped(program.summary or program.name.replace("_", " ")),
        "formula": [plain(line) for line in program.formula.splitlines()],
        "told": [(port.name, _told(port)) for port in program.inputs],
        "results": [(port.name, _told(port)) for port in program.data_outputs],
    }


def _defaults(code: Code, program: Program | Declaration) -> dict[str, Default]:
    """The defaults of the last arguments of ``program``, those that the robot file gives, by name."""
    entry = FUNCTIONS.get(program.function) if isinstance(program, Program) else None
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
    found: dict[Any, Default] = {}
    for name in ("nominal_parameters", "nominal_friction"):
        outputs = code.programs[name].data_outputs if name in code.programs else ()
        found |= {port.role: Default(name, len(outputs), i, port.name) for i, port in enumerate(outputs)}
    return found


def _told(port: Port) -> str:
    return plain(", ".join(filter(None, (port.meaning, port.unit, port.frame))))
