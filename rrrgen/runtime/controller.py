"""The controller of a model: compiles the unit in C and makes the Python class that calls it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rrrgen.controller.files import derived_unit, describe_unit, standalone_files
from rrrgen.controller.python_class import Controller
from rrrgen.controller.table import PERIOD, ControllerUnit
from rrrgen.emit import Real
from rrrgen.robot.spec import RobotSpec

__all__ = ["Controller", "compiled_controller"]


def compiled_controller(
    spec: RobotSpec,
    real: Real,
    mode: str | None,
    modes: Sequence[str] | None,
    parts: Sequence[str] | None,
    parameters: dict[str, Any],
) -> Controller:
    """Compile the unit of the robot ``spec`` ; the other arguments are those of ``Model.controller``."""
    period = parameters.get("Ts", PERIOD)
    usable = isinstance(period, (int, float)) and 0.0 < period <= 1.0  # else the check of the parameters refuses it
    unit = derived_unit(spec, modes=modes, parts=parts, period=period if usable else PERIOD)
    call, name_of = _compile_unit(unit, real)
    return Controller(call, name_of, describe_unit(unit, real), mode, **parameters)


def _compile_unit(unit: ControllerUnit, real: Real) -> tuple[Any, Any]:
    """The functions of the compiled unit: one that calls by name with addresses, and that of the field names."""
    from rrrgen.runtime.build import build_extension

    robot = unit.model.spec.name.removesuffix("_any_gravity")
    files = {name: text for name, text in standalone_files(unit, real).items() if not name.endswith(".json")}
    p = f"{robot}_controller"
    cdef = f"""
        void {p}_default(void *); int32_t {p}_check(void *); int32_t {p}_init(void *, void *, void *);
        int32_t {p}_set(void *, void *); uint32_t {p}_step(void *, void *, void *); int32_t {p}_reset(void *, void *);
        const char *{p}_field_name(int32_t, char *);
    """
    ffi, lib = build_extension(files, cdef, p)
    functions = {name: getattr(lib, f"{p}_{name}") for name in ("default", "check", "init", "set", "step", "reset")}

    def call(function: str, *addresses: int) -> int:
        return int(functions[function](*(ffi.cast("void *", address) for address in addresses)) or 0)

    def name_of(result: int) -> str:
        text = ffi.new("char[64]")
        field_name: bytes = ffi.string(getattr(lib, f"{p}_field_name")(result, text))
        return field_name.decode()

    return call, name_of
