"""What each pass over the loops of an inverse kinematics is worth: instructions a call without it, and as it is.

    python -m bench.measurements.ik_passes [ROBOT ...]

prints, for each pass left out and for all of them: instructions a call (callgrind, gcc -O2), solutions that differ, and
bytes of machine code. The page of the architecture quotes it.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import click

from bench.measurements.ik_change import compared, machine_code, write
from rrrgen.emit.c.ik.loop_nest import PASSES

ROBOTS = ("rrr", "puma560", "ur10e", "scara", "iiwa14")


def main(robots: Sequence[str]) -> None:
    """Leave out one pass after the other, over ``robots``."""
    for robot in robots or ROBOTS:
        for left_out in (*((one,) for one in PASSES), PASSES):
            with tempfile.TemporaryDirectory(prefix="rrrgen-bench-") as place:
                without, now = (Path(place) / name for name in ("without", "now"))
                write(robot, without, [one for one in PASSES if one not in left_out])
                write(robot, now)
                sizes = [machine_code(robot, folder) for folder in (without, now)]
                line = compared(robot, without, now, Path(place))
                click.echo(f"without {', '.join(map(repr, left_out))}: {line}; {sizes[0]} -> {sizes[1]} bytes of code")


if __name__ == "__main__":
    main(sys.argv[1:])
