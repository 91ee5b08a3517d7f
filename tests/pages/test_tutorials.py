"""The tutorials: their files are written and their commands run, in order, as a reader would."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from pages.reader import follow

matplotlib = pytest.importorskip("matplotlib", reason="the tutorials draw figures")

ROOT = Path(__file__).resolve().parents[2]

PARTS = re.compile(r"(?:^`(?P<file>[\w./-]+)`:\n\n)?^```(?P<language>\w+)\n(?P<text>.*?)^```", re.S | re.M)


@pytest.mark.sweep(but=["first-model", "optimal-control"])
@pytest.mark.parametrize("page", ["first-model", "first-identification", "first-calibration", "optimal-control"])
def test_every_line_of_the_tutorial_runs(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    steps = []
    for part in PARTS.finditer((ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")):
        if part["file"]:
            (tmp_path / part["file"]).write_text(part["text"], encoding="utf-8")
        else:
            assert part["language"] in ("sh", "python", "text"), "a block that is neither run nor written nor printed"
            steps.append((part["language"], part["text"]))
    assert len(steps) > 1
    monkeypatch.chdir(tmp_path)
    with matplotlib.rc_context():  # a library of a page may have a style of its own
        follow(steps, lambda: capfd.readouterr().out)
