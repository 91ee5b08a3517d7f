"""A small valid robot file that the tests spoil in one place at a time."""

SAMPLE = """\
schema: rrrgen/1
name: elbow3
convention: standard
units: {angle: rad, length: m}
gravity: [0, 0, -9.81]
parameters: {a2: 0.200, d1: 0.560}
joints:
  - {name: q1, type: revolute, alpha: pi/2, a: 0, d: d1, theta: 0}
  - {type: prismatic, alpha: 0, a: a2, d: 0, theta: 0}
links:
  - {mass: 9.2, com: [0.004, -0.18, 0.012], inertia: {about: com, xx: 0.21, yy: 0.05, zz: 0.19, xy: 0.002}}
  - {mass: 3, com: [0, 0, 0], inertia: {about: com, xx: 0.1, yy: 0.1, zz: 0.1}}
tool: {}
"""


def spoil(old: str, new: str) -> str:
    """The sample with one occurrence of ``old`` replaced."""
    assert SAMPLE.count(old) >= 1, old
    return SAMPLE.replace(old, new, 1)
