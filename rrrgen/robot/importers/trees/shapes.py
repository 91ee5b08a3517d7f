"""Inertia of homogeneous shapes about their centre, in their own axes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rrrgen.robot.importers.trees.exact_numbers import HIGH, identity, number, vector
from rrrgen.robot.importers.trees.tree import Inertia

SIZES = {"sphere": 1, "ellipsoid": 3, "box": 3, "cylinder": 2, "capsule": 2}
"""Number of sizes (m) that describe each shape: radius of a sphere; semi-axes of an ellipsoid; half edges of a box;
radius and half length along z of a cylinder and of a capsule."""


def volume(shape: str, size: Sequence[Any]) -> Any:
    """The volume (m^3) of a shape, a key of :data:`SIZES`, with the ``size`` (m) described there."""
    if shape == "box":
        return 8 * size[0] * size[1] * size[2]
    if shape == "cylinder":
        return 2 * HIGH.pi * size[0] ** 2 * size[1]
    if shape == "capsule":
        return 2 * HIGH.pi * size[0] ** 2 * size[1] + _ball(size[0])
    x, y, z = (size[0],) * 3 if shape == "sphere" else tuple(size)
    return 4 * HIGH.pi * x * y * z / 3


def _ball(radius: Any) -> Any:
    return 4 * HIGH.pi * radius**3 / 3


def inertia(shape: str, size: Sequence[Any], mass: Any) -> Inertia:
    """The inertia of a homogeneous body of ``mass`` (kg) that fills a ``shape`` of this ``size`` (:data:`SIZES`, m)."""
    if shape == "cylinder":
        across, along = mass * (3 * size[0] ** 2 + 4 * size[1] ** 2) / 12, mass * size[0] ** 2 / 2
    elif shape == "capsule":
        across, along = _capsule(size[0], size[1], mass)
    else:
        x, y, z = (size[0],) * 3 if shape == "sphere" else tuple(size)
        share = mass / (3 if shape == "box" else 5)
        return _about_centre(mass, [share * (y * y + z * z), share * (x * x + z * z), share * (x * x + y * y)])
    return _about_centre(mass, [across, across, along])


def _about_centre(mass: Any, moments: Sequence[Any]) -> Inertia:
    tensor = identity(3) * number(0)
    for k, moment in enumerate(moments):
        tensor[k, k] = moment
    return Inertia(mass, vector((0, 0, 0)), tensor)


def _capsule(radius: Any, half: Any, mass: Any) -> tuple[Any, Any]:
    """Moments of inertia of a capsule, across and along its axis: a cylinder with a half ball at each end."""
    total = volume("capsule", (radius, half))
    cylinder, ball = mass * (total - _ball(radius)) / total, mass * _ball(radius) / total
    along = cylinder * radius**2 / 2 + ball * 2 * radius**2 / 5
    across = cylinder * (3 * radius**2 + 4 * half**2) / 12
    across += ball * (2 * radius**2 / 5 + half**2 + 3 * half * radius / 4)
    return across, along
