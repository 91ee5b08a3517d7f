"""Methods of a model for elastic joints: dynamics of links and rotors, and control laws; compiled at the first call."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rrrgen.model.drive_terms import stated_at_joints
from rrrgen.runtime.functions.calls import Array
from rrrgen.runtime.functions.laws import ControlLaws
from rrrgen.runtime.results import ElasticAccelerations, RotorMotion


class ElasticFunctions(ControlLaws):
    """Dynamics and control of a robot with elastic joints: a spring K and damper D between link q and rotor theta.

    The model is that of Spong (1987):
    ``M ddq + c + g = K (theta - q) + D (dtheta - dq) = tau - J ddtheta`` with M, c and g of the links alone. Rotor
    positions theta, torques and the rotor inertia J are referred to the joint side of the gears. J, K and D are by
    default those that the robot file states under `drive` of every joint.
    """

    def elastic_inverse_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        d3q: ArrayLike,
        d4q: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        gravity: ArrayLike | None = None,
        rotor_inertia: ArrayLike | None = None,
        stiffness: ArrayLike | None = None,
    ) -> RotorMotion:
        """Torques of the motors and motion of the rotors for a motion of the links, without damping and friction.

        ``tau = J theta'' + tau_l``, ``theta = q + tau_l/K``, with the torques tau_l of the links.

        Args:
            q: positions of the links, (..., n), rad or m.
            dq: their velocities, (..., n), rad/s or m/s.
            ddq: their accelerations, (..., n), rad/s^2 or m/s^2.
            d3q: their third derivatives, (..., n), rad/s^3 or m/s^3.
            d4q: their fourth derivatives, (..., n), rad/s^4 or m/s^4.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            rotor_inertia: inertias of the rotors, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            stiffness: stiffnesses, (n,) or (..., n), N m/rad or N/m; by default those of the robot file.

        Returns:
            The named tuple (tau, theta, dtheta), (..., n) each: torques, N m or N, positions and velocities of rotors.
        """
        values = {"q": q, "dq": dq, "ddq": ddq, "d3q": d3q, "d4q": d4q}
        values |= self._rotors(rotor_inertia, stiffness)
        return RotorMotion(*self._named("elastic_inverse_dynamics", values, beta, gravity=gravity))

    def elastic_forward_dynamics(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        theta: ArrayLike,
        dtheta: ArrayLike,
        tau: ArrayLike,
        beta: ArrayLike | None = None,
        *,
        gravity: ArrayLike | None = None,
        rotor_inertia: ArrayLike | None = None,
        stiffness: ArrayLike | None = None,
        damping: ArrayLike | None = None,
        with_status: bool = False,
    ) -> Any:
        """Accelerations of links and rotors under torques on the rotors.

        Args:
            q: positions of the links, (..., n), rad or m.
            dq: velocities of the links, (..., n), rad/s or m/s.
            theta: positions of the rotors, seen at the joints, (..., n), rad or m.
            dtheta: velocities of the rotors, (..., n), rad/s or m/s.
            tau: torques on the rotors, friction subtracted, (..., n), N m or N.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            rotor_inertia: inertias of the rotors, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            stiffness: stiffnesses, (n,) or (..., n), N m/rad or N/m; by default those of the robot file.
            damping: dampings, (n,) or (..., n), N m s/rad or N s/m; by default those of the robot file, else zero.
            with_status: return ``(result, status)`` instead of raising LinAlgError.

        Returns:
            The named tuple (ddq, ddtheta), (..., n) each, rad/s^2 or m/s^2. The status, (...), is 1 where the mass
            matrix is not positive definite; ddq is zero there.

        Raises:
            numpy.linalg.LinAlgError: the mass matrix is not positive definite, and ``with_status`` is False.
        """
        values = {"q": q, "dq": dq, "theta": theta, "dtheta": dtheta, "tau": tau}
        values |= self._rotors(rotor_inertia, stiffness) | {"damping": self._drive("damping", damping, 0.0)}
        name = "elastic_forward_dynamics"
        ddq, ddtheta, status = self._named(name, values, beta, gravity=gravity)
        return self._with(name)._checked(name, ElasticAccelerations(ddq, ddtheta), status, with_status)

    def elastic_feedforward(
        self,
        theta: ArrayLike,
        dtheta: ArrayLike,
        q_d: ArrayLike,
        dq_d: ArrayLike,
        ddq_d: ArrayLike,
        d3q_d: ArrayLike,
        d4q_d: ArrayLike,
        kp: ArrayLike,
        kd: ArrayLike,
        *,
        beta: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        rotor_inertia: ArrayLike | None = None,
        stiffness: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        width: ArrayLike,
        tau_max: ArrayLike | None = None,
    ) -> Array:
        """Feed-forward of a motion of the links, and PD control of the rotors, where the encoders are.

        ``tau = J theta_d'' + tau_l + kp (theta_d - theta) + kd (theta_d' - theta') + f(dq_d)``, where theta_d are the
        rotor positions and tau_l the torques of the links that belong to the desired motion.

        Args:
            theta: measured positions of the rotors, (..., n), rad or m.
            dtheta: measured velocities of the rotors, (..., n), rad/s or m/s.
            q_d: desired positions of the links, (..., n), rad or m.
            dq_d: desired velocities, (..., n), rad/s or m/s.
            ddq_d: desired accelerations, (..., n), rad/s^2 or m/s^2.
            d3q_d: desired third derivatives, (..., n), rad/s^3 or m/s^3.
            d4q_d: desired fourth derivatives, (..., n), rad/s^4 or m/s^4.
            kp: gains of the position error, (n,) or (..., n), N m/rad or N/m.
            kd: gains of the velocity error, (n,) or (..., n), N m s/rad or N s/m.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            rotor_inertia: inertias of the rotors, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            stiffness: stiffnesses, (n,) or (..., n), N m/rad or N/m; by default those of the robot file.
            friction: friction parameters, (k,) or (..., k), SI units; by default those of the robot file.
            width: speeds below which the sign in friction laws is smoothed, (s,), (..., s) or one number, rad/s or m/s.
            tau_max: largest torques, (n,) or (..., n), N m or N; by default the limits of the robot file.

        Returns:
            The torques to apply, (..., n), N m or N.
        """
        values = {"theta": theta, "dtheta": dtheta, "q_d": q_d, "dq_d": dq_d, "ddq_d": ddq_d, "d3q_d": d3q_d}
        values |= {"d4q_d": d4q_d, "kp": kp, "kd": kd} | self._rotors(rotor_inertia, stiffness)
        values |= self._limits_and_friction(friction, width, tau_max)
        return self._named("elastic_feedforward", values, beta, gravity=gravity)[0]

    def elastic_feedback_linearization(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        theta: ArrayLike,
        dtheta: ArrayLike,
        q_d: ArrayLike,
        dq_d: ArrayLike,
        ddq_d: ArrayLike,
        d3q_d: ArrayLike,
        d4q_d: ArrayLike,
        w: ArrayLike,
        *,
        beta: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        rotor_inertia: ArrayLike | None = None,
        stiffness: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        width: ArrayLike,
        tau_max: ArrayLike | None = None,
        with_status: bool = False,
    ) -> Any:
        """Feedback linearisation with elastic joints (Spong 1987): errors of the links decay with four poles at -w.

        Args:
            q: measured positions of the links, (..., n), rad or m.
            dq: measured velocities of the links, (..., n), rad/s or m/s.
            theta: measured positions of the rotors, (..., n), rad or m.
            dtheta: measured velocities of the rotors, (..., n), rad/s or m/s.
            q_d: desired positions of the links, (..., n), rad or m.
            dq_d: desired velocities, (..., n), rad/s or m/s.
            ddq_d: desired accelerations, (..., n), rad/s^2 or m/s^2.
            d3q_d: desired third derivatives, (..., n), rad/s^3 or m/s^3.
            d4q_d: desired fourth derivatives, (..., n), rad/s^4 or m/s^4.
            w: bandwidths of the loops, (n,) or (..., n), rad/s.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            rotor_inertia: inertias of the rotors, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            stiffness: stiffnesses, (n,) or (..., n), N m/rad or N/m; by default those of the robot file.
            friction: friction parameters, (k,) or (..., k), SI units; by default those of the robot file.
            width: speeds below which the sign in friction laws is smoothed, (s,), (..., s) or one number, rad/s or m/s.
            tau_max: largest torques, (n,) or (..., n), N m or N; by default the limits of the robot file.
            with_status: return ``(result, status)`` instead of raising LinAlgError.

        Returns:
            The torques to apply, (..., n), N m or N. The status, (...), is 1 where the mass matrix is not positive
            definite.

        Raises:
            numpy.linalg.LinAlgError: the mass matrix is not positive definite, and ``with_status`` is False.
        """
        values = {"q": q, "dq": dq, "theta": theta, "dtheta": dtheta, "q_d": q_d, "dq_d": dq_d, "ddq_d": ddq_d}
        values |= {"d3q_d": d3q_d, "d4q_d": d4q_d, "w": w} | self._rotors(rotor_inertia, stiffness)
        values |= self._limits_and_friction(friction, width, tau_max)
        name = "elastic_feedback_linearization"
        tau, status = self._named(name, values, beta, gravity=gravity)
        return self._with(name)._checked(name, tau, status, with_status)

    def _rotors(self, rotor_inertia: ArrayLike | None, stiffness: ArrayLike | None) -> dict[str, Any]:
        return {
            "rotor_inertia": self._drive("inertia", rotor_inertia),
            "stiffness": self._drive("stiffness", stiffness),
        }

    def _drive(self, key: str, given: ArrayLike | None, missing: float | None = None) -> Any:
        """Return ``given`` or, if it is None, the values ``key`` (n,) of the drives in the robot file."""
        if given is not None:
            return given
        values, absent = stated_at_joints(self.spec, key, missing)
        if absent:
            name = {"inertia": "rotor_inertia"}.get(key, key)
            raise ValueError(f"the robot file states no '{key}' under 'drive' of {', '.join(absent)}: give {name}=")
        return np.array(values)
