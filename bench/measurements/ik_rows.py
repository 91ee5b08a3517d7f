"""Solutions of the inverse kinematics that a change takes away, one by one: were they solutions of their own?

    python -m bench.measurements.ik_change --write FOLDER [ROBOT ...]      in the checkout before the change
    python -m bench.measurements.ik_rows FOLDER [ROBOT ...]                in the checkout after it

On the targets of ``ik_change`` every row before the change is looked for among the rows after it. A row that is missing
there is

* repeated: another row before the change has the same angles;
* wrong: its forward kinematics misses the pose;
* joined: a path of configurations that all meet the pose leads from it to a row after the change, so that the target,
  with the rounding of its numbers, does not tell the two apart. Where a joint is free the solutions are such paths, of
  which one row is returned;
* lost: none of these. Those are solutions that should not be missing, and are printed.

Forward kinematics and Jacobian are those of the verification, which share no code with the solver.
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from bench.measurements.ik_change import answers, write
from rrrgen.ik.geometry.chain import numeric_chain
from rrrgen.robotfile import bundled_names, load_spec
from rrrgen.verify.references.chain import Array, chain_of
from rrrgen.verify.references.newton_euler import NewtonEuler

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

SHOWN = 5


@dataclass(frozen=True)
class Missing:
    """Rows that are missing after the change: configurations, their targets by number, and what became of each."""

    q: Array
    target: list[int]
    fate: list[str]


@dataclass(frozen=True)
class Task:
    """The task of a robot's targets: the pose of the tip, or its position."""

    model: NewtonEuler
    revolute: NDArray[np.bool_]
    reach: float
    position: bool

    def error(self, q: Array, T: Array) -> Array:
        """What is missing (N, 6) or (N, 3) from the configurations ``q`` (N, n) to the poses ``T`` (N, 4, 4)."""
        F = self.model.forward_kinematics(q)
        linear = (T[:, :3, 3] - F[:, :3, 3]) / self.reach
        if self.position:
            return np.asarray(linear)
        E = T[:, :3, :3] @ np.swapaxes(F[:, :3, :3], 1, 2)
        axis = 0.5 * np.stack([E[:, 2, 1] - E[:, 1, 2], E[:, 0, 2] - E[:, 2, 0], E[:, 1, 0] - E[:, 0, 1]], axis=1)
        axis[np.trace(E, axis1=1, axis2=2) < 1.0] = 1.0  # a quarter turn and more, whose sine says nothing
        return np.hstack([linear, axis])

    def meets(self, q: Array, T: Array) -> Array:
        """Whether each configuration meets its pose."""
        return np.asarray(np.abs(self.error(q, T)).max(axis=1) <= MEETS)

    def refined(self, q: Array, T: Array, held: Array) -> Array:
        """``q`` after Newton steps in which the joints of ``held`` (N, n) stand still."""
        for _ in range(NEWTON):
            left = np.logical_not(self.meets(q, T))
            if not left.any():
                break
            J = self.model.jacobian(q[left])
            J[:, :3] /= self.reach
            J = J[:, :3] if self.position else J
            J = np.where(held[left, None, :], 0.0, J)
            gram = np.swapaxes(J, 1, 2) @ J + 1e-13 * np.eye(q.shape[1])
            right = np.einsum("kij,ki->kj", J, self.error(q[left], T[left]))
            q[left] += np.linalg.solve(gram, right[..., None])[..., 0]
        return q

    def apart(self, a: Array, b: Array) -> Array:
        """Differences ``b - a`` of configurations, angles in [-pi, pi)."""
        d = b - a
        return np.asarray(np.where(self.revolute, (d + np.pi) % (2 * np.pi) - np.pi, d))

    def joined(self, q: Array, goal: Array, T: Array, rank: int, turn: float) -> Array:
        """Whether a path on which every configuration meets the pose leads from each row of ``q`` to that of ``goal``.

        One joint after the other is moved to the goal, the others follow; the first one is that with the largest
        difference (``rank`` 0), the second largest, ..., and goes ``turn`` times round more.
        """
        held = np.zeros(q.shape, bool)
        rows = np.arange(len(q))
        for k in range(3):
            left = np.where(held[rows], 0.0, self.apart(q[rows], goal[rows]))
            j = np.argsort(-np.abs(left), axis=1)[:, rank if k == 0 else 0]
            way = left[np.arange(len(rows)), j] + (2 * np.pi * turn * self.revolute[j] if k == 0 else 0.0)
            start = q[rows, j]
            held[rows, j] = True
            if np.abs(way).max(initial=0.0) < SAME:
                break
            for step in range(1, STEPS + 1):
                q[rows, j] = start + way * (step / STEPS)
                q[rows] = self.refined(q[rows], T[rows], held[rows])
                good = self.meets(q[rows], T[rows])
                rows, j, way, start = rows[good], j[good], way[good], start[good]
        ends = np.abs(self.apart(q, goal)).max(axis=1) < ENDS
        return np.asarray(ends & np.isin(np.arange(len(q)), rows))


