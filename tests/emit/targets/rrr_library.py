"""The committed code of the reference robot as a static library, built once for all tests that link it."""

from __future__ import annotations

import subprocess
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

GENERATED = Path(__file__).resolve().parents[3] / "generated" / "rrr"
SOURCES = ("rrr.c", "rrr_nominal.c", "rrr_derivatives.c", "rrr_ik.c")
STRICT = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Werror")


def run(*command: object, cwd: Path | None = None, timeout: float = 120) -> str:
    """Standard output of a command that must succeed."""
    done = subprocess.run([*map(str, command)], cwd=cwd, capture_output=True, text=True, timeout=timeout, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@cache
def library() -> Path:
    """``librrr.a``, optimized little: the tests of sockets run few calls."""
    folder = Path(mkdtemp(prefix="rrr-library-"))
    for source in SOURCES:
        run("gcc", "-std=c99", "-O1", "-fPIC", "-c", GENERATED / source, "-o", folder / f"{source}.o")
    run("ar", "rcs", folder / "librrr.a", *(folder / f"{source}.o" for source in SOURCES))
    return folder / "librrr.a"
