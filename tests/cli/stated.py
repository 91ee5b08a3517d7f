"""A robot file in which everything is stated, and what the command show prints of it."""

from __future__ import annotations

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


def line(text: str, start: str, after: str = "") -> list[str]:
    """The words of the first line that begins with ``start``, after the line that begins with ``after``."""
    lines = [each.strip() for each in text.splitlines()]
    first = next(k for k, each in enumerate(lines) if each.startswith(after))
    return next(each for each in lines[first:] if each.startswith(start)).split("  ")
