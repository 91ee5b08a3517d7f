"""Optimized models of bundled robots, each derived once per process."""

from __future__ import annotations

from functools import cache

from rrrgen import pipeline
from rrrgen.derive.derived_model import DerivedModel
from rrrgen.robotfile import load_spec


@cache
def bundled(name: str) -> DerivedModel:
    """The bundled robot with all passes."""
    return pipeline.derive(load_spec(name))
