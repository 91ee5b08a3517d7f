"""Boxes of inputs: the published one of the Panda."""

from __future__ import annotations

from rrrgen.derive import derive_once
from rrrgen.evidence.boxes import Ranges, box_of
from rrrgen.evidence.rounding import rounding_bounds
from rrrgen.robot.file import load_spec


def test_panda_on_the_published_box():
    """|dq| <= 0.5, |ddq| <= 1: at most 5e-13 N m in double, 4e-4 in float, trigonometry included."""
    spec = load_spec("panda")
    program = derive_once(spec).programs["inverse_dynamics_nominal"]
    box = box_of(program, spec, None, Ranges(speed=0.5, acceleration=1.0))
    bounds = rounding_bounds(program, {name: each.bounds for name, each in box.items()})
    assert max(bounds.double[0]) <= 5e-13
    assert max(bounds.single[0]) <= 4e-4
