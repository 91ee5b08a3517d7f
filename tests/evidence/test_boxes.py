"""Boxes of inputs: the published one of the Panda, and what is assumed where the robot file states no limit."""

from __future__ import annotations

import math

import pytest

from rrrgen.base.errors import InputError
from rrrgen.derive import derive_once
from rrrgen.evidence.boxes import ASSUMED_TORQUE, PortRange, Ranges, box_of
from rrrgen.evidence.rounding import rounding_bounds
from rrrgen.program import Builder, Port, Role
from rrrgen.robot.file import load_spec


def test_panda_on_the_published_box():
    """|dq| <= 0.5, |ddq| <= 1: at most 5e-13 N m in double, 4e-4 in float, trigonometry included."""
    spec = load_spec("panda")
    program = derive_once(spec).programs["inverse_dynamics_nominal"]
    box = box_of(program, spec, None, Ranges(speed=0.5, acceleration=1.0))
    bounds = rounding_bounds(program, {name: each.bounds for name, each in box.items()})
    assert max(bounds.double[0]) <= 5e-13
    assert max(bounds.single[0]) <= 4e-4


def test_torques_without_a_limit_have_an_assumed_range():
    """Of the Puma 560, whose file states none; those of the pendulum are its limits."""
    for name, size, source in (("puma560", ASSUMED_TORQUE, "assumed"), ("pendulum", 5.0, "limits of the robot file")):
        spec = load_spec(name)
        b = Builder()
        tau = b.input(Port("tau", (spec.n,), role=Role.TORQUE))
        program = b.program("sum", [(Port("y", (1,)), [sum(tau)])])
        assert box_of(program, spec, None, Ranges())["tau"] == PortRange((-size,) * spec.n, (size,) * spec.n, source)


@pytest.mark.parametrize("value", [math.nan, math.inf, 0.0, -1.0])
@pytest.mark.parametrize("name", ["speed", "acceleration"])
def test_ranges_of_rates_are_positive_and_finite(name, value):
    with pytest.raises(InputError, match=f"the range of the {name} must be positive and finite"):
        Ranges(**{name: value})
