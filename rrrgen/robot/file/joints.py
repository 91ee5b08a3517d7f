"""Reader of the rows of ``joints`` in a robot file: Denavit-Hartenberg parameters, limits, friction, drive."""

from __future__ import annotations

from typing import cast

import sympy as sp

from rrrgen.base.yamltext.document import Node, ScalarNode
from rrrgen.base.yamltext.fields import Key, read_choice, read_list, read_section
from rrrgen.robot.file.drives import read_friction, read_numbered_name
from rrrgen.robot.file.fields import DRIVE, JOINT, LIMITS, MAX_JOINTS, ROBOT_FILE
from rrrgen.robot.file.quantities import Scope, read_number, read_value
from rrrgen.robot.spec import DriveSpec, JointSpec, JointType, Limits

_TYPE = next(key for key in JOINT if key.name == "type")
_SIGN = next(key for key in JOINT if key.name == "sign")
_POSITIVE = ("velocity", "acceleration", "torque", "torque_constant", "encoder_resolution", "stiffness")
_NOT_NEGATIVE = ("inertia", "damping")
_SHORT_LENGTH = 0.001  # m
_SHORTEST_ARM = 0.005  # m; a whole mm file below it was written in metres


def read_joints(node: Node, scope: Scope) -> list[JointSpec | None]:
    """Read the list ``joints``; a row with a fault gives None, so that the number of joints is preserved."""
    items = read_list(node, "joints", None, scope.faults)
    if items is None:
        return []
    if not items:
        scope.faults.error(node, "joints is empty", "a robot has at least one joint")
    if len(items) > MAX_JOINTS:
        scope.faults.error(node, f"{len(items)} joints", f"at most {MAX_JOINTS}")
        return []
    joints = [_read_joint(item, number, scope) for number, item in enumerate(items, start=1)]
    _check_names(items, joints, scope)
    _check_scale(node, scope)
    _warn_about_short_lengths(node, joints, scope)
    return joints


def _read_joint(node: Node, number: int, scope: Scope) -> JointSpec | None:
    what = f"joint {number}"
    values = read_section(node, "joint", what, scope.faults, ROBOT_FILE)
    if values is None:
        return None
    joint_type = read_choice(values["type"], _TYPE, scope.faults) if "type" in values else None
    name = read_numbered_name(values.get("name"), "joint", number, scope)
    joint_type = joint_type or "revolute"  # only to look for more faults
    _check_variable(node, values, joint_type, name, what, scope)
    row: dict[str, sp.Expr | None] = {}
    for key in JOINT:
        if key.kind == "value":
            row[key.name] = (
                read_value(values[key.name], f"{key.name} of {what}", key.quantity, scope, key.file_units)
                if key.name in values
                else sp.S.Zero
            )
    sign = read_choice(values["sign"], _SIGN, scope.faults) if "sign" in values else None
    limits = _read_limits(values.get("limits"), joint_type, what, scope)
    friction = read_friction(values.get("friction"), joint_type, what, scope)
    drive = read_floats(values.get("drive"), DRIVE, "drive", joint_type, what, scope)
    if any(value is None for value in row.values()):
        return None
    return JointSpec(
        name=name,
        type=cast(JointType, joint_type),
        **row,
        limits=limits,
        friction=friction,
        drive=None if drive is None else DriveSpec(**drive),
        sign=-1 if sign == "-1" else 1,
    )


def refuse_placements(node: Node, scope: Scope) -> None:
    """Report the keys gamma and b of the rows of the list ``node``, whose file is in the standard convention.

    The twist of a standard row stands on the link that carries the next one, so a second row on that link would have to
    undo it first.
    """
    for number, item in enumerate(getattr(node, "items", ()), start=1):
        for key, _ in getattr(item, "entries", ()):
            if isinstance(key, ScalarNode) and key.text in ("gamma", "b"):
                hint = (
                    "there, fixed rows (follows: {}) do it: one with a and alpha of the carrier, negated, which undoes "
                    "its twist, and one with theta: gamma, d: b and the twist to this joint; or convention: modified"
                )
                scope.faults.error(key, f"{key.text} of joint {number}: standard rows have no gamma and b", hint)


