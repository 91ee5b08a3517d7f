"""Conversion of a ``DHRobot`` of the Robotics Toolbox for Python to a robot description.

Inertia is about the centre of mass. Rotor inertia ``Jm``, viscous friction ``B`` and Coulomb friction ``Tc`` (by
direction) are those of the motor, and act on the joint as ``G^2 Jm``, ``G^2 B`` and ``|G| Tc`` with the gear ratio G.
``gravity`` is the acceleration of a falling body, as in versions from 1.1.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import sympy as sp

from rrrgen.base.errors import Fault, InputError
from rrrgen.robot.file.reader import read_spec
from rrrgen.robot.file.writer import dumps
from rrrgen.robot.importers.interface import DEFAULT_ANGLE_TOLERANCE
from rrrgen.robot.importers.trees.exact_numbers import (
    HIGH,
    decimal,
    exact_angle,
    exact_multiple,
    exact_rotation,
    number,
    roll_pitch_yaw,
)
from rrrgen.robot.spec import (
    DriveSpec,
    FixedTransform,
    FrictionSpec,
    JointSpec,
    Limits,
    LinkSpec,
    RobotSpec,
    robot_identifier,
)

_NEEDED = ("links", "mdh", "base", "tool", "gravity", "name")
_OF_LINK = ("sigma", "a", "alpha", "d", "theta", "qlim", "m", "r", "I", "Jm", "B", "Tc", "G")
ORTHONORMAL = 1e-6
"""Largest error of the rotation of base and tool; it is made orthonormal."""


def from_toolbox(robot: Any, name: str = "", angle_tolerance: float = DEFAULT_ANGLE_TOLERANCE) -> RobotSpec:
    """Convert ``robot``, a ``roboticstoolbox.DHRobot``; ``rrrgen.robot.file.dumps`` writes the result as a robot file.

    Angles within ``angle_tolerance`` (rad) of a multiple of 15 degrees are taken as exact; other numbers keep the
    digits that they print. ``name`` renames the robot. Raises :class:`InputError` for other objects, for robots that a
    robot file cannot hold, and with every value of the robot that is no finite number, such as a symbol.
    """
    links = _links_of(robot)
    values = _Values(f"{name or robot.name} of the Robotics Toolbox")
    tolerance = values.number(angle_tolerance, "angle_tolerance")
    if values.faults or tolerance < 0:
        raise InputError(f"angle_tolerance is {angle_tolerance!r}, not an angle in rad of 0 or more")
    convention = "modified" if robot.mdh else "standard"
    gravity = values.vector(robot.gravity, "gravity", 3)
    base, tool = (_fixed_transform(getattr(robot, end), end, tolerance, values) for end in ("base", "tool"))
    joints, bodies = [], []
    for k, link in enumerate(links, 1):
        if _is_whole(k, link, convention, values):
            joints.append(_joint(k, link, tolerance, values))
            bodies.append(_link(k, link, values))
    if values.faults:
        raise InputError(values.faults)
    spec = RobotSpec(
        name=name or robot_identifier(str(robot.name)) or "robot",
        convention="modified" if robot.mdh else "standard",
        gravity=(_decimal(gravity[0]), _decimal(gravity[1]), _decimal(gravity[2])),
        parameters={},
        joints=tuple(joints),
        links=tuple(bodies) if any(body.mass for body in bodies) else None,
        base=base,
        tool=tool,
    )
    return read_spec(dumps(spec), values.file)


def _links_of(robot: Any) -> list[Any]:
    """The links of ``robot``; an error for every object that is no DHRobot."""
    missing = [attribute for attribute in _NEEDED if isinstance(robot, type) or not hasattr(robot, attribute)]
    try:
        links = [] if missing else list(robot.links)
    except TypeError:
        links = []
    if not links:
        kind = f"the class {robot.__name__}" if isinstance(robot, type) else type(robot).__name__
        raise InputError(f"{kind} is no DHRobot with links: it has no '{(missing or ['links'])[0]}'")
    return links


class _Values:
    """Finite numbers of a robot; a value that is none becomes 0 and adds to ``faults``, with what it is of."""

    def __init__(self, file: str) -> None:
        self.file, self.faults = file, list[Fault]()

    def fault(self, message: str, hint: str = "") -> None:
        self.faults.append(Fault(self.file, 0, 0, message, hint=hint))

    def number(self, value: Any, what: str) -> float:
        try:
            real = float("nan") if isinstance(value, str) else float(value)
        except (TypeError, ValueError):
            real = float("nan")
        if not np.isfinite(real):
            hint = (
                "the importer takes numbers: replace symbols by their values" if hasattr(value, "free_symbols") else ""
            )
            self.fault(f"{what} is {str(value)[:60]!r}, not a finite number", hint)
            return 0.0
        return real

    def vector(self, value: Any, what: str, size: int) -> list[float]:
        entries = np.ravel(np.asarray(value, dtype=object))
        if entries.size != size:
            self.fault(f"{what} has {entries.size} values instead of {size}")
            return [0.0] * size
        before = len(self.faults)
        numbers = [self.number(entry, f"entry {k} of {what}") for k, entry in enumerate(entries, 1)]
        del self.faults[before + 1 :]  # the first fault of a matrix says enough
        return numbers


def _is_whole(k: int, link: Any, convention: str, values: _Values) -> bool:
    """Whether the link has all attributes of a DHLink, moves in one way, and is of the robot's convention."""
    missing = [attribute for attribute in _OF_LINK if not hasattr(link, attribute)]
    if missing:
        values.fault(f"link {k} has no '{missing[0]}'", "a DHLink of the toolbox has " + ", ".join(_OF_LINK))
    elif link.sigma not in (0, 1):
        values.fault(f"sigma of link {k} is {str(link.sigma)[:60]!r}", "0 revolute, 1 prismatic")
    elif bool(getattr(link, "mdh", convention == "modified")) != (convention == "modified"):
        values.fault(f"link {k} is not of the {convention} convention of the robot", "one convention for all links")
    else:
        return True
    return False


