"""Files that accompany the emitted C: CMake and pkg-config files to build and find it, and a README."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from rrrgen.base.templates import render
from rrrgen.emit import Real
from rrrgen.emit.c.dialect import Dialect
from rrrgen.emit.description import title
from rrrgen.program import nominal_name
from rrrgen.robot.identity import Identity

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel


def build_files(
    files: Iterable[str],
    model: DerivedModel,
    identity: Identity,
    real: Real,
    languages: Sequence[tuple[str, str]] = (),
) -> dict[str, str]:
    """Print ``CMakeLists.txt``, ``<name>.pc`` and ``README.md`` for the emitted ``files`` (paths below the output).

    ``languages`` are files or folders of other languages among them, each with a description for the README.
    """
    names = sorted(files)
    prefix = model.spec.name
    values: dict[str, Any] = {
        "prefix": prefix,
        "macro": Dialect(prefix, real).macro,
        "identity": identity,
        "version": identity.tool_version,
        "headers": [name for name in names if name.endswith((".h", ".hpp")) and "/" not in name],
        "casadi": [name for name in names if name.startswith("casadi/") and name.endswith(".c")],
        "selftests": [name for name in names if name.endswith("_selftest.c")],
        "sources": sources(names),
    }
    return {
        "CMakeLists.txt": render("c/CMakeLists.txt.j2", **values),
        f"{prefix}.pc": render("c/pkgconfig.pc.j2", **values),
        "README.md": render("c/README.md.j2", **values, **_contents(model, names, real), languages=languages),
    }


BESIDE = {
    "differential_ik": "joint speeds for a velocity of the tip, within all limits",
    "fourier": "a Fourier series whose coefficients the caller owns",
    "timing": "time-optimal timing of a path",
    "tool_ik": "inverse kinematics with the tool as an input",
}
"""Stem of files beside the model -> what is in them."""


def sources(names: Iterable[str]) -> list[str]:
    """The C files of the library among the emitted files: all but self-tests and those of CasADi."""
    own = [name for name in names if name.endswith(".c") and "/" not in name]
    return sorted(name for name in own if not name.endswith("_selftest.c"))


def _contents(model: DerivedModel, names: list[str], real: Real) -> dict[str, Any]:
    """The variables of the README's template: which parts were emitted, and which functions exist."""
    name = model.spec.name
    return {
        "title": title(model.spec),
        "real": real,
        "nominal": nominal_name("inverse_dynamics") in model.programs,
        "drives": bool(model.drive_inertia_nominal),
        "solver": f"{name}_ik.h" in names,
        "any_gravity": f"{name}_any_gravity.h" in names,
        "beside": [(stem, what) for stem, what in BESIDE.items() if f"{name}_{stem}.h" in names],
        "law": _law(model),
        "friction": "friction" in model.programs,
    }


def _law(model: DerivedModel) -> dict[str, int] | None:
    """Sizes, by argument, of the control law in the example of the README; None where the example does not fit.

    The example is computed-torque control with smooth friction. It does not fit a robot without nominal inertia, or
    one whose friction takes further arguments.
    """
    law = model.programs.get(nominal_name("computed_torque"))
    friction = model.programs.get("smooth_friction")
    if law is None or friction is None or [port.name for port in friction.inputs] != ["dq", "friction", "width"]:
        return None
    return {port.name: port.size for port in law.inputs}
