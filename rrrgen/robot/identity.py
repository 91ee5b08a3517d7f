"""The identity of emitted code: a hash of the normalized robot description, and the version of rrrgen."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

from rrrgen.base.version import VERSION
from rrrgen.robot.spec import RobotSpec


@dataclass(frozen=True)
class Identity:
    """The origin of emitted code: SHA-256 of the normalized robot description, and the version of rrrgen."""

    model_hash: str
    tool_version: str


_NOT_THE_ROBOT = frozenset(
    {
        "file",
        "faults",
        "places",
        "description",
        "source",
        "angle_unit",
        "length_unit",
        "provenance",
        "emit",
        "tools",
    }
)
"""Fields of a description that do not change the robot and are left out of its hash."""


def identify(spec: RobotSpec) -> Identity:
    """The hash of the robot and the version of rrrgen.

    The hash is that of the normalized description (SI units, exact numbers), independent of comments and spelling.
    """
    robot = _canonical(spec)
    if spec.drives is None:  # robots without coupled drives keep the hash that they had before these were known
        del robot["drives"]
    if spec.mechanism is None:
        del robot["mechanism"]
    elif not spec.loops:
        del robot["mechanism"]["loops"]
    elif not spec.newton:
        for loop in robot["mechanism"]["loops"]:
            del loop["start"]
    for joint in robot["joints"]:
        for key in ("stiffness", "damping"):
            if joint["drive"] is not None and joint["drive"][key] is None:
                del joint["drive"][key]
    for row in (*robot["joints"], *robot.get("mechanism", {}).get("rows", ())):
        if row["sign"] == 1:
            del row["sign"]
        for key in ("gamma", "b"):
            if row[key] == "0":
                del row[key]
    if not spec.gravity_input:
        del robot["gravity_input"]
    if not spec.floating_base:
        del robot["floating_base"]
    if spec.ik == "general":
        del robot["ik"]
    if not spec.tips:
        del robot["tips"]
    text = json.dumps(robot, sort_keys=True, separators=(",", ":"))
    return Identity(hashlib.sha256(text.encode()).hexdigest(), VERSION)


def _canonical(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        names = [field.name for field in fields(value) if field.name not in _NOT_THE_ROBOT]
        return {name: _canonical(getattr(value, name)) for name in names}
    if isinstance(value, dict):
        return {key: _canonical(value[key]) for key in value}
    if isinstance(value, (tuple, list)):
        return [_canonical(item) for item in value]
    if value is None or isinstance(value, (str, bool, int)):
        return value
    return repr(value) if isinstance(value, float) else str(value)
