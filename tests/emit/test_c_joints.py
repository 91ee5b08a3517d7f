"""Names, units and limits of the joints in the header and the manifest."""

from __future__ import annotations

import json
import subprocess

import pytest

from rrrgen.derive import derive
from rrrgen.emit.package import emit
from rrrgen.robot.file import loads_spec

ROBOT = """\
schema: rrrgen/1
name: mixed
convention: standard
units: {angle: deg, length: mm}
gravity: [0, 0, -9.81]
joints:
  - {name: turn_with_a_name_of_forty_letters_or_so, type: revolute, alpha: 0, a: 500, d: 0,
     theta: 0, limits: {lower: -90, upper: 45, velocity: 180, acceleration: 360, torque: 12.5 N*m}}
  - {name: slide_with_a_name_as_long_as_that_one, type: prismatic, alpha: 0, a: 0, d: 0,
     theta: 0, limits: {upper: 250, torque: 40 N}}
"""
SHOWN = ("JOINT_NAMES", "Q_UNITS", "TAU_UNITS")
NUMBERS = {
    "Q_MIN": [-1.5707963267948966, float("-inf")],
    "Q_MAX": [0.7853981633974483, 0.25],
    "DQ_MAX": [3.141592653589793, float("inf")],
    "DDQ_MAX": [6.283185307179586, float("inf")],
    "TAU_MAX": [12.5, 40.0],
}


@pytest.fixture(scope="module")
def files():
    return emit(derive(loads_spec(ROBOT)))


@pytest.mark.parametrize("compiler", [["gcc", "-std=c99"], ["clang", "-std=c99"], ["g++", "-std=c++17", "-x", "c++"]])
def test_the_macros_initialize_arrays(files, tmp_path, compiler):
    lines = ['#include "mixed.h"', "#include <math.h>", "#include <stdio.h>", "int main(void) {", "int i;"]
    for name in SHOWN:
        lines += [f"static const char *const {name}[MIXED_N] = MIXED_{name};"]
        lines += [f'for (i = 0; i < MIXED_N; i++) printf("%s\\n", {name}[i]);']
    for name in NUMBERS:
        lines += [f"static const mixed_real {name}[MIXED_N] = MIXED_{name};"]
        lines += [f'for (i = 0; i < MIXED_N; i++) printf("%.17g\\n", {name}[i]);']
    (tmp_path / "mixed.h").write_text(files["mixed.h"])
    (tmp_path / "main.c").write_text("\n".join([*lines, "return 0; }\n"]))
    strict = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror"]
    subprocess.run([*compiler, *strict, "main.c", "-o", "main"], cwd=tmp_path, check=True)
    printed = subprocess.run([tmp_path / "main"], capture_output=True, text=True, check=True).stdout.splitlines()
    assert printed[0].startswith("turn_with_a_name")
    assert printed[1].startswith("slide_with_a_name")
    assert printed[2:6] == ["rad", "m", "N m", "N"]
    assert [float(text) for text in printed[6:]] == [value for row in NUMBERS.values() for value in row]


def test_the_manifest_has_them_too(files):
    turn, slide = json.loads(files["manifest.json"])["joints"]
    assert (turn["type"], turn["unit"], turn["torque_unit"]) == ("revolute", "rad", "N m")
    assert (slide["type"], slide["unit"], slide["torque_unit"]) == ("prismatic", "m", "N")
    assert turn["limits"] == {
        "lower": pytest.approx(-1.5707963267948966),
        "upper": pytest.approx(0.7853981633974483),
        "velocity": pytest.approx(3.141592653589793),
        "acceleration": pytest.approx(6.283185307179586),
        "torque": 12.5,
    }
    assert slide["limits"] == {"lower": None, "upper": 0.25, "velocity": None, "acceleration": None, "torque": 40.0}
