"""The command ``rrrgen doctor``: say what this installation can do."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version

import click

from rrrgen.base.version import VERSION
from rrrgen.cli.arguments import json_option, print_json
from rrrgen.cli.terminal import doubtful, mark_passed, say, terminal_width

TOOLS = {
    "gcc": "compiles the emitted C",
    "clang": "compiles the emitted C",
    "cmake": "builds the emitted C as a library",
    "rustc": "builds the crate of generate --with rust",
}
"""Programs that are looked for, with their use; the C compiler that rrrgen itself uses is reported separately."""

PROBE = {"probe.c": "double probe(double x) { return 2.0 * x; }\n", "probe.h": "double probe(double x);\n"}

WIDEST = ("avx512f", "avx2", "asimd", "neon", "sse2")
"""Vector instructions from the widest to the narrowest, as Linux names them."""


@dataclass(frozen=True)
class DoctorLine:
    """One line of the report: the ``name`` of what was looked for, what was ``found``, whether that is usable (``ok``).

    ``use`` says what it is good for, or how to get it.
    """

    name: str
    found: str
    ok: bool
    use: str


@click.command()
@json_option
def doctor(as_json: bool) -> int:
    """Say what this installation can do: compiler, extras, cache, processor.

    A small function is compiled, loaded and called. Exit code 5 if that fails: models then work with
    rrrgen.compile(..., backend="numpy") only.

    \b
    Example:
      rrrgen doctor
    """
    compiler = _compiler()
    findings = [*_system(), compiler, *_tools(), *_extras(), _cache()]
    if as_json:
        print_json({"findings": [asdict(finding) for finding in findings]})
    else:
        _print(findings)
    return 0 if compiler.ok else 5


def _print(findings: Sequence[DoctorLine]) -> None:
    width = max(len(finding.name) for finding in findings)
    indent = " " * (width + 10)
    columns = max(terminal_width() or 100, width + 40)
    for finding in findings:
        mark = mark_passed("ok     ") if finding.ok else doubtful("missing")
        first, *others = textwrap.wrap(finding.found, columns - len(indent), break_long_words=False)
        say(f"{mark} {finding.name:{width}}  {first}")
        for line in others:
            say(indent + line)
        for line in textwrap.wrap(finding.use, columns - len(indent)):
            say(indent + click.style(line, dim=True))


def _system() -> Iterator[DoctorLine]:
    from rrrgen.emit.c.compilers import processor

    python = f"{platform.python_version()} on {platform.system()} {platform.machine()}"
    yield DoctorLine("rrrgen", VERSION, True, "")
    yield DoctorLine("Python", python, True, "")
    features = processor().split()
    vectors = next((name for name in WIDEST if name in features), "no vector instructions reported")
    yield DoctorLine("processor", f"{os.cpu_count()} cores, {vectors}", True, "")


def _compiler() -> DoctorLine:
    """Test the C compiler that rrrgen uses at run time: compile, load and call a small function."""
    from rrrgen.base.errors import RrrgenError
    from rrrgen.emit.c.compilers import find_compiler
    from rrrgen.runtime.build import build_extension

    use = "compiled models in Python, verify, ik"
    try:
        compiler = find_compiler()
        _, library = build_extension(PROBE, "double probe(double x);", "probe")
        works = library.probe(1.5) == 3.0
    except RrrgenError as error:
        return DoctorLine("C compiler", str(error), False, f"needed for {use}")
    return DoctorLine("C compiler", f"{compiler.command[0]}: {_version(compiler.version_command())}", works, use)


def _tools() -> Iterator[DoctorLine]:
    for program, use in TOOLS.items():
        path = shutil.which(program)
        state = "not found" if path is None else _version([path, "--version"])
        yield DoctorLine(program, state, path is not None, use)


def _version(command: list[str]) -> str:
    """Run a command that prints the version of a program; returns the first line of its output."""
    try:
        said = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=60, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"does not run ({error})"
    lines = (said.stdout or said.stderr).splitlines()
    return lines[0] if lines else "says no version"


def _extras() -> Iterator[DoctorLine]:
    from rrrgen.base.errors import EXTRAS, USES, is_installed

    for extra, use in USES.items():
        modules = [module for module, needed in EXTRAS.items() if needed == extra]
        missing = [module for module in modules if not is_installed(module)]
        there = ", ".join(f"{module} {_distribution(module)}".strip() for module in modules if module not in missing)
        lacking = f"without {', '.join(missing)}; pip install 'rrrgen[{extra}]'"
        state = there if not missing else f"{there}; {lacking}" if there else lacking
        yield DoctorLine(f"extra {extra}", state, not missing, use)


def _distribution(module: str) -> str:
    """The installed version of the distribution package named like ``module``."""
    try:
        return version(module)
    except PackageNotFoundError:
        return ""


def _cache() -> DoctorLine:
    from rrrgen.base.cache import cache_directory
    from rrrgen.base.errors import StorageError

    use = "what earlier runs built and derived; RRRGEN_CACHE chooses another directory, and it may be deleted"
    try:
        directory = cache_directory()
        sizes = [file.stat().st_size for file in directory.rglob("*") if file.is_file()]
    except (OSError, StorageError) as error:
        return DoctorLine("cache", str(error), False, use)
    return DoctorLine("cache", f"{directory}: {len(sizes)} files, {sum(sizes) / 1e6:.0f} MB", True, use)
