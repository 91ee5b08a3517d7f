"""Sampled rounding errors: in parts of any size, from the worst states of a port with many elements."""

from __future__ import annotations

import numpy as np
import pytest

from rrrgen.evidence import sampling
from rrrgen.evidence.boxes import PortRange
from rrrgen.evidence.rounding import DOUBLE, rounding_bounds
from rrrgen.evidence.sampling import largest_errors
from rrrgen.program import Builder, Port
from rrrgen.program.program import Role

BOX = {"q": PortRange((-3.0, -3.0), (3.0, 3.0), "test"), "x": PortRange((-1.0, -1.0), (1.0, 1.0), "test")}


@pytest.fixture(scope="module")
def program():
    """Twelve elements, of which the later ones have the larger errors, and a port of one."""
    b = Builder()
    q, x = b.input(Port("q", (2,), role=Role.POSITION)), b.input(Port("x", (2,), role=Role.VELOCITY))
    rows = [(k + 1) * (b.sin(q[0]) * x[0] + b.cos(q[1]) * x[1]) for k in range(12)]
    return b.program("f", [(Port("y", (12,)), rows), (Port("z", (1,)), [b.sin(q[0] + q[1])])])


def test_states_evaluated_in_parts_find_as_large_errors(program, monkeypatch):
    whole = largest_errors(program, BOX, DOUBLE, 2000, 1)
    monkeypatch.setattr(sampling, "_TOGETHER", 0.0)
    parts = largest_errors(program, BOX, DOUBLE, 2000, 1)
    bounds = np.concatenate(rounding_bounds(program, {name: each.bounds for name, each in BOX.items()}).double)
    for found in (whole, parts):
        assert (found <= bounds * sampling.RESOLUTION).all()
        assert (found >= 0.5 * whole).all()


def test_the_search_goes_on_from_the_largest_errors_of_every_port_and_counts_for_all(program, monkeypatch):
    drawn = largest_errors(program, BOX, DOUBLE, 100, 1, climbs=0)
    climbed = sampling._outputs_to_climb(program, drawn)
    assert len(climbed) == 9
    assert 12 in climbed  # the port of one element
    assert min(drawn[climbed[:8]]) >= max(drawn[np.setdiff1d(np.arange(12), climbed)])
    searched = largest_errors(program, BOX, DOUBLE, 100, 1)
    assert (searched >= drawn).all()
    assert (searched[np.setdiff1d(np.arange(12), climbed)] > drawn[np.setdiff1d(np.arange(12), climbed)]).any()
