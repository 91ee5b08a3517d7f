"""Control laws, the momentum observer and motions in Python; compiled when one of them is first called."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rrrgen.runtime.functions.calls import Array
from rrrgen.runtime.functions.dynamics import DynamicFunctions
from rrrgen.runtime.results import (
    AdaptiveStep,
    ControlStep,
    Motion,
    ObserverState,
    ObserverStep,
    TimedMotion,
)

TRACKING = ("q", "dq", "q_d", "dq_d", "ddq_d", "kp", "kd", "ki", "z")
"""Names of the inputs of the laws that track a desired motion: measured and desired motion, gains, integral state."""


class ControlLaws(DynamicFunctions):
    """Control laws: each method computes one control period, as the emitted C does, and stores nothing between calls.

    In the formulas ``e = q_d - q`` and ``e' = dq_d - dq``; f is the friction torque at the desired speed. Torques are
    limited to ``tau_max``; the integral z of a joint is frozen while its torque is at the limit and its error would
    drive it further (anti-windup).
    """

    def pd_gravity(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        q_d: ArrayLike,
        dq_d: ArrayLike,
        ddq_d: ArrayLike,
        kp: ArrayLike,
        kd: ArrayLike,
        ki: ArrayLike,
        z: ArrayLike,
        *,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        width: ArrayLike,
        tau_max: ArrayLike | None = None,
        Ts: ArrayLike,
    ) -> ControlStep:
        """PD control with gravity and friction compensation, ``tau = kp e + kd e' + ki z + g(q) + f(dq_d)``.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            q_d: desired positions, (..., n), rad or m.
            dq_d: desired velocities, (..., n), rad/s or m/s.
            ddq_d: desired accelerations, (..., n), rad/s^2 or m/s^2.
            kp: gains of the position error, (n,) or (..., n), N m/rad or N/m.
            kd: gains of the velocity error, (n,) or (..., n), N m s/rad or N s/m.
            ki: gains of the integral, (n,) or (..., n), N m/(rad s) or N/(m s); zero for none.
            z: state of the integral, (..., n), rad s or m s; zero at the start, then ``z_next`` of the last tick.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            friction: friction parameters, (k,) or (..., k), SI units; by default those of the robot file.
            width: speeds below which the sign in friction laws is smoothed, (s,), (..., s) or one number, rad/s or m/s.
            tau_max: largest torques, (n,) or (..., n), N m or N; by default the limits of the robot file.
            Ts: the period, (...), s.

        Returns:
            The named tuple (tau, z_next), (..., n) each: the torques to apply, and the state for the next tick.
        """
        given = self._limits_and_friction(friction, width, tau_max) | {"Ts": Ts}
        values = dict(zip(TRACKING, (q, dq, q_d, dq_d, ddq_d, kp, kd, ki, z), strict=True))
        return ControlStep(*self._named("pd_gravity", values | given, beta, Ia, gravity))

    def feedforward(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        q_d: ArrayLike,
        dq_d: ArrayLike,
        ddq_d: ArrayLike,
        kp: ArrayLike,
        kd: ArrayLike,
        ki: ArrayLike,
        z: ArrayLike,
        *,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        width: ArrayLike,
        tau_max: ArrayLike | None = None,
        Ts: ArrayLike,
    ) -> ControlStep:
        """Torques of the desired motion, ``M ddq_d + c + g`` at q_d and dq_d, with ``kp e + kd e' + ki z + f(dq_d)``.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            q_d: desired positions, (..., n), rad or m.
            dq_d: desired velocities, (..., n), rad/s or m/s.
            ddq_d: desired accelerations, (..., n), rad/s^2 or m/s^2.
            kp: gains of the position error, (n,) or (..., n), N m/rad or N/m.
            kd: gains of the velocity error, (n,) or (..., n), N m s/rad or N s/m.
            ki: gains of the integral, (n,) or (..., n), N m/(rad s) or N/(m s); zero for none.
            z: state of the integral, (..., n), rad s or m s; zero at the start, then ``z_next`` of the last tick.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            friction: friction parameters, (k,) or (..., k), SI units; by default those of the robot file.
            width: speeds below which the sign in friction laws is smoothed, (s,), (..., s) or one number, rad/s or m/s.
            tau_max: largest torques, (n,) or (..., n), N m or N; by default the limits of the robot file.
            Ts: the period, (...), s.

        Returns:
            The named tuple (tau, z_next), (..., n) each: the torques to apply, and the state for the next tick.
        """
        given = self._limits_and_friction(friction, width, tau_max) | {"Ts": Ts}
        values = dict(zip(TRACKING, (q, dq, q_d, dq_d, ddq_d, kp, kd, ki, z), strict=True))
        return ControlStep(*self._named("feedforward", values | given, beta, Ia, gravity))

    def computed_torque(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        q_d: ArrayLike,
        dq_d: ArrayLike,
        ddq_d: ArrayLike,
        kp: ArrayLike,
        kd: ArrayLike,
        ki: ArrayLike,
        z: ArrayLike,
        *,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        width: ArrayLike,
        tau_max: ArrayLike | None = None,
        Ts: ArrayLike,
    ) -> ControlStep:
        """Computed torque, ``tau = M (ddq_d + kp e + kd e' + ki z) + c + g + f(dq_d)``. Source: (14.34).

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            q_d: desired positions, (..., n), rad or m.
            dq_d: desired velocities, (..., n), rad/s or m/s.
            ddq_d: desired accelerations, (..., n), rad/s^2 or m/s^2.
            kp: gains of the position error, (n,) or (..., n), 1/s^2.
            kd: gains of the velocity error, (n,) or (..., n), 1/s.
            ki: gains of the integral, (n,) or (..., n), 1/s^3; zero for none.
            z: state of the integral, (..., n), rad s or m s; zero at the start, then ``z_next`` of the last tick.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            friction: friction parameters, (k,) or (..., k), SI units; by default those of the robot file.
            width: speeds below which the sign in friction laws is smoothed, (s,), (..., s) or one number, rad/s or m/s.
            tau_max: largest torques, (n,) or (..., n), N m or N; by default the limits of the robot file.
            Ts: the period, (...), s.

        Returns:
            The named tuple (tau, z_next), (..., n) each: the torques to apply, and the state for the next tick.
        """
        given = self._limits_and_friction(friction, width, tau_max) | {"Ts": Ts}
        values = dict(zip(TRACKING, (q, dq, q_d, dq_d, ddq_d, kp, kd, ki, z), strict=True))
        return ControlStep(*self._named("computed_torque", values | given, beta, Ia, gravity))

    def slotine_li(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        q_d: ArrayLike,
        dq_d: ArrayLike,
        ddq_d: ArrayLike,
        lam: ArrayLike,
        k: ArrayLike,
        beta: ArrayLike,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        width: ArrayLike,
        tau_max: ArrayLike | None = None,
        gamma: ArrayLike,
        beta_min: ArrayLike,
        beta_max: ArrayLike,
        Ts: ArrayLike,
    ) -> AdaptiveStep:
        """Passivity-based tracking with adaptation of the base parameters (Slotine and Li 1987).

        ``tau = M a + C(q, dq) v + g - k s + f(dq_d)`` and ``beta_next = beta - Ts gamma Y' s``, with
        ``v = dq_d + lam e``, ``a = ddq_d + lam e'``, ``s = dq - v``; beta stays as it is while a joint is at its limit.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            q_d: desired positions, (..., n), rad or m.
            dq_d: desired velocities, (..., n), rad/s or m/s.
            ddq_d: desired accelerations, (..., n), rad/s^2 or m/s^2.
            lam: bandwidth of the error on s = 0, (n,) or (..., n), 1/s.
            k: gains of s, (n,) or (..., n), N m s/rad or N s/m.
            beta: base parameters, (..., b), SI units: at the start an estimate, then ``beta_next`` of the last tick.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            friction: friction parameters, (k,) or (..., k), SI units; by default those of the robot file.
            width: speeds below which the sign in friction laws is smoothed, (s,), (..., s) or one number, rad/s or m/s.
            tau_max: largest torques, (n,) or (..., n), N m or N; by default the limits of the robot file.
            gamma: adaptation gains, (b,) or (..., b); zero for parameters to keep. Drive inertias are kept.
            beta_min: lower bounds of beta, (b,) or (..., b), SI units.
            beta_max: upper bounds of beta, (b,) or (..., b), SI units.
            Ts: the period, (...), s.

        Returns:
            The named tuple (tau, beta_next), (..., n) and (..., b).
        """
        values = {"q": q, "dq": dq, "q_d": q_d, "dq_d": dq_d, "ddq_d": ddq_d, "lam": lam, "k": k, "gamma": gamma}
        values |= {"beta_min": beta_min, "beta_max": beta_max, "Ts": Ts}
        if self.drive_inertia is not None:
            kept = np.zeros_like(self.drive_inertia)
            adapting = {"gamma": kept, "beta_min": kept - np.inf, "beta_max": kept + np.inf}
            values |= {name: self._with_drives("slotine_li", values[name], each) for name, each in adapting.items()}
        values |= self._limits_and_friction(friction, width, tau_max)
        tau, following = self._named("slotine_li", values, beta, Ia, gravity)
        return AdaptiveStep(tau, self._of_links(following))

    def impedance(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        T_d: ArrayLike,
        V_d: ArrayLike,
        stiffness: ArrayLike,
        damping: ArrayLike,
        *,
        beta: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        tau_max: ArrayLike | None = None,
    ) -> Array:
        """Impedance control of the tip, ``tau = J' (stiffness e_x + damping (V_d - J dq)) + g(q)``.

        The error e_x (6,) is that of the position (m), then the axis of the rotation from the actual to the desired
        orientation, times the sine of its angle.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            T_d: desired pose of the tip in the base frame, (..., 4, 4), translation in m.
            V_d: desired velocity of the tip, (..., 6), m/s and rad/s, base frame.
            stiffness: spring along and about the axes of the base, (6,) or (..., 6), N/m and N m/rad.
            damping: damper along and about these axes, (6,) or (..., 6), N s/m and N m s/rad.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            tau_max: largest torques, (n,) or (..., n), N m or N; by default the limits of the robot file.

        Returns:
            tau, (..., n), N m or N, within ``tau_max``.
        """
        values = {"q": q, "dq": dq, "T_d": T_d, "V_d": V_d, "stiffness": stiffness, "damping": damping}
        values["tau_max"] = self._largest_torques(tau_max)
        return self._named("impedance", values, beta, None, gravity)[0]

    def momentum_observer_start(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        *,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        width: ArrayLike,
    ) -> ObserverState:
        """Initial state of the momentum observer (:meth:`momentum_observer`) for its first period.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            friction: friction parameters, (k,) or (..., k), SI units; by default those of the robot file.
            width: speeds below which the sign in friction laws is smoothed, (s,), (..., s) or one number, rad/s or m/s.

        Returns:
            The named tuple (p, u), (..., n) each: ``p = M dq`` and ``u = C' dq - g - f(dq)``.
        """
        values = {"q": q, "dq": dq} | self._friction(friction, width)
        return ObserverState(*self._named("momentum_observer_start", values, beta, Ia, gravity))

    def momentum_observer(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        tau: ArrayLike,
        *,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        width: ArrayLike,
        p_last: ArrayLike,
        u_last: ArrayLike,
        r_last: ArrayLike,
        gain: ArrayLike,
        Ts: ArrayLike,
    ) -> ObserverStep:
        """One period of the momentum observer, which estimates the torques r that the environment exerts, low-passed.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            tau: torques applied since the last tick, (..., n), N m or N.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            friction: friction parameters, (k,) or (..., k), SI units; by default those of the robot file.
            width: speeds below which the sign in friction laws is smoothed, (s,), (..., s) or one number, rad/s or m/s.
            p_last: momentum at the last tick, (..., n), N m s or N s.
            u_last: torques u at the last tick, (..., n), N m or N.
            r_last: estimate of the last tick, (..., n), N m or N; zero at the start.
            gain: pole of the observer, (...), 1/s.
            Ts: the period, (...), s.

        Returns:
            The named tuple (r, p, u), (..., n) each: the estimate, and the state for the next tick.
        """
        values = {"q": q, "dq": dq, "tau": tau, "p_last": p_last, "u_last": u_last, "r_last": r_last}
        values |= {"gain": gain, "Ts": Ts} | self._friction(friction, width)
        return ObserverStep(*self._named("momentum_observer", values, beta, Ia, gravity))

    def quintic(
        self,
        t: ArrayLike,
        T: ArrayLike,
        q_0: ArrayLike,
        dq_0: ArrayLike,
        ddq_0: ArrayLike,
        q_1: ArrayLike,
        dq_1: ArrayLike,
        ddq_1: ArrayLike,
    ) -> Motion:
        """Motion at the time t along quintic polynomials that connect two states (position, velocity, acceleration).

        Args:
            t: time since the start, (...), s; before 0 and after T the nearer end is returned.
            T: duration, (...), s.
            q_0: positions at the start, (..., n), rad or m.
            dq_0: velocities at the start, (..., n), rad/s or m/s.
            ddq_0: accelerations at the start, (..., n), rad/s^2 or m/s^2.
            q_1: positions at the end, (..., n), rad or m.
            dq_1: velocities at the end, (..., n), rad/s or m/s.
            ddq_1: accelerations at the end, (..., n), rad/s^2 or m/s^2.

        Returns:
            The named tuple (q_d, dq_d, ddq_d), (..., n) each.
        """
        values = (t, T, q_0, dq_0, ddq_0, q_1, dq_1, ddq_1)
        return Motion(*self._with("quintic").engine.call("quintic", values))

    def trapezoidal(
        self, t: ArrayLike, q_0: ArrayLike, q_1: ArrayLike, dq_max: ArrayLike, ddq_max: ArrayLike
    ) -> TimedMotion:
        """Fastest straight motion in joint space with trapezoidal speed and all joints in phase, at the time t.

        Args:
            t: time since the start, (...), s.
            q_0: positions at the start, (..., n), rad or m.
            q_1: positions at the end, (..., n), rad or m.
            dq_max: largest speeds, (n,) or (..., n), rad/s or m/s.
            ddq_max: largest accelerations, (n,) or (..., n), rad/s^2 or m/s^2.

        Returns:
            The named tuple (q_d, dq_d, ddq_d, T): (..., n) each, and the duration, (...), s.
        """
        values = (t, q_0, q_1, dq_max, ddq_max)
        return TimedMotion(*self._with("trapezoidal").engine.call("trapezoidal", values))

    def _friction(self, friction: ArrayLike | None, width: ArrayLike) -> dict[str, Any]:
        return {"friction": self.friction_parameters if friction is None else friction, "width": self._widths(width)}

    def _limits_and_friction(
        self, friction: ArrayLike | None, width: ArrayLike, tau_max: ArrayLike | None
    ) -> dict[str, Any]:
        """Inputs for friction and torque limits by name, with the values of the robot file where None is given."""
        return self._friction(friction, width) | {"tau_max": self._largest_torques(tau_max)}

    def _largest_torques(self, tau_max: ArrayLike | None) -> ArrayLike:
        """``tau_max``, or the torque limits (n,) of the robot file if it is None."""
        limits = [joint.limits.torque for joint in self.spec.joints]
        return [float("inf") if limit is None else limit for limit in limits] if tau_max is None else tau_max
