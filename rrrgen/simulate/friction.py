"""What the virtual robot asks of a friction model; :class:`rrrgen.friction.models.FrictionModel` fits."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

SMOOTH_WIDTH = 1e-3
"""rad/s (m/s): sgn(x) becomes tanh(x/width) where a stiff solver integrates through it."""


class FrictionLike(Protocol):
    """A friction model of n joints, see (14.11)-(14.14)."""

    @property
    def has_state(self) -> bool:
        """Whether there is a bristle deflection z per joint."""
        ...

    def torque(self, dq: Array, width: float = 0.0) -> Array:
        """Torque at the speeds ``dq``, sgn smoothed over ``width``."""
        ...

    def directed(self, dq: Array, direction: Array) -> Array:
        """Torque with sgn(dq) replaced by ``direction``."""
        ...

    def rate(self, z: Array, dq: Array) -> Array:
        """dz/dt."""
        ...

    def state_torque(self, z: Array, dq: Array) -> Array:
        """Torque in the state z."""
        ...


class Friction:
    """Friction as the integrators use it."""

    def __init__(self, model: FrictionLike, width: float = SMOOTH_WIDTH) -> None:
        self.model = model
        self.width = width
        self.has_state = model.has_state
        self.directed = model.directed
        self.rate = model.rate
        self.state_torque = model.state_torque

    def smooth_torque(self, dq: Array) -> Array:
        """The torque with sgn(x) replaced by tanh(x/width)."""
        return self.model.torque(dq, self.width)


class NoFriction(Friction):
    """None at all."""

    def __init__(self, n: int) -> None:
        super().__init__(_Frictionless(n))


class _Frictionless:
    has_state = False

    def __init__(self, n: int) -> None:
        self.zero = np.zeros(n)

    def torque(self, dq: Array, width: float = 0.0) -> Array:
        return self.zero

    def directed(self, dq: Array, direction: Array) -> Array:
        return self.zero

    def rate(self, z: Array, dq: Array) -> Array:
        return self.zero

    def state_torque(self, z: Array, dq: Array) -> Array:
        return self.zero
