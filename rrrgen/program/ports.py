"""Ports, the named inputs and outputs of programs: what each one stands for, and how a program says that it failed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum


class Role(Enum):
    """What a port stands for. Passes, back ends and the runtime ask for the role; the name is for readers only."""

    POSITION = "position"
    VELOCITY = "velocity"
    ACCELERATION = "acceleration"
    TORQUE = "torque"
    COVECTOR = "covector"  # e of e' Y: one number per joint, multiplied from the left
    BASE_PARAMETERS = "base parameters"
    DRIVE_INERTIA = "drive inertia"
    FRICTION = "friction parameters"
    GEOMETRY = "geometry"  # named lengths and angles, where they are symbols
    OTHER = "other"

    @property
    def is_parameter(self) -> bool:
        """Whether the port is constant while the robot moves."""
        return self in (Role.BASE_PARAMETERS, Role.DRIVE_INERTIA, Role.FRICTION, Role.GEOMETRY)

    @property
    def is_rate(self) -> bool:
        """Whether the port changes from one motion through a configuration to another."""
        return self in (Role.VELOCITY, Role.ACCELERATION, Role.COVECTOR)


@dataclass(frozen=True)
class Port:
    """A named input or output of a program, with what a reader must know to use it.

    ``shape`` is () for a scalar, (n,) for a vector, (m, n) for a row-major matrix, and so on.
    """

    name: str
    shape: tuple[int, ...]
    unit: str = ""
    frame: str = ""
    meaning: str = ""
    role: Role = Role.OTHER

    @property
    def size(self) -> int:
        """Number of scalars."""
        return math.prod(self.shape)


@dataclass(frozen=True)
class Status:
    """How a program reports failure: output number ``output``, a scalar, is 0 after success and 1 after failure.

    ``failure`` is a short name for what went wrong, ``message`` what the user is told, ``meaning`` the exact condition.
    """

    output: int
    failure: str
    message: str
    meaning: str
