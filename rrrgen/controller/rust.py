"""The unit as a Rust crate: its structs by ``repr(C)`` and its functions around the C, without the standard library."""

from __future__ import annotations

from rrrgen.base.templates import render
from rrrgen.base.version import VERSION
from rrrgen.controller.files import unit_files
from rrrgen.controller.layout import structs
from rrrgen.controller.proposals import proposals
from rrrgen.controller.table import MODES, STATUS, ControllerUnit, mode_number
from rrrgen.emit import Real


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
