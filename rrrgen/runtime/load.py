"""Turns a derived model into a callable one: emits the C code, builds it and loads it."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.base.errors import RobotFileWarning
from rrrgen.base.parallel import without_collection
from rrrgen.derive import closed_form, derive_once
from rrrgen.emit import Real
from rrrgen.robot.file import read
from rrrgen.robot.identity import Identity, identify
from rrrgen.runtime.engines import CompiledEngine, Engine, EngineName, NumpyEngine
from rrrgen.runtime.model import Model

if TYPE_CHECKING:
    from rrrgen.derive.closed_forms import ClosedForm
    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.derive.functions.table import Part
    from rrrgen.emit.c.language import Dialect
    from rrrgen.program import Program
    from rrrgen.robot.file import Robot
    from rrrgen.robot.spec import RobotSpec


def load_model(
    derived: DerivedModel,
    identity: Identity,
    backend: EngineName = "c",
    real: Real = "double",
    closed_form: Callable[[str], ClosedForm] | None = None,
    compiled: Callable[..., Model] | None = None,
) -> Model:
    """Build a callable model from the ``derived`` model of a robot; ``identity`` names it in the cache.

    ``backend`` is "c", or "numpy", which needs no compiler; ``real`` is the floating-point type of the C code.
    ``closed_form`` returns the closed form of a function by name; ``compiled`` compiles other models with the same
    options: copies, and other groups of functions. Raises ValueError for unknown options, BuildError if the C code
    cannot be built.
    """
    if backend not in ("c", "numpy"):
        raise ValueError(f"backend must be 'c' or 'numpy', not {backend!r}")
    if real not in ("double", "float"):
        raise ValueError(f"real must be 'double' or 'float', not {real!r}")
    if backend == "numpy" and real != "double":
        raise ValueError("the NumPy backend computes in double only")
    engine: Engine = NumpyEngine(derived.programs) if backend == "numpy" else _compiled(derived, identity, real)
    if derived.spec.newton:
        from rrrgen.runtime.loop_positions import FollowedLoops, LoopEngine

        engine = LoopEngine(engine, derived.programs, cache(partial(FollowedLoops, derived.spec)))
    return Model(derived, engine, closed_form, compiled)


def _compiled(derived: DerivedModel, identity: Identity, real: Real) -> CompiledEngine:
    from rrrgen.emit.c.language import Dialect, InlineSinCos
    from rrrgen.emit.c.robot_files import DERIVATIVES, NOMINAL, header_and_sources, source_parts
    from rrrgen.emit.description import programs_of

    dialect = Dialect(derived.spec.name, real)
    programs = {name: program for name, program in programs_of(derived).items() if program.inputs}
    code = header_and_sources(derived, identity, dialect, InlineSinCos())
    parts = source_parts(programs.values())
    first = [part for part in ("", NOMINAL) if parts.get(part)] or [DERIVATIVES]
    later = {name: part for part, names in parts.items() if part not in first for name in names}

    def built(*wanted: str) -> tuple[Any, dict[str, Any]]:
        """Compile the source files of the parts ``wanted``."""
        files = {f"{dialect.prefix}{part}.c" for part in wanted}
        sources = {name: text for name, text in code.items() if name.endswith(".h") or name in files}
        return _functions({name: programs[name] for part in wanted for name in parts.get(part, ())}, sources, dialect)

    def build_later(name: str) -> dict[str, Any]:
        return built(later[name])[1]

    ffi, functions = built(*first)

    def build_loops(names: Sequence[str]) -> dict[str, Any]:
        return _loops({name: programs[name] for name in names}, code, dialect)

    scalar = np.dtype(np.float64 if real == "double" else np.float32)
    return CompiledEngine(programs, ffi, functions, build_later, build_loops, scalar)


def _functions(
    programs: Mapping[str, Program], sources: Mapping[str, str], dialect: Dialect
) -> tuple[Any, dict[str, Any]]:
    """Compile the C ``sources`` of ``programs``; returns cffi's interface and the C functions by program name."""
    from rrrgen.emit.c.batches import declarations
    from rrrgen.emit.c.compilers import NATIVE
    from rrrgen.emit.c.header_comments import function_name
    from rrrgen.runtime.build import build_extension

    ffi, lib = build_extension(sources, declarations(programs.values(), dialect), dialect.prefix, NATIVE)
    return ffi, {name: getattr(lib, function_name(program, dialect)) for name, program in programs.items()}


def _loops(programs: Mapping[str, Program], code: Mapping[str, str], dialect: Dialect) -> dict[str, Any]:
    """Compile the loops over states of ``programs`` as a separate extension; returns them by program name."""
    from rrrgen.emit.c.batches import loop_declarations, loop_files, loop_name
    from rrrgen.emit.c.compilers import CONTRACT, NATIVE, find_compiler
    from rrrgen.runtime.build import build_extension

    simd = not find_compiler().microsoft
    sources = {name: text for name, text in code.items() if name.endswith(".h") or not simd}
    sources |= loop_files(programs.values(), dialect, simd)
    declared = loop_declarations(programs.values(), dialect)
    _, lib = build_extension(sources, declared, f"{dialect.prefix}-batches", (*NATIVE, *CONTRACT))
    return {name: getattr(lib, loop_name(program, dialect)) for name, program in programs.items()}


def compile(robot: Robot, backend: EngineName = "c", real: Real = "double") -> Model:
    """A callable model of a robot: derive, emit, build and load it.

    Derivations and built libraries are cached by content, so that the second call for a robot is fast. Derivatives of
    the dynamics, and functions that are emitted on request only, are derived and built when they are first called.

    Args:
        robot: path of a robot file, name of a bundled robot such as "rrr", or a RobotSpec.
        backend: "c" compiles the emitted C code; "numpy" evaluates the same functions without a compiler, slowly.
        real: the floating-point type of the C code, "double" or "float".

    Raises:
        InputError: the robot file is faulty; the error lists every fault.
        BuildError: the C compiler is missing or fails.

    Warns:
        RobotFileWarning: the robot file is doubtful; one warning for a file lists all of them. A RobotSpec has them as
            ``faults``.
    """
    spec = read(robot)
    if spec is not robot and spec.faults:
        warnings.warn(RobotFileWarning(spec.faults), stacklevel=2)
    return _compile(spec, backend, real)


@without_collection()
def _compile(
    spec: RobotSpec, backend: EngineName, real: Real, groups: Sequence[str] = ("model",), part: Part = "at once"
) -> Model:
    """Make a callable model with a ``part`` of the functions of ``groups``; others are compiled when first called."""
    identity = identify(spec)
    derived = derive_once(spec, groups, part)
    again = partial(_compile, backend=backend, real=real)
    return load_model(derived, identity, backend, real, lambda name: closed_form(spec, name), again)
