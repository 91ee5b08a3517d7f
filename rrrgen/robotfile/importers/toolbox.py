"""Conversion of a ``DHRobot`` of the Robotics Toolbox for Python to a robot description.

Inertia is about the centre of mass. Rotor inertia ``Jm``, viscous friction ``B`` and Coulomb friction ``Tc`` (by
direction) are those of the motor, and act on the joint as ``G^2 Jm``, ``G^2 B`` and ``|G| Tc`` with the gear ratio G.
``gravity`` is the acceleration of a falling body, as in versions from 1.1.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import sympy as sp

from rrrgen.errors import InputError
from rrrgen.robotfile.importers.interface import DEFAULT_ANGLE_TOLERANCE
from rrrgen.robotfile.importers.trees.exact_numbers import (
    HIGH,
    decimal,
    exact_angle,
    exact_multiple,
    exact_rotation,
    number,
    roll_pitch_yaw,
)
from rrrgen.robotfile.names import identifier
from rrrgen.robotfile.reader import read_spec
from rrrgen.robotfile.robot_spec import (
    DriveSpec,
    FixedTransform,
    FrictionSpec,
    JointSpec,
    Limits,
    LinkSpec,
    RobotSpec,
)
from rrrgen.robotfile.sections.reversal import with_reversed_joint
from rrrgen.robotfile.writer import dumps

_NEEDED = ("links", "mdh", "base", "tool", "gravity", "name")


def from_toolbox(robot: Any, name: str = "", angle_tolerance: float = DEFAULT_ANGLE_TOLERANCE) -> RobotSpec:
    """Convert ``robot``, a ``roboticstoolbox.DHRobot``; ``rrrgen.robotfile.dumps`` writes the result as a robot file.

    Angles within ``angle_tolerance`` (rad) of a multiple of 15 degrees are taken as exact; other numbers keep the
    digits that they print. ``name`` renames the robot. Raises :class:`InputError` for other objects, and for robots
    that a robot file cannot hold.
    """
    missing = [attribute for attribute in _NEEDED if not hasattr(robot, attribute)]
    if missing or not len(robot.links):
        raise InputError(f"{type(robot).__name__} is no DHRobot with links: it has no '{(missing or ['links'])[0]}'")
    joints, links = [], []
    for k, link in enumerate(robot.links):
        joints.append(_joint(k, link, angle_tolerance))
        links.append(_link(link))
    g = [decimal(number(float(value))) for value in np.ravel(robot.gravity)]
    spec = RobotSpec(
        name=name or identifier(str(robot.name)) or "robot",
        convention="modified" if robot.mdh else "standard",
        gravity=(g[0], g[1], g[2]),
        parameters={},
        joints=tuple(joints),
        links=tuple(links) if any(link.mass for link in links) else None,
        base=_fixed(robot.base, angle_tolerance),
        tool=_fixed(robot.tool, angle_tolerance),
    )
    for k, link in enumerate(robot.links):
        if getattr(link, "isflip", False):
            spec = with_reversed_joint(spec, k)
    return read_spec(dumps(spec), f"{spec.name} of the Robotics Toolbox")


def _angle(value: Any, tolerance: float) -> sp.Expr:
    return exact_angle(exact_multiple(number(float(value)), number(tolerance)))


def _length(value: Any) -> sp.Expr:
    return decimal(number(float(value)))


def _joint(k: int, link: Any, tolerance: float) -> JointSpec:
    revolute = link.sigma == 0
    offset = getattr(link, "offset", 0.0)
    theta = offset if revolute else link.theta
    d = link.d if revolute else offset
    lower, upper = (None, None) if link.qlim is None else (float(value) for value in np.ravel(link.qlim))
    limits = Limits() if lower is None or upper is None or not lower < upper else Limits(lower, upper)
    return JointSpec(
        name=f"q{k + 1}",
        type="revolute" if revolute else "prismatic",
        alpha=_angle(link.alpha, tolerance),
        a=_length(link.a),
        d=_length(d),
        theta=_angle(theta, tolerance),
        limits=limits,
        friction=_friction(link),
        drive=_drive(link),
    )


def _ratio(link: Any) -> float:
    """The gear ratio of a toolbox link; 0, by which the toolbox says that none is given, counts as 1."""
    return float(link.G or 1.0)


def _friction(link: Any) -> FrictionSpec | None:
    G = abs(_ratio(link))
    viscous = float(link.B or 0.0) * G * G
    forward, backward = (float(value) * G for value in np.ravel(link.Tc if link.Tc is not None else (0.0, 0.0)))
    coulomb, offset = (forward - backward) / 2, (forward + backward) / 2
    if not (viscous or coulomb or offset):
        return None
    return FrictionSpec(viscous or None, coulomb or None, offset or None)


def _drive(link: Any) -> DriveSpec | None:
    G, inertia = _ratio(link), float(link.Jm or 0.0)
    if not inertia and G == 1.0:
        return None
    return DriveSpec(inertia=inertia * G * G or None, gear_ratio=None if G == 1.0 else G)


def _link(link: Any) -> LinkSpec:
    mass = decimal(number(float(link.m or 0.0)))
    x, y, z = (decimal(number(float(value))) for value in (np.ravel(link.r) if link.r is not None else np.zeros(3)))
    tensor = np.reshape(link.I if link.I is not None else np.zeros(9), (3, 3))
    places = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    return LinkSpec(mass, (x, y, z), tuple(decimal(number(float(tensor[place]))) for place in places), "com")


def _fixed(pose: Any, tolerance: float) -> FixedTransform:
    """Convert a pose of the toolbox; its rotation is made exact through roll, pitch and yaw."""
    T = np.asarray(getattr(pose, "A", pose), dtype=float)
    across = float(np.hypot(T[0, 0], T[1, 0]))
    vertical = across < tolerance
    roll = HIGH.atan2(number(-T[1, 2]), number(T[1, 1])) if vertical else HIGH.atan2(number(T[2, 1]), number(T[2, 2]))
    pitch = HIGH.atan2(number(-T[2, 0]), number(across))
    yaw = number(0) if vertical else HIGH.atan2(number(T[1, 0]), number(T[0, 0]))
    R = roll_pitch_yaw(*(exact_multiple(angle, number(tolerance)) for angle in (roll, pitch, yaw)))
    x, y, z = (_length(value) for value in T[:3, 3])
    return FixedTransform(exact_rotation(R), (x, y, z))
