"""What ``generate`` writes under ``casadi/``.

- ``<name>_casadi.py``: every public function, rebuilt from CasADi alone;
- ``<name>_casadi.h`` and ``<name>_casadi.c``: the functions that optimisers use, with their derivatives;
- ``<name>_casadi_<function>.casadi``: CasADi's own files (:func:`serialized`).

The first two are text of rrrgen's own and the same everywhere. A ``.casadi`` file repeats byte for byte with one
version of CasADi but starts with that version's format number, and older versions cannot read newer formats, so these
files are written for convenience and are no part of what ``--check`` compares (:func:`is_reproducible`).
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from rrrgen.backends.casadi.external import external_sources
from rrrgen.backends.casadi.function import function
from rrrgen.backends.casadi.module import rebuild_module
from rrrgen.backends.casadi.smooth import has_sign, smooth_sign
from rrrgen.program import Program

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel

FIRST_ORDER = ("jac", "fwd1", "adj1")
SECOND_ORDER = (*FIRST_ORDER, "fwd1_adj1")

DERIVATIVES: dict[str, tuple[str, ...]] = {
    "forward_kinematics": SECOND_ORDER,
    "jacobian": FIRST_ORDER,
    "mass_matrix": FIRST_ORDER,
    "coriolis": FIRST_ORDER,
    "gravity": FIRST_ORDER,
    "inverse_dynamics": SECOND_ORDER,
    "forward_dynamics": SECOND_ORDER,
    "energy": SECOND_ORDER,
    "friction": FIRST_ORDER,
    "friction_smooth": SECOND_ORDER,
}
"""Functions that the C file contains and the derivatives that come with them; a ``_nominal`` twin like its original."""


def casadi_programs(model: DerivedModel) -> dict[str, Program]:
    """Public name -> program of everything the CasADi side offers: the model's, and smooth twins where sgn occurs."""
    programs: dict[str, Program] = {}
    for name, program in model.programs.items():
        programs[name] = program
        if has_sign(program):
            programs[f"{name}_smooth"] = smooth_sign(program)
    return programs


def sources(model: DerivedModel, header: tuple[str, ...] = ()) -> dict[str, str]:
    """File name -> text of the reproducible part; ``header`` lines (hash, convention, units) are put into comments."""
    robot = model.spec.name
    programs = casadi_programs(model)
    parameters = [(p.name, str(p.expression)) for p in model.base_parameters]
    files = {
        f"{robot}_casadi.py": rebuild_module(robot, list(programs.items()), parameters, model.beta_nominal, header)
    }
    chosen = [(name, program, _derivatives_of(name)) for name, program in programs.items() if _derivatives_of(name)]
    return files | external_sources(robot, chosen, header)


def _derivatives_of(name: str) -> tuple[str, ...]:
    return DERIVATIVES.get(name.removesuffix("_nominal"), ())


def serialized(model: DerivedModel) -> dict[str, bytes]:
    """File name -> contents of one ``.casadi`` file per function, as written by ``Function.save``.

    Raises :class:`rrrgen.errors.BuildError` without CasADi.
    """
    robot = model.spec.name
    files = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, program in casadi_programs(model).items():
            path = Path(folder) / f"{robot}_casadi_{name}.casadi"
            function(program, f"{robot}_casadi_{name}").save(str(path))
            files[path.name] = path.read_bytes()
    return files


def is_reproducible(file: str) -> bool:
    """Whether ``file`` is the same whatever version of CasADi is installed."""
    return not file.endswith(".casadi")
