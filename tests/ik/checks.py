"""What every solver must satisfy, on batches: rows meet the target, the seed is found, no row comes twice."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ik.robots import ROWS, make, reference
from rrrgen.ik.inverse_kinematics import InverseKinematics
from rrrgen.runtime.inverse_kinematics import load_solver

FK_ERROR = 1e-12
"""Largest entry of FK(row) - target: emitted rows are checked to 4e-13 of the reach, which is of the order of 1 m."""

SEED_ERROR = 1e-6
"""rad or m between the configuration that made a pose and the nearest row, divided by the smallest singular value."""

SAME_ROW = 1e-7
"""Two rows nearer than this would be one solution returned twice; the solver merges at 5e-7."""


@dataclass
class Sample:
    """A robot, random configurations, their targets, and what the solver says to them."""

    solver: InverseKinematics
    rows: list
    q: np.ndarray
    T: np.ndarray
    batch: object
    frames: dict

    @property
    def turning(self) -> np.ndarray:
        return np.array([row[0] == "R" for row in self.rows])

    @property
    def owner(self) -> np.ndarray:
        return np.repeat(np.arange(len(self.q)), self.batch.counts)

    @property
    def found(self) -> np.ndarray:
        return self.batch.q[np.arange(self.batch.q.shape[1])[None] < self.batch.counts[:, None]]

    def wrapped(self, d: np.ndarray) -> np.ndarray:
        return np.where(self.turning, np.mod(d + np.pi, 2 * np.pi) - np.pi, d)

    def errors(self) -> np.ndarray:
        """Largest error of forward kinematics per row."""
        F = reference(self.rows, self.found, **self.frames)
        difference = np.abs(F - self.T[self.owner])
        if self.solver.plan.task == "position":
            difference = difference[:, :3, 3]
        return difference.reshape(len(F), -1).max(axis=1)

    def missed(self) -> list[int]:
        """Poses whose own configuration is not among the rows."""
        nearest = np.full(len(self.q), np.inf)
        np.minimum.at(nearest, self.owner, np.abs(self.wrapped(self.found - self.q[self.owner])).max(axis=1))
        return [k for k in np.flatnonzero(nearest > SEED_ERROR) if nearest[k] * self.sharpness(self.q[k]) > SEED_ERROR]

    def sharpness(self, q: np.ndarray) -> float:
        """Smallest singular value of the Jacobian of the joints that are free."""
        J = self.solver.plan.chain.jacobian(q)
        if self.solver.plan.task == "position":
            J = J[:3]
        locked = self.solver.plan.locked
        if locked is not None and locked < J.shape[1]:
            J = np.delete(J, locked, axis=1)
        return float(np.linalg.svd(J, compute_uv=False)[min(J.shape) - 1])

    def repeated(self) -> int:
        """Pairs of rows of one target that are the same."""
        count = 0
        for i in range(self.batch.q.shape[1]):
            have = self.batch.counts > i
            for j in range(i):
                apart = np.abs(self.wrapped(self.batch.q[have, i] - self.batch.q[have, j])).max(axis=1)
                count += int(np.sum(apart < SAME_ROW))
        return count

    def assert_right(self) -> None:
        """No wrong row, no missed seed, no row twice, nothing that is not a number."""
        found = self.found
        assert np.isfinite(found).all()
        assert len(found) >= len(self.q)
        assert self.errors().max() <= FK_ERROR
        assert self.missed() == []
        assert self.repeated() == 0


def configurations(rows: list, N: int, seed: int) -> np.ndarray:
    """Angles over the whole turn, displacements of up to a metre."""
    q = np.random.default_rng(seed).uniform(-np.pi, np.pi, (N, len(rows)))
    return np.where([row[0] == "R" for row in rows], q, q / np.pi)


def sample(name, rows=None, *, N=1000, seed=0, q=None, solver=None, redundancy=None, q_ref=None, **frames) -> Sample:
    """Solve the poses of random configurations (or of ``q``) of the robot ``name`` or with the table ``rows``."""
    rows = ROWS[name] if rows is None else rows
    solver = solver or load_solver(make(name, rows, **frames), redundancy)
    q = configurations(rows, N, seed) if q is None else np.atleast_2d(q)
    T = reference(rows, q, **frames)
    goals = T[:, :3, 3] if solver.plan.task == "position" else T
    given = {}
    if solver.plan.locked is not None:
        given["redundancy"] = np.array([solver.parameter(x) for x in q])
    batch = solver.solve_batch(goals, q_ref, limits=False, **given)
    return Sample(solver, rows, q, T, batch, frames)
