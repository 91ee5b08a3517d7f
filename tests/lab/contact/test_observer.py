"""Accuracy of the momentum observer on exact states, with the model exact: what is left is the rule of integration."""

from __future__ import annotations

import numpy as np
import pytest

import rrrgen
from lab.contact.observer import ROBOTS, estimates, first_order, motion


def rms(r):
    return float(np.sqrt(np.mean(np.square(r))))


@pytest.mark.parametrize(("robot", "limit"), [("rrr", 0.0014), ("panda", 0.029)])
@pytest.mark.sweep(but=["rrr-0.0014"])
def test_the_error_without_a_contact(robot, limit):
    """The limits are those of a prototype at K T = 0.05; the first-order form blows up at K T = 2.5."""
    model, (friction, q0) = rrrgen.compile(robot), ROBOTS[robot]
    recorded = motion(model, friction, q0, count=20, seconds=0.25)
    error = rms(estimates(model, friction, *recorded, 50.0))
    assert 0.1 * limit < error < limit
    assert rms(first_order(model, friction, *recorded, 50.0)) > (4 if robot == "rrr" else 1) * error
    short = [part[:60] for part in recorded]
    assert rms(estimates(model, friction, *short, 2500.0)) < 2 * error
    assert rms(first_order(model, friction, *short, 2500.0)) > 1e6
