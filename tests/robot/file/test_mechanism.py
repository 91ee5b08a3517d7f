"""Joints that follow others and branches in the robot file: read exactly, printed back, every fault in its place."""

from __future__ import annotations

import jsonschema
import pytest
import sympy as sp
from ruamel.yaml import YAML

from rrrgen.base.errors import InputError
from rrrgen.robot.file import dumps, json_schema, loads_spec
from rrrgen.robot.file.reader import with_tool
from rrrgen.robot.identity import identify

TEXT = """\
schema: rrrgen/1
name: linkage
convention: standard
units: {angle: deg, length: m}
gravity: [0, 0, -9.81]
joints:
  - {name: column, type: revolute, alpha: -90, a: 0, d: 0.5}
  - {name: arm, type: revolute, alpha: 0, a: 0.4, d: 0, limits: {lower: -90, upper: 90}}
  - {name: crank, type: revolute, alpha: 0, a: -0.1, d: 0, parent: column, drive: {inertia: 0.2}}
  - {name: rod, type: revolute, alpha: 0, a: 0.4, d: 0, follows: {arm: 1, crank: -1}}
  - {name: forearm, type: revolute, alpha: 0, a: 0.5, d: 0, parent: arm, follows: {arm: -1, crank: 1}}
  - {name: finger, type: prismatic, alpha: 0, a: 0, theta: 0, follows: {crank: 0.02}, limits: {upper: 0.03}}
tip: forearm
"""


def test_rows_followers_and_branches_are_read_exactly():
    spec = loads_spec(TEXT)
    assert [joint.name for joint in spec.joints] == ["column", "arm", "crank"]
    assert spec.mechanism.parents == (-1, 0, 0, 2, 1, 4)
    assert spec.rows[spec.tip_row].name == "forearm"
    twentieth = sp.Rational(1, 50)
    assert spec.mechanism.matrix == ((1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 1, -1), (0, -1, 1), (0, 0, twentieth))
    assert spec.joints[2].limits.upper == pytest.approx(1.5)  # the finger's, over its factor


def test_a_mechanism_is_printed_back_and_fits_the_schema():
    spec = loads_spec(TEXT)
    assert loads_spec(dumps(spec)) == spec
    jsonschema.validate(YAML(typ="safe").load(TEXT), json_schema())
    jsonschema.validate(YAML(typ="safe").load(dumps(spec)), json_schema())
    assert identify(spec).model_hash != identify(loads_spec(TEXT.replace("arm: 1,", "arm: 2,"))).model_hash


def test_a_joint_that_names_itself_has_a_drive_of_its_own():
    spec = loads_spec(
        TEXT.replace("parent: arm, follows: {arm: -1, crank: 1}", "parent: arm, follows: {forearm: 1, arm: -1}")
    )
    assert [joint.name for joint in spec.joints] == ["column", "arm", "crank", "forearm"]
    assert spec.mechanism.matrix[4] == (0, -1, 0, 1)
    assert loads_spec(dumps(spec)) == spec


def test_a_row_that_follows_none_is_fixed():
    spec = loads_spec(TEXT.replace("follows: {crank: 0.02}, limits: {upper: 0.03}", "follows: {}"))
    assert spec.mechanism.matrix[5] == (0, 0, 0)
    assert loads_spec(dumps(spec)) == spec


def test_sign_turns_the_row_of_the_matrix():
    spec = loads_spec(
        TEXT.replace("d: 0, follows: {arm: 1, crank: -1}", "d: 0, sign: -1, follows: {arm: 1, crank: -1}")
    )
    assert spec.mechanism.matrix[3] == (0, -1, 1)
    assert loads_spec(dumps(spec)).mechanism == spec.mechanism


@pytest.mark.parametrize(
    ("old", "new", "message", "hint"),
    [
        ("parent: arm,", "parent: amr,", "11:69: error: parent of joint 5 is 'amr'", "did you mean 'arm'?"),
        ("parent: column", "parent: rod", "parent of joint 3 is 'rod'", "allowed are base, column, arm"),
        ("{arm: 1, crank: -1}", "{arm: 1, cranck: -1}", "follows 'cranck', which is no joint", "'crank'"),
        ("{crank: 0.02}", "{rod: 0.02}", "joint 'finger' follows 'rod', which follows others itself", "allowed are"),
        ("{crank: 0.02}", "{}", "joint 'finger' is fixed and has no limits", "it follows no joint"),
        ("{arm: 1, crank: -1}", "{arm: sqrt(2)}", "follows of joint 'rod' is irrational", "decimal"),
        ("{arm: 1, crank: -1}", "{arm: 1 m}", "m measures a length", ""),
        ("{upper: 0.03}", "{velocity: 0.03}", "joint 'finger': velocity belongs to the joint", "lower"),
        ("theta: 0, follows", "theta: 0, friction: {viscous: 1}, follows", "has no friction", "state it at crank"),
        ("tip: forearm\n", "", "end at rod, finger: the file needs the key 'tip'", "tip: finger"),
        ("tip: forearm", "tip: forarm", "tip is 'forarm'", "did you mean 'forearm'?"),
    ],
)  # fmt: skip
def test_faults_are_told_in_their_place(old, new, message, hint):
    assert old in TEXT
    text = TEXT.replace(old, new, 1)
    with pytest.raises(InputError) as raised:
        loads_spec(text)
    told = str(raised.value)
    assert message in told
    assert hint in told


