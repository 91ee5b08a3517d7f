"""The order of the passes."""

from __future__ import annotations

from dataclasses import replace

from rrrgen.derive.derived_model import DerivedModel, PassReport
from rrrgen.optimize.folding import fold
from rrrgen.program import Program, count_operations


def optimize_model(derived: DerivedModel) -> DerivedModel:
    """Run every pass over every function, then add the nominal twins."""
    programs: dict[str, Program] = {}
    reports: list[PassReport] = []
    for name, program in derived.programs.items():
        programs[name] = program
        twin = nominal_twin(derived, program)
        if twin is not None:
            programs[twin.name] = twin
            reports.append(
                PassReport("fold parameters", twin.name, count_operations(program), count_operations(twin))
            )
    return replace(derived, programs=programs, passes=tuple(reports))


def nominal_twin(derived: DerivedModel, program: Program) -> Program | None:
    """``program`` with the file's base parameters and drive inertias folded in, where it takes any."""
    if derived.beta_nominal is None or "beta" not in {port.name for port in program.inputs}:
        return None
    known = {"beta": derived.beta_nominal}
    if derived.drive_inertia_nominal is not None:
        known["Ia"] = derived.drive_inertia_nominal
    twin = fold(program, known)
    return twin.described(
        name=f"{program.name}_nominal",
        summary=program.summary.rstrip(".") + ", with the parameters of the robot file.",
    )
