"""From robot file to compiled C in a fresh process: seconds and peak memory."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from bench.toolchain import Toolchain, run
from rrrgen.base.errors import BuildError

FLAGS = ("-std=c99", "-O2")
"""As a user compiles a model."""

ROUNDS = 5
"""What disturbs a run makes it longer only, as with all timings here. Every round takes all robots."""

GENERATE = """
import atexit, sys
from rrrgen.cli.main import main
from rrrgen.base.parallel import usual_jobs

@atexit.register
def peak():
    try:
        own = next(int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmHWM"))
    except OSError:
        return
    import resource

    print(own + (usual_jobs() - 1) * resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)

main(["generate", sys.argv[1], "-o", sys.argv[2], "--no-casadi-files"])
"""
"""The process reads its own peak: what ``wait4`` reports may be that of the process it was forked from. Memory that it
shares with its helpers counts once for each."""


@dataclass(frozen=True)
class Generation:
    """Seconds of ``rrrgen generate`` and of the C compiler, as a user waits for them, and the peak of all in MB."""

    robot: str
    generate: float
    compile: float
    megabytes: float | None


def generations(robots: Sequence[str], toolchain: Toolchain, rounds: int = ROUNDS) -> list[Generation]:
    """The fastest of ``rounds`` runs of each robot, with the bytecode and templates that earlier runs have cached.

    Nothing of a robot is taken from a cache. The peak is None where the system does not tell it.
    """
    with tempfile.TemporaryDirectory(prefix="rrrgen-bench-") as place:
        cache = Path(place, "cache")
        _generate("pendulum", f"{place}/out", cache)
        runs = [[_attempt(robot, toolchain, cache) for robot in robots] for _ in range(rounds)]
    return [min(same, key=lambda run: run.generate + run.compile) for same in zip(*runs, strict=True)]


def _attempt(robot: str, toolchain: Toolchain, cache: Path) -> Generation:
    for derived in cache.glob("*.derived"):
        derived.unlink()
    with tempfile.TemporaryDirectory(prefix="rrrgen-bench-") as place:
        start = time.perf_counter()
        done = _generate(robot, f"{place}/out", cache)
        if done.returncode:
            raise BuildError(f"rrrgen generate {robot} failed: {done.stderr[:500]}")
        between = time.perf_counter()
        sources = [source for source in Path(place, "out").glob("*.c") if not source.stem.endswith("_selftest")]
        with ThreadPoolExecutor(len(sources)) as pool:  # the model and its inverse kinematics, side by side
            list(pool.map(lambda source: run([*toolchain.cc, *FLAGS, "-c", str(source), "-o", f"{source}.o"]), sources))
        end = time.perf_counter()
    peak = done.stdout.splitlines()[-1]
    return Generation(robot, between - start, end - between, int(peak) / 1024 if peak.isdigit() else None)


def _generate(robot: str, place: str, cache: Path) -> subprocess.CompletedProcess[str]:
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    environment["RRRGEN_CACHE"] = str(cache)
    command = [sys.executable, "-c", GENERATE, robot, place]
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
