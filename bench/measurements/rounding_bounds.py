"""Whether compiled code keeps the proven bounds of its rounding errors at very many states and in a search uphill.

    python -m bench.measurements.rounding_bounds [ROBOT ...] [--states N] [--seed S] [--real double|float]
        [--speed V] [--acceleration A] [--only FUNCTION] [--recorded]

ROBOT is a bundled name or a file. For every function with a bound: the largest error found, the largest bound of its
output elements and the ratio of the two, and the largest error of any element over its own bound, which is 1 where a
bound is reached. Half of the states have their rates at corners of the box, which is that of the limits of the robot
file unless speeds and accelerations of all joints are given. With ``--recorded`` the operations are evaluated one by
one as they were recorded, in NumPy. Exit status 1 if an error exceeds its bound.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import click

from rrrgen.cli.arguments import real_option
from rrrgen.cli.terminal import progress_bar
from rrrgen.evidence.boxes import Ranges
from rrrgen.evidence.statements import rounding_rows
from rrrgen.robot.file import bundled_names, read
from rrrgen.runtime import load

if TYPE_CHECKING:
    from rrrgen.emit import Real

STATES = 1_000_000


@click.command()
@click.argument("robots", nargs=-1, metavar="[ROBOT ...]")
@click.option("--states", type=click.IntRange(min=1), default=STATES, show_default=True, help="States per function.")
@click.option("--seed", default=1, show_default=True, help="Seed of the states and of the search.")
@click.option("--speed", type=float, metavar="V", help="Speeds up to V rad/s (m/s) instead of the limits of the file.")
@click.option("--acceleration", type=float, metavar="A", help="Accelerations up to A rad/s^2 (m/s^2) instead.")
@click.option("--only", multiple=True, metavar="FUNCTION", help="This function alone; may be repeated.")
@click.option("--recorded", is_flag=True, help="Evaluate the recorded operations in NumPy, not compiled code.")
@real_option
def rounding_bounds(
    robots: tuple[str, ...],
    states: int,
    seed: int,
    speed: float | None,
    acceleration: float | None,
    only: tuple[str, ...],
    recorded: bool,
    real: Real,
) -> int:
    """Look for errors of compiled code beyond their proven bounds; exit with 1 if there are any."""
    sound = True
    for robot in robots or tuple(bundled_names()):
        start = time.perf_counter()
        with progress_bar() as tell:
            model, ranges = load.compile(read(robot), "numpy" if recorded else "c", real), Ranges(speed, acceleration)
            rows, skipped = rounding_rows(model, ranges, states, seed, tell, only)
        for row in rows:
            click.echo(f"{robot:12} {row.function:36} {row.note:46} share {row.difference:.3f}")
        worst = max((row.difference for row in rows), default=0.0)
        seconds = time.perf_counter() - start
        click.echo(
            f"{robot:12} {real}, {states} states: {sum(row.ok for row in rows)} of {len(rows)} functions within their "
            f"bounds, largest share {worst:.3f}, {len(skipped)} without a bound, {seconds:.0f} s"
        )
        sound = sound and all(row.ok for row in rows)
    return 0 if sound else 1


if __name__ == "__main__":
    raise SystemExit(rounding_bounds(standalone_mode=False))
