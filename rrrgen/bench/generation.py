"""From robot file to compiled C in a fresh process: seconds and peak memory."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from rrrgen.bench.toolchain import Toolchain, run
from rrrgen.errors import BuildError


@dataclass(frozen=True)
class Generation:
    """Seconds of ``rrrgen generate`` and of the C compiler, and the peak memory of the former in MB."""

    robot: str
    generate: float
    compile: float
    megabytes: float


def generation(robot: str, toolchain: Toolchain) -> Generation:
    """Measure one robot; nothing is taken from a cache."""
    with tempfile.TemporaryDirectory(prefix="rrrgen-bench-") as place:
        command = [sys.executable, "-m", "rrrgen", "generate", robot, "-o", f"{place}/out", "--no-casadi-files"]
        start = time.perf_counter()
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        complaint = process.stderr.read() if process.stderr else ""
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        seconds = time.perf_counter() - start
        if process.returncode:
            raise BuildError(f"rrrgen generate {robot} failed: {complaint[:500]}")
        start = time.perf_counter()
        for source in sorted(Path(place, "out").glob("*.c")):
            run([*toolchain.cc, *toolchain.flags, "-std=gnu99", "-c", str(source), "-o", f"{place}/{source.stem}.o"])
        return Generation(robot, seconds, time.perf_counter() - start, _megabytes(usage))


def _megabytes(usage: resource.struct_rusage) -> float:
    """Peak resident memory; Linux counts kB, macOS bytes."""
    return usage.ru_maxrss / (1024.0**2 if sys.platform == "darwin" else 1024.0)
