"""Descriptions of the emitted functions for wrappers in other languages, and C loops that call them for many states."""

from __future__ import annotations

from typing import Any, NamedTuple

from rrrgen.backends.comments import plain, wrapped
from rrrgen.control.differential_ik import Declaration
from rrrgen.export.code import Code
from rrrgen.program import Port, Program
from rrrgen.resources import render


class Default(NamedTuple):
    """Source of a default argument: result number ``place`` of the C function ``function``, which has no inputs.

    The function returns values of the robot file, such as base parameters; it has ``results`` results in all, and
    ``name`` is that of the one to use.
    """

    function: str
    results: int
    place: int
    name: str


def loops(code: Code) -> dict[str, str]:
    """Print the C source ``<name>_calls.c``: for each function a loop over states, all with the same signature."""
    values = {**code.naming, "functions": described_functions(code)}
    return {f"{code.dialect.prefix}_calls.c": render("calls/calls.c.j2", **values)}


def described_functions(code: Code) -> list[dict[str, Any]]:
    """Describe every emitted function for the templates: inputs, defaults from the robot file, texts and results."""
    functions: list[Program | Declaration] = [*code.programs.values(), *code.declared]
    return [_described(code, function) for function in functions]


def _described(code: Code, program: Program | Declaration) -> dict[str, Any]:
    known = nominal_values(code)
    defaults = {port.name: known[port.role] for port in program.inputs if port.role in known}
    order = sorted(program.inputs, key=lambda port: port.name in defaults)
    return {
        "program": program,
        "inputs": order,
        "defaults": defaults,
        "summary": wrapped(program.summary or program.name.replace("_", " ")),
        "formula": [plain(line) for line in program.formula.splitlines()],
        "told": [(port.name, _told(port)) for port in order],
        "results": [(port.name, _told(port)) for port in program.data_outputs],
    }


def nominal_values(code: Code) -> dict[Any, Default]:
    """Map the role of each parameter with values in the robot file to the function that returns these values."""
    found: dict[Any, Default] = {}
    for name in ("nominal_parameters", "nominal_friction"):
        outputs = code.programs[name].data_outputs if name in code.programs else ()
        found |= {port.role: Default(name, len(outputs), i, port.name) for i, port in enumerate(outputs)}
    return found


def _told(port: Port) -> str:
    return plain(", ".join(filter(None, (port.meaning, port.unit, port.frame))))
