"""Paths of configurations that all meet one target, between two of them: whether the target tells the two apart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.measurements.ik_targets import ELBOW, Task
from rrrgen.verify.references.numeric_robot import Array

SAME = 1e-6
"""Rows whose joints differ less (rad, m) are one; twice what the emitted code takes for one row, which is 5e-7."""

MEETS = 1e-12
"""Largest error (rad, reaches) of a configuration that meets the pose: the emitted code accepts 4e-13, and rounding."""

STEPS = 60
"""Of a path; a joint moves by at most 0.11 rad in each."""

NEWTON = 40
"""Most Newton steps for a configuration: beside a double root each of them halves the error only."""

ENDS = 1e-4
"""How near the end of a path must be to the row (rad, m): half the digits, for the row may be a double root."""


@dataclass(frozen=True)
class Goals:
    """Poses (N, 4, 4), and the positions (N, 3) of the elbow that go with an arm angle."""

    T: Array
    elbow: Array

    def __getitem__(self, rows: NDArray[Any]) -> Goals:
        """Some of them, by numbers or by a mask."""
        return Goals(self.T[rows], self.elbow[rows])


@dataclass(frozen=True)
class Paths:
    """Paths on the solutions of the targets of a robot; on a path errors stay below ``most`` (rad, reaches)."""

    task: Task
    most: float = MEETS

    def goals(self, q: Array, T: Array) -> Goals:
        """The poses, and where the configurations ``q`` have their elbow."""
        return Goals(
            T, self.task.model.link_frames(q)[:, ELBOW, :3, 3] if self.task.arm_angle else np.zeros((len(q), 3))
        )

    def error(self, q: Array, goals: Goals) -> Array:
        """What is missing (N, m) from the configurations ``q`` (N, n), in the order of the rows of the Jacobian."""
        F, T = self.task.model.forward_kinematics(q), goals.T
        linear = (T[:, :3, 3] - F[:, :3, 3]) / self.task.reach
        if self.task.position:
            return np.asarray(linear)
        E = T[:, :3, :3] @ np.swapaxes(F[:, :3, :3], 1, 2)
        axis = 0.5 * np.stack([E[:, 2, 1] - E[:, 1, 2], E[:, 0, 2] - E[:, 2, 0], E[:, 1, 0] - E[:, 0, 1]], axis=1)
        axis[np.trace(E, axis1=1, axis2=2) < 1.0] = 1.0  # a quarter turn and more, whose sine says nothing
        parts = [linear, axis]
        if self.task.arm_angle:
            parts.append((goals.elbow - self.task.model.link_frames(q)[:, ELBOW, :3, 3]) / self.task.reach)
        return np.hstack(parts)

    def meets(self, q: Array, goals: Goals) -> Array:
        """Whether each configuration meets its target."""
        return np.asarray(np.abs(self.error(q, goals)).max(axis=1) <= self.most)

    def refined(self, q: Array, goals: Goals, held: Array) -> Array:
        """``q`` after Newton steps in which the joints of ``held`` (N, n) stand still."""
        for _ in range(NEWTON):
            left = np.logical_not(self.meets(q, goals))
            if not left.any():
                break
            J = np.where(held[left, None, :], 0.0, self.task.jacobian(q[left]))
            gram = np.swapaxes(J, 1, 2) @ J + 1e-13 * np.eye(q.shape[1])
            right = np.einsum("kij,ki->kj", J, self.error(q[left], goals[left]))
            q[left] += np.linalg.solve(gram, right[..., None])[..., 0]
        return q

    def joined(self, q: Array, goal: Array, T: Array, rank: int, turn: float) -> Array:
        """Whether a path of configurations that meet the target leads from each row of ``q`` to that of ``goal``.

        One joint after the other is moved to the goal, the others follow; the first one is that with the largest
        difference (``rank`` 0), the second largest, ..., and goes ``turn`` times round more. With ``rank`` -1 the two
        with the largest differences move together.
        """
        held = np.zeros(q.shape, bool)
        if self.task.plan.locked is not None and not self.task.arm_angle:
            held[:, self.task.plan.locked] = True
        goals = self.goals(q, T)
        rows = np.arange(len(q))
        q = q.copy()
        for k in range(3):
            left = np.where(held[rows], 0.0, self.task.apart(q[rows], goal[rows]))
            order = np.argsort(-np.abs(left), axis=1)
            j = order[:, :2] if rank < 0 and k == 0 else order[:, [rank if k == 0 else 0]]
            way = np.take_along_axis(left, j, axis=1) + (2 * np.pi * turn * self.task.revolute[j] if k == 0 else 0.0)
            start = np.take_along_axis(q[rows], j, axis=1)
            held[rows[:, None], j] = True
            if np.abs(way).max(initial=0.0) < SAME:
                break
            for step in range(1, STEPS + 1):
                q[rows[:, None], j] = start + way * (step / STEPS)
                q[rows] = self.refined(q[rows], goals[rows], held[rows])
                good = self.meets(q[rows], goals[rows])
                rows, j, way, start = rows[good], j[good], way[good], start[good]
        ends = np.abs(self.task.apart(q, goal)).max(axis=1) < ENDS
        return np.asarray(ends & np.isin(np.arange(len(q)), rows))
