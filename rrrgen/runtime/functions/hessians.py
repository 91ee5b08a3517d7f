"""Hessians of inverse and forward dynamics as full matrices, put together from the blocks that the programs compute."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rrrgen.derive.functions.table import STATE_FLOATING_BASE
from rrrgen.runtime.functions.calls import Array
from rrrgen.runtime.functions.table_functions import TableFunctions
from rrrgen.runtime.results import Hessian


class HessianFunctions(TableFunctions):
    """Second derivatives of the dynamics for solvers that use exact Hessians."""

    def inverse_dynamics_hessian(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        weights: ArrayLike,
        *,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        orientation: ArrayLike | None = None,
        twist: ArrayLike | None = None,
        twist_rate: ArrayLike | None = None,
    ) -> Hessian:
        """Gradient and Hessian of ``weights' tau`` with respect to (q, dq, ddq), for given weights.

        ``weights' tau(x + dx) = weights' tau + gradient' dx + dx' H dx / 2`` up to third order, x = (q, dq, ddq).
        Friction is not part of tau.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            ddq: joint accelerations, (..., n), rad/s^2 or m/s^2.
            weights: weights of the torques, (..., n), in any unit, such as the multipliers of a solver; of a floating
                base that moves, those of the wrench before them, (..., 6 + n).
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            orientation: of a floating base that moves: orientation of the base in the world, (..., 4): the unit
                quaternion x, y, z, w.
            twist: of a floating base that moves: velocity of the base origin, then angular velocity of the base,
                (..., 6), m/s and rad/s, base axes.
            twist_rate: of a floating base that moves: time derivatives of the components of the twist, (..., 6),
                m/s^2 and rad/s^2.

        Returns:
            The named tuple (gradient, H): (..., 3 n), and (..., 3 n, 3 n), symmetric, in SI units times the unit of
            the weights. The blocks of ddq and ddq, and of ddq and dq, are zero. Of a floating base that moves, what
            :meth:`floating_inverse_dynamics_hessian` returns.

        Raises:
            ValueError: a moving base is given, and what :meth:`floating_inverse_dynamics_hessian` says holds.
        """
        if orientation is not None or twist is not None or twist_rate is not None:
            return self.floating_inverse_dynamics_hessian(  # type: ignore[no-any-return]
                q, dq, ddq, weights, orientation, twist, twist_rate, beta, Ia=Ia, gravity=gravity
            )
        values = self._evaluate("inverse_dynamics_hessian", (q, dq, ddq, weights), beta, Ia, gravity)
        return Hessian(values[0], _symmetric(self.n, self.n, values[1:]))

    def floating_inverse_dynamics_hessian(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        ddq: ArrayLike,
        weights: ArrayLike,
        orientation: ArrayLike | None,
        twist: ArrayLike | None,
        twist_rate: ArrayLike | None,
        beta: ArrayLike | None = None,
        *,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        with_status: bool = False,
    ) -> Any:
        """Gradient and Hessian of ``weights' [wrench; tau]`` on a floating base, for given weights.

        The base is moved and turned along and about its own axes, as in
        :meth:`floating_inverse_dynamics_derivatives`: a rotation xi turns its orientation R to ``R exp([xi]x)``, as
        :func:`rrrgen.runtime.floating_base.integrate` does. The Hessian is that along this exponential map, which is
        symmetric; repeated derivatives by rotations are not. Friction is not part of tau.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            ddq: joint accelerations, (..., n), rad/s^2 or m/s^2.
            weights: weights of force and moment on the base, then of the torques, (..., 6 + n), in any unit, such as
                the multipliers of a solver.
            orientation: orientation of the base in the world, (..., 4): the unit quaternion x, y, z, w.
            twist: velocity of the base origin, then angular velocity of the base, (..., 6), m/s and rad/s, base axes.
            twist_rate: time derivatives of the components of the twist, (..., 6), m/s^2 and rad/s^2.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in world axes, (3,) or (..., 3), m/s^2; by default the file's.
            with_status: return ``(result, status)`` instead of raising ValueError.

        Returns:
            The named tuple (gradient, H): (..., 3 (6 + n)), and (..., 3 (6 + n), 3 (6 + n)), symmetric, in SI units
            times the unit of the weights: by translation and rotation of the base and q, then by twist and dq, then by
            twist_rate and ddq. The elements of the translation are zero. The status, (...), is 2 where the orientation
            is no unit quaternion and 0 elsewhere.

        Raises:
            ValueError: the robot file states no floating base, or the orientation is no unit quaternion (its norm is
                off by more than 1e-6, status 2) and ``with_status`` is False.
        """
        name = "floating_inverse_dynamics_hessian"
        if not self.spec.floating_base:
            raise ValueError(STATE_FLOATING_BASE)
        values = (q, dq, ddq, weights, orientation, twist, twist_rate)
        gradient, *blocks, status = self._evaluate(name, values, beta, Ia, gravity)
        return self._check_status(name, Hessian(gradient, _symmetric(6 + self.n, self.n, blocks)), status, with_status)

    def forward_dynamics_hessian(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        tau: ArrayLike,
        weights: ArrayLike,
        *,
        beta: ArrayLike | None = None,
        Ia: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        with_status: bool = False,
    ) -> Any:
        """Gradient and Hessian of ``weights' ddq`` with respect to (q, dq, tau), for given weights.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            tau: joint torques, friction subtracted, (..., n), N m or N.
            weights: weights of the accelerations, (..., n), in any unit, such as the multipliers of a solver.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.
            with_status: return ``(result, status)`` instead of raising LinAlgError.

        Returns:
            The named tuple (gradient, H): (..., 3 n), and (..., 3 n, 3 n), symmetric, in SI units times the unit of
            the weights; zero where M is not positive definite. The blocks of tau and tau, and of tau and dq, are zero.
            The status, (...), is 1 where M is not positive definite and 0 elsewhere.

        Raises:
            numpy.linalg.LinAlgError: M is indefinite or singular at some state, and ``with_status`` is False.
        """
        name = "forward_dynamics_hessian"
        gradient, *blocks, status = self._evaluate(name, (q, dq, tau, weights), beta, Ia, gravity)
        return self._check_status(name, Hessian(gradient, _symmetric(self.n, self.n, blocks)), status, with_status)


def _symmetric(size: int, n: int, blocks: Sequence[Array]) -> Array:
    """The symmetric matrix (..., 3 size, 3 size) of its blocks by x and x, v and q, a and q, v and v.

    x, v and a have ``size`` elements, of which the last ones of x are q (n,). The first and the last of the ``blocks``
    are upper triangles, row by row; the first may lack elements of x before q.
    """
    first, velocity, third, second = blocks
    H = np.zeros((*first.shape[:-1], 3 * size, 3 * size), first.dtype)
    moved = (math.isqrt(8 * first.shape[-1] + 1) - 1) // 2
    for start, count, triangle in ((size - moved, moved, first), (size, size, second)):
        rows, columns = (places + start for places in np.triu_indices(count))
        H[..., rows, columns] = triangle
        H[..., columns, rows] = triangle
    for start, block in ((size, velocity), (2 * size, third)):
        H[..., start : start + size, size - n : size] = block
        H[..., size - n : size, start : start + size] = np.swapaxes(block, -1, -2)
    return H
