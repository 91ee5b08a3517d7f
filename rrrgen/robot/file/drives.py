"""The section ``drives`` of a robot file: motors that move several joints each, and the matrix that couples them."""

from __future__ import annotations

import math
from collections.abc import Sequence as Row
from typing import cast

import sympy as sp

from rrrgen.base.yamltext.document import Node, ScalarNode, describe
from rrrgen.base.yamltext.fields import read_choice, read_list, read_section
from rrrgen.robot.file.fields import FRICTION, LINEAR_FRICTION, MAX_JOINTS, MOTOR, ROBOT_FILE
from rrrgen.robot.file.quantities import Scope, read_number, read_value
from rrrgen.robot.friction.laws import LAWS, LOAD, FrictionLaw
from rrrgen.robot.spec import DriveSpec, DrivesSpec, FrictionSpec, JointSpec, JointType, LawSpec, MotorSpec, name_fault

# ------------------------------------------------------------------------------------------------------------------
# Friction of a joint or motor: coefficients of the linear law, or a named law with its parameters.
# ------------------------------------------------------------------------------------------------------------------

_FRICTION_KEYS = {key.name: key for key in FRICTION}
_NOT_NEGATIVE = ("viscous", "coulomb", LOAD)


def read_friction(node: Node | None, joint_type: str, what: str, scope: Scope) -> FrictionSpec | None:
    """Read the section ``friction`` of the joint or motor ``what``; None if there is none or it is no mapping.

    ``joint_type``, "revolute" or "prismatic", decides the units.
    """
    if node is None:
        return None
    values = read_section(node, "friction", f"friction of {what}", scope.faults, ROBOT_FILE)
    if values is None:
        return None
    name = read_choice(values["law"], _FRICTION_KEYS["law"], scope.faults) if "law" in values else "coulomb_viscous"
    if name is None:
        return FrictionSpec()
    law = LAWS[name]
    linear = name == "coulomb_viscous"
    allowed = [key.name for key in LINEAR_FRICTION] if linear else [*(p.name for p in law.parameters), "offset"]
    numbers: dict[str, float] = {}
    for key, value in values.items():
        if key == "law":
            continue
        if key not in allowed:
            owners = [owner.name for owner in LAWS.values() if key in (p.name for p in owner.parameters)]
            hint = f"it takes {', '.join(allowed)}; {key} belongs to law: {', '.join(owners)}"
            scope.faults.error(value, f"the friction law {name} of {what} has no '{key}'", hint)
            continue
        number = read_number(value, f"{key} of {what}", _FRICTION_KEYS[key].quantity_for(joint_type), scope)
        if number is None:
            continue
        if key in _NOT_NEGATIVE and number < 0:
            scope.faults.error(value, f"{key} of {what} is {number:g}", "it must not be negative")
        if key == LOAD and number >= 1.0:
            scope.faults.error(value, f"{key} of {what} is {number:g}", "it must be below 1, or the joint locks itself")
        numbers[key] = number
    if linear:
        return FrictionSpec(numbers.get("viscous"), numbers.get("coulomb"), numbers.get("offset"))
    return FrictionSpec(offset=numbers.pop("offset", None), law=_law(law, numbers, values, node, what, scope))


def _law(
    law: FrictionLaw, numbers: dict[str, float], values: dict[str, Node], node: Node, what: str, scope: Scope
) -> LawSpec:
    """Complete a friction law: parameters that the file does not state are 0.

    A parameter that must be positive, and is absent or not positive, is a fault; so are bristles without friction.
    """
    for parameter in law.parameters:
        if not parameter.positive:
            continue
        if parameter.name not in values:
            hint = f"{parameter.name}: {parameter.meaning}, {parameter.unit}"
            scope.faults.error(node, f"the friction law {law.name} of {what} needs '{parameter.name}'", hint)
        elif numbers.get(parameter.name, 1.0) <= 0.0:
            number = numbers[parameter.name]
            scope.faults.error(
                values[parameter.name], f"{parameter.name} of {what} is {number:g}", "it must be positive"
            )
    excess = numbers.get("stiction_excess", 0.0)
    if law.damping and excess <= -numbers.get("coulomb", math.inf):
        hint = "it must be above -coulomb, or bristles at rest would carry nothing"
        scope.faults.error(values.get("stiction_excess", node), f"stiction_excess of {what} is {excess:g}", hint)
    return LawSpec(law.name, tuple(numbers.get(p.name, 0.0) for p in law.parameters))


