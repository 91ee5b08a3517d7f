"""Optimized models of bundled robots, each derived once for all processes of a run; the engines of their functions."""

from __future__ import annotations

from functools import cache

from rrrgen.derive import derive_once
from rrrgen.derive.derived_model import DerivedModel
from rrrgen.robot.file import load_spec
from rrrgen.runtime.engines import Engine
from rrrgen.runtime.model import Model


@cache
def bundled(name: str) -> DerivedModel:
    """The bundled robot with all passes, or what the cache kept of it (tests/runtime/test_derived_model.py)."""
    return derive_once(load_spec(name))


def engine_of(model: Model, function: str) -> Engine:
    """The engine that evaluates ``function``: that of ``model``, or of its functions on demand."""
    return next(part.engine for part in model.parts if function in part.derived.programs)