def _decimal(value: float) -> sp.Rational:
    return decimal(number(value))


def _angle(value: float, tolerance: float) -> sp.Expr:
    return exact_angle(exact_multiple(number(value), number(tolerance)))


def _joint(k: int, link: Any, tolerance: float, values: _Values) -> JointSpec:
    revolute = link.sigma == 0
    offset = getattr(link, "offset", 0.0)
    G = values.number(link.G or 1.0, f"G of link {k}") or 1.0  # 0 says that none is given
    alpha, a, d, theta = (
        values.number(value, f"{key} of link {k}")
        for key, value in (
            ("alpha", link.alpha),
            ("a", link.a),
            ("d", link.d) if revolute else ("offset", offset),
            ("offset", offset) if revolute else ("theta", link.theta),
        )
    )
    return JointSpec(
        name=f"q{k}",
        type="revolute" if revolute else "prismatic",
        alpha=_angle(alpha, tolerance),
        a=_decimal(a),
        d=_decimal(d),
        theta=_angle(theta, tolerance),
        limits=_limits(k, link.qlim, values),
        friction=_friction(k, link, G, values),
        drive=_drive(k, link, G, values),
        sign=-1 if getattr(link, "isflip", False) else 1,
    )


def _limits(k: int, qlim: Any, values: _Values) -> Limits:
    """The range of a joint; an infinite bound is none, and so are two equal ones, which state no range."""
    ends = None if qlim is None else np.ravel(np.asarray(qlim, dtype=object))
    if ends is None or (ends.size == 2 and ends[0] == ends[1]):
        return Limits()
    lower, upper = values.vector([0.0 if _infinite(end) else end for end in ends], f"qlim of link {k}", 2)
    if ends.size != 2:
        return Limits()
    limits = Limits(None if _infinite(ends[0]) else lower, None if _infinite(ends[1]) else upper)
    if limits.lower is not None and limits.upper is not None and lower > upper:
        values.fault(f"qlim of link {k} is [{lower:g}, {upper:g}]: the lower bound is above the upper one")
    return limits


