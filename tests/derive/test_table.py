"""The table of model functions."""

from __future__ import annotations

import keyword
import subprocess
import sys

import pytest

from rrrgen.base.parallel import without_collection
from rrrgen.derive import derive_model, prepare
from rrrgen.derive.functions.model_function import ArgumentKind
from rrrgen.derive.functions.table import FUNCTIONS, GROUPS, OF_TIP, TABLE, exists, find, recorders
from rrrgen.program import Role
from rrrgen.robot.file import load_spec, loads_spec
from rrrgen.robot.spec import KEYWORDS, name_fault


def test_the_table_loads_without_heavy_libraries():
    code = "import sys, rrrgen.derive.functions.table; print({'numpy', 'sympy'} & set(sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "set()\n"


def test_names_are_unique():
    assert len(FUNCTIONS) == len(TABLE)


@pytest.mark.parametrize("function", TABLE, ids=lambda function: function.name)
def test_functions_follow_those_that_they_are_made_of(function):
    names = list(FUNCTIONS)
    assert function.record or function.combine
    assert bool(function.combine) == bool(function.of)
    assert all(names.index(source) < names.index(function.name) for source in function.of)
    assert all(map(callable, recorders(function.name))) if function.record else True


def test_no_argument_or_result_has_the_name_of_a_keyword_or_macro():
    """Of C, C++, Python or MATLAB; back ends of other languages rename what collides there."""
    matlab = {"break", "case", "classdef", "continue", "end", "function", "global", "otherwise", "parfor", "persistent"}
    macros = {"I", "EOF", "NULL", "NAN", "INFINITY", "HUGE_VAL", "BUFSIZ", "EDOM", "ERANGE", "_B", "_C", "_N", "_P"}
    robot = prepare(load_spec("scara"))
    names = {
        port.name
        for function in TABLE
        for record in recorders(function.name)[:1]
        if function.record and exists(function, robot.spec)
        for program in (record(robot.recording()),)
        for port in (*program.inputs, *program.outputs)
    }
    assert {"q", "tau", "N"} <= names
    assert not names & (KEYWORDS | set(keyword.kwlist) | matlab | macros)


ARM = """
schema: rrrgen/1
name: arm
convention: standard
units: {angle: deg, length: m}
gravity: [0, 0, -9.81]
joints:
  - {type: revolute, alpha: 90, a: 1, d: 0, theta: 0, drive: {inertia: 0.1}, friction: {law: load_dependent, coulomb: 1,
     viscous: 1, load_ratio: 0.1}}
  - {type: prismatic, alpha: 90, a: 0.2, d: 0, theta: 0, friction: {law: lugre, sigma0: 1e5, sigma1: 300,
     stiction_excess: 1, coulomb: 2, viscous: 1, stribeck_speed: 0.1}}
  - {type: revolute, alpha: 0, a: 0.3, d: 0, theta: 0}
"""


@without_collection()
def test_gravity_and_what_the_robot_file_can_give_come_last():
    """In every program, hence in every language: as the table says which arguments these are."""
    recorded = derive_model(loads_spec(ARM).in_any_gravity(), tuple(GROUPS))
    assert len(recorded.alternatives) > 45
    for name, ways in recorded.alternatives.items():
        given = {quantity.name for quantity in FUNCTIONS[name].arguments if quantity.from_file} - {"gravity"}
        for program in ways:
            ranks = [1 if p.role is Role.GRAVITY else 2 if p.name in given else 0 for p in program.inputs]
            assert ranks == sorted(ranks), f"{name}: {[p.name for p in program.inputs]}"
            assert [p.name for p in program.inputs] == [p.name for p in ways[0].inputs]


@pytest.mark.parametrize("name", ["arm", "pendulum", "gantry", "stanford"])
@without_collection()
def test_every_argument_and_result_has_a_unit(name):
    spec = loads_spec(ARM) if name == "arm" else load_spec(name)
    recorded = derive_model(spec.in_any_gravity(), tuple(GROUPS))
    programs = [ways[0] for ways in recorded.alternatives.values()]
    assert [(p.name, port.name) for p in programs for port in (*p.inputs, *p.outputs) if not port.unit] == []
    mixed = {joint.is_revolute for joint in spec.joints} == {True, False}
    assert mixed or not any("|" in port.unit for p in programs for port in (*p.inputs, *p.outputs))


@pytest.mark.parametrize("function", TABLE, ids=lambda function: function.name)
def test_arguments_have_meaning_and_unit(function):
    assert all(quantity.meaning and quantity.unit for quantity in function.arguments)
    assert len({quantity.name for quantity in function.arguments}) == len(function.arguments)


TWO_TIPS = """
schema: rrrgen/1
name: fork
convention: modified
units: {angle: deg, length: m}
gravity: [0, 0, -9.81]
joints:
  - {name: yaw, type: revolute, alpha: 30, a: 0.1, d: 0.2}
  - {name: left, type: revolute, alpha: 40, a: 0.3, d: 0.1}
  - {name: right, type: revolute, parent: yaw, gamma: 50, alpha: 60, a: 0.4, d: 0.2}
tip: left
tips: {own: {row: left}, other: {row: right, tool: {translation: [0.1, 0.2, 0.3]}}}
"""


@without_collection()
def test_functions_that_differ_between_tips_are_those_that_every_named_tip_has():
    """A function is about the tip where its program changes with the tip, and then it has a name for every tip."""
    robot = prepare(loads_spec(TWO_TIPS))
    here = {name: ways[0] for name, ways in derive_model(robot.spec, tuple(GROUPS)).alternatives.items()}
    there = {
        name: ways[0] for name, ways in derive_model(robot.spec.at_tip("other"), tuple(GROUPS)).alternatives.items()
    }
    unnamed = [name for name in here if find(name).tip == "" and name in there]
    of_tip = {name for name in unnamed if here[name].nodes != there[name].nodes}
    assert of_tip == {f.name for f in OF_TIP if f.name in unnamed}
    assert len(of_tip) >= 12
    for name in of_tip:
        assert here[f"other_{name}"].nodes == there[name].nodes
        assert here[f"own_{name}"].nodes == here[name].nodes
        assert (here[f"other_{name}"].name, find(f"other_{name}").group) == (f"other_{name}", find(name).group)
        assert "tip other" in here[f"other_{name}"].summary
        assert "tip other" in find(f"other_{name}").summary


def test_no_allowed_name_of_a_tip_makes_the_name_of_another_function():
    others = [*FUNCTIONS, "inverse_kinematics", "inverse_kinematics_batch", "closest"]
    words = {name.removesuffix(f"_{f.name}") for f in OF_TIP for name in others if name.endswith(f"_{f.name}")}
    assert words == {"floating", "forward", "inverse", "point", "position", "tool"}
    for word in words:
        assert name_fault(word, "tip")
        assert name_fault(f"left_{word}", "tip")
    assert name_fault("any_gravity", "tip")
    for tip in ("left", "a_b", "forwards", "pose", "tip"):
        assert name_fault(tip, "tip") is None
        assert all((find(f"{tip}_{f.name}").tip, find(f"{tip}_{f.name}").takes) == (tip, f.takes) for f in OF_TIP)


def test_a_quantity_without_a_unit_is_refused():
    with pytest.raises(ValueError, match="kp has no unit"):
        ArgumentKind("kp", "n", "", "gains")
