"""The planned motion: both exact Hessians lead to it, and what the page says of the methods is printed."""

from __future__ import annotations

import pytest

from examples.script import exit_code

pytest.importorskip("casadi", reason="the solver is IPOPT, which comes with CasADi")


def test_exact_hessians_lead_to_the_same_motion(capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_code("swing", "--robot", "planar2r", "--intervals", "10", "--most", "60") == 0
    lines = capsys.readouterr().out.splitlines()
    found = {line[:36].strip(): line[36:].split() for line in lines[2:]}
    own, theirs = found["exact Hessian, functions of rrrgen"], found["exact Hessian, derived by CasADi"]
    assert own[0] == theirs[0]
    assert own[-1] == theirs[-1]
    assert set(found) >= {"Gauss-Newton", "quasi-Newton (L-BFGS)"}