# ------------------------------------------------------------------------------------------------------------------
# The section ``drives`` of a robot file
# ------------------------------------------------------------------------------------------------------------------

Matrix = tuple[tuple[sp.Expr, ...], ...]

SINGULAR = 1e-9  # determinant over the product of the lengths of the rows: rounded decimals of a singular matrix
_MATRICES = ("joint_from_drive", "drive_from_joint")
_FRICTION = tuple(key.name for key in LINEAR_FRICTION)
_DRIVE_KEYS = {key.name: key for key in MOTOR}


def read_drives(node: Node, joints: Row[JointSpec | None], scope: Scope) -> DrivesSpec | None:
    """Read the section ``drives`` of a robot with these joints (None for a joint with a fault); None if faulty."""
    values = read_section(node, "drives", "drives", scope.faults, ROBOT_FILE)
    if not values or not joints:
        return None
    matrix = _read_coupling(node, values, len(joints), scope)
    motors = _read_motors(values["motors"], joints, matrix, scope) if "motors" in values else None
    if matrix is None or motors is None:
        return None
    return DrivesSpec(matrix, tuple(motors))


def _read_coupling(node: Node, values: dict[str, Node], n: int, scope: Scope) -> Matrix | None:
    """Read the matrix ``joint_from_drive``, or invert ``drive_from_joint`` if the file states that; None if faulty."""
    given = [name for name in _MATRICES if name in values]
    if len(given) != 1:
        hint = "joint_from_drive: joint speeds = matrix * drive speeds; drive_from_joint: the other way round"
        missing = "drives needs one of the keys 'joint_from_drive' and 'drive_from_joint'"
        twice = "drives has both 'joint_from_drive' and 'drive_from_joint'"
        scope.faults.error(values[given[1]] if given else node, twice if given else missing, hint)
        return None
    name = given[0]
    matrix = _read_square(values[name], name, n, scope)
    if matrix is None:
        return None
    if _is_singular(matrix):
        hint = "every joint speed must follow from the speeds of the drives, and these from the joints'"
        scope.faults.error(values[name], f"{name} is singular", hint)
        return None
    if name == "drive_from_joint":
        matrix = sp.Matrix(matrix).inv(method="LU")
        return tuple(tuple(matrix[i, k] for k in range(n)) for i in range(n))
    return matrix


def _read_square(node: Node, name: str, n: int, scope: Scope) -> Matrix | None:
    rows = read_list(node, name, None, scope.faults)
    if rows is None:
        return None
    if len(rows) != n:
        hint = f"one row per {'joint' if name == 'joint_from_drive' else 'drive'}, as many drives as joints"
        scope.faults.error(node, f"{name} has {len(rows)} row{'s' * (len(rows) != 1)} for {n} joints", hint)
        return None
    matrix = []
    for i, row in enumerate(rows, start=1):
        items = read_list(row, f"row {i} of {name}", n, scope.faults)
        entries = [
            read_value(item, f"entry {i},{k} of {name}", "number", scope) for k, item in enumerate(items or (), start=1)
        ]
        matrix.append(tuple(scope.substitute(value) for value in entries if value is not None))
    return tuple(matrix) if all(len(row) == n for row in matrix) else None


def _is_singular(matrix: Matrix) -> bool:
    """Whether the matrix is singular, or so near a singular one that rounding of its decimals may explain it."""
    numbers = [[float(value) for value in row] for row in matrix]
    lengths = [sum(value * value for value in row) ** 0.5 for row in numbers]
    if not all(lengths):
        return True
    scaled = [[value / length for value in row] for row, length in zip(numbers, lengths, strict=True)]
    return abs(float(sp.Matrix(scaled).det(method="lu"))) < SINGULAR


