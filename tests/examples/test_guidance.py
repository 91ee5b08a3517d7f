"""A person pushes an arm in MuJoCo and then guides it: it stops, yields, goes on; the same bits in C and Python."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from examples.script import exit_code

pytest.importorskip("mujoco", reason="the arm of this example is simulated by MuJoCo")


@pytest.mark.sweep
def test_a_push_stops_the_arm_and_a_hand_guides_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_code("guidance", "--c") == 0
    assert "stopped at 10" in capsys.readouterr().out


def test_the_loops_are_as_short_as_the_page_says() -> None:
    """Lines of code, without comments and lone braces: the program in C, the function of the scene in Python."""
    folder = Path(__file__).parents[2] / "examples" / "guidance"
    code = re.sub(r"/\*.*?\*/", "", (folder / "loop.c").read_text(encoding="utf-8"), flags=re.DOTALL)
    assert sum(bool(line.strip(" {}")) for line in code.splitlines()) <= 40
    python = (folder / "run.py").read_text(encoding="utf-8")
    scene = python[python.index("    for k in range") : python.index("    return np.array(rows)")]
    assert len(scene.splitlines()) <= 20
