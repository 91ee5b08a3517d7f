"""The choices of an inverse kinematics as loops, as they are now, and unrolled to a tree of straight-line code.

    python -m bench.measurements.ik_unrolled [ROBOT ...]

prints, unrolled and as it is: instructions a call, solutions that differ, and bytes of machine code (gcc -O2). A loop
over the roots of one choice, of which there are two at most unless an elimination gives more, becomes one copy of its
body for each. The page of the architecture quotes it as the reason why choices are loops in C.
"""

from __future__ import annotations

import re
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import click

from bench.measurements.ik_change import compared, machine_code, write

ROOTS = 2
LOOP = re.compile(r"for \(int (i\w+) = 0; \1 < ([nm]\w+(?:\[[^;]*\])?); \+\+\1\)")
ROBOTS = ("rrr", "puma560", "ur10e", "scara", "stanford")


def main(robots: Sequence[str]) -> None:
    """Compare both layouts over ``robots``, by default those whose choices have two roots at most."""
    for robot in robots or ROBOTS:
        with tempfile.TemporaryDirectory(prefix="rrrgen-bench-") as place:
            unrolled, now = (Path(place) / name for name in ("unrolled", "now"))
            for folder in (unrolled, now):
                write(robot, folder)
            file = unrolled / f"{robot}_ik.c"
            copy = rf'_Pragma("GCC unroll {ROOTS}") for (int \1 = 0; \1 < {ROOTS} && \1 < \2; ++\1)'
            text, count = LOOP.subn(copy, file.read_text(encoding="utf-8"))
            file.write_text(text, encoding="utf-8")
            sizes = [machine_code(robot, folder) for folder in (unrolled, now)]
            line = compared(robot, unrolled, now, Path(place))
            click.echo(f"{line}; {count} loops; {sizes[0]} -> {sizes[1]} bytes of code")


if __name__ == "__main__":
    main(sys.argv[1:])
