"""Instructions of the inverse kinematics at the slowest of many targets at and beside singular configurations.

    python -m bench.measurements.ik_slowest [ROBOT ...]

For every robot: instructions a call (callgrind, gcc -O2) on average over random targets, over the 10 000 targets of
``ik_targets.singular``, and at the slowest of those by its time; without options, and with the joint limits.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import click
import numpy as np

from bench.measurements.ik_change import CALLS, built, instructions, write
from bench.measurements.ik_targets import Task, random, singular
from rrrgen.robot.file import bundled_names
from rrrgen.verify.references.numeric_robot import Array

TARGETS = 10_000

SLOWEST = 5
"""Targets with the longest times, whose instructions are counted: the times alone depend on what else runs."""

OPTIONS = (("no options", 0), ("limits", 1))


def main(robots: Sequence[str]) -> None:
    """Print the table."""
    for robot in robots or bundled_names():
        with tempfile.TemporaryDirectory(prefix="rrrgen-bench-") as place:
            write(robot, Path(place))
            program = built(robot, Path(place), Path(place) / "program")
            for name, options in OPTIONS:
                click.echo(f"{robot:9} {name:10} {counted(robot, program, Path(place), options)}")


def counted(robot: str, program: Path, place: Path, options: int) -> str:
    """One line of the table."""
    task, file = Task.of(robot), place / "targets"
    usual, beside = random(task, CALLS), singular(task, TARGETS)

    def count(targets: Array) -> float:
        targets.tofile(file)
        return instructions(program, file, len(targets), options)

    beside.tofile(file)
    said = subprocess.run([program, file, "times", str(TARGETS), str(options)], capture_output=True, check=True).stdout
    slowest = np.argsort(np.frombuffer(said))[-SLOWEST:]
    typical, most = count(usual), max(count(beside[k : k + 1]) for k in slowest)
    mean = count(beside[np.random.default_rng(1).permutation(TARGETS)[: 5 * CALLS]])
    return f"random {typical:9.0f}, singular {mean:9.0f}, the slowest {most:10.0f} ({most / typical:.0f} times)"


if __name__ == "__main__":
    main(sys.argv[1:])
