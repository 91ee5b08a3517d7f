"""The linear terms of a robot's drives: what the file states of inertia and friction, and along which direction.

A term acts along a direction ``w`` (n,) of joint space: with the speed ``s' = w dq`` it adds the generalised force
``w f`` to the joint torques, where f is ``Ia s''`` (inertia), ``fv s'`` (viscous), ``fc sgn(s')`` (Coulomb) or ``off``
(offset). A term of one joint has the unit vector as direction, one of a motor among coupled drives its row of the
matrix ``motor_from_joint``: then s is the angle of the motor, and all terms of all motors together are
``S^-T (Ia ddq_m + friction(dq_m))`` with ``dq = S dq_m``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

from rrrgen.robotfile.robot_spec import DriveSpec, FrictionSpec, JointSpec, MotorSpec, RobotSpec

Kind = Literal["inertia", "viscous", "coulomb", "offset"]
KINDS: tuple[Kind, ...] = ("inertia", "viscous", "coulomb", "offset")
SYMBOLS: dict[Kind, str] = {"inertia": "Ia", "viscous": "fv", "coulomb": "fc", "offset": "off"}


@dataclass(frozen=True)
class DriveTerm:
    """One term: its parameter's name and nominal value, its kind, and its direction ``w`` (n,), exact.

    ``joint`` is the joint (from 0) at which it is stated, ``motor`` the motor, whichever it is.
    """

    name: str
    kind: Kind
    value: float
    direction: tuple[Any, ...]
    joint: int | None = None
    motor: int | None = None


def drive_terms(spec: RobotSpec) -> tuple[DriveTerm, ...]:
    """The terms of ``spec`` in the order of the identification regressor.

    First those of the joints kind by kind (Ia1, Ia2, .., fv1, ..), then those of coupled motors, motor by motor
    (Ia_m1, fv_m1, ..). A field that the file states, 0 included, is a term.
    """
    return (*_joint_terms(spec), *_motor_terms(spec))


def inertia_terms(spec: RobotSpec) -> tuple[DriveTerm, ...]:
    """What the input ``Ia`` of the model functions holds; empty where the file states no inertia of a drive.

    Without coupled drives one entry per joint, 0 where the file is silent; with them one entry per inertia stated.
    """
    stated = tuple(term for term in drive_terms(spec) if term.kind == "inertia")
    if not stated or spec.drives is not None:
        return stated
    known = {term.joint: term for term in stated}
    return tuple(known.get(i, DriveTerm(f"Ia{i + 1}", "inertia", 0.0, unit(i, spec.n), i)) for i in range(spec.n))


def friction_terms(spec: RobotSpec) -> tuple[DriveTerm, ...]:
    """The terms that are no inertia."""
    return tuple(term for term in drive_terms(spec) if term.kind != "inertia")


def friction_surfaces(spec: RobotSpec) -> dict[str, tuple[Any, ...]] | None:
    """Where friction acts among coupled drives: names and directions; None where every joint has its own drive.

    The joints and motors for which the file states friction, or all motors where it states none.
    """
    if spec.drives is None:
        return None
    motors = {motor.name: tuple(spec.drives.motor_from_joint.row(k)) for k, motor in enumerate(spec.drives.motors)}
    joints = {f"joint {joint.name}": unit(i, spec.n) for i, joint in enumerate(spec.joints) if joint.friction}
    moved = {motor.name for motor in spec.drives.motors if motor.friction}
    return {**joints, **{name: w for name, w in motors.items() if name in moved}} or motors


def unit(joint: int, n: int) -> tuple[int, ...]:
    """The direction of one joint (from 0) of ``n``."""
    return tuple(int(i == joint) for i in range(n))


def _joint_terms(spec: RobotSpec) -> Iterator[DriveTerm]:
    for kind in KINDS:
        for i, joint in enumerate(spec.joints):
            value = _stated(joint, kind)
            if value is not None:
                yield DriveTerm(f"{SYMBOLS[kind]}{i + 1}", kind, value, unit(i, spec.n), joint=i)


def _motor_terms(spec: RobotSpec) -> Iterator[DriveTerm]:
    if spec.drives is None:
        return
    for k, motor in enumerate(spec.drives.motors):
        for kind in KINDS:
            value = _stated(motor, kind)
            if value is not None:
                direction = tuple(spec.drives.motor_from_joint.row(k))
                yield DriveTerm(f"{SYMBOLS[kind]}_{motor.name}", kind, value, direction, motor=k)


def _stated(owner: JointSpec | MotorSpec, kind: Kind) -> float | None:
    """What a joint or a motor states of one kind, None where it is silent."""
    inertial: DriveSpec | MotorSpec | None = owner if isinstance(owner, MotorSpec) else owner.drive
    source: DriveSpec | MotorSpec | FrictionSpec | None = inertial if kind == "inertia" else owner.friction
    value = None if source is None else getattr(source, kind)
    return None if value is None else float(value)
