"""The files of the unit, ``<name>_controller.h`` and ``.c``: a template around calls of the model functions."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

from rrrgen.base.templates import render
from rrrgen.base.version import VERSION
from rrrgen.controller.layout import COUNTERS, HEAD, FieldOffset, StructLayout, Structs, structs
from rrrgen.controller.programs import called_programs, own_programs
from rrrgen.controller.proposals import proposals
from rrrgen.controller.table import GROUPS, MODES, PARTS, PHASES, STATUS, ControllerUnit, Field, mode_number, unit_of
from rrrgen.emit import Real
from rrrgen.emit.c.function_files import function_files
from rrrgen.emit.c.language import Dialect, Trig, nonfinite_function, sincos_strategy
from rrrgen.emit.controller.differential_ik import differential_ik_files
from rrrgen.emit.interface import SelfTestCheck
from rrrgen.emit.printing import columns
from rrrgen.emit.targets.c_package import derived_model
from rrrgen.emit.targets.interface import UnitCode
from rrrgen.program import REFUSED, Program
from rrrgen.robot.identity import identify
from rrrgen.robot.spec import RobotSpec

ARGUMENTS = {
    "q": "tick->q",
    "dq": "tick->dq",
    "q_d": "input->q_d",
    "dq_d": "input->dq_d",
    "ddq_d": "input->ddq_d",
    "T_d": "input->T_d",
    "V_d": "input->V_d",
    "A_d": "input->A_d",
    "z": "tick->next.z",
    "Ts": "p->Ts",
    "beta": "beta",
    "tau_max": "p->tau_max",
    "tau": "tick->tau",
    "z_next": "z",
    "sines": "tick->sines",
    "decay": "state->decay",
}
"""Arguments of the laws -> C expressions, where they do not depend on the mode."""

OF_MODES: dict[str, dict[str, str]] = {
    "pd_gravity": {"kp": "p->pd_kp", "kd": "p->pd_kd", "ki": "p->pd_ki"},
    "feedforward": {"kp": "p->pd_kp", "kd": "p->pd_kd", "ki": "p->pd_ki"},
    "computed_torque": {"kp": "p->kp", "kd": "p->kd", "ki": "p->ki"},
    "velocity": {
        "kp": "p->kp", "kd": "p->kd", "ki": "p->ki",
        "q_d": "tick->next.q_r", "dq_d": "tick->next.dq_r", "ddq_d": "ddq_r",
    },
    "impedance": {"stiffness": "p->stiffness", "damping": "p->damping"},
    "adaptive": {
        "lam": "p->lam", "k": "p->k", "gamma": "p->gamma", "beta_min": "p->beta_min", "beta_max": "p->beta_max",
        "beta_next": "adapted",
    },
    "operational_space": {
        "kp": "p->tip_kp", "kd": "p->tip_kd", "ki": "p->tip_ki", "damping": "p->tip_damping", "p_d": "p_d",
        "tau_0": "tau_0", "tau_add": "none",
    },
}  # fmt: skip

OBSERVER = {
    "tau": "tick->next.tau_last", "p_last": "state->memory.p", "u_last": "state->memory.u",
    "r_last": "state->memory.r", "gain": "p->observer_gain", "r": "tick->next.r", "p": "tick->next.p",
    "u": "tick->next.u", "change_last": "state->memory.change", "threshold": "p->threshold",
    "change_threshold": "p->change_threshold", "ratio": "ratio", "touches": "&touches", "change": "tick->next.change",
}  # fmt: skip


def unit_files(unit: ControllerUnit, real: Real, trig: Trig = "inline") -> dict[str, str]:
    """Print ``<name>_controller.h``, ``.c`` and ``.json``, and with them ``<name>_controller_laws.h`` and ``.c`` if
    the unit calls functions that the model does not have. The functions of the model and the differential inverse
    kinematics are those of the other emitted files."""
    robot = unit.model.spec.name.removesuffix("_any_gravity")
    dialect, proposed = Dialect(f"{robot}_controller", real), proposals(unit)
    calls = _Calls(unit)
    laid = structs(unit, real, proposed)
    loops = unit.model.programs["closed_loops"].data_outputs if unit.model.spec.loops else ()
    values = {
        "P": dialect.prefix,
        "M": dialect.macro,
        "T": dialect.real_type,
        "real": real,
        "n": unit.n,
        "unit": unit,
        "has": unit.has,
        "robot": robot,
        "model_header": f"{unit.model.spec.name}.h",
        "model_number": identify(unit.model.spec).model_hash[:16],
        "structs": laid,
        "head": HEAD,
        "counters": COUNTERS,
        "modes": [(mode, mode_number(mode.name)) for mode in MODES if mode.name in unit.modes],
        "mode_mask": sum(1 << mode_number(name) for name in unit.modes),
        "status": list(STATUS.items()),
        "phases": list(PHASES.items()),
        "reference": _references(unit),
        "call": calls,
        "sines": calls.own["sines"].outputs[0].size if "sines" in calls.own else 0,
        "called_laws": set(unit.modes) - {"free", "gravity", "joint_impedance"},
        "laws_header": f"{calls.own_prefix}.h" if calls.own else "",
        "defaults": _default_table(laid.parameters, dialect),
        "literal": lambda value: _literal(value, dialect),
        "declaration": _declaration(dialect),
        "function": dialect.function,
        "nonfinite": nonfinite_function(dialect),
        "version": VERSION,
        "opening": _opening(unit, dialect, laid),
        "needs_z": unit.integrators,
        "loops": loops,
        "loop_arguments": {"q": "tick->q", **{port.name: port.name for port in loops}},
    }
    files = {f"{dialect.prefix}.{kind}": render(f"c/controller.{kind}.j2", **values) for kind in ("h", "c")}
    if calls.own:
        title = f"functions of {dialect.prefix}.c that {unit.model.spec.name}.h does not have"
        files |= function_files(calls.own_prefix, title, list(calls.own.values()), real, sincos_strategy(trig))
    description = describe_unit(unit, real, laid)
    return files | {f"{dialect.prefix}.json": json.dumps(description, indent=1, allow_nan=False) + "\n"}


def standalone_files(
    unit: ControllerUnit, real: Real, further: Sequence[Program] = (), trig: Trig = "inline"
) -> dict[str, str]:
    """The unit with all that it calls: of the model only these functions, and ``further`` ones of it."""
    name = unit.model.spec.name
    called = {program.name: program for program in (*called_programs(unit), *further)}
    of_model = [called[function] for function in called.keys() - own_programs(unit).keys()]
    files = function_files(
        name,
        f"functions of {name} for its controller",
        sorted(of_model, key=lambda p: p.name),
        real,
        sincos_strategy(trig),
    )
    if unit.has("velocity"):
        files |= differential_ik_files(name.removesuffix("_any_gravity"), unit.n, real)
    return files | unit_files(unit, real, trig)


def derived_unit(spec: RobotSpec, further: Sequence[str] = GROUPS, **chosen: Any) -> ControllerUnit:
    """The unit of a robot; ``chosen`` are arguments of :func:`rrrgen.controller.table.unit_of`.

    ``further`` are words with the groups of functions of the model that it calls. With the part "any_gravity" that is
    the model with gravity as an input.
    """
    moved = spec.in_any_gravity() if "any_gravity" in (chosen.get("parts") or ()) else spec
    return unit_of(derived_model(moved, further)[0], **chosen)


def unit_code(
    spec: RobotSpec, real: Real, further: Sequence[str] = GROUPS, chosen: Mapping[str, Any] | None = None
) -> UnitCode:
    """The code of :func:`derived_unit`, for a package that holds the robot's model."""
    unit = derived_unit(spec, further, **(chosen or {}))
    python = Path(__file__).with_name("python_class.py").read_text(encoding="utf-8")
    return UnitCode(unit_files(unit, real), describe_unit(unit, real), python)


