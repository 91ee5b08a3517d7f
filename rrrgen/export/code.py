"""Emitted C of a robot together with the data that export targets need to wrap it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from rrrgen.backends import Identity, Real
from rrrgen.backends.c.backend import Files
from rrrgen.backends.c.dialect import Dialect
from rrrgen.backends.c.solver.files import sources as solver_sources
from rrrgen.backends.c.sources import header_and_sources
from rrrgen.backends.c.trigonometry import sincos_strategy
from rrrgen.backends.description import programs_of
from rrrgen.derive.derived_model import DerivedModel
from rrrgen.ik.classify import plan as make_plan
from rrrgen.ik.plan import SolverPlan
from rrrgen.output.manifest import identify
from rrrgen.pipeline import derive
from rrrgen.program import Program
from rrrgen.robotfile.robot_spec import RobotSpec
from rrrgen.runtime.derived_cache import recall


@dataclass(frozen=True)
class Code:
    """Emitted C code of a robot: ``files`` are headers and sources, ``programs`` the functions in them by name."""

    model: DerivedModel
    identity: Identity
    dialect: Dialect
    files: Files
    programs: dict[str, Program]
    plan: SolverPlan

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
            "b": self.model.b,
            "joints": spec.joints,
            "sources": self.sources,
            "headers": self.headers,
            "programs": self.programs,
            "solver": self.plan if self.plan.solvable else None,
            "drives": len(self.model.drive_inertia_nominal or ()),
        }


def emitted_code(spec: RobotSpec, real: Real = "double") -> Code:
    """Emit the C code of ``spec``, inverse kinematics included; the symbolic derivation is cached.

    ``real`` is the C number type, "double" or "float".
    """
    identity = identify(spec)
    model = recall(spec, identity, partial(derive, groups=("model",)))
    dialect = Dialect(spec.name, real)
    files = header_and_sources(model, identity, dialect, sincos_strategy("inline"))
    return Code(model, identity, dialect, files | solver_sources(spec, real), programs_of(model), make_plan(spec))
