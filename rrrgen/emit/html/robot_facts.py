"""Tables and data for ``rrrgen show``: all that a robot file states besides the DH table, in SI and usual units."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rrrgen.robot.friction.laws import LAWS
from rrrgen.robot.model.drives import drives_data
from rrrgen.robot.spec import Limits

if TYPE_CHECKING:
    from rrrgen.robot.spec import FixedTransform, FrictionSpec, JointSpec, LinkSpec, RobotSpec

Rows = list[tuple[str, ...]]

SECOND_UNIT = {
    "rad": ("deg", 180.0 / math.pi),
    "rad/s": ("deg/s", 180.0 / math.pi),
    "rad/s^2": ("deg/s^2", 180.0 / math.pi),
    "m": ("mm", 1000.0),
    "m/s": ("mm/s", 1000.0),
    "m/s^2": ("mm/s^2", 1000.0),
}
"""The second unit that data sheets use for each SI unit, with the factor from the SI unit to it."""

LIMITS = {"lower": "rad", "upper": "rad", "velocity": "rad/s", "acceleration": "rad/s^2", "torque": "N m"}
DRIVE = {
    "inertia": "kg m^2",
    "gear_ratio": "",
    "torque_constant": "N m/A",
    "encoder_resolution": "rad",
    "stiffness": "N m/rad",
    "damping": "N m s/rad",
}
FRICTION = {"viscous": "N m s/rad", "coulomb": "N m", "offset": "N m"}
"""Keys of a joint with their units for a revolute joint."""

LINKS = "Links in the axes of their frames: centre of mass x y z, inertia tensor in kg m^2, Ixy = -integral of x*y dm"
INERTIA = ("xx", "yy", "zz", "xy", "xz", "yz")


def unit_of(unit: str, revolute: bool) -> str:
    """Convert ``unit``, that of a revolute joint, to the joint's: for a prismatic one N m becomes N, rad becomes m."""
    return unit if revolute else unit.replace("kg m^2", "kg").replace("N m", "N").replace("rad", "m")


def in_units(value: float, unit: str) -> dict[str, float]:
    """A value in SI and, where there is one, in the second unit: ``{"rad": 1.5708, "deg": 90.0}``."""
    second = {SECOND_UNIT[unit][0]: value * SECOND_UNIT[unit][1]} if unit in SECOND_UNIT else {}
    return {unit or "one": value} | second


def in_words(value: float | None, unit: str) -> str:
    """Print a value in both units, as in ``1.5708 rad (90 deg)``; ``-`` where the file states none."""
    if value is None:
        return "-"
    first, *second = (f"{number:.6g} {name}" for name, number in in_units(value, unit).items())
    return (first if unit else f"{value:.6g}") + (f" ({second[0]})" if second else "")


def tables(spec: RobotSpec) -> list[tuple[str, Rows]]:
    """The tables, (title, rows) each, of what the file states: transforms, limits, friction, drives and links."""
    sections = [
        (f"{name}: pose of {meaning}", _transform(spec, transform))
        for name, meaning, transform in (
            ("Base", "the frame before joint 1 in the base frame", spec.base),
            ("Tool", "the tip in the last link frame", spec.tool),
        )
    ]
    driven = {joint.name for joint in spec.joints}
    following = [row for row in spec.rows if row.name not in driven and row.limits != Limits()]
    sections.append(("Limits of the joints", _columns(spec, LIMITS, lambda joint: joint.limits, following)))
    sections.append(("Friction of the joints", _friction(spec.joints)))
    sections.append(("Drives, all values at the joint", _columns(spec, DRIVE, lambda joint: joint.drive)))
    sections.append((LINKS, _links(spec)))
    return [(title, rows) for title, rows in sections if rows]


def solvers_of_tips(spec: RobotSpec) -> list[tuple[str, str]]:
    """The name of every named tip with its solver in words, or with the reason why it has none."""
    from rrrgen.ik.classify import tip_plans

    solvers = []
    for tip, (arm, plan) in tip_plans(spec).items():
        joints = ", ".join(joint.name for joint in arm.joints)
        solved = f"{plan.title}, at most {plan.max_solutions} solutions, for {joints}"
        solvers.append((tip, solved if plan.solvable else plan.reason))
    return solvers


def not_stated(spec: RobotSpec) -> str:
    """One clause that names what the file does not state; empty if it states everything."""
    missing = [
        name
        for name, given in (
            ("base", _transform(spec, spec.base)),
            ("tool", _transform(spec, spec.tool)),
            ("limits", _columns(spec, LIMITS, lambda joint: joint.limits)),
            ("friction", _friction(spec.joints)),
            ("drives", spec.drives or _columns(spec, DRIVE, lambda joint: joint.drive)),
            ("links", spec.links),
        )
        if not given
    ]
    return ", ".join(missing)


def data(spec: RobotSpec) -> dict[str, Any]:
    """Data for JSON of all that the file states, every value by its unit; None where the file states none."""
    return {
        "base": _transform_data(spec, spec.base),
        "tool": _transform_data(spec, spec.tool),
        "limits": _by_joint(spec, LIMITS, lambda joint: joint.limits),
        "friction": {joint.name: _friction_data(joint.friction, joint.is_revolute) for joint in spec.joints},
        "joint_drives": _by_joint(spec, DRIVE, lambda joint: joint.drive),
        "drives": drives_data(spec),
        "links": None if spec.links is None else [_link_data(link) for link in spec.links],
    }