def unit_check(unit: ControllerUnit) -> SelfTestCheck:
    """The self-test of the unit: every fault in every mode, with its status, phase and recovery."""
    robot = unit.model.spec.name.removesuffix("_any_gravity")
    followed = {name for mode in MODES if mode.name in unit.modes for name in mode.reference}
    text = render(
        "c/controller_selftest.c.j2",
        P=f"{robot}_controller",
        M=f"{robot}_controller".upper(),
        robot=robot,
        modes=[mode_number(name) for name in unit.modes],
        references=[int(bool(mode.reference)) for mode in MODES if mode.name in unit.modes],
        joint_reference="q_d" in followed,
        tip_reference="T_d" in followed,
        filtered=unit.filtered,
    )
    return SelfTestCheck("controller", f"{robot}_controller.h", text, digested=True)


def describe_unit(unit: ControllerUnit, real: Real, laid: Structs | None = None) -> dict[str, Any]:
    """Describe the unit for programs in other languages, as pure data: modes, status, phases, and structs with fields.

    An infinite number is the string "inf" or "-inf".
    """
    laid = laid or structs(unit, real, proposals(unit))
    parts = {"params": laid.parameters, "input": laid.input, "output": laid.output}
    return {
        "name": unit.model.spec.name.removesuffix("_any_gravity") + "_controller",
        "joints": unit.n,
        "real": real,
        "abi": laid.abi,
        "model": identify(unit.model.spec).model_hash[:16],
        "modes": {name: mode_number(name) for name in unit.modes},
        "parts": list(unit.parts),
        "status": dict(STATUS),
        "phases": list(PHASES),
        "state_size": laid.state_size,
        "structs": {name: _described_struct(struct) for name, struct in parts.items()},
    }


