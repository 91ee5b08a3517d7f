"""A small arm with drive inertia and friction, from which the tests of packages make them."""

from __future__ import annotations

from functools import cache

from rrrgen.robot.file import loads_spec
from rrrgen.robot.spec import RobotSpec

TEXT = """\
schema: rrrgen/1
name: arm
convention: standard
units: {angle: rad, length: m}
gravity: [0, -9.81, 0]
joints:
  - {name: shoulder, type: revolute, alpha: 0, a: 0.5, d: 0, theta: 0, limits: {lower: -3, upper: 3, velocity: 6,
     torque: 60}, drive: {inertia: 0.05}, friction: {viscous: 0.4, coulomb: 0.6}}
  - {name: elbow, type: revolute, alpha: 0, a: 0.4, d: 0, theta: 0, limits: {lower: -2.5, upper: 2.5},
     drive: {inertia: 0.02}, friction: {viscous: 0.2, coulomb: 0.3}}
links:
  - {mass: 4, com: [-0.25, 0, 0], inertia: {about: com, xx: 0.0018, yy: 0.08423, zz: 0.08423}}
  - {mass: 2.5, com: [-0.2, 0, 0], inertia: {about: com, xx: 0.001125, yy: 0.0339, zz: 0.0339}}
"""

WITH_CONTROL = ("control", "observer")
"""What the packages of the tests hold besides the model; alike in all of them, so that it is derived once."""

FURTHER = ("gravity", "timing", "trajectory")
"""What the packages with wrappers in another language hold too."""


@cache
def arm() -> RobotSpec:
    return loads_spec(TEXT)
