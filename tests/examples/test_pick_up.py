"""From an unknown arm to a carried payload: the identified payload restores the accuracy of the loop."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("scipy", reason="identification needs the extra 'identify'")
pytest.importorskip("casadi", reason="exciting trajectories need the extra 'identify'")

SCRIPT = Path(__file__).resolve().parents[2] / "examples/pick_up/run.py"


def test_a_payload_is_identified_and_compensated(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, SCRIPT, "-o", tmp_path], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr  # 1 unless the error falls tenfold
    values = dict(line.split()[:2] for line in done.stdout.splitlines() if line.endswith("mrad"))
    assert float(values["told"]) < 2 * float(values["empty"])
    assert (tmp_path / "pick_up.png").exists()