def _check_variable(node: Node, values: dict[str, Node], joint_type: str, name: str, what: str, scope: Scope) -> None:
    """Check theta and d of a row: the constant one must be stated, the variable one may be stated only as an offset."""
    needed, variable = ("d", "theta") if joint_type == "revolute" else ("theta", "d")
    if needed not in values:
        scope.faults.error(node, f"{what} needs the key '{needed}'", f"{needed}: constant of a {joint_type} joint")
    offset = values.get(variable)
    if isinstance(offset, ScalarNode) and offset.text not in scope.names and offset.text in ("q", name, variable):
        hint = f"{variable} is the offset added to q; write 0 for none"
        scope.faults.error(offset, f"{variable} of {what} is the joint variable itself", hint)
        del values[variable]


def _check_names(items: list[Node], joints: list[JointSpec | None], scope: Scope) -> None:
    seen: dict[str, int] = {}
    for number, (item, joint) in enumerate(zip(items, joints, strict=True), start=1):
        if joint is None:
            continue
        if joint.name in seen:
            hint = f"joint {seen[joint.name]} has the same name; joints without a name are q1, q2, ..."
            scope.faults.error(item, f"the name '{joint.name}' of joint {number} is not unique", hint)
        seen.setdefault(joint.name, number)


def _check_scale(node: Node, scope: Scope) -> None:
    """Report a file in mm whose longest bare length is below 5 mm: it was probably written in metres."""
    longest = max(scope.bare_lengths, default=0.0)
    if 0.0 < longest < _SHORTEST_ARM:
        message = f"the longest length of the robot is {longest * 1000:g} mm"
        hint = f"units say mm; for metres write units: {{..., length: m}}, and for mm indeed {longest * 1000:g} mm"
        scope.faults.error(node, message, hint)


def _warn_about_short_lengths(node: Node, joints: list[JointSpec | None], scope: Scope) -> None:
    """Give one warning for all row lengths below 1 mm: usual in calibrated tables, otherwise often a wrong unit."""
    short_lengths = []
    for number, joint in enumerate(joints, start=1):
        for key in ("a", "d") if joint is not None else ():
            length = abs(float(scope.substitute(getattr(joint, key))))
            if 0.0 < length < _SHORT_LENGTH:
                short_lengths.append(f"{key} of joint {number} is {length * 1000:.3g} mm")
    if short_lengths:
        hint = "as in a calibrated table? otherwise check the unit; 0 makes shorter code and simpler inverse kinematics"
        scope.faults.warning(node, "lengths below 1 mm: " + ", ".join(short_lengths), hint)


def _read_limits(node: Node | None, joint_type: str, what: str, scope: Scope) -> Limits:
    values = read_floats(node, LIMITS, "limits", joint_type, what, scope)
    if values is None:
        return Limits()
    limits = Limits(**values)
    if node is not None and limits.lower is not None and limits.upper is not None and limits.lower >= limits.upper:
        message = f"limits of {what}: lower {limits.lower:g} is not below upper {limits.upper:g}"
        scope.faults.error(node, message, "lower < upper, both in q without the offset")
    return limits


def read_floats(
    node: Node | None, table: tuple[Key, ...], section: str, joint_type: str, what: str, scope: Scope
) -> dict[str, float | None] | None:
    """The SI values of a mapping by key, None for an absent key; None if ``node`` is absent or faulty.

    ``table`` holds the keys of the ``section``; the quantity that a key measures can depend on ``joint_type``.
    """
    if node is None or (isinstance(node, ScalarNode) and node.is_null):
        return None
    values = read_section(node, section, f"{section} of {what}", scope.faults, ROBOT_FILE)
    if values is None:
        return None
    numbers: dict[str, float | None] = {key.name: None for key in table}
    for key in table:
        if key.name not in values:
            continue
        label = f"{key.name} of {what}"
        number = read_number(values[key.name], label, key.quantity_for(joint_type), scope, key.file_units)
        numbers[key.name] = number
        if number is None:
            continue
        if key.name in _POSITIVE and number <= 0:
            scope.faults.error(values[key.name], f"{label} is {number:g}", "it must be positive")
        elif key.name in _NOT_NEGATIVE and number < 0:
            scope.faults.error(values[key.name], f"{label} is {number:g}", "it must not be negative")
        elif key.name == "gear_ratio" and number == 0:
            scope.faults.error(values[key.name], f"{label} is zero", "motor turns per joint turn")
    return numbers
