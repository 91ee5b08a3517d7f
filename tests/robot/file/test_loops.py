"""Closed loops in the robot file: read exactly, printed back, every fault in its place."""

from __future__ import annotations

import jsonschema
import pytest
import sympy as sp
from ruamel.yaml import YAML

from derive.loops import CYLINDER, EXAMPLES, FIVE_BAR, FOUR_BAR, SLIDER_CRANK, SLIDES, STACKED
from rrrgen.base.errors import InputError
from rrrgen.robot.file import dumps, json_schema, load_spec, loads_spec
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


@pytest.mark.parametrize("text", [FOUR_BAR, FIVE_BAR, STACKED, SLIDER_CRANK, CYLINDER, SLIDES])
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
    ("alpha: 0, a: 0.5, d: 0, parent: base}", "alpha: 0, a: 0, d: 0, parent: base}",
     "loop 'bars': no drive moves its passive links against each other", "follows: {}"),
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


SLIDE_FAULTS = [
    (SLIDER_CRANK, "rod, type: revolute, alpha: 0, a: 0.2, d: 0", "rod, type: prismatic, alpha: 90, a: 0.2, theta: 0",
     "loop 'bars': the passive rows 'rod' and 'slider' are prismatic", "one of them turns"),
    (SLIDER_CRANK, "gamma: 90, alpha: 90", "gamma: 90, alpha: 0",
     "loop 'bars': the axis of 'slider' is across",
     "slides in"),
    (SLIDER_CRANK, "gamma: 90, alpha: 90", "gamma: 0, alpha: 80",
     "loop 'bars': the axis of 'slider' is inclined",
     "or across"),
    (SLIDER_CRANK, "rod: [0.6, 0, 0]", "rod: [0, 0, 0]", "loop 'bars': a passive link has no length", "bars between"),
    (SLIDER_CRANK, "a: 0.2, d: 0}", "a: 0, d: 0}", "loop 'bars': no drive moves its passive links", "follows: {}"),
    (SLIDER_CRANK, "rod: [0.6, 0, 0], slider", "rod: [0.6, 0, 0], crank",
     "loop 'bars': 'slider' does not move",
     "pin links"),
    (SLIDER_CRANK, "theta: 0, parent: base}", "theta: 0, parent: base, limits: {upper: 1}}",
     "joint 'slider' is passive in a loop and has no limits", "drop it"),
    (SLIDER_CRANK, "theta: 0, parent: base}", "theta: 0, parent: base, follows: {crank: 0.2}}",
     "joint 'slider' is passive in a loop and has no follows", "drop it"),
    (CYLINDER, "follows: {}", "follows: {barrel: 1}",
     "its links depend on each other through the rows that follow",
     "one after"),
    (CYLINDER, "theta: -60, parent: base, follows: {}", "theta: -60, parent: base, follows: {piston: 1}",
     "the revolute joint 'bracket' cannot follow 'piston'", "prismatic rows may follow it"),
    (SLIDES, "follows: {slider: 1/2}", "follows: {rod: 1}",
     "the prismatic joint 'stage' cannot follow 'rod'", "cosine and sine"),
    (SLIDES, "follows: {slider: 1/2}", "limits: {upper: 1}, follows: {slider: 1/2}",
     "joint 'stage' has no limits", "passive"),
    (SLIDES, "slider: [0.02, 0.8, 0.1]", "slider: [0.02, 0.8, 0.1]}\n    passsive: {",
     "unknown key 'passsive'", "passive"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "old", "new", "message", "hint"), SLIDE_FAULTS)
def test_a_fault_of_a_loop_with_a_prismatic_joint_is_reported_in_its_place(text, old, new, message, hint):
    assert text.count(old) == 1
    with pytest.raises(InputError) as refused:
        loads_spec(text.replace(old, new))
    fault = next(each for each in refused.value.faults if message in each.message)
    assert hint in fault.hint
    assert fault.line > 6


@pytest.mark.parametrize("angle", [-48, -37.5, 48])
def test_the_plane_of_a_loop_has_any_angle_against_the_row_that_carries_it(angle):
    """Cosines of these angles have no short form; those of negative ones did not cancel."""
    text = FOUR_BAR.replace("joints:\n", "joints:\n  - {name: main, type: revolute, alpha: 63, a: -0.2, d: 0.1}\n", 1)
    text = text.replace("parent: base", "parent: main").replace(
        "links:\n", "links:\n  - {mass: 1, com: [0, 0, 0], inertia: {about: com, xx: 1, yy: 1, zz: 1}}\n"
    )
    for name in ("crank", "rocker"):
        text = text.replace(
            f"name: {name}, type: revolute, alpha: 0,", f"name: {name}, type: revolute, alpha: {angle},"
        )
    assert loads_spec(text).n == 2


@pytest.mark.parametrize("direction", [90, 25])
def test_a_rod_as_long_as_the_crank_on_the_axis_of_the_slider_is_refused(direction):
    text = SLIDER_CRANK.replace("a: 0.05", "a: 0").replace("gamma: 90", f"gamma: {direction}")
    with pytest.raises(InputError, match="as long as the crank"):
        loads_spec(text.replace("rod: [0.6, 0, 0]", "rod: [0.12, -0.16, 0]"))
    loads_spec(text.replace("rod: [0.6, 0, 0]", "rod: [0.12, -0.160001, 0]"))


def test_places_of_pins_and_a_slide_are_read_in_the_units_of_the_file():
    spec = load_spec(EXAMPLES / "press" / "robot.yaml")
    assert spec.loops[0].pins[0] == (1, (sp.Rational(7, 25), 0, 0))
    assert spec.mechanism.rows[2].a == sp.Rational(1, 100)


def test_rows_follow_passive_joints_by_whole_multiples():
    with pytest.raises(InputError, match="the factor of second in follows of joint 'leaf' is no integer"):
        loads_spec(STACKED.replace("{second: 2,", "{second: 0.5,"))
    with pytest.raises(InputError, match="joint 'leaf' has no limits"):
        loads_spec(STACKED.replace("parent: second, follows", "parent: second, limits: {upper: 1}, follows"))


def test_loops_on_a_floating_base_are_refused():
    body = "floating_base: {name: trunk, mass: 3, com: [0, 0, 0], inertia: {about: com, xx: 1, yy: 1, zz: 1}}\n"
    with pytest.raises(InputError, match="a robot with a floating base has no loops"):
        loads_spec(FOUR_BAR.replace("joints:\n", f"{body}joints:\n"))
