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


class Domain(Enum):
    """The values of an input that a function accepts; :mod:`rrrgen.program.guard` refuses all others."""

    FINITE = "finite"
    ESTIMATE = "an estimate of an observer, finite"  # refused also by functions that have no state
    POSITIVE = "finite and > 0"
    PERIOD = "a time, finite and > 0"
    LIMIT = ">= 0, INFINITY for none"  # of a magnitude
    LOWER = "a lower bound, -INFINITY for none"
    UPPER = "an upper bound, INFINITY for none"  # of what the port LOWER before it bounds from below


@dataclass(frozen=True)
class Port:
    """A named input or output of a program with its unit, reference frame and meaning.

    ``shape`` is () for a scalar, (n,) for a vector, (m, n) for a row-major matrix, and so on. ``role`` is the physical
    quantity, by which code recognizes the port. ``domain`` says which values of an input are accepted. An output that
    the caller hands back at the next call has in ``state`` the name of the input that takes it. ``refused`` is the
    value of an output, other than a state, of a call whose input is refused.
    """

    name: str
    shape: tuple[int, ...]
    unit: str = ""
    frame: str = ""
    meaning: str = ""
    role: Role = Role.OTHER
    domain: Domain = Domain.FINITE
    state: str = ""
    refused: int = 0

    @property
    def size(self) -> int:
        """Number of scalars."""
        return math.prod(self.shape)


@dataclass(frozen=True)
class Failure:
    """A failure that a status reports: its ``code``, a short ``name``, ``message`` for the user, ``meaning``.

    The meaning is the exact condition.
    """

    code: int
    name: str
    message: str
    meaning: str


REFUSED = Failure(
    2, "invalid input", "an input is not finite or out of its range", "an input is not finite or out of its range"
)
"""The failure of a guarded function whose input, or a value computed from it, is unusable; the state is unchanged."""


@dataclass(frozen=True)
class Status:
    """How a program reports failure: output number ``output``, a scalar, is 0 or the code of one of its ``failures``.

    The codes ascend; 2 is that of :data:`REFUSED`, 1 that of a failure of the function itself.
    """

    output: int
    failures: tuple[Failure, ...]

    @staticmethod
    def of(output: int, name: str, message: str, meaning: str) -> Status:
        """The status of a function with a single failure, whose code is 1."""
        return Status(output, (Failure(1, name, message, meaning),))

    @property
    def message(self) -> str:
        """The messages of all failures, for the user."""
        return " or ".join(failure.message for failure in self.failures)

    @property
    def meaning(self) -> str:
        """The conditions of all failures."""
        return "; ".join(
            failure.meaning if len(self.failures) == 1 else f"{failure.code}: {failure.meaning}"
            for failure in self.failures
        )
