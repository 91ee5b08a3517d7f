"""Derivation is remembered, and a damaged memory only costs time."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pytest
import sympy as sp

import rrrgen
from emit.planar import planar_model
from rrrgen.base.cache import cache_directory, keep
from rrrgen.derive import derive, derive_model, derive_once, derived_model
from rrrgen.derive.derived_model import dumps, loads
from rrrgen.derive.functions.table import functions_for
from rrrgen.robot.file import load_spec
from rrrgen.robot.identity import identify
from rrrgen.robot.model.exact_transforms import cosine_sine


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("RRRGEN_CACHE", str(tmp_path))
    cache_directory.cache_clear()
    yield tmp_path
    cache_directory.cache_clear()


@pytest.fixture
def calls(monkeypatch):
    """The parts of a model that were derived, each from an empty cache by the planar model."""
    derived = []

    def derive(spec, jobs, groups, tell, part):
        derived.append(part)
        return dataclasses.replace(planar_model(), spec=spec)

    monkeypatch.setattr("rrrgen.derive.derive", derive)
    return derived


def test_a_robot_is_derived_once(cache, calls, monkeypatch):
    spec = planar_model().spec
    first = derive_once(spec, part="at once")
    described = dataclasses.replace(spec, description="other words for the same robot")
    second = derive_once(described, part="at once")
    assert len(calls) == 1
    assert first.programs == second.programs == planar_model().programs
    assert second.spec.description == described.description
    (file,) = cache.glob("*.derived")
    file.write_bytes(file.read_bytes()[:-100])
    assert derive_once(spec, part="at once").programs == first.programs
    assert len(calls) == 2
    monkeypatch.setattr(derived_model, "compiler_hash", lambda: "another version of the compiler")
    derive_once(spec, part="at once")
    assert len(calls) == 3


def test_the_choice_of_a_solver_derives_nothing_again(cache, calls):
    for ik in ("general", "nominal_first"):
        assert derive_once(dataclasses.replace(planar_model().spec, ik=ik)).spec.ik == ik
    assert calls == ["all"]


def test_parts_of_what_was_derived_in_one_go_are_known(cache, calls):
    spec = planar_model().spec
    derive_once(spec)
    for part in ("at once", "on demand", "all"):
        derive_once(spec, part=part)
    assert calls == ["all"]
    late = derived_model.recall(spec, identify(spec), ("model", "on demand"))
    assert late is not None
    assert not late.programs


def test_what_stands_in_the_cache_is_never_run(cache, calls):
    """A pickle in the place of a derived model, with a sound checksum, is no derived model."""

    class Attack:
        def __reduce__(self):
            return pytest.fail, ("code from the cache was run",)

    spec = planar_model().spec
    derive_once(spec, part="at once")
    (file,) = cache.glob("*.derived")
    keep(file.name, pickle.dumps(Attack()))
    assert derive_once(spec, part="at once").programs == planar_model().programs
    assert len(calls) == 2


@pytest.mark.parametrize("robot", ["rrr", "scara", "puma560"])
def test_all_that_is_kept_of_a_robot_is_read_back_equal(robot):
    recorded = derive_model(load_spec(robot))
    programs = {name: ways[0] for name, ways in recorded.alternatives.items()}
    model = recorded.make_derived_model(programs, ())
    kept = {field.name: getattr(model, field.name) for field in dataclasses.fields(model) if field.name != "spec"}
    back = loads(dumps(kept))
    assert back == kept
    assert [p.labels for p in back["programs"].values()] == [p.labels for p in programs.values()]
    assert [type(p.expression) for p in back["base_parameters"]] == [
        type(p.expression) for p in kept["base_parameters"]
    ]


@pytest.mark.parametrize(
    "text", ['{"a":{"open":["x"]}}', '{"a":{"expr":["Lambda",1]}}', '{"a":{"program":{}}}', "[]", '{"a":{}}']
)
def test_nothing_but_the_formats_own_records_is_made(text):
    with pytest.raises((ValueError, TypeError, LookupError, AttributeError)):
        loads(text.encode())


@pytest.mark.parametrize("degrees", [33, 36, 60, 70, sp.Rational(45, 2)])
def test_an_angle_whose_cosine_is_held_back_is_read_back_equal(degrees):
    """36 degrees would become nested roots, so that its cosine has the angle unevaluated."""
    c, s = cosine_sine(sp.pi * degrees / 180)
    entry = sp.Symbol("m1", real=True) * c + s
    again = loads(dumps({"entry": entry}))["entry"]
    assert again == entry
    assert again.has(sp.UnevaluatedExpr) == entry.has(sp.UnevaluatedExpr)


@pytest.mark.parametrize("robot", ["rrr", "scara"])
def test_the_parts_of_a_model_join_to_the_whole(robot, cache):
    """Python compiles derivatives when they are called; the parts are those of what `derive` makes in one go."""
    spec = load_spec(robot)
    early, derivatives = derive_once(spec, part="at once"), derive_once(spec, part="on demand")
    whole, both = derive(spec), derive_once(spec)
    for words, part in ((("model", "at once"), early), (("model", "on demand"), derivatives)):
        derived_model.store(whole, identify(spec), words, functions_for(spec, ("model",), words[1]))
        assert derive_once(spec, part=words[1]) == derived_model.join_models([part], functions_for(spec, ("model",)))
    assert list(both.programs) == list(whole.programs)
    assert both == whole
    late = {name for name in whole.programs if name.startswith(("inverse_dynamics_deri", "forward_dynamics_deri"))}
    assert set(derive_once(spec, part="at once").programs) == set(whole.programs) - late


@pytest.mark.parametrize("backend", ["numpy", "c"])
def test_derivatives_are_compiled_when_they_are_called(backend):
    model = rrrgen.compile("pendulum", backend=backend)
    assert "inverse_dynamics_derivatives" not in model.derived.programs
    q = [0.3]
    tau, _, _, M = model.inverse_dynamics_derivatives(q, [0.1], [0.2])
    np.testing.assert_allclose(tau, model.inverse_dynamics(q, [0.1], [0.2]), rtol=1e-14)
    np.testing.assert_allclose(M, model.mass_matrix(q), rtol=1e-14)
    assert model.bind("inverse_dynamics_derivatives").outputs
    with pytest.raises(ValueError, match=r"no function 'inverse_dynamics_derivative'; .*there are .*_derivatives"):
        model.bind("inverse_dynamics_derivative")


def test_a_robot_without_masses_has_no_derivatives_with_numbers():
    model = rrrgen.compile(dataclasses.replace(load_spec("pendulum"), links=None), backend="numpy")
    with pytest.raises(ValueError, match="no function 'inverse_dynamics_derivatives_nominal'"):
        model.bind("inverse_dynamics_derivatives_nominal")
