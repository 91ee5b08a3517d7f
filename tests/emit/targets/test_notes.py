"""Notes about entries of a robot file that a format cannot hold: one for each kind that is stated and not kept."""

from __future__ import annotations

import pytest

from rrrgen.emit.targets.interface import unused_entries
from rrrgen.exporting import export_robot
from rrrgen.robot.file import load_spec, loads_spec

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


LINKS = "links:\n" + 2 * "  - {mass: 1, com: [0.1, 0, 0], inertia: {about: com, xx: 1, yy: 1, zz: 1}}\n"
STRIBECK = "friction: {law: stribeck, coulomb: 4, stiction_excess: 2, stribeck_speed: 0.1, viscous: 3}"


@pytest.mark.parametrize(
    ("target", "kept"),
    [("urdf", 'damping="3" friction="4"'), ("mjcf", 'damping="3" frictionloss="4"'), ("par", "FV = {3,0")],
)
def test_a_friction_law_leaves_its_viscous_and_coulomb_friction_and_is_named(target, kept):
    text = ARM.replace("friction: {viscous: 0.4, offset: 0.1}", STRIBECK) + LINKS
    exported = export_robot(loads_spec(text), target)
    assert kept in "".join(map(str, exported.files.values()))
    assert any(note.startswith("friction laws are left out, but for their viscous") for note in exported.notes)


def test_the_friction_of_motors_is_kept_or_named():
    text = ARM.replace(
        "friction: {viscous: 0.4, offset: 0.1}, drive: {inertia: 0.05, gear_ratio: 50, stiffness: 900}", ""
    )
    text = text.replace("velocity: 90, acceleration: 200},\n     ", "velocity: 90}")
    text += f"{LINKS}drives:\n  joint_from_drive: [[1, 0], [1, 1]]\n  motors:\n    - {{name: m, {STRIBECK}}}\n"
    text += "    - {name: n, friction: {offset: 0.3}}\n"
    exported = export_robot(loads_spec(text), "mjcf")
    assert 'damping="3" frictionloss="4"' in "".join(map(str, exported.files.values()))
    lost = {note.split(" are left out")[0] for note in exported.notes}
    assert {"friction laws", "constant torques of friction"} <= lost


FLOATING = """
schema: rrrgen/1
name: floating
convention: modified
units: {angle: deg, length: m}
gravity: [0, 0, -9.81]
floating_base: {name: trunk, mass: 5, com: [0, 0, 0], inertia: {about: com, xx: 1, yy: 1, zz: 1}}
joints:
  - {name: a, type: revolute, parent: base, alpha: 0, a: 0, d: 0.2}
links:
  - {mass: 1, com: [0.1, 0, 0], inertia: {about: com, xx: 1, yy: 1, zz: 1}}
"""


@pytest.mark.parametrize("target", ["urdf", "fmu"])
def test_a_base_that_is_free_no_more_is_named(target):
    notes = export_robot(loads_spec(FLOATING), target).notes
    assert any(note.startswith("the free base is") for note in notes), notes