def main(arguments: Sequence[str]) -> None:
    """Tell what became of the rows of the solvers in a folder."""
    folder, *robots = arguments
    for robot in robots or bundled_names():
        with tempfile.TemporaryDirectory(prefix="rrrgen-bench-") as place:
            after = Path(place) / "after"
            write(robot, after)
            click.echo(examined(robot, Path(folder), after, Path(place)))


def examined(robot: str, before: Path, after: Path, place: Path) -> str:
    """The counts of one robot, and some of the rows that are lost."""
    spec = load_spec(robot)
    targets, (old, new) = answers(robot, before, after, place)
    chain = numeric_chain(spec)
    task = Task(
        NewtonEuler(chain_of(spec), np.zeros((spec.n, 10))),
        np.asarray(chain_of(spec).revolute),
        chain.reach,
        spec.n < 4,
    )
    T = targets.reshape(-1, 4, 4)
    gone = [(k, row) for k in range(len(T)) for row in _without(task, old[k], new[k])]
    gained = sum(len(_without(task, new[k], old[k])) for k in range(len(T)))
    missing = Missing(np.array([row for _, row in gone]).reshape(-1, spec.n), [k for k, _ in gone], [""] * len(gone))
    _judge(task, missing, T, old, new)
    counts = Counter(missing.fate)
    fates = ", ".join(f"{counts[fate]} {fate}" for fate in ("repeated", "wrong", "joined", "lost"))
    lines = [
        f"{robot:9} {sum(map(len, old))} -> {sum(map(len, new))} rows; {len(gone)} rows of {len(set(missing.target))} "
        f"targets missing: {fates}; {gained} rows that were not there before"
    ]
    lost = [i for i, fate in enumerate(missing.fate) if fate == "lost"]
    lines += [f"    target {missing.target[i]}: {np.array2string(missing.q[i], precision=9)}" for i in lost[:SHOWN]]
    return "\n".join(lines)


def _without(task: Task, rows: Array, others: Array) -> list[Array]:
    """The rows that are not among the others."""
    return [row for row in rows if not len(others) or np.abs(task.apart(row, others)).max(axis=1).min() >= SAME]


def _judge(task: Task, missing: Missing, T: Array, old: Sequence[Array], new: Sequence[Array]) -> None:
    """Fill in the fates."""
    if not missing.fate:
        return
    meets = task.meets(missing.q, T[missing.target])
    for i, k in enumerate(missing.target):
        same = np.abs(task.apart(missing.q[i], old[k])).max(axis=1) < SAME
        missing.fate[i] = "wrong" if not meets[i] else "repeated" if same.sum() > 1 else "lost"
    most = max((len(new[k]) for k in missing.target), default=0)
    for rank, turn in ((0, 0.0), (0, 1.0), (0, -1.0), (1, 0.0), (1, 1.0), (1, -1.0)):
        for number in range(most):
            pairs = [
                i for i, fate in enumerate(missing.fate) if fate == "lost" and number < len(new[missing.target[i]])
            ]
            if not pairs:
                continue
            chosen = [missing.target[i] for i in pairs]
            goals = np.array([new[k][number] for k in chosen])
            for i, is_joined in zip(pairs, task.joined(missing.q[pairs], goals, T[chosen], rank, turn), strict=True):
                missing.fate[i] = "joined" if is_joined else missing.fate[i]


if __name__ == "__main__":
    main(sys.argv[1:])
