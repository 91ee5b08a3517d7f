"""Friction of a joint or motor: coefficients of the linear law, or a named law with its parameters."""

from __future__ import annotations

import math

from rrrgen.base.yamltext.document import Node
from rrrgen.base.yamltext.sections import read_choice, read_section
from rrrgen.robot.file.fields import FRICTION, LINEAR_FRICTION, ROBOT_FILE
from rrrgen.robot.file.quantities import Scope, read_number
from rrrgen.robot.friction.law import LOAD, FrictionLaw
from rrrgen.robot.friction.laws import LAWS
from rrrgen.robot.robot_spec import FrictionSpec, LawSpec

_KEYS = {key.name: key for key in FRICTION}
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
    name = read_choice(values["law"], _KEYS["law"], scope.faults) if "law" in values else "coulomb_viscous"
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
            owners = [each.name for each in LAWS.values() if key in (p.name for p in each.parameters)]
            hint = f"it takes {', '.join(allowed)}; {key} belongs to law: {', '.join(owners)}"
            scope.faults.error(value, f"the friction law {name} of {what} has no '{key}'", hint)
            continue
        number = read_number(value, f"{key} of {what}", _KEYS[key].quantity_for(joint_type), scope)
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
