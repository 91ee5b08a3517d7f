"""Closed form against recursive inverse kinematics along a path: the check of section 14.6.3, Fig. 14.7.

The recursive solver goes from point to point by Newton's method on its own forward kinematics (the chain in floats), so
the two share no equations.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.errors import DerivationError
from rrrgen.runtime.inverse_kinematics import InverseKinematics

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

NEWTON_TOLERANCE = 1e-14
"""Task error (m, rad) at which Newton's method stops; round-off of the forward kinematics is of this size."""

ITERATIONS = 40


@dataclass(frozen=True)
class Comparison:
    """Both joint paths (m, n) along the targets at times ``t`` (m,), and their difference, closed minus recursive."""

    t: NDArray[np.float64]
    closed: NDArray[np.float64]
    recursive: NDArray[np.float64]
    branch: int

    @property
    def difference(self) -> NDArray[np.float64]:
        """Closed form minus recursive solution (m, n), rad | m; the quantity of Fig. 14.7."""
        return self.closed - self.recursive

    def figure(self) -> Any:
        """The differences over time, one panel per joint, as Fig. 14.7 shows them."""
        from matplotlib.figure import Figure

        n = self.closed.shape[1]
        figure = Figure(figsize=(7.0, 1.6 * n), layout="constrained")
        axes = figure.subplots(n, 1, sharex=True, squeeze=False)[:, 0]
        for j, (axis, e) in enumerate(zip(axes, self.difference.T, strict=True)):
            axis.plot(self.t, e, linewidth=0.8, color="C0")
            axis.set_ylabel(f"$e_{{{j + 1}}}$ [rad | m]")
            axis.grid(visible=True, linewidth=0.3)
        axes[0].set_title("closed-form minus recursive inverse kinematics")
        axes[-1].set_xlabel("time [s]")
        return figure


def compare(solver: InverseKinematics, targets: ArrayLike, start: ArrayLike, t: ArrayLike | None = None) -> Comparison:
    """Both solutions along ``targets``, (m, 3) or (m, 4, 4), on the branch that begins nearest to ``start`` (n,).

    Raises DerivationError, naming the point, where the closed form has no row of that branch or Newton's method does
    not converge.
    """
    goals = np.asarray(targets, dtype=float)
    times = np.arange(len(goals), dtype=float) if t is None else np.asarray(t, dtype=float)
    closed, branch = _follow(solver, goals, np.asarray(start, dtype=float))
    recursive = np.empty_like(closed)
    q = closed[0]
    for k, goal in enumerate(goals):
        q = recursive[k] = _newton(solver, q, goal, k)
    return Comparison(times, closed, recursive, branch)


def _follow(
    solver: InverseKinematics, goals: NDArray[np.float64], start: NDArray[np.float64]
) -> tuple[NDArray[np.float64], int]:
    """One branch of the closed form along the path, angles without jumps."""
    path = np.empty((len(goals), solver.n))
    branch, q = -1, start
    for k, goal in enumerate(goals):
        found = solver.solve(goal, q, limits=False, sort="nearest")
        rows = np.flatnonzero(found.branches == branch) if k else np.arange(min(1, len(found)))
        if len(rows) == 0:
            raise DerivationError(f"point {k} of the path has no solution on the branch followed: {found.reason}")
        branch, q = int(found.branches[rows[0]]), found.q[rows[0]]
        path[k] = q
    return path, branch


def _newton(solver: InverseKinematics, q: NDArray[np.float64], goal: NDArray[np.float64], k: int) -> Any:
    chain, best = solver.plan.chain, np.inf
    for _ in range(ITERATIONS):
        T = chain.forward(q)
        J = chain.jacobian(q)
        if goal.shape == (3,):
            error, J = goal - T[:3, 3], J[:3]
        else:
            E = goal[:3, :3] @ T[:3, :3].T
            turn = 0.5 * np.array([E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]])
            error = np.concatenate([goal[:3, 3] - T[:3, 3], turn])
        size = float(np.abs(error).max())
        if size <= NEWTON_TOLERANCE or (size >= best and size < 1e3 * NEWTON_TOLERANCE):
            return q
        best = min(best, size)
        q = q + np.linalg.lstsq(J, error, rcond=1e-12)[0]
    raise DerivationError(f"the recursive inverse kinematics does not converge at point {k} of the path")
