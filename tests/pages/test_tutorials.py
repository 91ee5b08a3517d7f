"""The tutorials: their files are written and their commands run, in order, as a reader would."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

PARTS = re.compile(r"(?:^`(?P<file>[\w./-]+)`:\n\n)?^```(?P<language>\w+)\n(?P<text>.*?)^```", re.S | re.M)


@pytest.mark.parametrize("page", ["first-model", "first-identification", "first-calibration", "optimal-control"])
def test_every_line_of_the_tutorial_runs(page: str, tmp_path: Path) -> None:
    programs = tmp_path / "bin"
    programs.mkdir()
    launcher = programs / "rrrgen"
    launcher.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m rrrgen "$@"\n', encoding="utf-8")
    launcher.chmod(0o755)
    path = os.pathsep.join([str(programs), str(Path(sys.executable).parent), os.environ["PATH"]])
    environment = {**os.environ, "PATH": path, "PYTHONPATH": str(ROOT)}
    folder = tmp_path / "work"
    folder.mkdir()
    ran = 0
    for part in PARTS.finditer((ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")):
        if part["file"]:
            (folder / part["file"]).write_text(part["text"], encoding="utf-8")
        elif part["language"] in ("sh", "python"):
            command = ["bash", "-e", "-c"] if part["language"] == "sh" else [sys.executable, "-c"]
            done = subprocess.run(
                [*command, part["text"]], cwd=folder, env=environment, capture_output=True, text=True, check=False
            )
            assert done.returncode == 0, f"{part['text']}\n{done.stdout}\n{done.stderr}"
            ran += 1
        else:
            assert part["language"] == "text", "a block that is neither run nor written"
    assert ran > 1
