"""A wall in the way of the arm in MuJoCo is reported in time, and nothing before it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("mujoco", reason="the arm of this example is simulated by MuJoCo")
pytest.importorskip("scipy", reason="thresholds need the extra 'identify'")

SCRIPT = Path(__file__).resolve().parents[2] / "examples/collision/run.py"


def test_a_contact_is_reported_within_15_ms(tmp_path: Path) -> None:
    command = [sys.executable, SCRIPT, "--seconds", "13", "--block", "0.35", "-o", tmp_path]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr  # 1 for a false alarm or a late report
    assert "reported after" in done.stdout
    assert (tmp_path / "collision.png").exists()
