"""What is installed: templates, robots and types travel with the wheel, also with one built from the source archive."""

from __future__ import annotations

import os
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

USE = """
import sys
from pathlib import Path
import rrrgen, rrrgen.base.templates
from rrrgen.cli.main import run
assert str(Path(rrrgen.__file__)).startswith(sys.argv[1]), rrrgen.__file__
assert 'RESTRICT' in rrrgen.base.templates.template_text('c/header.h.j2')
code = run(['generate', 'pendulum', '-o', sys.argv[2], '--no-casadi-files'])
assert code == 0, code
"""


def test_the_wheel_built_from_the_source_archive_works_from_anywhere(tmp_path):
    pytest.importorskip("build")
    pytest.importorskip("hatchling")
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(tmp_path), str(ROOT)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    (archive,) = tmp_path.glob("*.tar.gz")
    with tarfile.open(archive) as source:
        names = {name.partition("/")[2] for name in source.getnames()}
    assert {"templates/c/header.h.j2", "LICENSE", "README.md", "rrrgen/py.typed"} <= names
    assert {"docs/index.md", "examples/README.md", "CITATION.cff", "generated/rrr/rrr.h"} <= names
    assert {path.name for path in ROOT.glob("*.md")} <= names
    (wheel,) = tmp_path.glob("*.whl")
    installed = tmp_path / "site"
    with zipfile.ZipFile(wheel) as file:
        contents = set(file.namelist())
        file.extractall(installed)
    assert {f"rrrgen/templates/{path}" for path in templates()} <= contents
    assert {"rrrgen/py.typed", "rrrgen/robot/robots/rrr.yaml"} <= contents
    done = subprocess.run(
        [sys.executable, "-c", USE, str(installed), str(tmp_path / "out")],
        env={**os.environ, "PYTHONPATH": str(installed)},
        cwd="/",
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert (tmp_path / "out" / "pendulum.h").is_file()


def templates() -> list[str]:
    root = ROOT / "templates"
    return [path.relative_to(root).as_posix() for path in root.rglob("*.j2")]


def test_the_checkout_has_no_symbolic_links():
    """They break checkouts on systems that have none, with an error far from its cause."""
    listed = subprocess.run(["git", "ls-files", "-s"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert not [line for line in listed.stdout.splitlines() if line.startswith("120000")]