def _infinite(value: Any) -> bool:
    return isinstance(value, float) and bool(np.isinf(value))


def _friction(k: int, link: Any, G: float, values: _Values) -> FrictionSpec | None:
    """Friction at the joint, behind a gear of ratio ``G``."""
    viscous = values.number(link.B or 0.0, f"B of link {k}") * G * G
    forward, backward = values.vector((0.0, 0.0) if link.Tc is None else link.Tc, f"Tc of link {k}", 2)
    coulomb, offset = abs(G) * (forward - backward) / 2, abs(G) * (forward + backward) / 2
    if viscous < 0:
        values.fault(f"B of link {k} is negative", "viscous friction takes energy")
    if coulomb < 0:
        values.fault(f"Tc of link {k} is [{forward:g}, {backward:g}]", "[positive, negative], by direction")
    if not (viscous or coulomb or offset):
        return None
    return FrictionSpec(viscous or None, coulomb or None, offset or None)


def _drive(k: int, link: Any, G: float, values: _Values) -> DriveSpec | None:
    """The drive of ratio ``G``, with its inertia at the joint; None without either."""
    inertia = values.number(link.Jm or 0.0, f"Jm of link {k}")
    if inertia < 0:
        values.fault(f"Jm of link {k} is negative")
    if not inertia and G == 1.0:
        return None
    return DriveSpec(inertia=inertia * G * G or None, gear_ratio=None if G == 1.0 else G)


def _link(k: int, link: Any, values: _Values) -> LinkSpec:
    mass = values.number(link.m or 0.0, f"m of link {k}")
    x, y, z = values.vector(np.zeros(3) if link.r is None else link.r, f"r of link {k}", 3)
    tensor = np.reshape(values.vector(np.zeros(9) if link.I is None else link.I, f"I of link {k}", 9), (3, 3))
    if mass < 0:
        values.fault(f"m of link {k} is negative")
    if np.abs(tensor - tensor.T).max() > ORTHONORMAL * np.abs(tensor).max():
        values.fault(f"I of link {k} is not symmetric", "the inertia tensor about the centre of mass, 3 x 3")
    places: Sequence[tuple[int, int]] = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    inertia = tuple(_decimal(float(tensor[place])) for place in places)
    return LinkSpec(_decimal(mass), (_decimal(x), _decimal(y), _decimal(z)), inertia, "com")


def _fixed_transform(pose: Any, what: str, tolerance: float, values: _Values) -> FixedTransform:
    """Convert a pose of the toolbox; its rotation is made exact through roll, pitch and yaw."""
    T = np.reshape(values.vector(getattr(pose, "A", pose), what, 16), (4, 4))
    R = T[:3, :3]
    if not values.faults and (np.abs(R @ R.T - np.eye(3)).max() > ORTHONORMAL or np.linalg.det(R) < 0):
        values.fault(f"the rotation of {what} is not orthonormal")
    across = float(np.hypot(T[0, 0], T[1, 0]))
    vertical = across < tolerance
    roll = HIGH.atan2(number(-T[1, 2]), number(T[1, 1])) if vertical else HIGH.atan2(number(T[2, 1]), number(T[2, 2]))
    pitch = HIGH.atan2(number(-T[2, 0]), number(across))
    yaw = number(0) if vertical else HIGH.atan2(number(T[1, 0]), number(T[0, 0]))
    exact = roll_pitch_yaw(*(exact_multiple(angle, number(tolerance)) for angle in (roll, pitch, yaw)))
    x, y, z = (_decimal(float(value)) for value in T[:3, 3])
    return FixedTransform(exact_rotation(exact), (x, y, z))
