"""A target of another package: an entry point is enough for both doors, `export --to` and `generate --with`."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

MODULE = """
import json
from rrrgen.emit.targets.interface import Exported, Exporter

def write(spec, options):
    return Exported({"joints.json": json.dumps([joint.name for joint in spec.joints])}, ("links are left out",))

EXPORTER = Exporter("joint-list", "names of the joints as JSON", write, one_file=False)
"""


def installed(folder: Path, value: str, module: str = MODULE) -> Path:
    """A folder with a distribution as pip leaves it: a module, and metadata with an entry point."""
    info = folder / "tiny_target-1.0.dist-info"
    info.mkdir(parents=True)
    (folder / "tiny_target.py").write_text(module)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: tiny-target\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[rrrgen.targets]\njoint-list = {value}\n")
    return folder


COMMANDS = """
import contextlib, io, json, sys
from rrrgen.cli.main import run
answers = []
for words in json.loads(sys.argv[1]):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        answers.append([run(words), out, err])
print(json.dumps([[code, out.getvalue(), err.getvalue()] for code, out, err in answers]))
"""


def rrrgen(packages: Path, *commands: tuple[str, ...]) -> list[tuple[int, str, str]]:
    """The exit codes and outputs of commands, run one after the other in one process that finds ``packages``."""
    paths = [str(packages), *filter(None, [os.environ.get("PYTHONPATH")])]
    done = subprocess.run(
        [sys.executable, "-c", COMMANDS, json.dumps(commands)],
        capture_output=True, text=True, check=True, env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
    )  # fmt: skip
    return json.loads(done.stdout)


def test_export_and_generate_write_its_files(tmp_path):
    packages, model = installed(tmp_path / "packages", "tiny_target:EXPORTER"), str(tmp_path / "model")
    (_, told, _), export, generate = rrrgen(
        packages,
        ("export", "--help"),
        ("export", "pendulum", "--to", "joint-list", "-o", str(tmp_path / "exported")),
        ("generate", "pendulum", "-o", model, "--no-casadi-files", "--with", "joint-list"),
    )
    assert "names of the joints as JSON" in told
    assert export[0] == 0, export
    assert "links are left out" in export[1] + export[2]
    assert generate[0] == 0, generate
    assert "joint-list: links are left out" in generate[2]
    for folder in ("exported", "model/joint-list"):
        assert json.loads((tmp_path / folder / "joints.json").read_text()) == ["q1"]


@pytest.mark.sweep(but=["tiny_target:EXPORTER-raise RuntimeError('no licence')-cannot be loaded: no licence"])
@pytest.mark.parametrize(
    ("value", "module", "words"),
    [
        ("tiny_target:EXPORTER", "raise RuntimeError('no licence')", "cannot be loaded: no licence"),
        ("tiny_target:EXPORTER", "EXPORTER = 3", "but int"),
        ("tiny_target:EXPORTER", MODULE.replace("joint-list", "urdf"), "there is a target 'urdf' already"),
    ],
)
def test_an_unusable_entry_point_is_named_and_keeps_no_other_from_working(tmp_path, value, module, words):
    """A warning beside another target; an error, without a file, where it is the one that is asked for."""
    packages, urdf = installed(tmp_path / "packages", value, module), tmp_path / "pendulum.urdf"
    asked = "joint-list", "-o", str(tmp_path / "not_written")
    (code, _, warned), *refused, (_, told, _) = rrrgen(
        packages,
        ("export", "pendulum", "--to", "urdf", "-o", str(urdf)),
        ("export", "pendulum", "--to", *asked),
        ("generate", "pendulum", "--no-casadi-files", "--with", *asked),
        ("export", "--help"),
    )
    assert code == 0, warned
    assert "<robot" in urdf.read_text()
    assert "warning: tiny-target: target 'joint-list'" in warned
    assert words in warned
    for code, _, error in refused:
        assert code == 3, error
        assert f"rrrgen: tiny-target: target 'joint-list' ({value})" in error
        assert words in error
        assert not (tmp_path / "not_written").exists()
    assert "urdf" in told
