"""The dynamic functions of a model: terms of the equation of motion, torques, accelerations, derivatives, energies.

Equation numbers (14.x) are those of Kostic, de Jager and Steinbuch, Modeling and Identification for Robot Motion
Control, chapter 14 of the Robotics and Automation Handbook (CRC Press, 2005).
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.derive.functions.friction_functions import friction_parameters, surfaces_of
from rrrgen.program import Port, Role
from rrrgen.runtime.arguments import prepare, read_only
from rrrgen.runtime.functions.calls import Array, Calls
from rrrgen.runtime.results import (
    DynamicsTerms,
    Energy,
    ForwardDynamicsDerivatives,
    FrictionStep,
    InverseDynamicsDerivatives,
)

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


class DynamicFunctions(Calls):
    """The equation of motion ``tau = M(q) ddq + c(q, dq) + g(q)`` of the rigid body with drive inertia, and its parts.

    Without ``beta`` and ``Ia`` the functions use the nominal values of the robot file, folded into the code. They raise
    ValueError if the file states no inertias and ``beta`` is not given, or if ``Ia`` is given and the file states no
    drive inertia. With ``gravity`` they are evaluated by ``any_gravity``, the model with gravity as an input, and
    ``beta`` must be its base parameters; it is compiled at the first such call.
    """

    def mass_matrix(self, q: ArrayLike, beta: ArrayLike | None = None, *, Ia: ArrayLike | None = None) -> Array:
        """Mass matrix ``M(q)``, symmetric, drive inertia included. Source: (14.7).

        Args:
            q: joint positions, (..., n), rad or m.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.

        Returns:
            M, (..., n, n), kg m^2, kg m or kg.
        """
        return self._call_with("mass_matrix", (q,), beta, Ia)

    def coriolis_matrix(self, q: ArrayLike, dq: ArrayLike, beta: ArrayLike | None = None) -> Array:
        """Coriolis matrix ``C(q, dq)`` of the Christoffel symbols: ``c = C dq``, and ``dM/dt - 2 C`` is skew-symmetric.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.

        Returns:
            C, (..., n, n), in SI units.
        """
        return self._call_with("coriolis_matrix", (q, dq), beta)

    def coriolis(self, q: ArrayLike, dq: ArrayLike, beta: ArrayLike | None = None) -> Array:
        """Coriolis and centrifugal torques ``c = C(q, dq) dq``. Source: (14.7).

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.

        Returns:
            c, (..., n), N m or N.
        """
        return self._call_with("coriolis", (q, dq), beta)

    def coriolis_transpose(self, q: ArrayLike, dq: ArrayLike, beta: ArrayLike | None = None) -> Array:
        """Transposed Coriolis matrix times dq, for momentum observers: ``d(M dq)/dt = tau + p - g``.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.

        Returns:
            ``p = C(q, dq)' dq``, (..., n), N m or N.
        """
        return self._call_with("coriolis_transpose", (q, dq), beta)

    def gravity(
        self,
        q: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        gravity: ArrayLike | None = None,
    ) -> Array:
        """Gravity torques ``g = dU/dq``: the joint torques that hold the arm still. Source: (14.7).

        Args:
            q: joint positions, (..., n), rad or m.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.

        Returns:
            g, (..., n), N m or N.
        """
        return self._call_with("gravity", (q,), beta, gravity=gravity)

    def bias(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        gravity: ArrayLike | None = None,
    ) -> Array:
        """Bias torques ``h = c(q, dq) + g(q)``: the joint torques for ddq = 0, without friction.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.

        Returns:
            h, (..., n), N m or N.
        """
        return self._call_with("bias", (q, dq), beta, gravity=gravity)

    def dynamics_terms(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
    ) -> DynamicsTerms:
        """All terms of ``tau = M ddq + c + g`` from one evaluation, cheaper than one call for each.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.

        Returns:
            The named tuple (M, c, g): (..., n, n), (..., n) and (..., n).
        """
        return DynamicsTerms(*self._evaluate("dynamics_terms", (q, dq), beta, Ia, gravity))

    def inverse_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
    ) -> Array:
        """Joint torques ``tau = M ddq + c + g`` of rigid body and drive inertia, without friction. Source: (14.6).

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            ddq: joint accelerations, (..., n), rad/s^2 or m/s^2.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.

        Returns:
            tau, (..., n), N m or N.
        """
        return self._call_with("inverse_dynamics", (q, dq, ddq), beta, Ia, gravity)

    def forward_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        tau: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        with_status: bool = False,
    ) -> Any:
        """Joint accelerations ``ddq = M^-1 (tau - c - g)``; friction is not part of it: subtract it from ``tau``.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            tau: joint torques, (..., n), N m or N.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            with_status: return ``(ddq, status)`` instead of raising LinAlgError.

        Returns:
            ddq, (..., n), rad/s^2 or m/s^2; zero where M is not positive definite. The status, (...), is 0 where M is
            positive definite and 1 elsewhere.

        Raises:
            numpy.linalg.LinAlgError: M is indefinite or singular at some state, and ``with_status`` is False.
        """
        ddq, status = self._evaluate("forward_dynamics", (q, dq, tau), beta, Ia, gravity)
        return self._checked("forward_dynamics", ddq, status, with_status)

    def inverse_dynamics_derivatives(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
    ) -> InverseDynamicsDerivatives:
        """Joint torques and their analytical derivatives, ``d tau = dtau_dq d(q) + dtau_dv d(dq) + M d(ddq)``.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            ddq: joint accelerations, (..., n), rad/s^2 or m/s^2.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.

        Returns:
            The named tuple (tau, dtau_dq, dtau_dv, M): (..., n), then three times (..., n, n), in SI units.
        """
        return InverseDynamicsDerivatives(
            *self._evaluate("inverse_dynamics_derivatives", (q, dq, ddq), beta, Ia, gravity)
        )

    def forward_dynamics_derivatives(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        tau: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        with_status: bool = False,
    ) -> Any:
        """Joint accelerations and their derivatives, ``d ddq = dddq_dq d(q) + dddq_dv d(dq) + dddq_dtau d(tau)``.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            tau: joint torques, (..., n), N m or N.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            with_status: return ``(derivatives, status)`` instead of raising LinAlgError.

        Returns:
            The named tuple (ddq, dddq_dq, dddq_dv, dddq_dtau): (..., n), then three times (..., n, n), in SI units;
            ``dddq_dtau`` is the inverse of M. All are zero where M is not positive definite; the status, (...), is 1
            there and 0 elsewhere.

        Raises:
            numpy.linalg.LinAlgError: M is indefinite or singular at some state, and ``with_status`` is False.
        """
        *values, status = self._evaluate("forward_dynamics_derivatives", (q, dq, tau), beta, Ia, gravity)
        return self._checked("forward_dynamics_derivatives", ForwardDynamicsDerivatives(*values), status, with_status)

    def energy(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
    ) -> Energy:
        """Kinetic energy ``dq' M dq / 2`` and potential energy U with ``dU/dq = g``, defined up to a constant.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.

        Returns:
            The named tuple (kinetic, potential), each (...), J.
        """
        return Energy(*self._evaluate("energy", (q, dq), beta, Ia, gravity))

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

    def _loads(self, function: str, tau_load: ArrayLike | None) -> tuple[ArrayLike, ...]:
        """``(tau_load,)`` if a friction law depends on the load, else (); ValueError if it is needed and None."""
        if all(port.name != "tau_load" for port in self.derived.programs[function].inputs):
            return ()
        if tau_load is None:
            raise ValueError(f"{function} needs tau_load: a friction law of this robot depends on the load")
        return (tau_load,)

    def friction_with(self, dq: ArrayLike, friction: ArrayLike, tau_load: ArrayLike | None = None) -> Array:
        """Friction torques under the laws of the robot file, with their parameters at run time.

        Args:
            dq: joint velocities, (..., n), rad/s or m/s.
            friction: friction parameters, (k,) or (..., k), SI units, in the order of ``friction_parameter_names``.
            tau_load: torques without friction, (..., n), N m or N; needed where a law depends on the load.

        Returns:
            tau_f, (..., n), N m or N.

        Raises:
            ValueError: a law depends on the load and ``tau_load`` is missing.
        """
        return self._call("friction_with", dq, friction, *self._loads("friction_with", tau_load))

    def smooth_friction(
        self, dq: ArrayLike, friction: ArrayLike, width: ArrayLike, tau_load: ArrayLike | None = None
    ) -> Array:
        """Friction torques as :meth:`friction_with`, with tanh(s / width) in place of sgn(s).

        Args:
            dq: joint velocities, (..., n), rad/s or m/s.
            friction: friction parameters, (k,) or (..., k), SI units, in the order of ``friction_parameter_names``.
            width: speeds below which sgn is smoothed, one for each joint and motor with friction, (s,) or (..., s),
                rad/s or m/s, or one number for all.
            tau_load: torques without friction, (..., n), N m or N; needed where a law depends on the load.

        Returns:
            tau_f, (..., n), N m or N.

        Raises:
            ValueError: a law depends on the load and ``tau_load`` is missing.
        """
        loads = self._loads("smooth_friction", tau_load)
        return self._call("smooth_friction", dq, friction, self._widths(width), *loads)

    def _widths(self, width: ArrayLike) -> Array:
        """``width`` as an array with one entry for each joint and motor with friction, rad/s or m/s."""
        wide = np.asarray(width)
        return wide if wide.ndim else np.full(len(surfaces_of(self.spec)), float(wide))

    @property
    def friction_parameter_names(self) -> tuple[str, ...]:
        """Names of the friction parameters at run time, such as q1_viscous, q1_coulomb, q1_offset."""
        return tuple(name for name, _ in friction_parameters(self.spec))

    @cached_property
    def friction_parameters(self) -> Array:
        """Friction parameters (k,) of the robot file, SI units, in the order of their names; 0 if the file has none."""
        return read_only(np.array([float(value) for _, value in friction_parameters(self.spec)]))

    def friction_step(
        self, dq: ArrayLike, z: ArrayLike, Ts: ArrayLike, tau_load: ArrayLike | None = None
    ) -> FrictionStep:
        """One period of the friction laws with a state, exact for constant dq: the next state and the torques.

        Args:
            dq: joint velocities, (..., n), rad/s or m/s.
            z: states of the laws that have one, (..., s), rad or m, zero at first: bristle deflections at those joints
                and coupled motors, in the order of the robot file.
            Ts: the period, (...), s.
            tau_load: torques without friction, (..., n), N m or N; needed where a law depends on the load.

        Returns:
            The named tuple (z_next, tau_f): the states after the period, (..., s), rad or m, and the friction torques
            of all joints, (..., n), N m or N.

        Raises:
            ValueError: no friction law of this robot has a state, or one depends on the load and ``tau_load`` is
                missing.
        """
        if "friction_step" not in self.derived.programs:
            raise ValueError("no friction law of this robot has a state: friction(dq) states it all")
        loads = self._loads("friction_step", tau_load)
        return FrictionStep(*self.engine.call("friction_step", (dq, z, Ts, *loads)))
