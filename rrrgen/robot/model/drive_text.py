"""Text and plain data about coupled drives, for printing and for the manifest."""

from __future__ import annotations

from typing import Any

from rrrgen.robot.friction.laws import LAWS
from rrrgen.robot.robot_spec import LawSpec, MotorSpec, RobotSpec

_UNITS = {
    "revolute": {"inertia": "kg m^2", "viscous": "N m s/rad", "coulomb": "N m", "offset": "N m", "torque_limit": "N m"},
    "prismatic": {"inertia": "kg", "viscous": "N s/m", "coulomb": "N", "offset": "N", "torque_limit": "N"},
}


def coupling_equations(spec: RobotSpec) -> list[str]:
    """One equation per joint: its speed as a sum of drive speeds, ``roll = -1/3*left + right``. Empty if uncoupled."""
    if spec.drives is None:
        return []
    names = [motor.name for motor in spec.drives.motors]
    return [
        f"{joint.name} = {weighted_sum(names, [str(value) for value in row])}"
        for joint, row in zip(spec.joints, spec.drives.joint_from_drive, strict=True)
    ]


def weighted_sum(names: list[str], factors: list[str]) -> str:
    """Print the sum of ``factors`` times ``names``, as in ``-1/3*left + right``; "0" for an empty sum."""
    text = ""
    for name, factor in zip(names, factors, strict=True):
        if factor == "0":
            continue
        negative = factor.startswith("-")
        size = f"({factor.removeprefix('-')})" if "+" in factor[1:] else factor.removeprefix("-")
        term = name if size == "1" else f"{size}*{name}"
        sign = ("-" if negative else "") if not text else " - " if negative else " + "
        text += sign + term
    return text or "0"


def motor_facts(motor: MotorSpec) -> str:
    """A clause with what the robot file states about a motor: values at its shaft, in SI units."""
    units = _UNITS[motor.type]
    values = {name: value for name, value in _values(motor).items() if value is not None}
    facts = ["linear motor"] if motor.type == "prismatic" else []
    facts += [f"gear ratio {motor.gear_ratio}"] if motor.gear_ratio != 1 else []
    facts += [f"{name.replace('_', ' ')} {value:.10g} {units[name]}" for name, value in values.items()]
    if motor.friction is not None and motor.friction.law is not None:
        facts.append(law_text(motor.friction.law))
    return ", ".join(facts)


def law_text(law: LawSpec) -> str:
    """A clause with the name and the values (SI) of a friction law: ``friction stribeck (coulomb 2, ...)``."""
    names = [parameter.name for parameter in LAWS[law.name].parameters]
    values = ", ".join(f"{name} {value:.6g}" for name, value in zip(names, law.values, strict=True))
    return f"friction {law.name} ({values})"


def drives_data(spec: RobotSpec) -> dict[str, Any] | None:
    """The coupling matrix (exact, as text) and the motors; None without coupling."""
    if spec.drives is None:
        return None
    return {
        "joint_from_drive": [[str(value) for value in row] for row in spec.drives.joint_from_drive],
        "motors": [
            {
                "name": motor.name,
                "type": motor.type,
                "gear_ratio": str(motor.gear_ratio),
                **_values(motor),
                **_law(motor),
            }
            for motor in spec.drives.motors
        ],
    }


def _law(motor: MotorSpec) -> dict[str, Any]:
    law = None if motor.friction is None else motor.friction.law
    if law is None:
        return {}
    values = zip((parameter.name for parameter in LAWS[law.name].parameters), law.values, strict=True)
    return {"friction_law": {"name": law.name, **dict(values)}}


def _values(motor: MotorSpec) -> dict[str, float | None]:
    friction = {name: getattr(motor.friction, name, None) for name in ("viscous", "coulomb", "offset")}
    return {"inertia": motor.inertia, **friction, "torque_limit": motor.torque_limit}
