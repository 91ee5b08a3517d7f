"""Mechanisms as trees: followers, several branches, a palletiser."""

from __future__ import annotations

from pathlib import Path

import numpy as np

PALLETISER = Path(__file__).resolve().parents[2] / "examples" / "palletiser" / "robot.yaml"
TREE = """\
schema: rrrgen/1
name: tree
convention: {convention}
units: {{angle: rad, length: m}}
gravity: [1, -2, -9.5]
base: {{translation: [0.1, 0.2, 0.3], rpy: [0.3, -0.2, 0.5]}}
joints:
  - {{name: lift, type: prismatic, alpha: 0.3, a: 0.1, theta: 0.4}}
  - {{name: swing, type: revolute, alpha: 0, a: 0.3, d: 0.1, theta: 0.2, follows: {{swing: 1, lift: 2/3}}}}
  - {{name: twin, type: revolute, alpha: 0, a: 0.25, d: 0.05, theta: -0.3, follows: {{swing: -3/2}}}}
  - {{name: hand, type: revolute, alpha: -pi/2, a: 0.1, d: 0, theta: 0}}
  - {{name: side, type: revolute, alpha: 0.7, a: -0.2, d: 0.1, parent: lift, follows: {{hand: -1, swing: 1/2}}}}
  - {{name: rack, type: prismatic, alpha: pi/2, a: 0.1, d: 0.2, theta: 0.1, parent: swing, follows: {{hand: 0.04}}}}
  - {{name: arm2, type: revolute, alpha: 0, a: 0.2, d: -0.1, theta: 0.6, parent: base, follows: {{swing: 2}}}}
tip: hand
tool: {{translation: [0.1, 0, 0.2], rpy: [0.1, 0.2, 0.3]}}
"""
X, Y, Z = np.eye(3)

PLACED_TREE = (
    TREE.format(convention="modified")
    .replace("theta: 0.2, ", "theta: 0.2, gamma: 0.9, b: 0.07, ")
    .replace("a: 0.1, theta: 0.4}", "a: 0.1, theta: 0.4, gamma: -0.4, b: 0.2}")
    .replace("parent: lift,", "parent: lift, gamma: pi/2, b: -0.3,")
    .replace("parent: swing,", "parent: swing, gamma: 1.1, b: 0.05,")
    .replace("parent: base,", "parent: base, gamma: -pi, b: 0.4,")
)
"""Turns of any size and by quarters, before revolute and prismatic rows, parallel and tilted ones, at the base."""
