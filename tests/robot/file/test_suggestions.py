"""Advice says what was written, mended: with its sign, digits and unit. Following it removes the fault."""

from __future__ import annotations

import re

import pytest

from rrrgen.base.errors import InputError
from rrrgen.base.yamltext.suggestions import added_number, with_point
from rrrgen.robot.file import loads_spec

FILE = """\
schema: rrrgen/1
name: elbow3
convention: standard
units: {{angle: {angle}, length: {length}}}
gravity: [0, 0, -9.81]
parameters: {{a2: {reach} m, d1: 0.56 m}}
joints:
  - {{name: q1, type: revolute, alpha: {alpha}, a: {a}, d: d1, theta: {theta}}}
  - {{type: prismatic, alpha: 0, a: a2, d: 0, theta: 0}}
links:
  - {{mass: 9, com: {com}, inertia: {{about: com, xx: 0.21, yy: 0.05, zz: 0.19}}}}
  - {{mass: 3, com: [0, 0, 0], inertia: {{about: com, xx: 0.1, yy: 0.1, zz: 0.1}}}}
"""
USUAL = {"angle": "rad", "length": "m", "reach": "0.2", "alpha": "0", "a": "0", "theta": "0", "com": "[0, 0, 0]"}


def messages(**values: str) -> str:
    """Everything that the reader says about the file with these values."""
    try:
        faults = loads_spec(FILE.format(**USUAL | values)).faults
    except InputError as error:
        faults = tuple(error.faults)
    return "\n".join(str(fault) for fault in faults)


DEGREES, MILLIMETRES = {"angle": "deg"}, {"length": "mm"}

CASES: list[tuple[dict[str, str], str, str, list[str]]] = [
    # file, key, written, what is advised to write instead
    (DEGREES, "alpha", "-1.5708", ["-1.5708 rad", "-90"]),
    (DEGREES, "alpha", "1.5708", ["1.5708 rad", "90"]),
    (DEGREES, "alpha", "3.14159", ["3.14159 rad", "180"]),
    (DEGREES, "theta", "-4.7124", ["-4.7124 rad", "-270"]),
    (DEGREES, "alpha", "-pi/2", ["-90", "(-pi/2) rad"]),
    (DEGREES, "alpha", "pi/4", ["45", "(pi/4) rad"]),
    (DEGREES, "theta", "-2*pi/3", ["-120", "(-2*pi/3) rad"]),
    ({}, "alpha", "-90", ["-90 deg", "-90 rad"]),
    ({}, "alpha", "45+45", ["(45+45) deg"]),
    ({}, "a", "-425", ["-425 mm", "-425 m"]),
    ({}, "a", "400+25", ["(400+25) mm"]),
    ({}, "a", "2,5", ["2.5"]),
    ({}, "a", "-2,5", ["-2.5"]),
    ({}, "a", "-0,010", ["-0.010"]),
    ({}, "a", "0,35", ["0.35"]),
    ({}, "a", "+1,25 m", ["+1.25 m"]),
    ({}, "a", "350,5 mm", ["350.5 mm"]),
    ({}, "a", "1,5e-2", ["1.5e-2"]),
    (MILLIMETRES, "a", "1,250", ["1.250", "1250"]),
    ({}, "a", "'-0,35'", ["-0.35"]),
    ({}, "a", "'-0,35 m'", ["-0.35 m"]),
    ({}, "a", "'1.234,5 mm'", ["1234.5 mm"]),
    ({}, "a", "'1,234.5 mm'", ["1234.5 mm"]),
    ({}, "a", "'0,1 + 0,25'", ["0.1 + 0.25"]),
    ({}, "a", "2a2", ["2*a2"]),
    ({}, "a", "-3(a2)", ["-3*(a2)"]),
    ({}, "a", "a2^2/d1", ["a2**2/d1"]),
    ({}, "a", "-010 mm", ["-10 mm"]),
    ({}, "com", "[0, -0,06, 0]", ["-0.06"]),
    ({}, "com", "[0,1, 0, 0]", ["0.1"]),
    ({}, "com", "[-1,5, 0, 0,25]", ["-1.5 and 0.25"]),
    (MILLIMETRES, "com", "[0, -0.06, 0]", ["-0.06 m"]),
    (MILLIMETRES, "a", "a2 + 30", ["offset: 30 mm"]),
    (MILLIMETRES, "a", "25 - a2", ["offset: 25 mm"]),
]


@pytest.mark.parametrize(("file", "key", "written", "better"), CASES, ids=[f"{c[1]} {c[2]}" for c in CASES])
def test_advice_is_made_from_what_was_written(file, key, written, better):
    text = messages(**file, **{key: written})
    for advice in better:
        assert re.search(rf"(?<![\w.+-]){re.escape(advice)}(?![\w.]|\*\*)", text), text
    assert "e.g. 0.5" not in text


@pytest.mark.parametrize(
    ("file", "key", "written", "better"),
    [case for case in CASES if case[1] != "com" and not case[3][0].startswith("offset")],
    ids=[f"{c[1]} {c[2]}" for c in CASES if c[1] != "com" and not c[3][0].startswith("offset")],
)
def test_what_is_advised_is_accepted(file, key, written, better):
    before = messages(**file, **{key: written})
    for advice in better:
        after = messages(**file, **{key: advice})
        assert f"error: {key} of joint 1" not in after, (before, after)


def test_the_second_number_with_a_comma_is_no_duplicate_key():
    text = messages(a="0,5", theta="1,5")
    assert "duplicate" not in text
    assert "write 0.5" in text
    assert "write 1.5" in text


def test_the_warning_about_a_right_angle_speaks_the_units_of_the_file():
    assert "write -pi/2," in messages(alpha="-1.5708")
    assert "write -90 deg," in messages(angle="deg", alpha="-1.5708 rad")
    assert not messages(angle="deg", alpha="-90 deg")


def test_the_distance_from_a_right_angle_is_that_of_the_exact_decimal():
    assert "only to 2e-16 rad" in messages(alpha="-1.5707963267948968520107209")
    assert "only to 2e-17 rad" in messages(alpha="1.5707963267948966")
    assert "is 1e-12, which is 0 only to 1e-12 rad" in messages(alpha="1e-12")
    assert "write 0," in messages(angle="deg", alpha="-1e-15 rad")
    assert not messages(alpha="1e-8")


def test_a_whole_list_with_commas():
    assert "write" not in messages(com="[0, 1, 0, 0]")  # four entries, no comma inside a number
    assert "decimal comma" in messages(com="[0,1,0,0]")


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ("0,35", "0.35"), ("-0,35", "-0.35"), ("+,5", "+,5"), ("1.234,5", "1234.5"), ("1,234.5", "1234.5"),
        ("1,234,567", "1234567"), ("1.234.567,8", "1234567.8"), ("2,5*a2", "2.5*a2"), ("a2,5", "a2,5"),
        ("-1,5 mm", "-1.5 mm"), ("1,5e3", "1.5e3"),
    ],
)  # fmt: skip
def test_decimal_points(written, meant):
    assert with_point(written) == meant


@pytest.mark.parametrize(
    ("written", "number"),
    [("a2 + 30", "30"), ("30 - a2", "30"), ("a2 - 1.5e2", "1.5e2"), ("2*a2 + 7.5", "7.5"), ("a2 + 1 + 2", None)],
)
def test_the_number_that_is_added(written, number):
    assert added_number(written) == number
