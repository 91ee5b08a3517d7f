"""Hessians of inverse and forward dynamics as full matrices, put together from the blocks that the programs compute."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

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
    ) -> Hessian:
        """Gradient and Hessian of ``weights' tau`` with respect to (q, dq, ddq), for given weights.

        ``weights' tau(x + dx) = weights' tau + gradient' dx + dx' H dx / 2`` up to third order, x = (q, dq, ddq).
        Friction is not part of tau.

        Args:
            q: joint positions, (..., n), rad or m.
            dq: joint velocities, (..., n), rad/s or m/s.
            ddq: joint accelerations, (..., n), rad/s^2 or m/s^2.
            weights: weights of the torques, (..., n), in any unit, such as the multipliers of a solver.
            beta: base parameters, (b,) or (..., b), SI units; by default those of the robot file.
            Ia: drive inertias, (n,) or (..., n), kg m^2 or kg; by default those of the robot file.
            gravity: acceleration of gravity in the base frame, (3,) or (..., 3), m/s^2; by default the file's.

        Returns:
            The named tuple (gradient, H): (..., 3 n), and (..., 3 n, 3 n), symmetric, in SI units times the unit of
            the weights. The blocks of ddq and ddq, and of ddq and dq, are zero.
        """
        values = self._evaluate("inverse_dynamics_hessian", (q, dq, ddq, weights), beta, Ia, gravity)
        return Hessian(values[0], _symmetric(self.n, values[1:]))

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
        return self._checked(name, Hessian(gradient, _symmetric(self.n, blocks)), status, with_status)


def _symmetric(n: int, blocks: Sequence[Array]) -> Array:
    """The symmetric matrix (..., 3 n, 3 n) of the blocks of q and q, dq and q, the third argument and q, dq and dq.

    The first and the last of the ``blocks`` are upper triangles, row by row.
    """
    first, velocity, third, second = blocks
    H = np.zeros((*first.shape[:-1], 3 * n, 3 * n), first.dtype)
    upper = np.triu_indices(n)
    for start, triangle in ((0, first), (n, second)):
        rows, columns = upper[0] + start, upper[1] + start
        H[..., rows, columns] = triangle
        H[..., columns, rows] = triangle
    for start, block in ((n, velocity), (2 * n, third)):
        H[..., start : start + n, :n] = block
        H[..., :n, start : start + n] = np.swapaxes(block, -1, -2)
    return H