def _read_motors(
    node: Node, joints: Row[JointSpec | None], matrix: Matrix | None, scope: Scope
) -> list[MotorSpec] | None:
    items = read_list(node, "motors", None, scope.faults)
    if items is None:
        return None
    if len(items) != len(joints):
        number = f"{len(items)} motors for {len(joints)} joints" if len(items) <= MAX_JOINTS else f"{len(items)} motors"
        scope.faults.error(
            node, number, "one motor per drive and as many drives as joints; - {name: m1} for a bare one"
        )
        return None
    motors = [_read_motor(item, number, scope) for number, item in enumerate(items, start=1)]
    seen: set[str] = set()
    for item, (motor, _) in zip(items, motors, strict=True):
        if motor.name in seen:
            scope.faults.error(item, f"the motor name '{motor.name}' is not unique", "m1, m2, ... where it is missing")
        seen.add(motor.name)
    motor_specs = [motor for motor, _ in motors]
    if matrix is not None:
        directions = DrivesSpec(matrix, tuple(motor_specs)).motor_from_joint
        for k, (motor, places) in enumerate(motors):
            _check_not_twice(list(directions.row(k)), motor, places, joints, scope)
    return motor_specs


def _read_motor(node: Node, number: int, scope: Scope) -> tuple[MotorSpec, dict[str, Node]]:
    """Read one motor: (the motor, with defaults for values that are faulty, and the nodes of its values by key)."""
    what = f"motor {number}"
    values = read_section(node, "motor", what, scope.faults, ROBOT_FILE) or {}
    kind = read_choice(values["type"], _DRIVE_KEYS["type"], scope.faults) if "type" in values else "revolute"
    joint_type = cast(JointType, kind or "revolute")
    gear: sp.Expr | None = sp.S.One
    if "gear_ratio" in values:
        gear = read_value(values["gear_ratio"], f"gear_ratio of {what}", "number", scope)
        gear = None if gear is None else scope.substitute(gear)
        if gear == 0:
            scope.faults.error(values["gear_ratio"], f"gear_ratio of {what} is zero", _DRIVE_KEYS["gear_ratio"].meaning)
            gear = None
    numbers: dict[str, float | None] = {}
    for name, positive in (("inertia", False), ("torque_limit", True)):
        numbers[name] = _read_size(values.get(name), name, what, joint_type, positive, scope)
    friction = read_friction(values.get("friction"), joint_type, what, scope)
    return (
        MotorSpec(
            name=read_numbered_name(values.get("name"), "motor", number, scope),
            type=joint_type,
            gear_ratio=sp.S.One if gear is None else gear,
            friction=friction,
            **numbers,
        ),
        values,
    )


def _read_size(node: Node | None, name: str, what: str, joint_type: str, positive: bool, scope: Scope) -> float | None:
    if node is None:
        return None
    number = read_number(node, f"{name} of {what}", _DRIVE_KEYS[name].quantity_for(joint_type), scope)
    if number is not None and (number < 0 or (positive and number == 0)):
        allowed = "it must be positive" if positive else "it must not be negative"
        scope.faults.error(node, f"{name} of {what} is {number:g}", allowed)
    return number


def read_numbered_name(node: Node | None, kind: str, number: int, scope: Scope) -> str:
    """Read the name of a "joint" or "motor"; one without has the name q1, q2, ... or m1, m2, ... by its ``number``."""
    usual = f"{'q' if kind == 'joint' else 'm'}{number}"
    if node is None:
        return usual
    if not isinstance(node, ScalarNode):
        scope.faults.error(node, f"the name of {kind} {number} is {describe(node)}, not a word")
        return usual
    if fault := name_fault(node.text, kind):
        scope.faults.error(node, *fault)
    return node.text


def _check_not_twice(
    direction: Row[sp.Expr], motor: MotorSpec, places: dict[str, Node], joints: Row[JointSpec | None], scope: Scope
) -> None:
    """If a motor moves a single joint, refuse a friction or inertia term stated at both of them."""
    moved = [joint for joint, weight in zip(joints, direction, strict=True) if weight != 0]
    joint = moved[0] if len(moved) == 1 else None
    if joint is None:
        return
    motor_friction, other = motor.friction or FrictionSpec(), joint.friction or FrictionSpec()
    terms = {
        f"friction {name}": ("friction", getattr(motor_friction, name), getattr(other, name)) for name in _FRICTION
    }
    drive = joint.drive or DriveSpec()
    terms["friction law"] = ("friction", motor_friction.law, other.law)
    terms["inertia"] = ("inertia", motor.inertia, drive.inertia)
    terms["gear_ratio"] = ("gear_ratio", places.get("gear_ratio"), drive.gear_ratio)
    for what, (key, here, there) in terms.items():
        if here is not None and there is not None:
            message = f"{what} is given twice: here and at joint '{joint.name}', with which motor '{motor.name}' turns"
            scope.faults.error(places[key], message, "state it at the motor or at the joint")
