"""A tree of rigid bodies connected by joints, in 60-digit numbers, as URDF and MJCF describe it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from rrrgen.base.yamltext.document import Place
from rrrgen.robot.importers.trees.exact_numbers import Array, identity, number, vector
from rrrgen.robot.robot_spec import DriveSpec, FrictionSpec, Limits

MOVING = ("revolute", "prismatic")


@dataclass(frozen=True)
class Inertia:
    """Mass (kg), centre of mass (3,) in m and inertia tensor (3, 3) about it in kg m^2, in the frame of the body."""

    mass: Any
    com: Array
    tensor: Array

    def moved(self, T: Array) -> Inertia:
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
class Tree:
    """Bodies by name and the joints between them; ``root`` is the name of the body that no joint carries.

    ``gravity`` (3,), m/s^2, is in the frame of the root. ``shafts`` are motors that move several joints.
    """

    name: str
    root: str
    bodies: dict[str, Body]
    joints: tuple[TreeJoint, ...]
    gravity: Array
    shafts: tuple[Shaft, ...] = ()

    def joint_above(self) -> dict[str, TreeJoint]:
        """The joint that carries each body but the root."""
        return {joint.child: joint for joint in self.joints}

    def joints_below(self) -> dict[str, list[TreeJoint]]:
        """The joints that each body carries."""
        below: dict[str, list[TreeJoint]] = {name: [] for name in self.bodies}
        for joint in self.joints:
            below[joint.parent].append(joint)
        return below
