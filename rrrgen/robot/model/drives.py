"""The drives of a robot: the linear terms of inertia and friction that the robot file states, and their text."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

from rrrgen.robot.friction.laws import LAWS
from rrrgen.robot.spec import DriveSpec, FrictionSpec, JointSpec, LawSpec, MotorSpec, RobotSpec

# ------------------------------------------------------------------------------------------------------------------
# The linear terms of a robot's drives, inertia and friction, as the robot file states them.
#
# A term acts along a direction ``w`` (n,) of joint space. With the speed ``s' = w . dq`` it adds the generalized
# force ``w f`` to the joint torques, where f is ``Ia s''`` (inertia), ``fv s'`` (viscous), ``fc sgn(s')`` (Coulomb)
# or ``off`` (offset). The direction of a term at a joint is a unit vector. The direction of a term at a coupled motor
# is the row of that motor in ``motor_from_joint``, and s is the angle of the motor; all terms of all motors together
# are ``S^-T (Ia ddq_m + friction(dq_m))`` with ``dq = S dq_m``.
# ------------------------------------------------------------------------------------------------------------------

Kind = Literal["inertia", "viscous", "coulomb", "offset"]
KINDS: tuple[Kind, ...] = ("inertia", "viscous", "coulomb", "offset")
SYMBOLS: dict[Kind, str] = {"inertia": "Ia", "viscous": "fv", "coulomb": "fc", "offset": "off"}


@dataclass(frozen=True)
class DriveTerm:
    """One drive term: name and nominal value of its parameter, its kind, and its exact direction ``w`` (n,).

    It belongs either to the joint number ``joint`` or to the motor number ``motor`` (from 0); the other is None.
    """

    name: str
    kind: Kind
    value: float
    direction: tuple[Any, ...]
    joint: int | None = None
    motor: int | None = None


def drive_terms(spec: RobotSpec) -> tuple[DriveTerm, ...]:
    """The terms of ``spec`` in the order of the identification regressor.

    First come the terms of the joints, kind by kind (Ia1, Ia2, .., fv1, ..), then those of coupled motors, motor by
    motor (Ia_m1, fv_m1, ..). Every field that the robot file states, even as 0, is a term.
    """
    return (*_joint_terms(spec), *_motor_terms(spec))


def inertia_terms(spec: RobotSpec) -> tuple[DriveTerm, ...]:
    """The terms whose parameters are the elements of the input ``Ia``; empty if the file states no drive inertia.

    Without coupled drives there is one element per joint, 0 if the file states none for it; with coupled drives there
    is one element per stated inertia.
    """
    stated = tuple(term for term in drive_terms(spec) if term.kind == "inertia")
    if not stated or spec.drives is not None:
        return stated
    known = {term.joint: term for term in stated}
    return tuple(known.get(i, DriveTerm(f"Ia{i + 1}", "inertia", 0.0, unit(i, spec.n), i)) for i in range(spec.n))


def friction_terms(spec: RobotSpec) -> tuple[DriveTerm, ...]:
    """The friction terms: all terms that are not inertias."""
    return tuple(term for term in drive_terms(spec) if term.kind != "inertia")


def friction_surfaces(spec: RobotSpec) -> dict[str, tuple[Any, ...]] | None:
    """The joints and motors at which friction acts, name -> direction (n,); None without coupled drives.

    These are the joints and motors for which the file states friction, or all motors if it states none.
    """
    if spec.drives is None:
        return None
    motors = {motor.name: tuple(spec.drives.motor_from_joint.row(k)) for k, motor in enumerate(spec.drives.motors)}
    joints = {f"joint {joint.name}": unit(i, spec.n) for i, joint in enumerate(spec.joints) if joint.friction}
    moved = {motor.name for motor in spec.drives.motors if motor.friction}
    return {**joints, **{name: w for name, w in motors.items() if name in moved}} or motors


def unit(joint: int, n: int) -> tuple[int, ...]:
    """The direction of one joint: the unit vector (n,) with 1 at index ``joint``."""
    return tuple(int(i == joint) for i in range(n))


def _joint_terms(spec: RobotSpec) -> Iterator[DriveTerm]:
    for kind in KINDS:
        for i, joint in enumerate(spec.joints):
            value = _stated_value(joint, kind)
            if value is not None:
                yield DriveTerm(f"{SYMBOLS[kind]}{i + 1}", kind, value, unit(i, spec.n), joint=i)


def _motor_terms(spec: RobotSpec) -> Iterator[DriveTerm]:
    if spec.drives is None:
        return
    for k, motor in enumerate(spec.drives.motors):
        for kind in KINDS:
            value = _stated_value(motor, kind)
            if value is not None:
                direction = tuple(spec.drives.motor_from_joint.row(k))
                yield DriveTerm(f"{SYMBOLS[kind]}_{motor.name}", kind, value, direction, motor=k)


def _stated_value(owner: JointSpec | MotorSpec, kind: Kind) -> float | None:
    """The value that the file states for ``kind`` at a joint or motor; None if it states none."""
    inertial: DriveSpec | MotorSpec | None = owner if isinstance(owner, MotorSpec) else owner.drive
    source: DriveSpec | MotorSpec | FrictionSpec | None = inertial if kind == "inertia" else owner.friction
    value = None if source is None else getattr(source, kind)
    return None if value is None else float(value)


def stated_at_joints(spec: RobotSpec, key: str, missing: float | None = None) -> tuple[list[float], list[str]]:
    """The values ``key`` under `drive` of all joints, and the names of the joints without it.

    ``key`` is "inertia", "stiffness" or "damping"; ``missing`` is the value where there is none.
    """
    stated = [None if joint.drive is None else getattr(joint.drive, key) for joint in spec.joints]
    values = [missing if value is None else value for value in stated]
    absent = [joint.name for joint, value in zip(spec.joints, values, strict=True) if value is None]
    return [float(value) for value in values if value is not None], absent


# ------------------------------------------------------------------------------------------------------------------
# Text and plain data about coupled drives, for printing and for the manifest.
# ------------------------------------------------------------------------------------------------------------------

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