def _columns(spec: RobotSpec, keys: dict[str, str], part: Any, further: Sequence[JointSpec] = ()) -> Rows:
    """One row for each joint and each of ``further``, one column for each key that one of them states."""
    listed = [*spec.joints, *further]
    used = [key for key in keys if any(getattr(part(joint), key, None) is not None for joint in listed)]
    rows: Rows = [("joint", *(key.replace("_", " ") for key in used))]
    for joint in listed:
        units = {key: unit_of(keys[key], joint.is_revolute) for key in used}
        rows.append((joint.name, *(in_words(getattr(part(joint), key, None), unit) for key, unit in units.items())))
    return rows if used else []


def _by_joint(spec: RobotSpec, keys: dict[str, str], part: Any) -> dict[str, Any]:
    return {
        joint.name: {
            key: None if value is None else in_units(value, unit_of(unit, joint.is_revolute))
            for key, unit in keys.items()
            for value in [getattr(part(joint), key, None)]
        }
        for joint in spec.joints
    }


def _friction(joints: Sequence[JointSpec]) -> Rows:
    """Make the table of friction: joint, law and parameters of every joint with friction."""
    rows: Rows = []
    for joint in joints:
        if joint.friction is not None:
            parameters = _friction_parameters(joint.friction, joint.is_revolute)
            words = ", ".join(f"{name} {value:.6g} {unit}" for name, (value, unit) in parameters.items())
            rows.append((joint.name, _law_name(joint.friction), words))
    return [("joint", "law", "parameters"), *rows] if rows else []


def _law_name(friction: FrictionSpec) -> str:
    return "linear" if friction.law is None else friction.law.name


def _friction_parameters(friction: FrictionSpec, revolute: bool) -> dict[str, tuple[float, str]]:
    """Value and unit of every parameter that the file states, by name."""
    known = {name: (getattr(friction, name), unit) for name, unit in FRICTION.items()}
    if friction.law is not None:
        law = zip(LAWS[friction.law.name].parameters, friction.law.values, strict=True)
        known |= {parameter.name: (value, parameter.unit) for parameter, value in law}
    return {name: (value, unit_of(unit, revolute)) for name, (value, unit) in known.items() if value is not None}


def _friction_data(friction: FrictionSpec | None, revolute: bool) -> dict[str, Any] | None:
    if friction is None:
        return None
    parameters = _friction_parameters(friction, revolute)
    return {"law": _law_name(friction)} | {name: {unit: value} for name, (value, unit) in parameters.items()}


def _transform(spec: RobotSpec, transform: FixedTransform) -> Rows:
    """Make the table of a transform, with its translation and angles; no rows for the identity."""
    if transform == type(transform)():
        return []
    place, angles = _numbers(spec, transform)
    return [
        (what, *(f"{axis} {in_words(value, unit)}" for axis, value in zip(axes, values, strict=True)))
        for what, axes, values, unit in (
            ("translation", ("x", "y", "z"), place, "m"),
            ("rotation about the fixed axes x, y, z", ("roll", "pitch", "yaw"), angles, "rad"),
        )
    ]


def _numbers(spec: RobotSpec, transform: FixedTransform) -> tuple[list[float], list[float]]:
    """Translation (m), and roll, pitch, yaw (rad) with ``R = Rz(yaw) Ry(pitch) Rx(roll)``."""
    R = [float(spec.nominal(value)) for value in transform.rotation]
    pitch = math.atan2(-R[6], math.hypot(R[0], R[3]))
    if math.hypot(R[0], R[3]) < 1e-12:  # gimbal lock: yaw and roll are about the same axis, and yaw is set to 0
        roll, yaw = math.atan2(-R[5], R[4]), 0.0
    else:
        roll, yaw = math.atan2(R[7], R[8]), math.atan2(R[3], R[0])
    place = [float(spec.nominal(value)) for value in transform.translation]
    return place, [angle + 0.0 for angle in (roll, pitch, yaw)]  # no negative zero


def _transform_data(spec: RobotSpec, transform: FixedTransform) -> dict[str, Any]:
    place, angles = _numbers(spec, transform)
    return {
        "translation": {"m": place, "mm": [1000.0 * value for value in place]},
        "rpy": {"rad": angles, "deg": [math.degrees(value) for value in angles]},
        "matrix": [[float(spec.nominal(value)) for value in row] for row in transform.matrix().tolist()],
        "exact": [[str(value) for value in row] for row in transform.matrix().tolist()],
    }


def _links(spec: RobotSpec) -> Rows:
    """Make the table of links: mass, centre of mass and inertia, as the file states them."""
    if spec.links is None:
        return []
    rows: Rows = [("link", "mass", "x", "y", "z", "about", *(f"I{name}" for name in INERTIA))]
    for number, link in enumerate(spec.links, start=1):
        com = (in_words(float(value), "m") for value in link.com)
        tensor = (f"{float(value):.6g}" for value in link.inertia)
        rows.append((str(number), f"{float(link.mass):.6g} kg", *com, link.about, *tensor))
    return rows


def _link_data(link: LinkSpec) -> dict[str, Any]:
    com = [float(value) for value in link.com]
    return {
        "mass": {"kg": float(link.mass)},
        "com": {"m": com, "mm": [1000.0 * value for value in com]},
        "inertia": {"about": link.about}
        | {name: {"kg m^2": float(value)} for name, value in zip(INERTIA, link.inertia, strict=True)},
    }
