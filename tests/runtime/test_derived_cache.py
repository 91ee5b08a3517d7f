"""Derivation is remembered, and a damaged memory only costs time."""

from __future__ import annotations

import dataclasses

import pytest

from backends.c_tools import IDENTITY
from backends.planar import planar_model
from rrrgen.cache import cache_directory
from rrrgen.runtime import derived_cache


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("RRRGEN_CACHE", str(tmp_path))
    cache_directory.cache_clear()
    yield tmp_path
    cache_directory.cache_clear()


def test_a_robot_is_derived_once(cache, monkeypatch):
    model = planar_model()
    calls = []

    def derive(spec):
        calls.append(spec)
        return model

    first = derived_cache.recall(model.spec, IDENTITY, derive)
    described = dataclasses.replace(model.spec, description="other words for the same robot")
    second = derived_cache.recall(described, IDENTITY, derive)
    assert len(calls) == 1
    assert first.programs == second.programs == model.programs
    assert second.spec.description == described.description
    (file,) = cache.glob("*.derived")
    file.write_bytes(file.read_bytes()[:100])
    assert derived_cache.recall(model.spec, IDENTITY, derive).programs == model.programs
    assert len(calls) == 2
    monkeypatch.setattr(derived_cache, "_compiler_hash", lambda: "another version of the compiler")
    derived_cache.recall(model.spec, IDENTITY, derive)
    assert len(calls) == 3
