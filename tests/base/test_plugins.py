"""Other packages add robots, importers and commands: an entry point is enough."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

MODULE = """
from pathlib import Path
import click
from rrrgen.robot.importers.interface import Found, Importer

ROBOT = Path(__file__).with_name("tiny.yaml")

def read(source, faults):
    from rrrgen.robot.file.reader import load_spec
    return Found(load_spec(str(ROBOT)))

IMPORTER = Importer("tiny-format", "a format of one robot", (".tiny",), lambda text: text.startswith("tiny"), read)

@click.command()
@click.argument("word")
def hello(word):
    \"\"\"Greet.\"\"\"
    click.echo(f"hello {word}")
"""

ENTRIES = """[rrrgen.robots]
tiny = tiny_arms:ROBOT
tiny-format = tiny_arms:IMPORTER
[rrrgen.commands]
hello = tiny_arms:hello
broken = tiny_arms:missing
check = tiny_arms:hello
"""


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("packages")
    info = folder / "tiny_arms-1.0.dist-info"
    info.mkdir()
    pendulum = Path(__file__).parents[2] / "rrrgen" / "robot" / "robots" / "pendulum.yaml"
    (folder / "tiny.yaml").write_text(pendulum.read_text().replace("name: pendulum", "name: tiny"))
    (folder / "tiny_arms.py").write_text(MODULE)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: tiny-arms\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(ENTRIES)
    return folder


def rrrgen(packages: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    paths = [str(packages), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    command = [sys.executable, "-m", "rrrgen", *arguments]
    return subprocess.run(command, capture_output=True, text=True, env=environment, check=False)


def test_a_robot_and_an_importer(packages: Path, tmp_path: Path) -> None:
    done = rrrgen(packages, "check", "tiny")
    assert (done.returncode, done.stdout.split(":")[0]) == (0, "tiny"), done.stderr
    (tmp_path / "arm.tiny").write_text("tiny arm\n")
    done = rrrgen(packages, "import", str(tmp_path / "arm.tiny"), "-o", str(tmp_path / "arm.yaml"))
    assert done.returncode == 0, done.stderr
    assert "name: tiny" in (tmp_path / "arm.yaml").read_text()


def test_a_command_and_one_that_cannot_be_loaded(packages: Path) -> None:
    done = rrrgen(packages, "hello", "world")
    assert (done.returncode, done.stdout) == (0, "hello world\n"), done.stderr
    done = rrrgen(packages, "broken")
    assert done.returncode == 3
    assert "tiny-arms: command 'broken' (tiny_arms:missing) cannot be loaded" in done.stderr
    assert "Commands of other packages" in rrrgen(packages, "--help-all").stdout
    assert rrrgen(packages, "check", "pendulum").stdout.startswith("pendulum: ok")  # a name of ours stays ours
