"""Optimized models of bundled robots, each derived once for all processes of a run."""

from __future__ import annotations

from functools import cache

from rrrgen.derive import derive_once
from rrrgen.derive.derived_model import DerivedModel
from rrrgen.robot.file import load_spec


@cache
def bundled(name: str) -> DerivedModel:
    """The bundled robot with all passes, or what the cache kept of it (tests/runtime/test_derived_model.py)."""
    return derive_once(load_spec(name))
