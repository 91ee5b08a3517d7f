"""The tutorials: their files are written and their commands run, in order, as a reader would.

One process runs a page, so that libraries are loaded once: commands through the entry point of the command line, Python
as a script of its own, everything else by the shell.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

PARTS = re.compile(r"(?:^`(?P<file>[\w./-]+)`:\n\n)?^```(?P<language>\w+)\n(?P<text>.*?)^```", re.S | re.M)

READER = """
import json, shlex, subprocess, sys
from rrrgen.cli.main import run
from rrrgen.runs import figures

figures.PRINT = 60  # as for all tests, whose conftest.py does not reach this process
for language, text in json.loads(sys.argv[1]):
    print("[step]", text, flush=True)
    if language == "python":
        exec(compile(text, "page", "exec"), {"__name__": "__main__"})
        continue
    for line in text.replace("\\\\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        code = run(words[1:]) if words[:1] == ["rrrgen"] else subprocess.run(["bash", "-e", "-c", line]).returncode
        if code:
            sys.exit(f"exit code {code}: {line}")
"""


@pytest.mark.parametrize("page", ["first-model", "first-identification", "first-calibration", "optimal-control"])
def test_every_line_of_the_tutorial_runs(page: str, tmp_path: Path) -> None:
    steps = []
    for part in PARTS.finditer((ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")):
        if part["file"]:
            (tmp_path / part["file"]).write_text(part["text"], encoding="utf-8")
        elif part["language"] in ("sh", "python"):
            steps.append((part["language"], part["text"]))
        else:
            assert part["language"] == "text", "a block that is neither run nor written"
    assert len(steps) > 1
    done = subprocess.run(
        [sys.executable, "-c", READER, json.dumps(steps)],
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, f"{done.stdout[-5000:]}\n{done.stderr}"
    ran = [line for line in done.stdout.splitlines() if line.startswith("[step]")]
    assert len(ran) == len(steps)
