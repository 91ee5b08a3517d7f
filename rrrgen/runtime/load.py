"""A derived model -> a model that can be called: emitted, built, loaded."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Literal

import numpy as np

from rrrgen.backends import Identity, Real
from rrrgen.runtime.engines import CompiledEngine, Engine, NumpyEngine
from rrrgen.runtime.model import Model

if TYPE_CHECKING:
    from rrrgen.derive.closed_form import ClosedForm
    from rrrgen.derive.derived_model import DerivedModel

EngineName = Literal["c", "numpy"]


def load_model(
    derived: DerivedModel,
    identity: Identity,
    backend: EngineName = "c",
    real: Real = "double",
    closed_form: Callable[[str], ClosedForm] | None = None,
) -> Model:
    """A callable model; ``backend="numpy"`` needs no compiler. Raises BuildError where C cannot be built."""
    if backend not in ("c", "numpy"):
        raise ValueError(f"backend must be 'c' or 'numpy', not {backend!r}")
    if backend == "numpy" and real != "double":
        raise ValueError("the NumPy backend computes in double only")
    engine: Engine = NumpyEngine(derived.programs) if backend == "numpy" else _compiled(derived, identity, real)
    return Model(derived, engine, closed_form)


def _compiled(derived: DerivedModel, identity: Identity, real: Real) -> CompiledEngine:
    from rrrgen.backends.c.dialect import Dialect
    from rrrgen.backends.c.loops import declarations, loop_files, loop_name
    from rrrgen.backends.c.signature import function_name
    from rrrgen.backends.c.sources import header_and_source, programs_of
    from rrrgen.backends.c.trigonometry import InlineSinCos
    from rrrgen.runtime.build import CONTRACT, NATIVE, build_extension

    dialect = Dialect(derived.spec.name, real)
    programs = {name: program for name, program in programs_of(derived).items() if program.inputs}
    code = header_and_source(derived, identity, dialect, InlineSinCos())
    loops = loop_files(programs.values(), dialect)
    ffi, lib = build_extension(
        {**code, **loops},
        declarations(programs.values(), dialect),
        derived.spec.name,
        NATIVE,
        {file: CONTRACT for file in loops if file.endswith(".c")},
    )
    functions = {name: getattr(lib, function_name(program, dialect)) for name, program in programs.items()}
    over_states = {name: getattr(lib, loop_name(program, dialect)) for name, program in programs.items()}
    return CompiledEngine(
        programs, ffi, functions, over_states, np.dtype(np.float64 if real == "double" else np.float32)
    )
