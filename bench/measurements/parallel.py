"""What ``rrrgen generate`` gains from several processes: one alone, forked ones, and new ones where none can be forked.

    python -m bench.measurements.parallel [ROBOT...] [--jobs 2] [--rounds 5]

Each run is a process of its own, from the start of Python to its end. New processes load their modules again; forked
ones share what their parent has loaded. Nothing of a robot is taken from a cache. Beside the seconds that pass stand
those that the process computes itself, which on an idle machine are nearly all of them, and which other programs on a
busy one disturb less.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time

import click

GENERATE = """
import atexit, sys, time
atexit.register(lambda: print(time.process_time()))
import rrrgen.base.parallel
if sys.argv[1] == "new":
    rrrgen.base.parallel.may_fork = lambda: False
from rrrgen.cli.main import main
main(["generate", sys.argv[2], "-o", sys.argv[3], "--no-casadi-files", "--jobs", sys.argv[4]])
"""

WAYS = ("one", "forked", "new")
ROBOTS = ("rrr", "puma560", "panda")


def seconds(way: str, robot: str, jobs: int) -> tuple[float, float]:
    """Time that passes in one run, and that its first process computes."""
    with tempfile.TemporaryDirectory(prefix="rrrgen-bench-") as place:
        count = "1" if way == "one" else str(jobs)
        command = [sys.executable, "-c", GENERATE, way, robot, f"{place}/out", count]
        start = time.perf_counter()
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        return time.perf_counter() - start, float(done.stdout.splitlines()[-1])


@click.command()
@click.argument("robots", nargs=-1)
@click.option("--jobs", default=2, show_default=True, help="Number of processes.")
@click.option("--rounds", default=5, show_default=True, help="Runs of each way, which take turns.")
def main(robots: tuple[str, ...], jobs: int, rounds: int) -> None:
    """Print the time of ``rrrgen generate`` by one process, by forked and by new ones; the fastest run counts."""
    click.echo(f"{os.cpu_count()} cores, {jobs} processes, fastest of {rounds} runs: seconds (of computing)")
    click.echo(f"{'robot':10}" + "".join(f"{way:>16}" for way in WAYS))
    for robot in robots or ROBOTS:
        runs = [[seconds(way, robot, jobs) for way in WAYS] for _ in range(rounds)]
        fastest = [[min(times) for times in zip(*way, strict=True)] for way in zip(*runs, strict=True)]
        cells = (f"{passed:.2f} ({computed:.2f})" for passed, computed in fastest)
        click.echo(f"{robot:10}" + "".join(f"{cell:>16}" for cell in cells))


if __name__ == "__main__":
    main()
