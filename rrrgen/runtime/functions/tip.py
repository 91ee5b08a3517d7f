"""Operational-space control and contact detection in Python; compiled when one of them is first called."""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from rrrgen.runtime.functions.laws import ControlLaws
from rrrgen.runtime.results import Contact, ExternalLoad, OperationalStep


class TipFunctions(ControlLaws):
    """Operational-space control of the tip, and contact detection from estimated external torques."""

    def operational_space(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        T_d: ArrayLike,
        V_d: ArrayLike,
        A_d: ArrayLike,
        kp: ArrayLike,
        kd: ArrayLike,
        ki: ArrayLike,
        z: ArrayLike,
        tau_0: ArrayLike,
        damping: ArrayLike,
        *,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        tau_add: ArrayLike,
        tau_max: ArrayLike | None = None,
        Ts: ArrayLike,
        with_status: bool = False,
    ) -> Any:
        """Operational-space control of the pose of the tip (Khatib 1987), damped near singular configurations.

        ``tau = J' L (a - (dJ/dt) dq - J inv(M) tau_0) + c + g + tau_0 + tau_add`` with ``L = inv(J inv(M) J')`` and ``a
        = A_d + kp e_x + kd (V_d - J dq) + ki z``. The error e_x (6,) is that of the position (m), then the axis of the
        rotation from the actual to the desired orientation, times the sine of its angle.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            T_d: desired pose of the tip in the base frame, (..., 4, 4), translation in m.
            V_d: desired velocity of the tip, (..., 6), m/s and rad/s, base frame.
            A_d: desired acceleration of the tip, (..., 6), m/s^2 and rad/s^2, base frame.
            kp: gains of the error of the tip, (6,) or (..., 6), 1/s^2.
            kd: gains of the error of its velocity, (6,) or (..., 6), 1/s.
            ki: gains of the integral, (6,) or (..., 6), 1/s^3; zero for none.
            z: state of the integral, (..., 6); zero at the start, then ``z_next`` of the last tick.
            tau_0: torques of a second task that must not move the tip, (..., n), N m or N; zero for none.
            damping: share, such as 0.01, of the mean diagonal entry of J inv(M) J' below which its pivots are damped.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            tau_add: torques to add before the limits, (..., n), N m or N, such as friction at the desired speeds.
            tau_max: largest torques, (n,) or (..., n), N m or N; by default the limits of the robot file.
            Ts: the period, (...), s.
            with_status: return ``(result, status)`` instead of raising LinAlgError.

        Returns:
            The named tuple (tau, z_next), (..., n) and (..., 6): torques to apply and the state for the next tick.
            The status, (...), is 1 where damping acts; the tip then follows only where it can move.

        Raises:
            numpy.linalg.LinAlgError: damping acts at some state, and ``with_status`` is False.
            ValueError: the robot has fewer than six joints.
        """
        values = {"q": q, "dq": dq, "T_d": T_d, "V_d": V_d, "A_d": A_d, "kp": kp, "kd": kd, "ki": ki, "z": z}
        values |= {"tau_0": tau_0, "damping": damping, "tau_add": tau_add, "Ts": Ts}
        return self._operational("operational_space", values, beta, Ia, gravity, tau_max, with_status)

    def position_operational_space(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        p_d: ArrayLike,
        V_d: ArrayLike,
        A_d: ArrayLike,
        kp: ArrayLike,
        kd: ArrayLike,
        ki: ArrayLike,
        z: ArrayLike,
        tau_0: ArrayLike,
        damping: ArrayLike,
        *,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        tau_add: ArrayLike,
        tau_max: ArrayLike | None = None,
        Ts: ArrayLike,
        with_status: bool = False,
    ) -> Any:
        """Operational-space control of the position of the tip (Khatib 1987), damped near singular configurations.

        ``tau = J' L (a - (dJ/dt) dq - J inv(M) tau_0) + c + g + tau_0 + tau_add`` with ``L = inv(J inv(M) J')`` and ``a
        = A_d + kp e_x + kd (V_d - J dq) + ki z``, J the first three rows of the Jacobian, e_x the position error (m).

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            p_d: desired position of the tip in the base frame, (..., 3), m.
            V_d: desired velocity of the tip, (..., 3), m/s, base frame.
            A_d: desired acceleration of the tip, (..., 3), m/s^2, base frame.
            kp: gains of the error of the tip, (3,) or (..., 3), 1/s^2.
            kd: gains of the error of its velocity, (3,) or (..., 3), 1/s.
            ki: gains of the integral, (3,) or (..., 3), 1/s^3; zero for none.
            z: state of the integral, (..., 3); zero at the start, then ``z_next`` of the last tick.
            tau_0: torques of a second task that must not move the tip, (..., n), N m or N; zero for none.
            damping: share, such as 0.01, of the mean diagonal entry of J inv(M) J' below which its pivots are damped.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            tau_add: torques to add before the limits, (..., n), N m or N, such as friction at the desired speeds.
            tau_max: largest torques, (n,) or (..., n), N m or N; by default the limits of the robot file.
            Ts: the period, (...), s.
            with_status: return ``(result, status)`` instead of raising LinAlgError.

        Returns:
            The named tuple (tau, z_next), (..., n) and (..., 3): torques to apply and the state for the next tick.
            The status, (...), is 1 where damping acts; the tip then follows only where it can move.

        Raises:
            numpy.linalg.LinAlgError: damping acts at some state, and ``with_status`` is False.
            ValueError: the robot has fewer than three joints.
        """
        values = {"q": q, "dq": dq, "p_d": p_d, "V_d": V_d, "A_d": A_d, "kp": kp, "kd": kd, "ki": ki, "z": z}
        values |= {"tau_0": tau_0, "damping": damping, "tau_add": tau_add, "Ts": Ts}
        return self._operational("position_operational_space", values, beta, Ia, gravity, tau_max, with_status)

    def _operational(
        self, name: str, values: dict[str, Any], beta: Any, Ia: Any, gravity: Any, tau_max: Any, with_status: bool
    ) -> Any:
        values["tau_max"] = self._largest_torques(tau_max)
        tau, z_next, status = self._named(name, values, beta, Ia, gravity)
        return self._with(name)._checked(name, OperationalStep(tau, z_next), status, with_status)

    def contact(
        self,
        r: ArrayLike,
        r_last: ArrayLike,
        change_last: ArrayLike,
        gain: ArrayLike,
        Ts: ArrayLike,
        threshold: ArrayLike,
        change_threshold: ArrayLike,
    ) -> Contact:
        """One period of contact detection: compare estimated external torques and their changes with thresholds.

        The change ``h = alpha^2 change_last + alpha (r - r_last)``, alpha = exp(-gain Ts), is what an observer with
        twice the pole would estimate, minus r: a contact shows in it although the model errors in r are larger.

        Args:
            r: estimated torques of the environment, (..., n), N m or N, of :meth:`momentum_observer`.
            r_last: those of the last tick, (..., n), N m or N; zero at the start.
            change_last: change of the last tick, (..., n), N m or N; zero at the start.
            gain: pole of the momentum observer, (...), 1/s.
            Ts: the period, (...), s.
            threshold: thresholds of r, (n,) or (..., n), N m or N, of ``rrrgen contact-thresholds``; inf for none.
            change_threshold: thresholds of the change, (n,) or (..., n), N m or N, of the same command; inf for none.

        Returns:
            The named tuple (ratio, touches, change): the larger of ``|r|/threshold`` and ``|h|/change_threshold``,
            (..., n), 1 where one of them exceeds 1, (...), and the change h for the next tick, (..., n).
        """
        values = (r, r_last, change_last, gain, Ts, threshold, change_threshold)
        return Contact(*self._evaluate("contact", values))

    def external_wrench(self, J: ArrayLike, r: ArrayLike, covariance: ArrayLike, with_status: bool = False) -> Any:
        """Estimate the wrench F on the robot that causes the external torques r: ``F = P J inv(S) r``.

        It is a weighted least-squares estimate: ``P = inv(J inv(S) J')`` with the covariance S of the errors of r and
        the Jacobian J of the point where the wrench acts.

        Args:
            J: Jacobian of the tip or of the point where it acts, (..., 6, n), linear rows first, SI units.
            r: estimated torques of the environment, (..., n), N m or N, of :meth:`momentum_observer`.
            covariance: of the errors of r, (n, n) or (..., n, n), (N m)^2 or N^2, of ``rrrgen contact-thresholds``.
            with_status: return ``(result, status)`` instead of raising LinAlgError.

        Returns:
            The named tuple (F, P, condition): the wrench in base axes, (..., 6), N and N m, its covariance,
            (..., 6, 6), and a condition number, (...), that is 1 at best and large near singular configurations.

        Raises:
            numpy.linalg.LinAlgError: the torques do not determine it at some state, and ``with_status`` is False.
            ValueError: the robot has fewer than six joints.
        """
        return self._load("external_wrench", J, r, covariance, with_status)

    def external_force(self, J: ArrayLike, r: ArrayLike, covariance: ArrayLike, with_status: bool = False) -> Any:
        """Estimate the force F, without a moment, that causes the external torques r: ``F = P J inv(S) r``.

        It is a weighted least-squares estimate: ``P = inv(J inv(S) J')`` with the covariance S of the errors of r and J
        the first three rows of the Jacobian of the point where the force acts.

        Args:
            J: Jacobian of the tip or of the point where it acts, (..., 6, n), linear rows first, SI units.
            r: estimated torques of the environment, (..., n), N m or N, of :meth:`momentum_observer`.
            covariance: of the errors of r, (n, n) or (..., n, n), (N m)^2 or N^2, of ``rrrgen contact-thresholds``.
            with_status: return ``(result, status)`` instead of raising LinAlgError.

        Returns:
            The named tuple (F, P, condition): the force in base axes, (..., 3), N, its covariance,
            (..., 3, 3), and a condition number, (...), that is 1 at best and large near singular configurations.

        Raises:
            numpy.linalg.LinAlgError: the torques do not determine it at some state, and ``with_status`` is False.
            ValueError: the robot has fewer than three joints.
        """
        return self._load("external_force", J, r, covariance, with_status)

    def _load(self, name: str, J: ArrayLike, r: ArrayLike, covariance: ArrayLike, with_status: bool) -> Any:
        *found, status = self._evaluate(name, (J, r, covariance))
        return self._with(name)._checked(name, ExternalLoad(*found), status, with_status)
