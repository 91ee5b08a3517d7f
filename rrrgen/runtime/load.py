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
    options: copies, and other groups of functions. Raises ValueError for unknown options, BuildError if the C compiler
    is missing.
    """
    if backend not in ("c", "numpy"):
        raise ValueError(f"backend must be 'c' or 'numpy', not {backend!r}")
    if real not in ("double", "float"):
        raise ValueError(f"real must be 'double' or 'float', not {real!r}")
    if backend == "numpy" and real != "double":
        raise ValueError("the NumPy backend computes in double only")
    engine: Engine = NumpyEngine(derived.programs) if backend == "numpy" else _compile_engine(derived, identity, real)
    if derived.spec.newton:
        from rrrgen.runtime.loop_positions import FollowedLoops, LoopEngine

        engine = LoopEngine(engine, derived.programs, cache(partial(FollowedLoops, derived.spec)))
    return Model(derived, engine, closed_form, compiled)


def _compile_engine(derived: DerivedModel, identity: Identity, real: Real) -> CompiledEngine:
    from _cffi_backend import FFI

    from rrrgen.emit.c.compilers import find_compiler, include_directory
    from rrrgen.emit.c.language import Dialect, InlineSinCos
    from rrrgen.emit.c.robot_files import header_and_sources, source_parts
    from rrrgen.emit.description import programs_of

    find_compiler(), include_directory()  # what is missing is told here, and not by the first call
    dialect = Dialect(derived.spec.name, real)
    programs = {name: program for name, program in programs_of(derived).items() if program.inputs}
    parts = source_parts(programs.values())

    @cache
    def code() -> dict[str, str]:
        return header_and_sources(derived, identity, dialect, InlineSinCos())

    def build_functions(names: Sequence[str]) -> dict[str, Any]:
        chosen = {part: within for part, within in parts.items() if not set(names).isdisjoint(within)}
        files = (f"{dialect.prefix}.h", *(f"{dialect.prefix}{part}.c" for part in chosen))
        together = {name: programs[name] for within in chosen.values() for name in within}
        return _functions(together, {file: code()[file] for file in files}, dialect)

    def build_loops(names: Sequence[str]) -> dict[str, Any]:
        return _loops({name: programs[name] for name in names}, code, dialect)

    scalar = np.dtype(np.float64 if real == "double" else np.float32)
    return CompiledEngine(programs, FFI().from_buffer, build_functions, build_loops, scalar)


def _functions(programs: Mapping[str, Program], sources: Mapping[str, str], dialect: Dialect) -> dict[str, Any]:
    """Compile the C ``sources`` of ``programs``; returns the C functions by program name."""
    from rrrgen.emit.c.batches import declarations
    from rrrgen.emit.c.compilers import NATIVE
    from rrrgen.emit.c.header_comments import function_name
    from rrrgen.runtime.build import build_extension

    _, lib = build_extension(sources, declarations(programs.values(), dialect), dialect.prefix, NATIVE)
    return {name: getattr(lib, function_name(program, dialect)) for name, program in programs.items()}


def _loops(programs: Mapping[str, Program], code: Callable[[], Mapping[str, str]], dialect: Dialect) -> dict[str, Any]:
    """Compile the loops over states of ``programs`` as a separate extension; returns them by program name.

    Only loops without vector types need the ``code`` of the robot, whose functions they call.
    """
    from rrrgen.emit.c.batches import loop_declarations, loop_files, loop_name
    from rrrgen.emit.c.compilers import CONTRACT, NATIVE, find_compiler
    from rrrgen.runtime.build import build_extension

    simd = not find_compiler().microsoft
    sources = {**({} if simd else code()), **loop_files(programs.values(), dialect, simd)}
    declared = loop_declarations(programs.values(), dialect)
    _, lib = build_extension(sources, declared, f"{dialect.prefix}-batches", (*NATIVE, *CONTRACT))
    return {name: getattr(lib, loop_name(program, dialect)) for name, program in programs.items()}


def compile(robot: Robot, backend: EngineName = "c", real: Real = "double") -> Model:
    """A callable model of a robot: derive, emit, build and load it.

    Derivations and built libraries are cached by content, so that the second call for a robot is fast. A function is
    built when it is first called or bound, once for one state and once for batches; ``model.engine.prepare()`` builds
    all. Derivatives of the dynamics, and functions that are emitted on request only, are then derived too.

    Args:
        robot: path of a robot file, name of a bundled robot such as "rrr", or a RobotSpec.
        backend: "c" compiles the emitted C code; "numpy" evaluates the same functions without a compiler, slowly.
        real: the floating-point type of the C code, "double" or "float".

    Raises:
        InputError: the robot file is faulty; the error lists every fault.
        BuildError: the C compiler is missing. If it fails, the first call of a function says so.

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
