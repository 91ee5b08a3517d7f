"""Solutions of the inverse kinematics that a change takes away, one by one: were they solutions of their own?

    python -m rrrgen generate ROBOT -o BEFORE/ROBOT         in the checkout before the change, for every ROBOT
    python -m bench.measurements.ik_rows BEFORE [ROBOT ...]            in the checkout after it

For every robot a line tells what became of the rows at 100 000 targets of random configurations, and another one at
10 000 targets at and beside singular ones (see ``ik_targets``); half of them are solved with a reference. Every row
before the change is looked for among the rows after it. A row that is missing there is

* repeated: another row before the change has the same angles;
* wrong: its forward kinematics misses the pose;
* joined: a path of configurations that all meet the pose leads from it to a row after the change, so that the target,
  with the rounding of its numbers, does not tell the two apart. Where a joint is free the solutions are such paths, of
  which one row is returned;
* lost: none of these. Those are solutions that should not be missing, and are printed.

Forward kinematics and Jacobian are those of the verification, which share no code with the solver.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from bench.measurements.ik_change import built, write
from bench.measurements.ik_paths import MEETS, SAME, Paths
from bench.measurements.ik_targets import Kind, Task, random, singular
from rrrgen.robot.file import bundled_names, load_spec
from rrrgen.verify.references.numeric_robot import Array

KINDS: tuple[tuple[str, Kind, int], ...] = (("random", random, 100_000), ("singular", singular, 10_000))

SHOWN = 5

WAYS = ((0, 0.0), (-1, 0.0), (0, 1.0), (0, -1.0), (1, 0.0), (1, 1.0), (1, -1.0))
"""Which joint goes first on the paths that are tried, and how many turns more."""

FATES = ("repeated", "wrong", "joined", "lost")


@dataclass(frozen=True)
class Answers:
    """The rows of all targets: ``q`` (N, most, n), of which the first ``count`` (N,) of each target are rows."""

    q: Array
    count: NDArray[np.int64]

    @classmethod
    def of(cls, robot: str, folder: Path, targets: Array, place: Path) -> Answers:
        """What the solver in a folder, or in its folder of the name of the robot, answers."""
        folder = folder / robot if (folder / robot).is_dir() else folder
        targets.tofile(place / "targets")
        program = built(robot, folder, place / f"program-{folder.parent.name}-{folder.name}")
        said = subprocess.run([program, place / "targets", "rows"], capture_output=True, check=True).stdout
        numbers = np.frombuffer(said).reshape(len(targets), -1)
        count = numbers[:, 0].astype(np.int64)
        q = numbers[:, 1:].reshape(len(targets), -1, load_spec(robot).n)
        return cls(np.where((np.arange(q.shape[1]) < count[:, None])[..., None], q, np.nan), count)


def main(arguments: Sequence[str]) -> None:
    """Tell what became of the rows of the solvers in a folder."""
    folder, *robots = arguments
    for robot in robots or bundled_names():
        task = Task.of(robot)
        with tempfile.TemporaryDirectory(prefix="rrrgen-bench-") as place:
            after = Path(place) / "after"
            write(robot, after)
            for name, kind, count in KINDS:
                targets = kind(task, count)
                old, new = (Answers.of(robot, each, targets, Path(place)) for each in (Path(folder), after))
                click.echo(f"{robot:9} {name:8} {compared(task, targets, old, new)}")


def compared(task: Task, targets: Array, old: Answers, new: Answers) -> str:
    """The counts of one robot, and some of the rows that are lost."""
    target, row = without(task, old, new)
    gained = len(without(task, new, old)[0])
    q = old.q[target, row]
    fate = judged(task, targets, old, new, target, q)
    counts = Counter(fate)
    lines = [
        f"{old.count.sum()} -> {new.count.sum()} rows; {len(q)} rows of {len(set(target))} targets missing: "
        + ", ".join(f"{counts[each]} {each}" for each in FATES)
        + f"; {gained} rows that were not there before"
    ]
    lost = [i for i, each in enumerate(fate) if each == "lost"]
    return "\n".join(lines + [f"    target {target[i]}: {np.array2string(q[i], precision=9)}" for i in lost[:SHOWN]])


def without(task: Task, rows: Answers, others: Answers) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The rows that are not among the others: numbers of their targets, and of the rows there."""
    targets, places = [], []
    for start in range(0, len(rows.q), 5000):
        part = slice(start, start + 5000)
        apart = np.abs(task.apart(rows.q[part, :, None], others.q[part, None])).max(axis=3)
        found = np.where(np.isnan(apart), np.inf, apart).min(axis=2) < SAME
        k, i = np.nonzero(~found & ~np.isnan(rows.q[part, :, 0]))
        targets.append(k + start)
        places.append(i)
    return np.concatenate(targets), np.concatenate(places)


def judged(
    task: Task,
    targets: Array,
    old: Answers,
    new: Answers,
    target: NDArray[np.int64],
    q: Array,
    most: float = MEETS,
) -> list[str]:
    """The fates of the rows ``q`` (k, n) of the targets numbered ``target`` (k,) that are missing after the change."""
    if not len(q):
        return []
    paths = Paths(task, most)
    T = targets[:, :16].reshape(-1, 4, 4)
    meets = paths.meets(q, paths.goals(q, T[target]))
    same = np.abs(task.apart(q[:, None], old.q[target])).max(axis=2) < SAME
    fate = np.where(np.logical_not(meets), "wrong", np.where(same.sum(axis=1) > 1, "repeated", "lost")).astype(object)
    for rank, turn in WAYS:
        for number in range(new.q.shape[1]):
            pairs = np.nonzero((fate == "lost") & (number < new.count[target]))[0]
            if len(pairs):
                joined = paths.joined(q[pairs], new.q[target[pairs], number], T[target[pairs]], rank, turn)
                fate[pairs[joined]] = "joined"
    return [str(each) for each in fate]


if __name__ == "__main__":
    main(sys.argv[1:])
