"""What wrappers in other languages need of the functions: texts, default arguments, and loops over states in C."""

from __future__ import annotations

from typing import Any, NamedTuple

from rrrgen.backends.comments import plain, wrapped
from rrrgen.export.code import Code
from rrrgen.program import Port, Program
from rrrgen.resources import render


class Default(NamedTuple):
    """The function without inputs that returns the numbers of the robot file, and which of its results they are."""

    function: str
    results: int
    place: int
    name: str


def loops(code: Code) -> dict[str, str]:
    """``<name>_calls.c``: for every function a loop over states, with one signature for all of them."""
    values = {**code.naming, "functions": described_functions(code)}
    return {f"{code.dialect.prefix}_calls.c": render("calls/calls.c.j2", **values)}


def described_functions(code: Code) -> list[dict[str, Any]]:
    """Every function for the templates; an input has a default where the robot file has its numbers."""
    return [_described(code, program) for program in code.programs.values()]


def _described(code: Code, program: Program) -> dict[str, Any]:
    known = _nominal(code)
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


def _nominal(code: Code) -> dict[Any, Default]:
    """Role of a parameter -> where its numbers are."""
    found: dict[Any, Default] = {}
    for name in ("nominal_parameters", "nominal_friction"):
        outputs = code.programs[name].data_outputs if name in code.programs else ()
        found |= {port.role: Default(name, len(outputs), i, port.name) for i, port in enumerate(outputs)}
    return found


def _told(port: Port) -> str:
    return plain(", ".join(filter(None, (port.meaning, port.unit, port.frame))))
