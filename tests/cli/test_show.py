"""``show`` prints the whole robot as understood, with both usual units, as text and as JSON."""

from __future__ import annotations

import json
import math

import pytest

from rrrgen.cli.main import run
from rrrgen.emit.html.robot_facts import measured, unit_of
from rrrgen.robot.file import bundled_names, load_spec

FULL = """\
schema: rrrgen/1
name: full
convention: modified
units: {angle: deg, length: mm}
gravity: [0, 0, -9.81]
parameters: {reach: 250 mm, tilt: 30 deg, count: 3 one}
base: {translation: [0, 0, 100], rpy: [0, 0, 90]}
joints:
  - name: swing
    type: revolute
    alpha: tilt
    a: reach
    d: 12.5
    theta: 45
    limits: {lower: -170, upper: 170, velocity: 180, acceleration: 720, torque: 40}
    friction: {viscous: 0.1, coulomb: 0.5}
    drive: {inertia: 0.01, gear_ratio: 50, torque_constant: 0.2, encoder_resolution: 0.01}
  - name: lift
    type: prismatic
    alpha: 0
    a: 0
    d: 0
    theta: 0
    limits: {lower: 0, upper: 500, velocity: 1000, torque: 200}
    friction: {law: stribeck, stiction_excess: 1, coulomb: 2, viscous: 3, stribeck_speed: 0.1}
links:
  - {mass: 3, com: [0, -100, 0], inertia: {about: com, xx: 0.02, yy: 0.01, zz: 0.02, xy: 0.001}}
  - {mass: 2, com: [-200, 0, 0], inertia: {about: origin, xx: 0.003, yy: 0.12, zz: 0.12}}
tool: {translation: [0, 0, 50], rpy: [0, 90, 0]}
"""


@pytest.fixture
def robot(tmp_path):
    file = tmp_path / "full.yaml"
    file.write_text(FULL, encoding="utf-8")
    return str(file)


@pytest.fixture
def show(capsys, monkeypatch):
    """The text that the command prints on stdout."""

    def call(*words: str, columns: str = "") -> str:
        monkeypatch.setenv("COLUMNS", columns)
        code, found = run(["show", *words]), capsys.readouterr()
        assert code == 0, found.err
        return found.out

    return call


def line(text: str, start: str, after: str = "") -> list[str]:
    """The words of the first line that begins with ``start``, after the line that begins with ``after``."""
    lines = [each.strip() for each in text.splitlines()]
    first = next(k for k, each in enumerate(lines) if each.startswith(after))
    return next(each for each in lines[first:] if each.startswith(start)).split("  ")


def test_everything_that_the_file_states_is_printed(robot, show):
    text = show(robot, "--no-closed-forms")
    assert "reach = 0.25 m (250 mm), tilt = 0.523599 rad (30 deg), count = 3" in text
    swing = [cell.strip() for cell in line(text, "swing", "Denavit") if cell]
    assert swing == [
        "swing", "revolute", "tilt (0.523599 rad, 30 deg)", "reach (0.25 m, 250 mm)", "0.0125 m (12.5 mm)",
        "swing + pi/4 (0.785398 rad, 45 deg)",
    ]  # fmt: skip
    for value in ("z 0.1 m (100 mm)", "yaw 1.5708 rad (90 deg)"):
        assert value in text.partition("Base:")[2].partition("Tool:")[0]
    for value in ("z 0.05 m (50 mm)", "pitch 1.5708 rad (90 deg)"):
        assert value in text.partition("Tool:")[2].partition("Limits")[0]
    limits = text.partition("Limits of the joints")[2].partition("Friction")[0]
    for value in ("-2.96706 rad (-170 deg)", "3.14159 rad/s (180 deg/s)", "12.5664 rad/s^2 (720 deg/s^2)", "40 N m",
                  "0.5 m (500 mm)", "1 m/s (1000 mm/s)", "200 N"):  # fmt: skip
        assert value in limits
    friction = text.partition("Friction of the joints")[2].partition("Drives")[0]
    assert "viscous 0.1 N m s/rad, coulomb 0.5 N m" in friction
    assert "stribeck" in friction
    assert "stribeck_speed 0.1 m/s" in friction
    drives = text.partition("Drives, all values at the joint")[2].partition("Links")[0]
    for value in ("0.01 kg m^2", "50", "0.2 N m/A", "0.000174533 rad (0.01 deg)"):
        assert value in drives
    links = text.partition("Links in the axes")[2].partition("Pose of the tip")[0]
    for value in ("3 kg", "-0.1 m (-100 mm)", "com", "origin", "0.12"):
        assert value in links
    assert "not stated" not in text


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


def test_joints_have_both_units_in_json(robot, show):
    (swing, _) = json.loads(show(robot, "--no-closed-forms", "--json"))["joints"]
    assert swing["alpha"] == {"exact": "tilt", "nominal": pytest.approx(math.pi / 6), "rad": pytest.approx(math.pi / 6),
                              "deg": pytest.approx(30)}  # fmt: skip
    assert swing["a"]["mm"] == pytest.approx(250)


@pytest.mark.parametrize("name", bundled_names())
def test_no_stated_fact_of_a_bundled_robot_is_left_out(name):
    """Every number of limits and links that its file states stands in the JSON."""
    from rrrgen.emit.html.robot_facts import data

    spec, found = load_spec(name), data(load_spec(name))
    for joint in spec.joints:
        for key, unit in (("lower", "rad"), ("torque", "N m")):
            value = getattr(joint.limits, key)
            expected = None if value is None else measured(value, unit_of(unit, joint.is_revolute))
            assert found["limits"][joint.name][key] == expected
    masses = None if spec.links is None else [float(link.mass) for link in spec.links]
    assert masses == (None if found["links"] is None else [link["mass"]["kg"] for link in found["links"]])
