"""The controller of a robot with closed loops reports dead points, and stops there if its parameters say so."""

from __future__ import annotations

import numpy as np
import pytest

import rrrgen
from derive.loops import FOUR_BAR

SHORT = FOUR_BAR.replace("[0.6, 0, 0]", "[0.25, 0, 0]")


@pytest.fixture(scope="module")
def four_bar():
    return rrrgen.compile(rrrgen.loads_spec(SHORT))


@pytest.mark.parametrize(("action", "phase"), [(0, "RUN"), (1, "STOP")])
def test_a_dead_point_is_reported(four_bar, action, phase):
    q = np.linspace(0, np.pi, 2000)[:, None]
    _, status = four_bar.closed_loops(q, with_status=True)
    near, away = q[np.flatnonzero(status)[0]], q[np.flatnonzero(status == 0)[50]]
    c = four_bar.controller("gravity", modes=["gravity"], parts=[], model_action=action)
    for place, reported in ((away, False), (near, True)):
        c.start(q=place, dq=[0.0])
        seen = set()
        for _ in range(20):
            out = c.step(q=place, dq=[0.0])
            seen |= {*c.faults(out.status)}
            assert np.isfinite(out.tau).all()
        assert ("MODEL" in seen) is reported
        assert c.description["phases"][out.phase] == (phase if reported else "RUN")
