"""Emitted C of a robot together with the data that export targets need to wrap it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

from rrrgen.derive import derive
from rrrgen.derive.derived_cache import recall
from rrrgen.derive.derived_model import DerivedModel
from rrrgen.derive.functions.table import GROUPS
from rrrgen.emit import Real
from rrrgen.emit.c.backend import CBackend, Files
from rrrgen.emit.c.dialect import Dialect
from rrrgen.emit.c.ik.files import sources as solver_sources
from rrrgen.emit.c.path_timing.files import further_inputs
from rrrgen.emit.controller.differential_ik import Declaration, declaration
from rrrgen.emit.controller.template_files import files_beside
from rrrgen.emit.description import programs_of
from rrrgen.ik.classify import plan as make_plan
from rrrgen.ik.plan import SolverPlan
from rrrgen.program import Program
from rrrgen.robot.file.fields import EMIT
from rrrgen.robot.identity import Identity, identify
from rrrgen.robot.robot_spec import RobotSpec


@dataclass(frozen=True)
class Code:
    """Emitted C code of a robot: ``files`` are headers and sources, ``programs`` the functions in them by name.

    ``identity`` is the hash of the robot with the version of rrrgen, ``dialect`` the way in which C is written,
    ``plan`` the solver of the inverse kinematics. ``declared`` are functions written from templates, in files
    ``<name>_<function>.h`` and ``.c`` of their own; ``further`` are the words of :data:`rrrgen.robot.file.fields.EMIT`
    that the code holds besides the model.
    """

    model: DerivedModel
    identity: Identity
    dialect: Dialect
    files: Files
    programs: dict[str, Program]
    plan: SolverPlan
    declared: tuple[Declaration, ...] = ()
    further: tuple[str, ...] = ()

    @property
    def sources(self) -> list[str]:
        """Names of the C files to compile."""
        return sorted(name for name in self.files if name.endswith(".c"))

    @property
    def headers(self) -> list[str]:
        """Names of the headers."""
        return sorted(name for name in self.files if name.endswith(".h"))

    @property
    def naming(self) -> dict[str, object]:
        """Template variables common to all targets: names, sizes, functions, files and version."""
        spec = self.model.spec
        return {
            "prefix": self.dialect.prefix,
            "macro": self.dialect.macro,
            "real": self.dialect.real,
            "identity": self.identity,
            "version": self.identity.tool_version,
            "n": spec.n,
            "b": self.model.beta_size,
            "joints": spec.joints,
            "sources": self.sources,
            "headers": self.headers,
            "programs": self.programs,
            "declared": self.declared,
            "further": {word: EMIT[word] for word in self.further},
            "solver": self.plan if self.plan.solvable else None,
            "timing": further_inputs(self.programs["path_dynamics"]) if "path_dynamics" in self.programs else None,
            "fourier": f"{self.dialect.prefix}_fourier.h" in self.files,
            "drives": bool(self.model.drive_inertia_nominal),
        }


def emitted_code(spec: RobotSpec, real: Real = "double", further: Sequence[str] = ()) -> Code:
    """Emit the C code of ``spec``, inverse kinematics included; the symbolic derivation is cached.

    ``real`` is the C number type, "double" or "float". ``further`` are words of :data:`rrrgen.robot.file.fields.EMIT`:
    groups of functions, and "gravity" for the model with gravity as an input beside it; other words change nothing.
    """
    model, identity = derived_model(spec, further)
    groups = ("model", *(group for group in GROUPS if group in further))
    dialect, c = Dialect(spec.name, real), CBackend()
    files = c.sources(model, identity, real) | solver_sources(spec, real)
    files |= files_beside(spec, real, groups)
    declared = (declaration(spec.n),) if "control" in groups else ()
    if "gravity" in further:
        files |= c.sources(*derived_model(spec.in_any_gravity(), further), real)
    return Code(model, identity, dialect, files, programs_of(model), make_plan(spec), declared, tuple(further))


def any_gravity_code(spec: RobotSpec, real: Real = "double", further: Sequence[str] = ()) -> Code:
    """Emit the model of ``spec`` with gravity as an input, for a package that holds it beside the model itself.

    It has no inverse kinematics and none of the functions from templates, which do not feel gravity.
    """
    model, identity = derived_model(spec.in_any_gravity(), further)
    dialect = Dialect(model.spec.name, real)
    files = CBackend().sources(model, identity, real)
    unsolved = replace(make_plan(spec), family="none", reason="the model with its own gravity has the solver")
    return Code(model, identity, dialect, files, programs_of(model), unsolved)


def derived_model(spec: RobotSpec, further: Sequence[str] = ()) -> tuple[DerivedModel, Identity]:
    """The model of ``spec`` with the groups of functions among the words ``further``, from the cache if it is there."""
    groups = ("model", *(group for group in GROUPS if group in further))
    identity = identify(spec)
    return recall(spec, identity, partial(derive, groups=groups), groups), identity
