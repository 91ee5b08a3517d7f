"""Notes about entries of a robot file that a format cannot hold: one for each kind that is stated and not kept."""

from __future__ import annotations

import pytest

from rrrgen.emit.targets.interface import unused_entries
from rrrgen.robot.file import load_spec

ARM = """
schema: rrrgen/1
name: noted
convention: modified
units: {angle: deg, length: m}
gravity: [0, 0, -9.81]
joints:
  - {name: a, type: revolute, alpha: 0, a: 0, d: 0.2, theta: 0, limits: {velocity: 90, acceleration: 200},
     friction: {viscous: 0.4, offset: 0.1}, drive: {inertia: 0.05, gear_ratio: 50, stiffness: 900}}
  - {name: b, type: revolute, alpha: 90, a: 0.3, d: 0, theta: 0}
"""
STATED = {
    "acceleration": "limits of the acceleration",
    "offset": "constant torques of friction",
    "gear_ratio": "gear ratios",
    "stiffness": "stiffnesses of joints",
}


@pytest.mark.parametrize("kept", [(), ("gear_ratio",), ("acceleration", "stiffness"), tuple(STATED)], ids=str)
def test_what_is_stated_and_not_kept_is_named(kept, tmp_path):
    (tmp_path / "noted.yaml").write_text(ARM, encoding="utf-8")
    lost = [words for key, words in STATED.items() if key not in kept]
    notes = list(unused_entries(load_spec(tmp_path / "noted.yaml"), kept))
    assert notes == [f"{words} are left out: the format has no such entry" for words in lost]