def _described_struct(struct: StructLayout) -> dict[str, Any]:
    fields = []
    for place in field_places(struct):
        field = place.field
        row: dict[str, Any] = {
            "name": field.name,
            "unit": field.unit,
            "text": field.text,
            "offset": place.offset,
            "count": field.count if field.array else None,
            "type": "real" if not field.integer else ("int32" if field.signed else "uint32"),
        }
        if struct.name == "params":
            row |= {"low": field.low, "high": field.high, "infinite": field.infinite}
            row["default"] = [_number(value) for value in field.values]
        fields.append(row)
    return {"size": struct.size, "fields": fields}


def _number(value: float) -> float | str:
    return value if math.isfinite(value) else str(value)


class _Calls:
    """Prints calls of the model functions: the arguments of a function, in its order, as C expressions."""

    def __init__(self, unit: ControllerUnit) -> None:
        self.unit, self.prefix, self.own = unit, unit.model.spec.name, own_programs(unit)
        self.own_prefix = f"{self.prefix.removesuffix('_any_gravity')}_controller_laws"

    def law(self, mode: str) -> str:
        """The call of the law of ``mode``: 0, 1 where it is damped, 2 where it refused its input."""
        name = self.unit.law(mode)
        refused = Dialect(self.own_prefix if name in self.own else self.prefix, "double").failure(REFUSED)
        call = self.function(name, {**ARGUMENTS, **OF_MODES.get(mode, {})})
        return f"{self.prefix.removesuffix('_any_gravity')}_controller_outcome((int){call}, (int){refused})"

    def observer(self, name: str) -> str:
        """The call of a function of the observer: its start, its step, or contact detection."""
        given = {**ARGUMENTS, **OBSERVER}
        if name == "contact":
            given |= {"r": "tick->next.r"}
        return self.function(name, given)

    def function(self, name: str, given: Mapping[str, str]) -> str:
        """The C call of the model function ``name``; ``given`` has the C expression of each argument, by its name."""
        program = self.own.get(name) or self.unit.model.programs[name]
        prefix = self.own_prefix if name in self.own else self.prefix
        return f"{prefix}_{name}({', '.join(self._arguments(program, given))})"

    def gravity(self, q: str, g: str) -> str:
        """The call that computes the gravity torques ``g`` at ``q``."""
        return self.function("gravity", {**ARGUMENTS, "q": q, "g": g})

    def _arguments(self, program: Program, given: Mapping[str, str]) -> list[str]:
        known = {**given}
        if self.unit.has("any_gravity"):
            known["gravity"] = "p->gravity"
        known |= {"friction": "p->friction", "width": "p->friction_width"}
        return [known[port.name] for port in (*program.inputs, *program.data_outputs)]


