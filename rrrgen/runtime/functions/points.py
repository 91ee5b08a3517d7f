"""Kinematics of a model at any link frame or point; compiled when one of these functions is first called."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from numpy.typing import ArrayLike

from rrrgen.runtime.functions.calls import Array, Calls
from rrrgen.runtime.results import Kinematics, Manipulability, PointMotion


class PointFunctions(Calls):
    """Velocities, Jacobians and wrenches at any link frame or point, tools at run time, null space, manipulability.

    A point is fixed to a frame with pose T and Jacobian J: ``T = m.link_frames(q)[..., i, :, :]`` and
    ``J = m.link_jacobians(q)[..., i, :, :]`` of link i (from 0), or those of the tip.
    """

    def link_velocities(self, q: ArrayLike, dq: ArrayLike) -> Array:
        """Velocities of all link frames in the base frame, ``[v_i; omega_i] = J_i(q) dq``.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.

        Returns:
            V, (..., n, 6): linear, m/s, then angular, rad/s.
        """
        return self._points("link_velocities", q, dq)[0]

    def link_jacobians_dot_dq(self, q: ArrayLike, dq: ArrayLike) -> Array:
        """Time derivatives of the Jacobians of all link frames times dq: the accelerations of the frames for ddq = 0.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.

        Returns:
            A, (..., n, 6): linear, m/s^2, then angular, rad/s^2, in the base frame.
        """
        return self._points("link_jacobians_dot_dq", q, dq)[0]

    def point_jacobian(self, T: ArrayLike, J: ArrayLike, point: ArrayLike) -> Array:
        """Geometric Jacobian of a point that is fixed to a frame: ``[v_p; omega] = J_p dq``.

        Args:
            T: pose of the frame, (..., 4, 4), translation in m.
            J: its Jacobian, (..., 6, n), base frame, linear rows first.
            point: the point in that frame, (..., 3), m.

        Returns:
            J_p, (..., 6, n), base frame, linear rows first.
        """
        return self._points("point_jacobian", T, J, point)[0]

    def point_motion(self, T: ArrayLike, V: ArrayLike, A: ArrayLike, point: ArrayLike) -> PointMotion:
        """Velocity and acceleration of a point that is fixed to a frame.

        Args:
            T: pose of the frame, (..., 4, 4), translation in m.
            V: its velocity, (..., 6), linear part first, m/s and rad/s, such as ``link_velocities(q, dq)[..., i, :]``.
            A: its acceleration, (..., 6), m/s^2 and rad/s^2. If only its part (dJ/dt) dq is given, A_p is that part for
                the point.
            point: the point in that frame, (..., 3), m.

        Returns:
            The named tuple (V_p, A_p), (..., 6) each, in the base frame.
        """
        return PointMotion(*self._points("point_motion", T, V, A, point))

    def wrench_torques(self, J: ArrayLike, F: ArrayLike) -> Array:
        """Joint torques ``tau = J' F`` of a wrench: if F acts on the robot, ``M ddq + c + g = tau_m + J' F``.

        Args:
            J: Jacobian of the frame or point at which the wrench acts, (..., 6, n).
            F: force and moment about that point, (..., 6), N and N m, in base axes.

        Returns:
            tau, (..., n), N m or N.
        """
        return self._points("wrench_torques", J, F)[0]

    def tool_kinematics(self, q: ArrayLike, tool: ArrayLike) -> Kinematics:
        """Pose and Jacobian of a tool in place of that of the robot file.

        Args:
            q: joint positions, (..., n), rad or m.
            tool: pose of the tool in the last link frame, (4, 4) or (..., 4, 4), translation in m.

        Returns:
            The named tuple (T, J): (..., 4, 4) and (..., 6, n), base frame.
        """
        return Kinematics(*self._points("tool_kinematics", q, tool))

    def tool_target(self, T: ArrayLike, tool: ArrayLike) -> Array:
        """Target of ``inverse_kinematics`` for which a tool in place of that of the robot file has the pose T.

        Args:
            T: wanted pose of the tool in the base frame, (..., 4, 4), translation in m.
            tool: pose of the tool in the last link frame, (4, 4) or (..., 4, 4), translation in m.

        Returns:
            target, (..., 4, 4), translation in m: ``T tool^-1 T_tool`` with the tool T_tool of the robot file.
        """
        return self._points("tool_target", T, tool)[0]

    def manipulability(self, q: ArrayLike, with_status: bool = False) -> Any:
        """Manipulability ``w = sqrt(det(J J'))`` (of ``J' J`` for fewer than six joints) and its gradient.

        Args:
            q: joint positions, (..., n), rad or m.
            with_status: return ``(result, status)`` instead of raising LinAlgError.

        Returns:
            The named tuple (w, dw_dq): (...) and (..., n); zero where J loses rank, and the status, (...), is 1 there.

        Raises:
            numpy.linalg.LinAlgError: J loses rank at some state, and ``with_status`` is False.
        """
        return self._manipulability("manipulability", q, with_status)

    def position_manipulability(self, q: ArrayLike, with_status: bool = False) -> Any:
        """Manipulability of the position of the tip alone, from the three linear rows of J.

        Args:
            q: joint positions, (..., n), rad or m.
            with_status: return ``(result, status)`` instead of raising LinAlgError.

        Returns:
            The named tuple (w, dw_dq): (...) and (..., n).

        Raises:
            numpy.linalg.LinAlgError: J loses rank at some state, and ``with_status`` is False.
        """
        return self._manipulability("position_manipulability", q, with_status)

    def nullspace(self, q: ArrayLike, damping: ArrayLike = 0.0, with_status: bool = False) -> Any:
        """Projection ``N = 1 - J' (J J' + damping^2 1)^-1 J`` on joint motions that keep the pose of the tip.

        Args:
            q: joint positions, (..., n), rad or m.
            damping: 0 projects exactly; larger values keep N smooth through singularities.
            with_status: return ``(N, status)`` instead of raising LinAlgError.

        Returns:
            N, (..., n, n); the unit matrix where J loses rank and damping is 0, and the status, (...), is 1 there.

        Raises:
            numpy.linalg.LinAlgError: J loses rank at some state, damping is 0, and ``with_status`` is False.
            ValueError: the robot has six joints or fewer.
        """
        return self._nullspace("nullspace", q, damping, with_status)

    def position_nullspace(self, q: ArrayLike, damping: ArrayLike = 0.0, with_status: bool = False) -> Any:
        """Projection N on joint motions that keep the position of the tip, while its orientation may change.

        Args:
            q: joint positions, (..., n), rad or m.
            damping: 0 projects exactly; larger values keep N smooth through singularities.
            with_status: return ``(N, status)`` instead of raising LinAlgError.

        Returns:
            N, (..., n, n).

        Raises:
            numpy.linalg.LinAlgError: J loses rank at some state, damping is 0, and ``with_status`` is False.
            ValueError: the robot has three joints or fewer.
        """
        return self._nullspace("position_nullspace", q, damping, with_status)

    def _points(self, name: str, *values: ArrayLike) -> Sequence[Array]:
        return self._with(name).engine.call(name, values)

    def _manipulability(self, name: str, q: ArrayLike, with_status: bool) -> Any:
        w, gradient, status = self._points(name, q)
        return self._with(name)._checked(name, Manipulability(w, gradient), status, with_status)

    def _nullspace(self, name: str, q: ArrayLike, damping: ArrayLike, with_status: bool) -> Any:
        N, status = self._points(name, q, damping)
        return self._with(name)._checked(name, N, status, with_status)
