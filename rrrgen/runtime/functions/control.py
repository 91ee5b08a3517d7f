"""Functions of a model for observers and passivity-based control; compiled when one of them is first called."""

from __future__ import annotations

from numpy.typing import ArrayLike

from rrrgen.runtime.functions.calls import Array, Calls
from rrrgen.runtime.results import MomentumTerms


class ControlFunctions(Calls):
    """Methods for observers and passivity-based control: momentum terms, and torques for a reference velocity."""

    def momentum_terms(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
    ) -> MomentumTerms:
        """Generalized momentum and the terms of its rate, for momentum observers: ``dp/dt = tau + ct - g``.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.

        Returns:
            The named tuple (p, ct, g), (..., n) each: ``p = M dq`` in N m s or N s, ``ct = C(q, dq)' dq`` and the
            gravity torques in N m or N.
        """
        return MomentumTerms(*self._evaluate("momentum_terms", (q, dq), beta, Ia, gravity))

    def reference_torque(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
    ) -> Array:
        """Torques ``tau = M a + C(q, dq) v + g`` of a reference motion at the measured velocity (Slotine and Li).

        C is the matrix of the Christoffel symbols, so that ``dM/dt - 2 C`` is skew-symmetric.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            v: reference velocities, (..., n), rad/s or m/s.
            a: reference accelerations, (..., n), rad/s^2 or m/s^2.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.

        Returns:
            tau, (..., n), N m or N.
        """
        return self._call_with("reference_torque", (q, dq, v, a), beta, Ia, gravity)

    def reference_regressor_transpose(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        e: ArrayLike,
        *,
        gravity: ArrayLike | None = None,
    ) -> Array:
        """Transposed regressor of :meth:`reference_torque` times a vector, ``r = Y' e``, for adaptive control.

        ``Y(q, dq, v, a) beta = M a + C(q, dq) v + g``, without drive inertia; Y is never formed.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            v: reference velocities, (..., n), rad/s or m/s.
            a: reference accelerations, (..., n), rad/s^2 or m/s^2.
            e: the vector, (..., n), in any unit, such as a tracking error of the velocities.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.

        Returns:
            r, (..., b), in SI units times the unit of ``e``.
        """
        found = self._evaluate("reference_regressor_transpose", (q, dq, v, a, e), gravity=gravity)[0]
        return self._of_links(found)
