"""Closed loops in the robot file: read exactly, printed back, every fault in its place."""

from __future__ import annotations

import jsonschema
import pytest
import sympy as sp
from ruamel.yaml import YAML

from derive.loops import FIVE_BAR, FOUR_BAR, STACKED
from rrrgen.base.errors import InputError
from rrrgen.robot.file import dumps, json_schema, loads_spec
from rrrgen.robot.identity import identify
from rrrgen.robot.model.mechanism import mechanism_data, mechanism_equations


def test_loops_are_read_exactly():
    spec = loads_spec(FOUR_BAR)
    assert [joint.name for joint in spec.joints] == ["crank"]
    (loop,) = spec.loops
    assert loop.passive == (1, 2)
    assert loop.pins == ((1, (sp.Rational(3, 5), 0, 0)), (2, (sp.Rational(2, 5), 0, 0)))
    assert loop.assembly == 1
    assert spec.mechanism.matrix == ((1, 0, 0), (0, 1, 0), (0, 0, 1))
    assert spec.mechanism.passive == (1, 2)


@pytest.mark.parametrize("text", [FOUR_BAR, FIVE_BAR, STACKED])
def test_loops_are_printed_back(text):
    spec = loads_spec(text)
    again = loads_spec(dumps(spec))
    assert again.mechanism == spec.mechanism
    assert identify(again) == identify(spec)
    jsonschema.validate(YAML(typ="safe").load(text), json_schema())


def test_a_loop_is_described_in_words_and_as_data():
    spec = loads_spec(FOUR_BAR)
    assert mechanism_equations(spec) == [
        "crank on base",
        "rod on crank without a drive",
        "rocker on base without a drive",
        "loop bars: a pin of rod and rocker moves rod and rocker, assembly +1",
    ]
    assert mechanism_data(spec)["loops"] == [
        {
            "name": "bars",
            "passive": ["rod", "rocker"],
            "pins": {"rod": ["3/5", "0", "0"], "rocker": ["2/5", "0", "0"]},
            "assembly": 1,
        }
    ]


FAULTS = [
    ("passive: [rod, rocker]", "passive: [rot, rocker]", "passive joint of loop bars is 'rot'", "did you mean 'rod'?"),
    ("passive: [rod, rocker]", "passive: [rod]", "passive of loop bars has 1 values instead of 2", ""),
    ("passive: [rod, rocker]", "passive: [rod, rod]", "joint 'rod' is passive twice", "it belongs to loop bars"),
    ("pins: {rod: [0.6, 0, 0], rocker", "pins: {rocker", "pins of loop bars names 1 links instead of 2", "or base"),
    ("rod: [0.6, 0, 0],", "rodd: [0.6, 0, 0],", "a link in pins of loop bars is 'rodd'", "did you mean 'rod'?"),
    ("assembly: +1", "assembly: left", "assembly: 'left' is not allowed", "allowed are 1, +1, -1"),
    ("assembly: +1", "assembly: +1\n    asembly: 1", "unknown key 'asembly' in loop bars", "assembly"),
    ("a: 0.2, d: 0}", "a: 0.2, d: 0, limits: {upper: 1}}", "joint 'rod' is passive in a loop and has no limits", ""),
    ("a: 0.2, d: 0}", "a: 0.2, d: 0, follows: {crank: 1}}", "joint 'rod' is passive in a loop and has no follows", ""),
    ("alpha: 0, a: 0.5", "alpha: 90, a: 0.5", "loop 'bars': the axis of 'rocker' is not across its plane", "parallel"),
    ("rocker: [0.4, 0, 0]", "rocker: [0, 0, 0]", "loop 'bars': a passive link has no length in it", "bars between"),
    ("rod: [0.6, 0, 0]", "rod: [0.5, 0, 0]", "parallelogram", "follows: {crank: 1, arm: -1}"),
    ("rocker: [0.4, 0, 0]", "crank: [0.4, 0, 0]", "'rocker' does not move one of the pinned links", "pin links"),
    ("rod, type: revolute, alpha: 0, a: 0.2, d: 0", "rod, type: prismatic, alpha: 90, a: 0.2, theta: 0",
     "loop 'bars': the passive row 'rod' is prismatic", "both passive rows are revolute"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "message", "hint"), FAULTS)
def test_a_fault_is_reported_in_its_place_with_a_hint(old, new, message, hint):
    text = FOUR_BAR.replace(old, new)
    if "parallelogram" in message:
        text = text.replace("rocker: [0.4", "rocker: [0.2")
    assert text != FOUR_BAR
    with pytest.raises(InputError) as refused:
        loads_spec(text)
    fault = next(each for each in refused.value.faults if message in each.message)
    assert hint in fault.hint
    assert fault.line > 6


def test_rows_follow_passive_joints_by_whole_multiples():
    with pytest.raises(InputError, match="the factor of second in follows of joint 'leaf' is no integer"):
        loads_spec(STACKED.replace("{second: 2,", "{second: 0.5,"))
    with pytest.raises(InputError, match="joint 'leaf' has no limits"):
        loads_spec(STACKED.replace("parent: second, follows", "parent: second, limits: {upper: 1}, follows"))


def test_loops_on_a_floating_base_are_refused():
    body = "floating_base: {name: trunk, mass: 3, com: [0, 0, 0], inertia: {about: com, xx: 1, yy: 1, zz: 1}}\n"
    with pytest.raises(InputError, match="a robot with a floating base has no loops"):
        loads_spec(FOUR_BAR.replace("joints:\n", f"{body}joints:\n"))
