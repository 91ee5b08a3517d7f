"""Imports: they go down the rooms only, and nothing heavy is loaded before it is used."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "rrrgen"

ROOMS = (
    "base",
    "program",
    "robot",
    "derive",
    "ik",
    "emit",
    "controller",
    "exporting",
    "runtime",
    "verify",
    "evidence",
    "lab/data",
    "lab/estimate",
    "lab/design",
    "lab/response",
    "lab/friction",
    "lab/plant",
    "lab/identify",
    "lab/closed_loop",
    "lab/calibrate",
    "lab/contact",
    "lab/vibration",
    "lab/experiment",
    "lab/studies",
    "cli",
)
"""From the bottom to the top: a room imports from rooms before it. The compiler knows nothing of the laboratory."""

HEAVY = ("sympy", "numpy", "scipy", "casadi", "cffi", "jinja2", "matplotlib", "cvxpy", "ruamel", "joblib")


@cache
def imports(file: Path) -> list[tuple[str, str]]:
    """What a file imports when it runs, inside functions too, as (module, name in it or ""); not for type checkers."""
    nodes = list(ast.walk(ast.parse(file.read_text(encoding="utf-8"))))
    unread = {
        inner
        for node in nodes
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        for inner in ast.walk(node)
    }
    found: list[tuple[str, str]] = []
    for node in nodes:
        if isinstance(node, ast.ImportFrom) and node not in unread:
            assert node.level == 0, f"{file}: imports name their room"
            found += ((str(node.module), alias.name) for alias in node.names)
        elif isinstance(node, ast.Import) and node not in unread:
            found += ((alias.name, "") for alias in node.names)
    return found


def imported(file: Path) -> Iterator[str]:
    """The modules among them, those of the package by their room."""
    for module, name in imports(file):
        yield f"rrrgen.{name}" if module == "rrrgen" and name else module


def room_files(room: str) -> list[Path]:
    """The files of a room: those of its folder, or the one file that it is."""
    alone = PACKAGE / f"{room}.py"
    return [alone] if alone.exists() else sorted((PACKAGE / room).rglob("*.py"))


def room_of(module: str) -> str:
    """The room of a module of the package, such as "derive" or "lab/data"."""
    parts = module.split(".")
    return "/".join(parts[1:3]) if parts[1] == "lab" else parts[1]


def rooms_used(room: str) -> set[str]:
    files = room_files(room)
    assert files, room
    used = {module for file in files for module in imported(file)}
    assert "rrrgen" not in used, f"{room} imports the package, which stands above every room"
    return {room_of(module) for module in used if module.startswith("rrrgen.")} - {room}


def test_every_room_is_listed():
    files = set(PACKAGE.rglob("*.py")) - {PACKAGE / name for name in ("__init__.py", "__main__.py", "lab/__init__.py")}
    assert {room_of(module_name(file)) for file in files} == set(ROOMS)


@pytest.mark.parametrize("room", ROOMS)
def test_imports_go_down(room):
    allowed = set(ROOMS[: ROOMS.index(room)])
    assert rooms_used(room) <= allowed, f"{room} imports from a room above it"


def test_no_room_outgrows_the_house():
    lines = {
        room: sum(len(file.read_text(encoding="utf-8").splitlines()) for file in room_files(room)) for room in ROOMS
    }
    total = sum(lines.values())
    assert {room: count for room, count in lines.items() if count > 0.15 * total} == {}


def test_no_circles_of_modules():
    files = {module_name(file): file for file in PACKAGE.rglob("*.py")}
    used = {
        module: {f"{source}.{name}" if f"{source}.{name}" in files else source for source, name in imports(file)}
        for module, file in files.items()
    }
    order = TopologicalSorter({module: (each & files.keys()) - {module} for module, each in used.items()})
    assert len(list(order.static_order())) == len(files)  # CycleError tells the circle


def module_name(file: Path) -> str:
    parts = file.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def test_backends_do_not_import_each_other():
    folders = ("c", "casadi", "latex")
    for own in folders:
        used = {module for file in (PACKAGE / "emit" / own).rglob("*.py") for module in imported(file)}
        for other in set(folders) - {own}:
            assert not any(f"{module}.".startswith(f"rrrgen.emit.{other}.") for module in used), (own, other)


def modules_after(statement: str) -> set[str]:
    code = f"import sys\n{statement}\nprint(*sorted(name.split('.')[0] for name in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=PACKAGE.parent)
    return set(done.stdout.splitlines()[-1].split())


@pytest.mark.parametrize(
    "statement",
    [
        "import rrrgen",
        "from rrrgen.cli.main import run\nrun(['--help'])",
        "from rrrgen.cli.main import run\nrun(['verify', '--help'])",
        "from rrrgen.cli.main import run\nrun(['identify', '--help'])",
    ],
    ids=["package", "help", "command-help", "study-help"],
)
def test_help_and_import_load_nothing_heavy(statement):
    assert modules_after(statement) & set(HEAVY) == set()


def test_heavy_modules_would_be_seen():
    assert "numpy" in modules_after("import numpy")
