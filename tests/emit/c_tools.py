"""Compilers for emitted C, and how strictly they are asked."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from rrrgen.emit.c.robot_files import CBackend
from rrrgen.robot.identity import Identity

IDENTITY = Identity("0123456789abcdef" * 4, "0.0.0")

WARNINGS = [
    "-Wall",
    "-Wextra",
    "-Wpedantic",
    "-Wconversion",
    "-Wdouble-promotion",
    "-Wshadow",
    "-Wundef",
    "-Wfloat-equal",
    "-Werror",
]
C99 = ["-std=c99", "-Wstrict-prototypes", "-Wmissing-prototypes", *WARNINGS]
CXX = ["-x", "c++", "-std=c++17", *WARNINGS]
SANITIZERS = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-O0"]


def compiler(name: str) -> str:
    """The compiler's path; the test is skipped where it is not installed."""
    path = shutil.which(name)
    if path is None:
        pytest.skip(f"{name} is not installed")
    return path


def write(files: dict[str, str], folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8", newline="\n")
    return folder


def emitted(model, folder: Path, real: str = "double") -> Path:
    """The C of ``model`` below ``folder``."""
    return write(CBackend().files(model, IDENTITY, real), folder)


def compile_all(folder: Path, command: list[str], program: str = "selftest") -> Path:
    """Compile and link every C file of ``folder``; a compiler's complaint fails the test with its words."""
    sources = sorted(path.name for path in folder.glob("*.c"))
    done = subprocess.run(
        [*command, *sources, "-o", program, "-lm"], cwd=folder, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr[:3000]
    return folder / program


def check_all(folder: Path, command: list[str]) -> None:
    """Let a compiler read every C file of ``folder`` without making code; a complaint fails the test with its words."""
    sources = sorted(path.name for path in folder.glob("*.c"))
    done = subprocess.run(
        [*command, "-fsyntax-only", *sources], cwd=folder, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr[:3000]


def run(program: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(program)], capture_output=True, text=True, timeout=120)


def frames(source: Path, command: list[str]) -> dict[str, int]:
    """Bytes of stack of every function of a C file, as the compiler reports them; clones count as their function."""
    subprocess.run(
        [*command, "-std=c99", "-fstack-usage", "-c", source.name], cwd=source.parent, check=True, timeout=300
    )
    found: dict[str, int] = {}
    for line in source.with_suffix(".su").read_text().splitlines():
        place, size, kind = line.split("\t")
        assert kind != "dynamic", line  # "dynamic,bounded" is a frame that is aligned for vectors
        function = place.split(":")[-1].split(".")[0]
        found[function] = max(found.get(function, 0), int(size))
    return found
