"""The friction laws that are fitted to a recording of one joint, with its inertia and gravity: names and bounds.

One joint moves, the others are locked: ``J ddq = tau - gravity cos(q - angle) - tau_f``. Source: (14.15) of Kostic, de
Jager, Steinbuch, Robotics and Automation Handbook, CRC Press 2005, chapter 14.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.robot.friction.laws import LAWS, FrictionLaw, neural_law
from rrrgen.robot.friction.models import FixedDirection

NEURAL_UNITS = 3
GRAVITY = ("gravity_cos", "gravity_sin", "gravity_constant")
"""Coefficients of cos q, sin q and 1 in the load; a prismatic joint has the first alone, as a constant force."""
DELAY = "delay"
"""Delay of the motion behind the recorded torque, in sampling periods; negative if the torque was recorded late."""

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
"""Parameters whose logarithm is estimated: so they stay positive, and their errors are relative."""


@dataclass(frozen=True)
class Candidate:
    """Model of one joint that is fitted to a recording: a friction ``law`` with inertia, gravity and a time delay.

    The parameters theta (k,) are the inertia (kg m^2 or kg), the ``gravity`` coefficients (0 to 3), the parameters of
    the law except those in ``left_out``, which are zero, and the delay in sampling periods. The third gravity
    coefficient is an offset of the torque, as is, with ``offset``, the only one at a joint without gravity.
    """

    law: FrictionLaw
    gravity: int
    left_out: tuple[str, ...] = ()
    offset: bool = False

    @property
    def constant(self) -> str:
        """Name under which a constant torque is reported."""
        return "offset" if self.offset or self.gravity == 3 else "gravity"

    @property
    def constant_coefficient(self) -> str | None:
        """Name of the estimated parameter that is a constant torque, None without one."""
        return {1: "gravity_cos", 3: "gravity_constant"}.get(self.gravity)

    @property
    def equation(self) -> str:
        """Equation of motion of the joint, as text."""
        load = {0: "", 1: f" - {self.constant}", 2: " - gravity cos(q - gravity_angle)"}[min(self.gravity, 2)]
        load += " - offset" if self.gravity == 3 else ""
        return f"J ddq = tau{load} - tau_f; {self.law.formula}"

    @property
    def name(self) -> str:
        """Name of the friction law."""
        return self.law.name

    @property
    def law_names(self) -> tuple[str, ...]:
        """Names of the law's parameters that are estimated."""
        return tuple(p.name for p in self.law.parameters if p.name not in self.left_out)

    @property
    def names(self) -> tuple[str, ...]:
        """Names (k,) of all estimated parameters: inertia, gravity, law, delay."""
        return ("inertia", *GRAVITY[: self.gravity], *self.law_names, DELAY)

    def law_values(self, theta: Sequence[Any] | Array) -> list[Any]:
        """Values of all parameters of the law, in its order, taken from ``theta`` (k,); those left out are 0."""
        given = dict(zip(self.names, theta, strict=True))
        return [given.get(p.name, 0) for p in self.law.parameters]

    def torque(self, speed: Array, theta: Sequence[Any] | Array, direction: Any = None) -> Array:
        """Friction torque (N,), N m (N), at ``speed`` (N,), rad/s (m/s), for the parameters ``theta`` (k,).

        ``direction`` (-1 or +1, or an array (N,)) replaces sgn(speed). A law with a state is evaluated in steady
        sliding.
        """
        sign = np.sign(speed) if direction is None else direction
        torque = self.law.torque(FixedDirection(np.asarray(sign)), speed, self.law_values(theta))
        return np.asarray(torque + 0.0 * speed)

    def gravity_torque(self, q: Any, theta: Sequence[Any] | Array, ops: Any = np) -> Any:
        """Gravity torque, N m (N), at the positions ``q``: ``gravity_cos cos q + gravity_sin sin q``, same shape as q.

        A third coefficient is added to it. It is the constant ``gravity_cos`` with one coefficient, as at a prismatic
        joint, and 0 with none. ``ops`` supplies ``cos`` and ``sin`` for NumPy or a program builder.
        """
        if self.gravity >= 2:
            torque = theta[1] * ops.cos(q) + theta[2] * ops.sin(q)
            return torque + theta[3] if self.gravity == 3 else torque
        return theta[1] + 0 * q if self.gravity else 0 * q

    @property
    def jumps(self) -> bool:
        """Whether the friction torque is discontinuous at zero speed, so that the joint can stick."""
        return self.law.name not in ("neural", "lugre")

    @property
    def has_bristles(self) -> bool:
        """Whether the law has a state: the deflection of bristles."""
        return self.law.rate is not None

    @cached_property
    def is_logarithmic(self) -> NDArray[np.bool_]:
        """Mask (k,) of the parameters whose logarithm is estimated."""
        return np.array([name in LOGARITHMIC for name in self.names])

    def to_free(self, theta: Array) -> Array:
        """Convert parameters ``theta`` (k, ...) to the optimizer's variables: some are replaced by their logarithm."""
        free = np.array(theta, dtype=float)
        logs = self.is_logarithmic[: len(free)]
        free[logs] = np.log(free[logs])
        return free

    def from_free(self, free: Array) -> Array:
        """Convert the optimizer's variables ``free`` (k, ...) back to parameters; the inverse of :meth:`to_free`."""
        theta = np.array(free, dtype=float)
        logs = self.is_logarithmic[: len(theta)]
        theta[logs] = np.exp(theta[logs])
        return theta

    def balance_coulomb(self, theta: Array) -> Array:
        """The parameters ``theta`` (k,), with equal Coulomb torques of both directions where these are a convention.

        Beside a constant force, as at a prismatic joint, only their sums with it can be estimated.
        """
        if self.gravity != 1 or self.name != "asymmetric":
            return theta
        parameters, (up, down) = theta.copy(), (self.names.index(name) for name in ("coulomb_p", "coulomb_n"))
        mean = 0.5 * (theta[up] + theta[down])
        parameters[1] += theta[up] - mean
        parameters[up] = parameters[down] = mean
        return parameters

    def clip(self, theta: Array) -> Array:
        """The parameters ``theta`` (k,), each moved to the nearest value within its bounds."""
        bounds = [BOUNDS.get(name, (-np.inf, np.inf)) for name in self.names]
        return np.array([np.clip(v, low, high) for v, (low, high) in zip(theta, bounds, strict=True)])


def candidates(gravity: int, wide: bool = False) -> tuple[Candidate, ...]:
    """The models to fit, from the fewest parameters to the most.

    Each has ``gravity`` (0, 1 or 2) gravity coefficients. Where gravity does not act, an offset of the measured torque
    takes its place: a symmetric law could not explain it otherwise. Beside the gravity of a revolute joint whose motion
    is ``wide`` enough to tell the two apart, all laws but the asymmetric one have an offset, which is not identifiable
    beside a Coulomb torque for each direction.
    """
    offset = gravity == 0
    curved = 3 if gravity == 2 and wide else max(gravity, 1)
    return (
        Candidate(LAWS["coulomb_viscous"], curved, ("offset",), offset),
        Candidate(LAWS["asymmetric"], gravity),
        Candidate(LAWS["stribeck"], curved, (), offset),
        Candidate(LAWS["lugre"], curved, (), offset),
        Candidate(neural_law(NEURAL_UNITS), curved, (), offset),
    )
