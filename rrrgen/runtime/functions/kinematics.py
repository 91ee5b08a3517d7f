"""The kinematic functions of a model: poses, Jacobians, and the acceleration of the tip without joint accelerations."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rrrgen.runtime.functions.calls import Array, Calls
from rrrgen.runtime.results import Kinematics

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


class KinematicFunctions(Calls):
    """Poses and Jacobians. They depend on the geometry alone, so they take no parameters."""

    def forward_kinematics(self, q: ArrayLike) -> Array:
        """Pose of the tip in the base frame, ``T_0_n = base A_1 ... A_n tool``. Source: (14.5).

        Args:
            q: joint positions, (..., n), rad or m.

        Returns:
            Homogeneous transforms T, (..., 4, 4), positions in m.
        """
        return self._call("forward_kinematics", q)

    def link_frames(self, q: ArrayLike) -> Array:
        """Poses of all link frames in the base frame, ``T_0_i = base A_1 ... A_i``, without the tool.

        Args:
            q: joint positions, (..., n), rad or m.

        Returns:
            Homogeneous transforms T, (..., n, 4, 4), positions in m: ``T[..., i, :, :]`` is the frame of link i + 1.
        """
        return self._call("link_frames", q)

    def jacobian(self, q: ArrayLike) -> Array:
        """Geometric Jacobian of the tip, ``[v; w] = J(q) dq``, in the axes of the base frame.

        Args:
            q: joint positions, (..., n), rad or m.

        Returns:
            J, (..., 6, n): linear velocity v of the tip (m/s) first, then angular velocity w (rad/s).
        """
        return self._call("jacobian", q)

    def link_jacobians(self, q: ArrayLike) -> Array:
        """Geometric Jacobians of the origins of all link frames, ``[v_i; w_i] = J_i(q) dq``, in the base frame's axes.

        A wrench [f; m] at the origin of link frame i loads the joints with ``tau = J_i' [f; m]``.

        Args:
            q: joint positions, (..., n), rad or m.

        Returns:
            J, (..., n, 6, n), linear rows first: ``J[..., i, :, :]`` belongs to ``link_frames(q)[..., i, :, :]``. The
            columns of joints beyond the link are zero.
        """
        return self._call("link_jacobians", q)

    def kinematics(self, q: ArrayLike) -> Kinematics:
        """Pose and Jacobian of the tip from one evaluation, cheaper than one call for each.

        Args:
            q: joint positions, (..., n), rad or m.

        Returns:
            The named tuple (T, J): as :meth:`forward_kinematics`, (..., 4, 4), and :meth:`jacobian`, (..., 6, n).
        """
        return Kinematics(*self.engine.call("kinematics", (q,)))

    def jacobian_dot_dq(self, q: ArrayLike, dq: ArrayLike) -> Array:
        """Acceleration of the tip for ddq = 0, ``a = (dJ/dt) dq``, so that ``d[v; w]/dt = J ddq + a``.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.

        Returns:
            a, (..., 6), in the axes of the base frame: linear part (m/s^2) first, then angular (rad/s^2).
        """
        return self._call("jacobian_dot_dq", q, dq)
