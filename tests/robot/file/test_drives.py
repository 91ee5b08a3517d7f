"""Coupled drives in the robot file: read exactly, printed back, and every fault in its place."""

from __future__ import annotations

import json
import re
from pathlib import Path

import jsonschema
import pytest
import sympy as sp
from ruamel.yaml import YAML

from rrrgen.base.errors import InputError
from rrrgen.robot.file import DrivesSpec, FrictionSpec, MotorSpec, dumps, json_schema, load_spec, loads_spec
from rrrgen.robot.identity import identify

HEAD = """schema: rrrgen/1
name: wrist
convention: standard
units: {angle: deg, length: m}
gravity: [0, 0, -9.81]
joints:
  - {name: pitch, type: revolute, alpha: 90, a: 0, d: 0, friction: {coulomb: 1}}
  - {name: roll, type: revolute, alpha: 0, a: 0.1, d: 0, drive: {inertia: 0.2}}
"""
DRIVES = """drives:
  joint_from_drive:
    - [1, 0]
    - [-1/3, 1]
  motors:
    - {name: left, gear_ratio: 45, inertia: 1.5e-4, friction: {viscous: 0.001, coulomb: 0.02, offset: -0.01}}
    - {name: right, gear_ratio: -32, inertia: 2 kg*cm^2, torque_limit: 0.4}
"""


def test_the_section_is_read_exactly():
    drives = loads_spec(HEAD + DRIVES.replace("coulomb: 0.02, ", "")).drives
    third = sp.Rational(1, 3)
    assert drives == DrivesSpec(
        ((1, 0), (-third, 1)),
        (
            MotorSpec("left", "revolute", sp.Integer(45), 1.5e-4, FrictionSpec(0.001, None, -0.01)),
            MotorSpec("right", "revolute", sp.Integer(-32), 2e-4, torque_limit=0.4),
        ),
    )
    assert drives.joint_from_motor == sp.ImmutableMatrix([[sp.Rational(1, 45), 0], [-third / 45, -sp.Rational(1, 32)]])
    assert drives.motor_from_joint == sp.ImmutableMatrix([[45, 0], [-32 * third, -32]])


def test_either_direction_may_be_stated():
    forth = loads_spec(HEAD + DRIVES.replace("coulomb: 0.02, ", ""))
    back = loads_spec(
        HEAD + DRIVES.replace("coulomb: 0.02, ", "").replace("joint_from", "drive_from").replace("joint:", "joint:")
        .replace("drive_from_drive", "drive_from_joint").replace("-1/3", "1/3")
    )  # fmt: skip
    assert back.drives == forth.drives
    assert identify(back) == identify(forth)


def test_missing_names_and_exact_constants():
    text = """parameters: {lead: 5 one}
drives:
  joint_from_drive: [[lead/(2*pi), 0], [sqrt(2)/7, 2]]
  motors: [{}, {type: prismatic, inertia: 3 kg}]
"""
    drives = loads_spec(HEAD.replace("joints:", "parameters: {lead: 5 one}\njoints:") + text.split("\n", 1)[1]).drives
    assert [motor.name for motor in drives.motors] == ["m1", "m2"]
    assert drives.joint_from_drive == ((5 / (2 * sp.pi), 0), (sp.sqrt(2) / 7, 2))
    assert drives.motors[1].inertia == 3.0


@pytest.mark.parametrize("motors", [DRIVES, DRIVES.replace("name: left, gear_ratio: 45", "type: prismatic")])
def test_what_is_written_is_what_was_read(motors):
    text = HEAD + motors.replace("coulomb: 0.02, ", "").replace("1.5e-4", "1.25").replace("2 kg*cm^2", "0.1")
    spec = loads_spec(text)
    assert loads_spec(dumps(spec)) == spec
    assert dumps(loads_spec(dumps(spec))) == dumps(spec)
    jsonschema.validate(YAML(typ="safe").load(dumps(spec)), json_schema())
    jsonschema.validate(YAML(typ="safe").load(text), json_schema())


