"""rrrgen's emitted C as contenders."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bench.contenders.cases import Case, Numbers
from bench.contenders.contender import OURS, OURS_FILE, OURS_LIBM, TITLES, Contender, Supplier
from rrrgen.emit.c.language import Dialect, sincos_strategy
from rrrgen.emit.c.robot_files import header_and_sources
from rrrgen.program import Program, Role, count_operations, specialization
from rrrgen.robot.identity import identify
from rrrgen.verify.references.numeric_robot import Array

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.emit.c.language import Trig

PLACES = {Role.POSITION: 0, Role.VELOCITY: 1, Role.ACCELERATION: 2, Role.TORQUE: 2, Role.COVECTOR: 3}
"""Offset of each input in a state, in multiples of n."""


def emitted_contenders(case: Case, derived: DerivedModel, libm: bool = True) -> Supplier:
    """Every compared function with base parameters at run time and with the file's numbers folded in.

    With the C library's sines instead of the inline kernel only inverse dynamics takes part.
    """
    group = Supplier([])
    _add(group, case, derived, OURS, "inline", "", list(TITLES))
    if libm:
        _add(group, case, derived, OURS_LIBM, "libm", "_libm", ["inverse_dynamics"])
    return group


def _add(
    group: Supplier, case: Case, derived: DerivedModel, label: str, trig: Trig, tag: str, names: list[str]
) -> None:
    name = derived.name
    prefix = f"{name}{tag}"
    files = header_and_sources(derived, identify(derived.spec), Dialect(name, "double"), sincos_strategy(trig))
    for file, text in files.items():
        renamed = text.replace(f"{name}_", f"{prefix}_").replace(f"{name}.h", f"{prefix}.h") if tag else text
        group.sources[file.replace(name, prefix, 1)] = renamed
    group.declarations += f'#include "{prefix}.h"\n' + _constants(case, derived, prefix)
    for function in names:
        for suffix, numbers in _variants(label, function, derived):
            shown = OURS_FILE if suffix else label
            program = derived.programs.get(function + suffix)  # of long chains only some functions are derived
            if program is not None:
                group.contenders.append(_contender(case, derived, prefix, shown, function, program, numbers))


def _variants(label: str, function: str, derived: DerivedModel) -> list[tuple[str, Numbers]]:
    with_nominal = label == OURS and specialization(derived.programs, function) is not None
    return [("", "dense"), ("_nominal", "file")] if with_nominal else [("", "dense")]


def _contender(
    case: Case, derived: DerivedModel, prefix: str, label: str, function: str, program: Program, numbers: Numbers
) -> Contender:
    arguments = [
        f"in + {PLACES[port.role] * case.n}" if port.role in PLACES else f"{prefix}_{port.name}_values"
        for port in program.inputs
    ]
    filled = 0
    for port in program.data_outputs:
        arguments.append(f"out + {filled}")
        filled += port.size
    call = f"{prefix}_{program.name}({', '.join(arguments)});"
    count = count_operations(program)
    operations = {key: getattr(count, key) for key in ("mul", "add", "div", "sincos")}
    statement = f"(void){call}" if program.status else call
    return Contender(label, function, filled, statement, numbers, _multiplied(case, derived, function), operations)


def _multiplied(case: Case, derived: DerivedModel, function: str) -> Array | None:
    if function == "standard_regressor":
        return case.dense.reshape(-1)
    return base_parameters(case, derived) if function in ("regressor", "regressor_transpose") else None


def base_parameters(case: Case, derived: DerivedModel) -> Array:
    """beta of the dense bodies."""
    return np.asarray(np.array(derived.base_projection, dtype=float) @ case.dense.reshape(-1))


def _constants(case: Case, derived: DerivedModel, prefix: str) -> str:
    beta = [*base_parameters(case, derived), *(0.0 for _ in derived.drive_inertia_nominal or ())]
    return f"static double {prefix}_beta_values[] = {{{', '.join(repr(float(value)) for value in beta)}}};\n"
