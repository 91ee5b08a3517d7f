"""The emitted self-tests, compiled and run: what stands in the place of a rounding bound of code with loops.

The functions of some headers have no rule for their bounds: a tick of the controller switches by what it measures, and
a search ends by what it finds. The self-test that is emitted with them checks what holds of their results.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rrrgen.base.files import write

if TYPE_CHECKING:
    from rrrgen.base.files import Contents

COMPILERS = ("gcc", "clang")
FLAGS = ("-std=c99", "-O1", "-ffp-contract=off")
SUFFIX = "_selftest.c"

CHECKS_OF = {
    "_differential_ik.h": "differential IK",
    "_controller.h": "controller",
    "_controller_laws.h": "controller",
    "_fourier.h": "Fourier series",
    "_tool_ik.h": "inverse kinematics with a tool",
    "_timing.h": "timing",
    "_ik.h": "inverse kinematics",
}
"""How the checks of the functions of a header begin, by the end of its name."""

_LINE = re.compile(r"(ok|FAIL)\S*\s+(.+?)\s+(\S+)")


def self_test_lines(files: Mapping[str, Contents]) -> dict[str, list[tuple[str, str]]] | None:
    """The checks and their largest differences that every emitted self-test prints, by the name of its file.

    It is run with every compiler of :data:`COMPILERS` that is installed; the differences are those of the first. None
    where none is. Raises RuntimeError, with what was printed, if a self-test does not pass.
    """
    compilers = installed_compilers()
    if not compilers:
        return None
    code = {path: text for path, text in files.items() if "/" not in path and path.endswith((".c", ".h"))}
    sources = sorted(path for path in code if path.endswith(".c") and not path.endswith(SUFFIX))
    printed_lines = {}
    with tempfile.TemporaryDirectory() as folder:
        write(code, Path(folder))
        for path in sorted(path for path in code if path.endswith(SUFFIX)):
            runs = [_lines(folder, path, sources, compiler) for compiler in compilers]
            printed_lines[path] = runs[0]
    return printed_lines


def installed_compilers() -> list[str]:
    """The compilers with which self-tests are run, of those that are installed."""
    return [compiler for compiler in COMPILERS if shutil.which(compiler) is not None]


def _lines(folder: str, path: str, sources: Sequence[str], compiler: str) -> list[tuple[str, str]]:
    program = Path(folder, "selftest")
    for command in ([compiler, *FLAGS, *sources, path, "-lm", "-o", str(program)], [str(program)]):
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if done.returncode:
            raise RuntimeError(f"{path}, compiled with {compiler}, does not pass: {done.stdout}{done.stderr}")
    return [(row[2], row[3]) for row in map(_LINE.fullmatch, done.stdout.splitlines()) if row]


def checks_of(header: str, lines: Mapping[str, Sequence[tuple[str, str]]]) -> str:
    """What the self-tests found of the functions of ``header``, as one sentence; empty without a check of them."""
    checks = lines.get(f"{header.removesuffix('.h')}{SUFFIX}")
    if checks is None:
        starts = [start for end, start in CHECKS_OF.items() if header.endswith(end)]
        checks = [row for rows in lines.values() for row in rows if starts and row[0].startswith(f"{starts[0]}:")]
    if not checks:
        return ""
    listed = "; ".join(f"{name.partition(': ')[2] or name} ({value})" for name, value in checks)
    compiled = " and ".join(installed_compilers())
    passed = f"the emitted self-test passes {len(checks)} checks, compiled with {compiled}"
    return f"{passed}, with the largest differences: {listed}"
