"""Facts of a robot: everything that its file states, in both units, and what is not stated."""

from __future__ import annotations

import json
import math

import pytest

from cli.stated import line
from rrrgen.emit.html.robot_facts import in_units, unit_of
from rrrgen.robot.file import bundled_names, load_spec


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
            expected = None if value is None else in_units(value, unit_of(unit, joint.is_revolute))
            assert found["limits"][joint.name][key] == expected
    masses = None if spec.links is None else [float(link.mass) for link in spec.links]
    assert masses == (None if found["links"] is None else [link["mass"]["kg"] for link in found["links"]])
