"""Ports, the named inputs and outputs of programs, and the status by which a program reports failure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum


class Role(Enum):
    """The physical quantity of a port. Code decides by the role; the name of a port is for readers only."""

    POSITION = "position"
    VELOCITY = "velocity"
    ACCELERATION = "acceleration"
    TORQUE = "torque"
    REFERENCE_VELOCITY = "reference velocity"
    REFERENCE_ACCELERATION = "reference acceleration"
    DESIRED_POSITION = "desired position"
    DESIRED_VELOCITY = "desired velocity"
    DESIRED_ACCELERATION = "desired acceleration"
    COVECTOR = "covector"  # e in e' Y, shape (n,): multiplies the regressor from the left
    BASE_PARAMETERS = "base parameters"  # followed by the drive inertias, where the robot file states some
    STANDARD_PARAMETERS = "standard parameters"  # likewise
    GRAVITY = "gravity"  # the acceleration of gravity in the base frame, where it is an input
    FRICTION = "friction parameters"
    GEOMETRY = "geometry"  # named lengths and angles that are inputs instead of numbers
    OTHER = "other"

    @property
    def is_parameter(self) -> bool:
        """Whether the port is constant while the robot moves."""
        return self in (
            Role.BASE_PARAMETERS,
            Role.STANDARD_PARAMETERS,
            Role.FRICTION,
            Role.GEOMETRY,
        )

    @property
    def is_rate(self) -> bool:
        """Whether the port is a velocity, an acceleration or the vector e in ``e' Y``, which multiplies a regressor."""
        return self in (
            Role.VELOCITY,
            Role.ACCELERATION,
            Role.REFERENCE_VELOCITY,
            Role.REFERENCE_ACCELERATION,
            Role.COVECTOR,
        )


@dataclass(frozen=True)
class Port:
    """A named input or output of a program with its unit, reference frame and meaning.

    ``shape`` is () for a scalar, (n,) for a vector, (m, n) for a row-major matrix, and so on. ``role`` is the physical
    quantity, by which code recognizes the port.
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

    ``failure`` is a short name of the failure, ``message`` the text for the user, ``meaning`` the exact condition.
    """

    output: int
    failure: str
    message: str
    meaning: str
