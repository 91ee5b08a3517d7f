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


def rrrgen(packages: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    paths = [str(packages), *filter(None, [os.environ.get("PYTHONPATH")])]
    return subprocess.run(
        [sys.executable, "-m", "rrrgen", *arguments],
        capture_output=True, text=True, env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
    )  # fmt: skip


def test_export_and_generate_write_its_files(tmp_path):
    packages = installed(tmp_path / "packages", "tiny_target:EXPORTER")
    assert "names of the joints as JSON" in rrrgen(packages, "export", "--help").stdout
    done = rrrgen(packages, "export", "pendulum", "--to", "joint-list", "-o", str(tmp_path / "exported"))
    assert done.returncode == 0, done.stderr
    assert "links are left out" in done.stdout + done.stderr
    done = rrrgen(
        packages, "generate", "pendulum", "-o", str(tmp_path / "model"), "--no-casadi-files", "--with", "joint-list"
    )
    assert done.returncode == 0, done.stderr
    assert "joint-list: links are left out" in done.stderr
    for folder in ("exported", "model/joint-list"):
        assert json.loads((tmp_path / folder / "joints.json").read_text()) == ["q1"]


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
    packages = installed(tmp_path / "packages", value, module)
    urdf = tmp_path / "pendulum.urdf"
    done = rrrgen(packages, "export", "pendulum", "--to", "urdf", "-o", str(urdf))
    assert done.returncode == 0, done.stderr
    assert "<robot" in urdf.read_text()
    assert "warning: tiny-target: target 'joint-list'" in done.stderr
    assert words in done.stderr
    for arguments in (["export", "pendulum", "--to"], ["generate", "pendulum", "--no-casadi-files", "--with"]):
        done = rrrgen(packages, *arguments, "joint-list", "-o", str(tmp_path / "not_written"))
        assert done.returncode == 3, done.stderr
        assert f"rrrgen: tiny-target: target 'joint-list' ({value})" in done.stderr
        assert words in done.stderr
        assert not (tmp_path / "not_written").exists()
    assert "urdf" in rrrgen(packages, "export", "--help").stdout
