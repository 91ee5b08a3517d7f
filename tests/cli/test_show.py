"""``show`` prints the whole robot as understood, with both usual units, as text and as JSON."""

from __future__ import annotations

import json
import math

import pytest
from click.testing import CliRunner

from cli.stated import line
from rrrgen.cli.main import cli


def test_what_is_not_stated_is_said(show):
    text = show("rrr", "--no-closed-forms")
    assert line(text, "not stated")[1:] == ["base, tool, friction"]


def test_json_states_every_value_by_unit(robot, show):
    data = json.loads(show(robot, "--no-closed-forms", "--json"))
    assert data["units"] == {"angle": "deg", "length": "mm"}
    assert data["base"]["translation"] == {"m": [0, 0, 0.1], "mm": [0, 0, 100]}
    assert data["base"]["rpy"]["deg"] == pytest.approx([0, 0, 90])
    assert data["tool"]["rpy"]["deg"] == pytest.approx([0, 90, 0])
    assert data["tool"]["matrix"][0] == pytest.approx([0, 0, 1, 0], abs=1e-15)
    assert data["limits"]["swing"]["velocity"] == pytest.approx({"rad/s": math.pi, "deg/s": 180})
    assert data["limits"]["lift"]["upper"] == {"m": 0.5, "mm": 500}
    assert data["limits"]["lift"]["acceleration"] is None
    assert data["friction"]["swing"] == {"law": "linear", "viscous": {"N m s/rad": 0.1}, "coulomb": {"N m": 0.5}}
    assert data["friction"]["lift"]["stribeck_speed"] == {"m/s": 0.1}
    assert data["joint_drives"]["swing"]["gear_ratio"] == {"one": 50}
    assert data["links"][0]["com"] == {"m": [0, -0.1, 0], "mm": [0, -100, 0]}
    assert data["links"][1]["inertia"]["about"] == "origin"
    assert data["links"][0]["inertia"]["xy"] == {"kg m^2": 0.001}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["-f", "inverse_kinematics", "--entry", "9,9"], "inverse_kinematics has no closed form with entries"),
        (["-f", "inverse_kinematics", "--program", "--recorded"], "inverse_kinematics has one program"),
        (["--latex", "--no-closed-forms"], "--latex prints closed forms"),
    ],
)
def test_options_without_an_effect_are_refused(options, message):
    done = CliRunner().invoke(cli, ["show", "rrr", *options])
    assert done.exit_code == 2
    assert message in " ".join(done.output.split())
