"""A tree of rigid bodies connected by joints, in 60-digit numbers, and the inertia of solid shapes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from rrrgen.base.yamltext.document import Place
from rrrgen.robot.importers.trees.exact_numbers import HIGH, Array, identity, number, vector
from rrrgen.robot.spec import DriveSpec, FrictionSpec, Limits

# ------------------------------------------------------------------------------------------------------------------
# A tree of rigid bodies connected by joints, in 60-digit numbers, as URDF and MJCF describe it.
# ------------------------------------------------------------------------------------------------------------------

MOVING = ("revolute", "prismatic")


@dataclass(frozen=True)
class Inertia:
    """Mass (kg), centre of mass (3,) in m and inertia tensor (3, 3) about it in kg m^2, in the frame of the body."""

    mass: Any
    com: Array
    tensor: Array

    def transform(self, T: Array) -> Inertia:
        """The inertia expressed in another frame; ``T`` (4, 4) is the pose of the present frame in that one."""
        R = T[:3, :3]
        return Inertia(self.mass, R @ self.com + T[:3, 3], R @ self.tensor @ R.T)

    def __add__(self, other: Inertia) -> Inertia:
        mass = self.mass + other.mass
        com = (self.mass * self.com + other.mass * other.com) / mass if mass else self.com
        tensor = 0 * self.tensor
        for part in (self, other):
            r = part.com - com
            squares = sum(x * x for x in r)
            steiner = [[squares * int(i == k) - r[i] * r[k] for k in range(3)] for i in range(3)]
            tensor = tensor + part.tensor + part.mass * vector_rows(steiner)
        return Inertia(mass, com, tensor)


def vector_rows(rows: list[list[Any]]) -> Array:
    """A matrix (3, 3) from its rows."""
    matrix = identity(3)
    for i, row in enumerate(rows):
        matrix[i] = vector(row)
    return matrix


NO_INERTIA = Inertia(number(0), vector((0, 0, 0)), 0 * identity(3))


@dataclass(frozen=True)
class Body:
    """One body, stated at ``place`` of the file; ``inertia`` is None where the file states none."""

    name: str
    inertia: Inertia | None
    place: Place


@dataclass(frozen=True)
class Mimic:
    """A joint that follows another one: ``q = multiplier q_of + offset``."""

    of: str
    multiplier: Any
    offset: Any


@dataclass(frozen=True)
class TreeJoint:
    """A joint between two bodies: ``T_parent_child(q) = origin motion(axis, q)``.

    ``parent`` and ``child`` are names of bodies, ``origin`` is (4, 4), ``axis`` (3,) is a unit vector in the frame of
    the joint. ``mimic`` is the joint that it follows, if any. ``kind`` is revolute, prismatic, fixed, or the file's
    word for what has no place in a serial chain.
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: Array
    axis: Array
    place: Place
    limits: Limits = field(default_factory=Limits)
    friction: FrictionSpec | None = None
    drive: DriveSpec | None = None
    mimic: Mimic | None = None

    @property
    def moves(self) -> bool:
        """Whether the joint has a variable."""
        return self.kind != "fixed"


@dataclass(frozen=True)
class Shaft:
    """A motor whose angle is ``sum_j weights[j] q_j``, with its inertia, friction and torque limit.

    In an MJCF it is a fixed tendon with its actuator.
    """

    name: str
    weights: Mapping[str, Any]
    inertia: float | None
    friction: FrictionSpec | None
    torque_limit: float | None
    place: Place


@dataclass(frozen=True)
class Constraint:
    """A constraint ``name`` between two ``bodies`` that no joint of a robot file represents, such as a weld."""

    name: str
    bodies: tuple[str, str]
    place: Place


@dataclass(frozen=True)
class Tree:
    """Bodies by name and the joints between them; ``root`` is the name of the body that no joint carries.

    ``gravity`` (3,), m/s^2, is in the frame of the root. ``shafts`` are motors that move several joints. ``place`` is
    that of the element which names the robot. ``constraints`` hold between bodies besides the joints.
    """

    name: str
    root: str
    bodies: dict[str, Body]
    joints: tuple[TreeJoint, ...]
    gravity: Array
    shafts: tuple[Shaft, ...] = ()
    place: Place | None = None
    constraints: tuple[Constraint, ...] = ()

    def joint_above(self) -> dict[str, TreeJoint]:
        """The joint that carries each body but the root."""
        return {joint.child: joint for joint in self.joints}

    def joints_below(self) -> dict[str, list[TreeJoint]]:
        """The joints that each body carries."""
        below: dict[str, list[TreeJoint]] = {name: [] for name in self.bodies}
        for joint in self.joints:
            below[joint.parent].append(joint)
        return below


# ------------------------------------------------------------------------------------------------------------------
# Inertia of homogeneous shapes about their centre, in their own axes.
# ------------------------------------------------------------------------------------------------------------------

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
