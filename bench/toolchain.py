"""Compilers, their flags, and the cache of object files."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from rrrgen.base.cache import cache_directory, digest
from rrrgen.base.errors import BuildError
from rrrgen.emit.c.compilers import find_compiler

FLAGS = ("-O3", "-march=native")
"""For every contender. Contraction to fused multiply-adds stays as the compiler has it by default: on, for all."""

STANDARDS = {"c": "-std=gnu99", "cpp": "-std=c++17"}


@dataclass(frozen=True)
class Toolchain:
    """A C and a C++ compiler of the same vendor, and the flags for both."""

    cc: tuple[str, ...]
    cxx: str | None
    flags: tuple[str, ...]

    def object(self, name: str, source: str, headers: Mapping[str, str], extra: Sequence[str] = ()) -> Path:
        """Compile ``source`` (``name`` ends in .c or .cpp) next to ``headers``; cached by content."""
        language = name.rsplit(".", 1)[1]
        command = [*self.cc] if language == "c" else [self.require_cxx()]
        command += [STANDARDS[language], *self.flags, *extra]
        contents = [text for header in sorted(headers) for text in (header, headers[header])]
        key = digest(_version(command[0]), _processor(), *command, source, *contents)[:24]
        place = _directory() / key
        target = place / f"{name}.o"
        if not target.exists():
            place.mkdir(parents=True, exist_ok=True)
            for file, text in {**headers, name: source}.items():
                (place / file).write_text(text, encoding="utf-8")
            part = place / f"{name}.{os.getpid()}.part"
            run([*command, f"-I{place}", "-c", str(place / name), "-o", str(part)])
            os.replace(part, target)
        return target

    def link(self, objects: Sequence[Path], target: Path, cxx: bool) -> None:
        """Link ``objects`` to an executable."""
        command = [self.require_cxx()] if cxx else [*self.cc]
        run([*command, *map(str, objects), "-lm", "-o", str(target)])

    def require_cxx(self) -> str:
        """The command of the C++ compiler. Raises BuildError if there is none."""
        if self.cxx is None:
            raise BuildError("no C++ compiler beside the C compiler: Pinocchio cannot be built")
        return self.cxx

    def describe(self) -> str:
        """Compiler and flags, for the report."""
        return f"{Path(self.cc[0]).resolve().name}: {_version(self.cc[0])}, `{' '.join(self.flags)}`"


def find_toolchain(flags: Sequence[str] = FLAGS) -> Toolchain:
    """``$CC`` (or the first C compiler found) and the C++ compiler of the same make. Raises BuildError without C."""
    cc = find_compiler().command
    make = Path(cc[0]).name
    partners = {"gcc": "g++", "clang": "clang++", "cc": "c++"}
    cxx = shutil.which(partners.get(make, make.replace("gcc", "g++").replace("clang", "clang++")))
    return Toolchain(cc, None if cxx == cc[0] else cxx, tuple(flags))


def run(command: Sequence[str], seconds: float = 3600.0) -> str:
    """Run a command and return its output. Raises BuildError with its error message if it fails."""
    done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=seconds, check=False)
    if done.returncode:
        words = "\n".join(line[:300] for line in done.stderr.splitlines() if "error" in line)
        raise BuildError(f"{command[0]} failed (exit {done.returncode}):\n{words[:3000]}")
    return done.stdout


def machine() -> str:
    """The name of the processor."""
    return f"{_processor()}, {os.cpu_count()} cores, {platform.system()} {platform.machine()}"


@cache
def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    facts = dict(line.split(":", 1) for line in lines if ":" in line)
    facts = {key.strip(): value.strip() for key, value in facts.items()}
    widest = [kind for kind in ("avx512f", "avx2", "avx", "sse2") if kind in facts.get("flags", "").split()]
    name = facts.get("model name", platform.machine())
    return f"{name} ({widest[0].upper()})" if widest else name


@cache
def _version(compiler: str) -> str:
    return run([compiler, "--version"]).splitlines()[0]


def _directory() -> Path:
    place = cache_directory() / "bench"
    place.mkdir(exist_ok=True)
    return place
