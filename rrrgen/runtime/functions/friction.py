"""Friction as the robot file states it: torques, zero where it states none, and the parameters at run time."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from rrrgen.derive.functions.friction import friction_parameters
from rrrgen.program import Port, Role
from rrrgen.runtime.arguments import prepare, read_only
from rrrgen.runtime.functions.calls import Array
from rrrgen.runtime.functions.table_functions import TableFunctions


class FrictionFunctions(TableFunctions):
    """Friction of the robot file, and its parameters."""

    def friction(self, dq: ArrayLike, tau_load: ArrayLike | None = None) -> Array:
        """Friction torques of the laws of the robot file, such as ``tau_f = fv dq + fc sgn(dq) + offset``.

        They add to the torques of the rigid body. Laws with a state are taken in steady sliding. Coupled motors add
        ``S^-T tau_fm(S^-1 dq)``, the laws at their shafts. Source: (14.11)-(14.14).

        Args:
            dq: joint velocities, (..., n), rad/s or m/s.
            tau_load: torques without friction, (..., n), N m or N, as of :meth:`inverse_dynamics`; needed where a law
                depends on the load.

        Returns:
            tau_f, (..., n), N m or N; zero where the file states no friction.

        Raises:
            ValueError: a law depends on the load and ``tau_load`` is missing.
        """
        if "friction" in self.derived.programs:
            return self._call("friction", dq, *self._loads("friction", tau_load))
        port = Port("dq", (self.n,), meaning="joint velocities", role=Role.VELOCITY)
        return np.zeros_like(prepare("friction", [port], [dq], self.engine.dtype)[1][0])

    @property
    def friction_parameter_names(self) -> tuple[str, ...]:
        """Names of the friction parameters at run time, such as q1_viscous, q1_coulomb, q1_offset."""
        return tuple(name for name, _ in friction_parameters(self.spec))

    @cached_property
    def friction_parameters(self) -> Array:
        """Friction parameters (k,) of the robot file, SI units, in the order of their names; 0 if the file has none."""
        return read_only(np.array([float(value) for _, value in friction_parameters(self.spec)]))