def _references(unit: ControllerUnit) -> list[tuple[int, list[tuple[str, int]]]]:
    """For every generated mode with a reference its number and the fields of the input that must be finite."""
    sizes = {"q_d": unit.n, "dq_d": unit.n, "ddq_d": unit.n, "T_d": 16, "V_d": 6, "A_d": 6}
    return [
        (mode_number(mode.name), [(name, sizes[name]) for name in mode.reference])
        for mode in MODES
        if mode.name in unit.modes and mode.reference
    ]


def _declaration(dialect: Dialect) -> Any:
    def declaration(field: Field) -> str:
        kind = dialect.real_type if not field.integer else ("int32_t" if field.signed else "uint32_t")
        return f"{kind} {field.name}{f'[{field.count}]' if field.array else ''};"

    return declaration


def _literal(value: float, dialect: Dialect) -> str:
    if math.isinf(value):
        return f"({dialect.real_type}){'-' if value < 0 else ''}INFINITY".replace(")-I", ")(-I") + (
            ")" if value < 0 else ""
        )
    return dialect.literal(Fraction(value))


def _default_table(params: StructLayout, dialect: Dialect) -> dict[str, Any]:
    """The rows of the field table and the array of all defaults; equal defaults of a field are stored once."""
    values: list[float] = []
    rows = []
    for place in params.places:
        field = place.field
        if field.name == "reserved":
            continue
        first = len(values)
        single = len(set(field.values)) == 1
        values += field.values[:1] if single else field.values
        rows.append(
            {
                "field": field,
                "offset": place.offset,
                "first": first,
                "step": 0 if single else 1,
                "low": _literal(field.low, dialect),
                "high": _literal(field.high, dialect),
            }
        )
    return {"rows": rows, "numbers": [_literal(value, dialect) for value in values]}


def _opening(unit: ControllerUnit, dialect: Dialect, laid: Structs) -> list[str]:
    parts = ", ".join(unit.parts) or "none"
    return [
        f"{dialect.prefix}.h: the controller of {unit.model.spec.name} as one unit",
        "",
        *columns(
            [
                ("Generated by", f"rrrgen {VERSION}. The generated code belongs to you: use it freely."),
                ("Modes", ", ".join(unit.modes)),
                ("Parts", f"{parts} (of {', '.join(PARTS)})"),
                (
                    "Bytes",
                    f"parameters {laid.parameters.size}, state {laid.state_size}, input {laid.input.size}, "
                    f"output {laid.output.size}",
                ),
                ("Precision", f"{dialect.real}; the typedef {dialect.real_type} is the only switch"),
            ],
            indent="",
        ),
    ]


def field_places(struct: StructLayout) -> list[FieldOffset]:
    """The places of the fields of a struct that a caller uses."""
    return [place for place in struct.places if place.field.name != "reserved"]


# ------------------------------------------------------------------------------------------------------------------
# The unit as a Rust crate: its structs by ``repr(C)`` and its functions around the C, without the standard library.
# ------------------------------------------------------------------------------------------------------------------


def rust_files(unit: ControllerUnit, real: Real) -> dict[str, str]:
    """Print the crate in the folder ``rust_controller``, whose build script compiles the C in the folder above it."""
    robot = unit.model.spec.name.removesuffix("_any_gravity")
    laid = structs(unit, real, proposals(unit))
    called = [unit.model.spec.name, *(name[:-2] for name in unit_files(unit, real) if name.endswith(".c"))]
    called += [f"{robot}_differential_ik"] if unit.has("velocity") else []
    values = {
        "P": f"{robot}_controller",
        "robot": robot,
        "real": real,
        "version": VERSION,
        "modes": [(mode, mode_number(mode.name)) for mode in MODES if mode.name in unit.modes],
        "status": list(STATUS.items()),
        "parts": [
            ("Parameters: take the defaults, then change what is yours.", laid.parameters),
            ("What is read in every tick. Fields that the mode does not use are not looked at.", laid.input),
            ("What is computed in every tick.", laid.output),
        ],
        "state_size": laid.state_size,
        "sources": called,
    }
    places = {"Cargo.toml": "Cargo.toml", "build.rs": "build.rs", "src/lib.rs": "lib.rs"}
    return {f"rust_controller/{path}": render(f"rust_controller/{name}.j2", **values) for path, name in places.items()}
