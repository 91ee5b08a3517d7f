"""A person pushes an arm in MuJoCo and then guides it: it stops, yields, goes on; the same bits in C and Python."""

from __future__ import annotations

import pytest

from examples.script import exit_code

pytest.importorskip("mujoco", reason="the arm of this example is simulated by MuJoCo")


def test_a_push_stops_the_arm_and_a_hand_guides_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_code("guidance", "--c") == 0
    assert "stopped at 10" in capsys.readouterr().out
