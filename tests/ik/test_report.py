"""The closed form for reading: its steps, evaluated in order, give the rows of the emitted code."""

from __future__ import annotations

import pytest

from ik.robots import ROWS, make
from rrrgen.base.errors import DerivationError
from rrrgen.emit.latex.inverse_kinematics import closed_form


@pytest.mark.parametrize("name", ["puma", "ur5", "stanford", "scara", "iiwa14"])
def test_large_arms_are_written_too(name):
    form = closed_form(make(name, ROWS[name]))
    joints = {str(step.symbol) for step in form.steps}
    moving = len(ROWS[name]) - (form.plan.locked is not None and form.plan.locked < len(ROWS[name]))
    assert sum(symbol.startswith("q_") for symbol in joints) >= moving
    assert form.latex().startswith("\\begin{align*}")
    assert form.text().startswith(f"inverse kinematics: {form.plan.title}\nat most ")


def test_a_chain_without_a_solver_says_why():
    rows = [("R", 0.3, 0.1, 0.0, 0.0)] * 9
    with pytest.raises(DerivationError, match="at most one joint can be prescribed"):
        closed_form(make("arm", rows))
