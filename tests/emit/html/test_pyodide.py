"""The core's tests that need no NumPy, in the Python that the playground runs: Pyodide under node.

The compiler comes from the archive of the page, so that a module which the archive lacks is found here too.
"""

from __future__ import annotations

import re
import subprocess
import zipfile
from importlib import import_module
from pathlib import Path

import pytest

from rrrgen.cli.playground import write_compiler

from .test_playground import NODE, NPM, ROOT

PACKAGES = ("pytest", "_pytest", "pluggy", "iniconfig", "packaging", "pygments")
"""What pytest imports, besides the module py."""

CORE = (
    "base/test_templates.py",
    "base/test_version.py",
    "derive/test_optimizer.py",
    "emit/targets/test_notes.py",
    "emit/test_costs.py",
    "emit/test_equations.py",
    "emit/test_header_comments.py",
    "emit/test_languages.py",
    "emit/test_solver_arcs.py",
    "emit/test_solver_hoisting.py",
    "emit/test_solver_unused.py",
    "ik/test_symbolic_chain.py",
    "program/test_dump.py",
    "program/test_program.py",
    "robot/file/test_folded_faults.py",
    "robot/file/test_joints.py",
    "robot/file/test_quantities.py",
    "robot/file/test_schema.py",
    "robot/file/test_suggestions.py",
    "robot/test_identity.py",
)
"""Test files of the core that need the compiler's libraries alone, but for a test with a C compiler."""


def missing() -> str:
    if NODE is None:
        return "needs node"
    return "" if (NPM / "pyodide").is_dir() else "needs the npm package pyodide: make playground"


def test_the_core_passes_in_the_browsers_python(tmp_path: Path) -> None:
    if reason := missing():
        pytest.skip(reason)
    write_compiler(tmp_path / "compiler.zip")
    with zipfile.ZipFile(tmp_path / "tests.zip", "w") as archive:
        for source in (ROOT / "tests").rglob("*"):
            if source.suffix in (".py", ".yaml", ".json", ".txt", ".urdf", ".xml", ".csv"):
                archive.write(source, source.relative_to(ROOT).as_posix())
        for name in PACKAGES:
            folder = Path(str(import_module(name).__file__)).parent
            for source in folder.rglob("*.py"):
                archive.write(source, source.relative_to(folder.parent).as_posix())
        archive.write(str(import_module("py").__file__), "py.py")
        for name in ("pyproject.toml", "CITATION.cff", "CHANGELOG.md"):  # the version is stated there as well
            archive.write(ROOT / name, name)
    script = Path(__file__).with_name("pyodide_tests.mjs")
    files = [f"tests/{name}" for name in CORE]
    command = [NODE, script, NPM / "pyodide", tmp_path / "compiler.zip", tmp_path / "tests.zip", "--", *files]
    done = subprocess.run(command, capture_output=True, text=True, timeout=900)
    print(done.stdout[-12000:], done.stderr[-4000:])
    assert done.returncode == 0
    assert int(re.findall(r"(\d+) passed", done.stdout)[-1]) > 100
