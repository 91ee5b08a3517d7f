"""The friction laws that compete for a recording, with inertia and gravity of the joint: names, bounds, steps.

One joint moves, the others are locked: ``J ddq = tau - gravity cos(q - angle) - tau_f``. Source: (14.15).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.arrays import Array
from rrrgen.friction.law import FrictionLaw
from rrrgen.friction.laws import LAWS, neural_law
from rrrgen.friction.models import FixedDirection

NEURAL_UNITS = 3
GRAVITY = ("gravity_cos", "gravity_sin")
"""Coefficients of cos q and sin q in the gravity torque; a prismatic joint has the former alone, a constant force."""
DELAY = "delay"
"""Lag of the motion behind the recorded torque, in sampling periods; negative where the torque was recorded late."""

Bounds = tuple[float, float]
BOUNDS: dict[str, Bounds] = {
    "inertia": (1e-9, np.inf),
    "coulomb": (0.0, np.inf),
    "viscous": (0.0, np.inf),
    "stribeck_speed": (1e-4, 50.0),
    "sigma0": (1.0, 1e9),
    "sigma1": (0.0, np.inf),
    **{f"w{k + 1}": (0.02, 2e3) for k in range(NEURAL_UNITS)},
}
LOGARITHMIC = ("inertia", "stribeck_speed", "sigma0", *(f"w{k + 1}" for k in range(NEURAL_UNITS)))
"""Parameters estimated by their logarithm: their errors are relative, and they stay positive."""


@dataclass(frozen=True)
class Candidate:
    """A law with the parameters that are estimated along with it, in the order inertia, gravity, law, delay."""

    law: FrictionLaw
    gravity: int  # 0, 1 or 2 coefficients
    left_out: tuple[str, ...] = ()  # parameters of the law held at zero

    @property
    def name(self) -> str:
        """Name of the law."""
        return self.law.name

    @property
    def law_names(self) -> tuple[str, ...]:
        """The law's parameters that are estimated."""
        return tuple(p.name for p in self.law.parameters if p.name not in self.left_out)

    @property
    def names(self) -> tuple[str, ...]:
        """All estimated parameters."""
        return ("inertia", *GRAVITY[: self.gravity], *self.law_names, DELAY)

    def law_values(self, theta: Sequence[Any] | Array) -> list[Any]:
        """The law's parameters, in its order, from all parameters ``theta``."""
        given = dict(zip(self.names, theta, strict=True))
        return [given.get(p.name, 0.0) for p in self.law.parameters]

    def torque(self, speed: Array, theta: Sequence[Any] | Array, direction: Any = None) -> Array:
        """Friction torque, in sliding where the law has a state; ``direction`` stands in for sgn(speed)."""
        sign = np.sign(speed) if direction is None else direction
        torque = self.law.torque(FixedDirection(np.asarray(sign)), speed, self.law_values(theta))
        return np.asarray(torque + 0.0 * speed)

    def gravity_torque(self, q: Array, theta: Sequence[Any] | Array) -> Array:
        """``gravity_cos cos q + gravity_sin sin q``, or a constant force."""
        if self.gravity == 2:
            return np.asarray(theta[1] * np.cos(q) + theta[2] * np.sin(q))
        return np.asarray(theta[1] + 0.0 * q) if self.gravity else 0.0 * q

    @property
    def jumps(self) -> bool:
        """Whether friction jumps at rest, so that the joint can stick."""
        return self.law.name not in ("neural", "lugre")

    @cached_property
    def is_logarithmic(self) -> NDArray[np.bool_]:
        """Which parameters are estimated by their logarithm."""
        return np.array([name in LOGARITHMIC for name in self.names])

    def to_free(self, theta: Array) -> Array:
        """Parameters (k, ..) as they are estimated: some by their logarithm."""
        free = np.array(theta, dtype=float)
        logs = self.is_logarithmic[: len(free)]
        free[logs] = np.log(free[logs])
        return free

    def from_free(self, free: Array) -> Array:
        """The inverse of :meth:`to_free` for parameters along the first axis."""
        theta = np.array(free, dtype=float)
        logs = self.is_logarithmic[: len(theta)]
        theta[logs] = np.exp(theta[logs])
        return theta

    def clipped(self, theta: Array) -> Array:
        """Parameters within their bounds."""
        bounds = [BOUNDS.get(name, (-np.inf, np.inf)) for name in self.names]
        return np.array([np.clip(v, low, high) for v, (low, high) in zip(theta, bounds, strict=True)])


def candidates(gravity: int) -> tuple[Candidate, ...]:
    """Friction laws to try, from the fewest parameters to the most.

    The asymmetric law has no torque offset: with gravity and a Coulomb level per direction it is not identifiable.
    """
    return (
        Candidate(LAWS["coulomb_viscous"], gravity, ("offset",)),
        Candidate(LAWS["asymmetric"], gravity),
        Candidate(LAWS["stribeck"], gravity),
        Candidate(LAWS["lugre"], gravity),
        Candidate(neural_law(NEURAL_UNITS), gravity),
    )