def test_joints_that_the_rows_do_not_tell_apart_are_refused():
    text = TEXT.replace("a: 0.4, d: 0, limits", "a: 0.4, d: 0, follows: {arm: 1, crank: 1}, limits")
    text = text.replace("parent: column,", "parent: column, follows: {crank: 1, arm: 1},")
    for old, new in (("{arm: 1, crank: -1}", "{arm: 2, crank: 2}"), ("{arm: -1, crank: 1}", "{arm: 1, crank: 1}")):
        text = text.replace(old, new)
    with pytest.raises(InputError, match="do not follow from those of the joints"):
        loads_spec(text.replace("{crank: 0.02}", "{arm: 1, crank: 1}"))


PLACED = TEXT.replace("standard", "modified").replace("a: -0.1, d: 0,", "a: -0.1, d: 0, gamma: 30, b: 0.2,")


def test_gamma_and_b_place_modified_rows_on_their_carrier():
    spec = loads_spec(PLACED)
    assert (spec.rows[2].gamma, spec.rows[2].b) == (sp.pi / 6, sp.Rational(1, 5))
    assert loads_spec(dumps(spec)) == spec
    jsonschema.validate(YAML(typ="safe").load(dumps(spec)), json_schema())
    assert identify(spec) != identify(loads_spec(PLACED.replace("gamma: 30", "gamma: 31")))
    zero = PLACED.replace("gamma: 30, b: 0.2", "gamma: 0, b: 0")
    assert identify(loads_spec(zero)) == identify(loads_spec(TEXT.replace("standard", "modified")))


def test_gamma_and_b_are_refused_in_standard_rows():
    with pytest.raises(InputError) as caught:
        loads_spec(PLACED.replace("modified", "standard"))
    faults = [(fault.line, fault.message) for fault in caught.value.faults]
    assert faults == [
        (9, "gamma of joint 3: standard rows have no gamma and b"),
        (9, "b of joint 3: standard rows have no gamma and b"),
    ]
    assert "negated, which undoes its twist" in caught.value.faults[0].hint


TIPS = TEXT.replace(
    "tip: forearm\n",
    """\
tip: forearm
tools: {pen: {translation: [0, 0, 0.1]}}
tips:
  jaw: {row: finger, tool: {translation: [0, 0.1, 0.2], rpy: [0, 90, 0]}}
  bare: {row: rod}
""",
)


def test_named_tips_take_the_place_of_the_tip():
    spec = loads_spec(TIPS)
    jaw = with_tool(spec, "jaw")
    assert (jaw.name, jaw.rows[jaw.tip_row].name, jaw.tool) == ("linkage_jaw", "finger", spec.tips["jaw"].tool)
    assert with_tool(spec, "bare").tip_row == 3
    assert with_tool(spec, "pen").tip_row == spec.tip_row
    assert loads_spec(dumps(spec)) == spec
    jsonschema.validate(YAML(typ="safe").load(TIPS), json_schema())
    assert identify(spec) != identify(loads_spec(TEXT))  # every tip has functions of its own
    assert identify(with_tool(spec, "bare")) == identify(with_tool(loads_spec(TIPS.replace("  jaw", "  jow")), "bare"))
    with pytest.raises(InputError, match="no tool or tip 'jaws'") as raised:
        with_tool(spec, "jaws")
    assert "did you mean 'jaw'?" in str(raised.value)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("row: finger", "row: fingr", "row of tip jaw is 'fingr'"),
        ("jaw: {", "pen: {", "'pen' names a tool too"),
        ("bare: {row: rod}", "bare: {}", "tip bare"),
        ("jaw: {", "int: {", "tip name 'int' is a keyword"),
        ("jaw: {", "forward: {", "tip name 'forward' makes names of functions that exist already"),
        ("jaw: {", "floating: {", "tip name 'floating' makes names of functions that exist already"),
        ("jaw: {", "left_floating: {", "tip name 'left_floating' makes names of functions that exist already"),
        ("jaw: {", f"{'j' * 35}: {{", r"the robot name 'linkage_j+\.\.\.' is too long"),
    ],
)
def test_faults_of_tips_have_their_place(old, new, message):
    with pytest.raises(InputError, match=message):
        loads_spec(TIPS.replace(old, new))


def test_tips_of_a_chain_need_the_key_tip():
    text = TIPS.partition("joints:")[0] + "joints:\n  - {name: finger, type: revolute, alpha: 0, a: 1, d: 0}\n"
    with pytest.raises(InputError, match="tips need the key 'tip'"):
        loads_spec(text + "tips: {jaw: {row: finger}}\n")
