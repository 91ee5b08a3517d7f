"""Macros of the emitted header with the names, units and limits of the joints, as initializers of arrays."""

from __future__ import annotations

from fractions import Fraction

from rrrgen.emit.c.dialect import Dialect
from rrrgen.robot.robot_spec import RobotSpec, joint_units

_LINE = 116


def joint_macros(spec: RobotSpec, dialect: Dialect) -> list[str]:
    """The lines of the macros ``<NAME>_JOINT_NAMES``, ``_Q_UNITS``, ``_Q_MIN``, ``_Q_MAX`` and so on."""
    units = [joint_units(joint) for joint in spec.joints]
    limits = [joint.limits for joint in spec.joints]
    rows = {
        "JOINT_NAMES": [_quoted(joint.name) for joint in spec.joints],
        "Q_UNITS": [_quoted(unit["unit"]) for unit in units],
        "TAU_UNITS": [_quoted(unit["torque_unit"]) for unit in units],
        "Q_MIN": [_number(each.lower, dialect, "(-INFINITY)") for each in limits],
        "Q_MAX": [_number(each.upper, dialect) for each in limits],
        "DQ_MAX": [_number(each.velocity, dialect) for each in limits],
        "DDQ_MAX": [_number(each.acceleration, dialect) for each in limits],
        "TAU_MAX": [_number(each.torque, dialect) for each in limits],
    }
    return [line for name, values in rows.items() for line in _macro(f"{dialect.macro}_{name}", values)]


def _macro(name: str, values: list[str]) -> list[str]:
    """Print the macro ``#define name {values}``, continued over lines where it is long."""
    lines = [f"#define {name} {{{values[0]}"]
    for value in values[1:]:
        if len(lines[-1]) + len(value) > _LINE:
            lines[-1] += ", \\"
            lines.append(f"    {value}")
        else:
            lines[-1] += f", {value}"
    return [*lines[:-1], lines[-1] + "}"]


def _quoted(text: str) -> str:
    return f'"{text}"'


def _number(value: float | None, dialect: Dialect, unlimited: str = "INFINITY") -> str:
    return f"({dialect.real_type}){unlimited}" if value is None else dialect.literal(Fraction(str(value)))
