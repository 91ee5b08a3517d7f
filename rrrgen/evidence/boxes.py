"""The box of inputs over which something is proven about a function: from the limits that the robot file states."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rrrgen.base.errors import InputError
from rrrgen.derive.functions.friction import friction_parameters
from rrrgen.program import Port, Program, Role
from rrrgen.program.program import Domain
from rrrgen.robot.spec import JointSpec, RobotSpec
from rrrgen.verify.references.numeric_robot import nominal_parameters

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel


@dataclass(frozen=True)
class Ranges:
    """The ranges that are assumed where the robot file states none, and those that the user sets instead.

    ``speed`` and ``acceleration`` of all joints replace the limits of the file; None keeps them. ``spread`` is the
    relative range of inertial and friction parameters around their nominal values. Raises InputError for a speed or
    an acceleration that is not positive and finite.
    """

    speed: float | None = None
    acceleration: float | None = None
    spread: float = 0.2

    def __post_init__(self) -> None:
        for name in ("speed", "acceleration"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < math.inf:
                raise InputError(f"the range of the {name} must be positive and finite, not {value:g}")


ASSUMED_ANGLE, ASSUMED_STROKE = math.pi, 1.0
ASSUMED_SPEED, ASSUMED_ACCELERATION = (10.0, 2.0), (100.0, 20.0)
"""Where the robot file states no limit: rad and m; rad/s and m/s; rad/s^2 and m/s^2 (revolute, prismatic)."""
ASSUMED_TORQUE = 1000.0  # N m or N, of a joint without a limit

ASSUMED_MAGNITUDE = {
    "1": 1.0,
    "any": 1.0,
    "(unit of beta)^2/J": 1.0,
    **dict.fromkeys(("m", "rad", "m/s", "rad/s", "m s", "rad s", "m per unit of s", "rad per unit of s", "s"), 10.0),
    **dict.fromkeys(("m/s^2", "rad/s^2", "m per unit of s^2", "rad per unit of s^2", "1/s", "SI", "(N m)^2"), 100.0),
    **dict.fromkeys(("N m s/rad", "N s/m"), 100.0),
    **dict.fromkeys(("N m", "N", "N m s", "N s", "N m/rad", "N/m", "N m/(rad s)", "N/(m s)", "1/s^2"), 1000.0),
    **dict.fromkeys(("rad/s^3", "m/s^3"), 1000.0),
    **dict.fromkeys(("rad/s^4", "m/s^4", "1/s^3"), 1e4),
    **dict.fromkeys(("kg m^2", "kg"), 10.0),
}
"""The largest magnitudes of gains, states, points, poses and wrenches, by their unit; of several units the first one.
The robot file states none of them."""

LEAST = 1e-3
"""Share of its magnitude that a positive number or a limit has at least."""

PERIOD, DURATION = (1e-4, 1e-2), (1.0, 10.0)
"""The period, s, of a function that keeps a state; and of one that does not: the duration of a motion."""

GRAVITY = 10.0  # m/s^2, of every component where gravity is an input
PAYLOAD = 10.0  # kg, m, kg m^2: of every number that describes a payload


@dataclass(frozen=True)
class PortRange:
    """The range of one input port: ``lower`` and ``upper``, row-major, and ``source``, where they come from."""

    lower: tuple[float, ...]
    upper: tuple[float, ...]
    source: str

    @property
    def bounds(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """The lower and the upper bounds."""
        return self.lower, self.upper


def nominal_beta(model: DerivedModel) -> list[float] | None:
    """The values of the port of base parameters in the robot file, drive inertias included; None if it has none."""
    if model.beta_nominal is None:
        return None
    return [float(value) for value in (*model.beta_nominal, *(model.drive_inertia_nominal or ()))]


def box_of(program: Program, spec: RobotSpec, beta: Sequence[float] | None, ranges: Ranges) -> dict[str, PortRange]:
    """The range of every input port of ``program`` that has one, by name.

    ``beta`` are the nominal values of the port of base parameters, drive inertias included; None where the robot file
    states none. Gains, states, points, poses and wrenches have the ranges of :data:`ASSUMED_MAGNITUDE`.
    """
    box = {}
    period = PERIOD if any(port.state for port in program.outputs) else DURATION
    for port in program.inputs:
        port_range = _range(port, spec, beta, ranges, period)
        if port_range is not None:
            box[port.name] = port_range
    return box


def acceleration_range(spec: RobotSpec, ranges: Ranges) -> PortRange:
    """The range of the joint accelerations, also of a function that returns them."""
    return _symmetric(spec, ranges.acceleration, _acceleration)


def _range(
    port: Port, spec: RobotSpec, beta: Sequence[float] | None, ranges: Ranges, period: tuple[float, float]
) -> PortRange | None:
    role = port.role
    if role in (Role.POSITION, Role.DESIRED_POSITION):
        return _of_joints(spec, _position)
    if role in (Role.VELOCITY, Role.DESIRED_VELOCITY, Role.REFERENCE_VELOCITY):
        return _symmetric(spec, ranges.speed, _speed)
    if role in (Role.ACCELERATION, Role.DESIRED_ACCELERATION, Role.REFERENCE_ACCELERATION):
        return acceleration_range(spec, ranges)
    if role is Role.TORQUE:
        return _of_joints(spec, lambda joint: (-_torque(joint)[0], *_torque(joint)))
    if role is Role.COVECTOR:
        return PortRange((-1.0,) * port.size, (1.0,) * port.size, "assumed")
    if role is Role.GRAVITY:
        return PortRange((-GRAVITY,) * port.size, (GRAVITY,) * port.size, "assumed")
    if role is Role.PAYLOAD:
        return PortRange((-PAYLOAD,) * port.size, (PAYLOAD,) * port.size, "assumed")
    if role is Role.BASE_PARAMETERS:
        return None if beta is None or len(beta) != port.size else _around(beta, ranges.spread)
    if role is Role.FRICTION:
        values = [float(value) for _, value in friction_parameters(spec)]
        return _around(values, ranges.spread) if len(values) == port.size else None
    if role is Role.STANDARD_PARAMETERS:
        nominal = nominal_parameters(spec)
        if nominal is None or nominal.size != port.size:
            return None
        return _around([float(value) for value in nominal.ravel()], ranges.spread)
    return _assumed_range(port, period) if role is Role.OTHER else None


def _assumed_range(port: Port, period: tuple[float, float]) -> PortRange | None:
    """The range of a port that no limit of the robot file is about, by its unit and domain; None if it has another."""
    if port.unit == "1, m" and port.shape == (4, 4):
        return _POSE
    size = ASSUMED_MAGNITUDE.get(re.split(r" \| |, ", port.unit)[0])
    if size is None:
        return None
    if port.name in _POSITIVE and ", " not in port.unit:
        return PortRange((LEAST * size,) * port.size, (size,) * port.size, "assumed")
    low, high = {
        Domain.POSITIVE: (LEAST * size, size),
        Domain.LIMIT: (LEAST * size, size),
        Domain.PERIOD: period,
        Domain.LOWER: (-size, -LEAST * size),
        Domain.UPPER: (LEAST * size, size),
    }.get(port.domain, (-size, size))
    return PortRange((low,) * port.size, (high,) * port.size, "assumed")


_POSITIVE = ("rotor_inertia", "stiffness")
"""Divisors of functions with elastic joints; the stiffness of the tip, which has two units at once, is none."""

_TURN = ASSUMED_MAGNITUDE["1"], ASSUMED_MAGNITUDE["1"], ASSUMED_MAGNITUDE["1"], ASSUMED_MAGNITUDE["m"]
_POSE = PortRange((*(-size for size in _TURN * 3), 0.0, 0.0, 0.0, 1.0), (*_TURN * 3, 0.0, 0.0, 0.0, 1.0), "assumed")


def _around(values: Sequence[float], spread: float) -> PortRange:
    lower = tuple(value - spread * abs(value) for value in values)
    upper = tuple(value + spread * abs(value) for value in values)
    return PortRange(lower, upper, f"nominal values of the robot file, within {spread:.0%}")


def _of_joints(spec: RobotSpec, bounds: Callable[[JointSpec], tuple[float, float, bool]]) -> PortRange:
    rows = [bounds(joint) for joint in spec.joints]
    stated = [row[2] for row in rows]
    source = "limits of the robot file" if all(stated) else "assumed" if not any(stated) else "limits, else assumed"
    return PortRange(tuple(row[0] for row in rows), tuple(row[1] for row in rows), source)


def _symmetric(spec: RobotSpec, given: float | None, limit: Callable[[JointSpec], tuple[float, bool]]) -> PortRange:
    if given is not None:
        n = len(spec.joints)
        return PortRange((-given,) * n, (given,) * n, "stated by the user")
    return _of_joints(spec, lambda joint: (-limit(joint)[0], *limit(joint)))


def _position(joint: JointSpec) -> tuple[float, float, bool]:
    reach = ASSUMED_ANGLE if joint.is_revolute else ASSUMED_STROKE
    lower, upper = joint.limits.lower, joint.limits.upper
    stated = lower is not None and upper is not None
    if lower is None:
        lower = -reach if upper is None else min(-reach, upper - reach)
    if upper is None:
        upper = max(reach, lower + reach)
    return lower, upper, stated


def _speed(joint: JointSpec) -> tuple[float, bool]:
    limit = joint.limits.velocity
    return (ASSUMED_SPEED[not joint.is_revolute], False) if limit is None else (limit, True)


def _torque(joint: JointSpec) -> tuple[float, bool]:
    limit = joint.limits.torque
    return (ASSUMED_TORQUE, False) if limit is None else (float(limit), True)


def _acceleration(joint: JointSpec) -> tuple[float, bool]:
    limit = joint.limits.acceleration
    return (ASSUMED_ACCELERATION[not joint.is_revolute], False) if limit is None else (limit, True)
