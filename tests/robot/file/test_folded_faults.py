"""One mistake gives one message: what follows from it is not reported again."""

from __future__ import annotations

import pytest

from rrrgen.base.errors import Fault, InputError
from rrrgen.robot.file import loads_spec

ARM = """\
schema: rrrgen/1
name: arm
convention: standard
units: {angle: deg, length: mm}
gravity: [0, 0, -9.81]
joints:
  - {name: q1, type: revolute, alpha: 90, a: 0, d: 350, theta: 0, limits: {lower: -170, upper: 170}}
  - {name: q2, type: revolute, alpha: 0, a: 400, d: 0, theta: 30}
tool: {translation: [0, 0, 120], rpy: [0, 90, 0]}
"""
UNITS = "units: {angle: deg, length: mm}\n"


def faults(text: str) -> list[Fault]:
    with pytest.raises(InputError) as caught:
        loads_spec(text)
    return list(caught.value.faults)


def test_the_arm_itself_has_no_fault():
    assert loads_spec(ARM).n == 2


def test_missing_units_are_one_fault():
    (fault,) = faults(ARM.replace(UNITS, ""))
    assert "needs the key 'units'" in fault.message


def test_one_missing_unit_leaves_the_other_in_force():
    messages = [fault.message for fault in faults(ARM.replace("angle: deg, length: mm", "length: m"))]
    assert messages[0] == "units needs the key 'angle'"
    assert messages[1:] == ["d of joint 1 is 350 m", "a of joint 2 is 400 m", "entry 3 of translation of tool is 120 m"]


def test_swapped_units_are_one_fault_with_the_line_to_write():
    (fault,) = faults(ARM.replace("angle: deg, length: mm", "angle: mm, length: deg"))
    assert fault.message == "the units of angle and length are swapped"
    assert fault.hint == "write units: {angle: deg, length: mm}"


def test_a_unit_that_does_not_exist_is_one_fault():
    (fault,) = faults(ARM.replace("angle: deg", "angle: grad"))
    assert fault.message == "angle: 'grad' is not allowed"


def test_values_with_a_unit_are_checked_all_the_same():
    found = faults(ARM.replace(UNITS, "").replace("d: 350", "d: 350 deg"))
    assert [fault.message for fault in found] == [
        "the robot needs the key 'units'",
        "deg measures an angle; d of joint 1 is a length",
    ]


def test_a_misspelt_key_is_not_missing_too():
    (fault,) = faults(ARM.replace("alpha: 90", "Alpha: 90"))
    assert fault.message == "unknown key 'Alpha' in joint 1"
    assert fault.hint.startswith("did you mean 'alpha'?")


def test_the_value_of_a_misspelt_key_is_checked():
    found = faults(ARM.replace("alpha: 90", "Alpha: 90 mm"))
    assert [fault.message for fault in found] == [
        "unknown key 'Alpha' in joint 1",
        "mm measures a length; alpha of joint 1 is an angle",
    ]


def test_a_key_that_resembles_nothing_leaves_the_other_missing():
    found = faults(ARM.replace("alpha: 90, ", "wheel: 90, "))
    assert [fault.message for fault in found] == ["joint 1 needs the key 'alpha'", "unknown key 'wheel' in joint 1"]


@pytest.mark.parametrize(
    ("written", "advice"),
    [
        ("\N{MINUS SIGN}9.81", "'\N{MINUS SIGN}' is a typographic minus sign; write -9.81"),
        ("\N{EN DASH}9.81", "'\N{EN DASH}' is a typographic minus sign; write -9.81"),
        ("-\N{GREEK SMALL LETTER PI}", "'\N{GREEK SMALL LETTER PI}' is a Greek letter; write -pi"),
        ("-2\N{MULTIPLICATION SIGN}4", "'\N{MULTIPLICATION SIGN}' is a typographic times sign; write -2*4"),
        ("-9\N{DIVISION SIGN}2", "'\N{DIVISION SIGN}' is a typographic division sign; write -9/2"),
    ],
)
def test_typographic_signs_are_named(written, advice):
    (fault,) = faults(ARM.replace("-9.81", written))
    assert fault.hint == advice


def test_cut_source_lines_show_that_they_are_cut():
    long = ARM.replace("limits: {", "limits: {velocity: 3 rad/s, acceleration: 100 rad/s^2, torque: 20 N m, ")
    (fault,) = faults(long.replace("upper: 170}}", "uper: 170}, friction: {viscous: 0.5, coulomb: 0.4, offset: 0.1}}"))
    shown, caret = str(fault).splitlines()[1:3]
    assert shown.startswith("    ...")
    assert shown.endswith("...")
    assert len(shown) <= 124
    assert shown[caret.index("^") :].startswith("uper: 170")
    (whole,) = faults(ARM.replace("Alpha", "alpha").replace("theta: 30}", "thet: 30}"))
    assert "..." not in str(whole).splitlines()[1]
