"""Export to MATLAB and Octave: a MEX function, a package of functions that call it, and C for Simulink blocks."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from rrrgen.base.templates import render
from rrrgen.derive.functions.friction import friction_parameters
from rrrgen.emit.description import title
from rrrgen.emit.targets.c_package import (
    FURTHER,
    Code,
    any_gravity_code,
    described_functions,
    emitted_code,
    loops,
    nominal_values,
)
from rrrgen.emit.targets.interface import Contents, Exported, Exporter, ExportOptions
from rrrgen.ik.result_layout import most_rows
from rrrgen.program import Port
from rrrgen.robot.spec import RobotSpec

_WORDS = """arguments break case catch classdef continue do else elseif end end_try_catch end_unwind_protect endclassdef
endfor endfunction endif endparfor endswitch endwhile enumeration events for function global if methods otherwise parfor
persistent properties return spmd switch try until unwind_protect unwind_protect_cleanup while NaN Inf"""
_KEYWORDS = frozenset(_WORDS.split())
"""Keywords of MATLAB and Octave, and two numbers that are functions: a package of such a name cannot be called."""


def _package_name(robot: str) -> str:
    return f"{robot}_robot" if robot in _KEYWORDS else robot


def _write(spec: RobotSpec, options: ExportOptions) -> Exported:
    words = tuple(word for word in options.further if word != "gravity")
    code = replace(emitted_code(spec, further=words, unit=options.unit), further=options.further)
    files = _package(code)
    if "gravity" in options.further:
        second = _package(any_gravity_code(spec, further=words))
        files |= {f"any_gravity/{path}": text for path, text in second.items()}
    files["README.md"] = render("matlab/README.md.j2", **_values(code))
    return Exported(files)


def _package(code: Code) -> dict[str, Contents]:
    """Sources, the MEX function, the package of functions that call it, and what builds them."""
    name, values = code.dialect.prefix, _values(code)
    package = f"+{values['package']}"
    files: dict[str, Contents] = {f"src/{file}": text for file, text in (code.files | loops(code)).items()}
    files[f"src/{name}_mex.c"] = render("matlab/mex.c.j2", **values)
    for suffix in ("h", "c"):
        files[f"src/{name}_simulink.{suffix}"] = render(f"matlab/simulink.{suffix}.j2", **values)
    for function in values["functions"]:
        text = render("matlab/function.m.j2", **values, f=function)
        files[f"{package}/{function['program'].name}.m"] = text
    if code.plan.solvable:
        for function in ("inverse_kinematics", "closest"):
            text = render("matlab/solver.m.j2", **values, function=function)
            files[f"{package}/{function}.m"] = text
    special = ("time_path", "timed_path") if values["timing"] is not None else ()
    for function in (*special, *(("fourier",) if values["fourier"] else ())):
        files[f"{package}/{function}.m"] = render(f"matlab/{function}.m.j2", **values)
    if code.unit is not None:
        files[f"src/{name}_controller_mex.c"] = render("matlab/controller.c.j2", **values)
        files[f"{package}/controller.m"] = render("matlab/controller.m.j2", **values)
    files[f"build_{name}.m"] = render("matlab/build.m.j2", **values)
    files[f"{name}_blocks.m"] = render("matlab/blocks.m.j2", **values)
    return files


def _values(code: Code) -> dict[str, Any]:
    functions = described_functions(code)
    return {
        **code.naming,
        "package": _package_name(code.dialect.prefix),
        "title": title(code.model.spec),
        "functions": functions,
        "most_inputs": max(len(f["inputs"]) for f in functions),
        "most_outputs": max(len(f["program"].data_outputs) for f in functions),
        "shape": _shape,
        "block_size": _block_size,
        "rows": most_rows(code.plan) if code.plan.solvable else 0,
        "nominal": nominal_values(code),
        "friction": len(friction_parameters(code.model.spec)),
    }


def _shape(port: Port) -> str:
    """Shape of a port as a C initializer ``{matrices, rows, columns}``; a vector is one column, a scalar 1 x 1."""
    *stack, rows, columns = (1, 1, 1, *port.shape) if len(port.shape) > 1 else (1, 1, port.size, 1)
    count = 1
    for size in stack:
        count *= size
    return f"{{{count}, {rows}, {columns}}}"


def _block_size(port: Port) -> str:
    """Size of a signal in the syntax of MATLAB's ``legacy_code``, such as ``[3][1]``; empty for a scalar."""
    shape = port.shape if len(port.shape) == 2 else (port.size,)
    return "".join(f"[{size}]" for size in shape) if port.shape else ""


EXPORTER = Exporter(
    "matlab",
    "MEX for MATLAB and Octave with a package of functions; C and a legacy_code script for Simulink",
    _write,
    one_file=False,
    mechanisms=True,
    loops=True,
    further=FURTHER,
)
