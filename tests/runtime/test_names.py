"""A function has the same arguments and results, of the same names and in the same order, in Python, C and CasADi."""

from __future__ import annotations

import inspect
import re
from functools import cache

import pytest

import rrrgen
from rrrgen.base.parallel import without_collection
from rrrgen.derive import derive_model, prepare
from rrrgen.derive.functions.table import GROUPS, TABLE, functions_for, recorders
from rrrgen.emit.c.header_comments import prototype
from rrrgen.emit.c.ik.files import emit
from rrrgen.emit.c.language import Dialect
from rrrgen.emit.casadi.derivatives import matrix_size
from rrrgen.ik.classify import plan
from rrrgen.ik.inverse_kinematics import InverseKinematics
from rrrgen.ik.results import IKBatch, IKResult
from rrrgen.program import Program
from rrrgen.robot.file import load_spec, loads_spec
from rrrgen.runtime.model import Model

PYTHON_ONLY = {"with_status"}
"""Python raises an error where C and CasADi return a status, so the status has to be asked for."""

RENAMED = {"base_parameters": "base_parameters_of"}
"""In Python ``base_parameters`` are the expressions of the parameters."""

WITH_FRICTION = """
schema: rrrgen/1
name: with_friction
convention: standard
units: {angle: deg, length: m}
gravity: [0, 0, -9.81]
joints:
  - {name: a, type: revolute, alpha: 0, a: 1, d: 0, theta: 0, drive: {inertia: 0.1},
     friction: {law: load_dependent, coulomb: 1, viscous: 1, load_ratio: 0.1}}
  - {name: b, type: prismatic, alpha: 0, a: 0, d: 0, theta: 0,
     friction: {law: lugre, sigma0: 1e5, sigma1: 300, stiction_excess: 1, coulomb: 2, viscous: 1, stribeck_speed: 0.1}}
"""


@cache
@without_collection()
def programs(name: str) -> dict[str, Program]:
    """The functions as recorded: optimization keeps their ports, and the ways to record a function have the same."""
    if name == "with_friction":
        every = derive_model(loads_spec(WITH_FRICTION), tuple(GROUPS)).alternatives
        assert all(
            {(way.inputs, way.outputs) for way in ways} == {(ways[0].inputs, ways[0].outputs)}
            for ways in every.values()
        )
        return {function: ways[0] for function, ways in every.items()}
    spec = load_spec(name)
    recorded = prepare(spec)
    return {f.name: recorders(f.name)[0](recorded.recording()) for f in functions_for(spec, GROUPS) if f.record}


def arguments(method: object) -> list[str]:
    names = list(inspect.signature(method).parameters)[1:]  # type: ignore[arg-type]
    return [name for name in names if name not in PYTHON_ONLY]


def results(method: object) -> tuple[str, ...] | None:
    """The names of a named tuple that a method returns; None for one array, which has no name."""
    kind = inspect.signature(method).return_annotation  # type: ignore[arg-type]
    return getattr(getattr(rrrgen.runtime.results, kind, None), "_fields", None)


OF_BASE = ("orientation", "twist", "twist_rate", "wrench")  # of a moving base, in methods of every robot


@pytest.mark.parametrize("name", ["rrr", "gantry", "scara", "puma560", "panda", "with_friction"])
def test_arguments_and_results(name):
    found = programs(name)
    assert len(found) >= 20
    for function, program in found.items():
        method = getattr(Model, RENAMED.get(function, function))
        inputs = [port.name for port in program.inputs]
        outputs = [port.name for port in program.outputs]
        taken = arguments(method)
        assert [argument for argument in taken if argument in inputs] == inputs, function
        assert set(taken) - set(inputs) <= {"beta", "Ia", "gravity", "tau_load", "tip", *OF_BASE}, (
            f"{function}: parameters that this robot does not have"
        )
        prototyped = re.findall(r"(\w+)(?:\[[^]]*\])?[,)]", prototype(program, Dialect(name, "double")))
        assert prototyped == [*inputs, *(port.name for port in program.data_outputs)], function
        if program.status is not None:
            assert outputs[-1] == "status", function  # as (result, status) in Python


@pytest.mark.parametrize("name", ["rrr", "gantry", "with_friction"])
def test_casadi_functions(name):
    pytest.importorskip("casadi")
    from rrrgen.emit.casadi.function import function

    for title, program in programs(name).items():
        made = function(program)
        assert made.name_in() == [port.name for port in program.inputs], title
        assert made.name_out() == [port.name for port in program.outputs], title
        assert [made.size_out(k) for k in range(made.n_out())] == [matrix_size(port) for port in program.outputs]


def test_several_results_are_named_tuples():
    overloaded = {f.name for f in TABLE if f.status} | {"inverse_dynamics_derivatives"}  # their methods return Any
    named = {f.name: f.result for f in TABLE if f.name in overloaded and f.result}
    tuples = {name: getattr(rrrgen.runtime.results, result)._fields for name, result in named.items()}
    tuples["manipulability"] = tuples["position_manipulability"] = rrrgen.runtime.results.Manipulability._fields
    assert {"computed_torque", "contact", "slotine_li"} < tuples.keys()
    for title, program in programs("puma560").items():
        names = tuple(port.name for port in program.data_outputs)
        expected = tuples.get(title, results(getattr(Model, RENAMED.get(title, title))))
        assert names == expected if len(names) > 1 or title in tuples else expected is None, title


def test_inverse_kinematics():
    casadi = pytest.importorskip("casadi")
    from rrrgen.emit.casadi.inverse_kinematics import branch_function

    model = rrrgen.compile("rrr", backend="numpy")
    assert model.casadi_function("inverse_kinematics").name_in() == branch_function(model.spec).name_in()
    for robot in ("rrr", "puma560", "iiwa14"):
        spec = load_spec(robot)
        header = emit(spec, plan(spec)).files[f"{robot}_ik.h"]
        text = re.search(rf"{robot}_inverse_kinematics\(([^;]*)\);", header)
        assert text
        declared = re.findall(r"(\w+)(?:\[[^]]*\])?[,)]", text[1] + ")")
        python = arguments(InverseKinematics.solve)
        assert [each for each in declared if each not in ("options", "out")] == [
            each for each in python if each in declared
        ]
        assert {"limits", "residual"} < set(python), "the options, which C adds up"
        made = branch_function(spec)
        assert isinstance(made, casadi.Function)
        assert [each for each in made.name_in() if each != "branch_signs"] == [
            each for each in declared if each in ("target", "redundancy")
        ]
        assert made.name_out() == ["q"]
        fields = re.search(r"typedef struct \w+_ik_solutions \{(.*?)\}", header, re.S)
        assert fields
        stored = set(re.findall(r"^\s+[\w ]+ (\w+)[\[;]", fields[1], re.M))
        assert stored - {"count", "stage"} == set(IKResult.__dataclass_fields__) - {"status", "reason"}
        batch = re.search(rf"{robot}_inverse_kinematics_batch\(([^;]*)\);", header)
        assert batch
        assert set(IKBatch.__dataclass_fields__) <= set(re.findall(r"(\w+)(?:\[[^]]*\])?[,)]", batch[1] + ")"))
