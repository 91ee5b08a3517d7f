"""Friction laws as columns of the regressor: states along a motion, windows, coupled motors."""

from __future__ import annotations

import numpy as np
import pytest

from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.identify.friction_columns import FrictionSurface, Sliding, law_columns, recursion
from rrrgen.lab.identify.observations import Observations, RowMaker
from rrrgen.robot.friction.laws import LAWS
from rrrgen.robot.friction.models import FrictionModel


class Cut(Log):
    """A recording that is delivered in parts of ``size`` samples."""

    size = 4000

    def parts(self):
        for part in super().parts():
            for k in range(0, len(part), self.size):
                yield part.slice_samples(k, min(len(part), k + self.size))


def test_recursion_is_the_loop():
    rng = np.random.default_rng(0)
    a, b = np.exp(-rng.exponential(size=(300, 2)) * [0.01, 30.0]), rng.normal(size=(300, 2))
    y = np.zeros(2)
    for k, got in enumerate(recursion(a, b)):
        y = a[k] * y + b[k]
        assert got == pytest.approx(y, rel=1e-12, abs=1e-14)


@pytest.mark.parametrize("law", ["dahl", "dahl_exponential", "lugre"])
def test_columns_are_the_law_along_a_motion(law):
    """Parameters times columns equal the law stepped from sample to sample, at a motor that moves two joints."""
    shapes = {"dahl": (2e-3,), "dahl_exponential": (0.1, 2e-3), "lugre": (1.4, 0.3, 2e-3)}[law]
    surface = FrictionSurface("_m", (0.5, 2.0), law, shapes)
    t = np.arange(2000) * 1e-3
    speed = np.column_stack([6 * np.cos(2 * np.pi * t), -1.5 * np.sin(5 * t)])
    mean = (speed[1:] + speed[:-1]) / 2
    q = np.vstack([np.zeros((1, 2)), np.cumsum(mean * 1e-3, axis=0)])
    W = law_columns([surface], speed, Sliding((surface,)).states(q, speed, np.zeros(1)))
    linear = [0.7, 2.0, 1.5, -0.2][: len(LAWS[law].linear)]
    model = FrictionModel(LAWS[law], np.array([LAWS[law].join(linear, shapes)]))
    z = np.zeros(1)
    for k in range(len(t)):
        if k:
            z, _ = model.step(z, mean[k - 1] @ [[0.5], [2.0]], 1e-3)
        tau = model.state_torque(z, speed[k] @ [[0.5], [2.0]])
        assert W[k] @ linear == pytest.approx(np.array([0.5, 2.0]) * tau, rel=1e-9, abs=1e-9)


def test_states_do_not_depend_on_where_the_recording_is_cut():
    slow = FrictionSurface("2", (0.0, 1.0), "lugre", (1.4, 0.5, 3.0))
    surfaces = (FrictionSurface("1", (1.0, 0.0), "dahl", (0.02,)), slow)
    rng = np.random.default_rng(1)
    t = np.arange(4000) * 1e-3
    q = np.column_stack([np.sin(3 * t), np.cos(2 * t)]) * (t < 2.5)[:, None] + 1e-5 * rng.normal(size=(4000, 2))
    maker = RowMaker(
        lambda q, dq, ddq, s: law_columns(surfaces, dq, s),
        Processing("butterworth", cutoff=20.0, decimate=10),
        columns=5,
        sliding=Sliding.of(surfaces),
    )
    log = Cut(("a", "b"), t, q, np.zeros_like(q))
    whole = np.concatenate([rows.W for rows in Observations((log,), maker)])
    log.__class__.size = 700
    cut = np.concatenate([rows.W for rows in Observations((log,), maker)])
    assert len(list(Observations((log,), maker).windows())) > 2
    assert cut == pytest.approx(whole, abs=1e-9)
    assert np.ptp(whole[:, 1, 3]) > 0.1
