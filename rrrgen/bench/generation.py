"""From robot file to compiled C in a fresh process: seconds and peak memory."""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from rrrgen.bench.toolchain import Toolchain, run
from rrrgen.errors import BuildError

GENERATE = """
import sys
from rrrgen.cli.main import run
code = run(["generate", sys.argv[1], "-o", sys.argv[2], "--no-casadi-files"])
try:
    peak = [line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")][0]
except OSError:
    peak = "0"
print(code, peak)
"""
"""The process reads its own peak: what ``wait4`` reports may be that of the process it was forked from."""


@dataclass(frozen=True)
class Generation:
    """Processor seconds of ``rrrgen generate`` and of the C compiler, both together elapsed, and the peak in MB."""

    robot: str
    generate: float
    compile: float
    elapsed: float
    megabytes: float | None


def generation(robot: str, toolchain: Toolchain) -> Generation:
    """Measure one robot; nothing is taken from a cache. The peak is None where the system does not tell it."""
    with tempfile.TemporaryDirectory(prefix="rrrgen-bench-") as place:
        start, before = time.perf_counter(), _processor_seconds()
        command = [sys.executable, "-c", GENERATE, robot, f"{place}/out"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        code, peak = (done.stdout.splitlines() or ["1 0"])[-1].split()
        if done.returncode or code != "0":
            raise BuildError(f"rrrgen generate {robot} failed: {done.stderr[:500]}")
        between = _processor_seconds()
        for source in sorted(Path(place, "out").glob("*.c")):
            run([*toolchain.cc, *toolchain.flags, "-std=gnu99", "-c", str(source), "-o", f"{place}/{source.stem}.o"])
        after, elapsed = _processor_seconds(), time.perf_counter() - start
    return Generation(robot, between - before, after - between, elapsed, int(peak) / 1024 if int(peak) else None)


def _processor_seconds() -> float:
    """Of all finished child processes."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime
