"""A wall in the way of the arm in MuJoCo is reported in time, and nothing before it."""

from __future__ import annotations

from pathlib import Path

import pytest

from examples.script import exit_code

pytest.importorskip("mujoco", reason="the arm of this example is simulated by MuJoCo")
pytest.importorskip("scipy", reason="thresholds need the extra 'identify'")


@pytest.mark.sweep
def test_a_contact_is_reported_within_15_ms(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ("--seconds", "9", "--block", "0.25", "-o", tmp_path)
    assert exit_code("collision", *arguments) == 0  # 1 for a false alarm or a late report
    assert "reported after" in capsys.readouterr().out
    assert (tmp_path / "collision.png").exists()
