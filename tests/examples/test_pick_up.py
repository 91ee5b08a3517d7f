"""From an unknown arm to a carried payload: the identified payload restores the accuracy of the loop."""

from __future__ import annotations

from pathlib import Path

import pytest

from examples.script import exit_code

pytest.importorskip("scipy", reason="identification needs the extra 'identify'")
pytest.importorskip("casadi", reason="exciting trajectories need the extra 'identify'")


@pytest.mark.sweep
def test_a_payload_is_identified_and_compensated(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_code("pick_up", "-o", tmp_path) == 0  # 1 unless the error falls tenfold
    values = dict(line.split()[:2] for line in capsys.readouterr().out.splitlines() if line.endswith("mrad"))
    assert float(values["told"]) < 2 * float(values["empty"])
    assert (tmp_path / "pick_up.png").exists()