def test_the_schema_refuses_both_directions_and_unknown_keys():
    text = HEAD + DRIVES.replace("coulomb: 0.02, ", "")
    for wrong in (text + "  drive_from_joint: [[1, 0], [0, 1]]\n", text.replace("motors:", "engines:")):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(YAML(typ="safe").load(wrong), json_schema())


FAULTS = [
    ("[1, 0]", "[1, 0, 0]", 11, "row 1 of joint_from_drive has 3 values instead of 2"),
    ("    - [-1/3, 1]\n", "", 11, "joint_from_drive has 1 row for 2 joints"),
    ("[-1/3, 1]", "[-1/3, x]", 12, "unknown name 'x'"),
    ("[-1/3, 1]", "[-1/3, 5 mm]", 12, "entry 2,2 of joint_from_drive is a plain number"),
    ("[-1/3, 1]", "[2, 0]", 11, "joint_from_drive is singular"),
    ("[-1/3, 1]", "[0.3333333333, 1e-12]", 11, "joint_from_drive is singular"),
    ("  joint_from_drive:\n    - [1, 0]\n    - [-1/3, 1]\n", "", 10, "needs one of the keys 'joint_from_drive' and"),
    ("  motors:", "  drive_from_joint: [[1, 0], [0, 1]]\n  motors:", 13, "has both 'joint_from_drive' and"),
    ("joint_from_drive:", "matrix:", 10, "unknown key 'matrix' in drives"),
    ("gear_ratio: 45", "gear: 45", 14, "unknown key 'gear' in motor 1"),
    ("gear_ratio: 45", "gear_ratio: 0", 14, "gear_ratio of motor 1 is zero"),
    ("1.5e-4", "-1.5e-4", 14, "inertia of motor 1 is -0.00015"),
    ("viscous: 0.001", "viscous: -1", 14, "viscous of motor 1 is -1"),
    ("torque_limit: 0.4", "torque_limit: 0", 15, "torque_limit of motor 2 is 0"),
    ("name: right", "name: left", 15, "the motor name 'left' is not unique"),
    ("name: right", "name: for", 15, "the motor name 'for' is a keyword"),
    ("name: right", "name: [a]", 15, "the name of motor 2 is a list"),
    ("name: right", "type: linear", 15, "type: 'linear' is not allowed"),
    ("coulomb: 0.02", "coulomb: 0.03", 14, "friction coulomb is given twice: here and at joint 'pitch'"),
]


@pytest.mark.parametrize(("old", "new", "line", "message"), FAULTS, ids=[f[3][:40] for f in FAULTS])
def test_every_fault_is_told_with_its_place(old, new, line, message):
    text = HEAD + DRIVES
    if "given twice" not in message:
        text = text.replace("coulomb: 0.02, ", "")
    assert text.count(old) == 1
    with pytest.raises(InputError) as caught:
        loads_spec(text.replace(old, new))
    faults = [str(fault) for fault in caught.value.faults]
    assert any(re.match(rf"robot.yaml:{line}:\d+: ", fault) and message in fault for fault in faults), faults


def test_inertia_and_gear_ratio_of_one_joint_are_stated_once():
    """A motor that turns with one joint alone, whatever else its drive moves."""
    text = HEAD.replace("friction: {coulomb: 1}", "drive: {inertia: 0.1, gear_ratio: 45}") + DRIVES
    with pytest.raises(InputError) as caught:
        loads_spec(text)
    told = " ".join(str(fault) for fault in caught.value.faults)
    assert "inertia is given twice: here and at joint 'pitch', with which motor 'left' turns" in told
    assert "gear_ratio is given twice" in told
    assert "right" not in told  # its inertia goes with both joints, that of joint 'roll' with one


def test_too_few_motors():
    with pytest.raises(InputError, match=r"robot.yaml:14:5: error: 1 motors for 2 joints"):
        loads_spec(HEAD + "\n".join(DRIVES.splitlines()[:-1]) + "\n")


def test_robots_without_the_section_keep_their_hash():
    manifest = Path(__file__).resolve().parents[3] / "generated" / "rrr" / "manifest.json"
    assert identify(load_spec("rrr")).model_hash == json.loads(manifest.read_text())["model_hash"]
