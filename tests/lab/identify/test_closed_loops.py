"""Identification of a robot with closed loops, from motions along which they are assembled."""

from __future__ import annotations

import numpy as np
import pytest

import rrrgen
from derive.loops import FIVE_BAR
from rrrgen.base.errors import InputError


@pytest.fixture(scope="module")
def five_bar():
    return rrrgen.compile(rrrgen.loads_spec(FIVE_BAR), backend="numpy")


def _swing(offset: tuple[float, float]) -> tuple[np.ndarray, ...]:
    """Times, and an arm and a crank that swing about ``offset``, rad: positions, speeds, accelerations (N, 2)."""
    t = np.arange(0, 6, 0.01)
    w = 2 * np.pi * np.array([0.5, 1.0, 1.5])[:, None]
    amplitude = np.array([[0.3, 0.1, 0.08], [-0.2, 0.2, 0.1]]).T[:, None, :]
    phase = (w * t)[:, :, None] + np.array([0.0, 1.0])
    scaled = w[:, :, None]
    q = (amplitude * np.sin(phase)).sum(0) + offset
    dq = (scaled * amplitude * np.cos(phase)).sum(0)
    return t, q, dq, (-(scaled**2) * amplitude * np.sin(phase)).sum(0)


def test_its_base_parameters_are_found(five_bar):
    t, q, dq, ddq = _swing((0.3, 1.2))
    loops, status = five_bar.closed_loops(q, with_status=True)
    assert not status.any()
    assert loops.sine.min() > 0.2
    rng = np.random.default_rng(3)
    tau = five_bar.inverse_dynamics(q, dq, ddq) + 1e-3 * rng.normal(size=q.shape)
    recorded = {"t": t, "q": q, "tau": tau}
    found = rrrgen.identify(five_bar, recorded)
    assert found.identification.fit["relative_error"] < 1e-3
    assert not found.diagnoses
    identified = rrrgen.compile(found.spec, backend="numpy")
    _, q, dq, ddq = _swing((0.2, 1.3))
    error = identified.inverse_dynamics(q, dq, ddq) - five_bar.inverse_dynamics(q, dq, ddq)
    assert np.abs(error).max() < 0.02 * np.abs(tau).max()


def test_positions_that_the_loop_cannot_take_are_refused(five_bar):
    t, q, dq, ddq = _swing((0.3, 1.2))
    tau = five_bar.inverse_dynamics(q, dq, ddq)
    turned = q + np.array([1.5, 0.0])
    assert (five_bar.closed_loops(turned, with_status=True)[1] == 2).any()
    with pytest.raises(InputError, match=r"closed loops cannot be assembled at .* check zeros"):
        rrrgen.identify(five_bar, {"t": t, "q": turned, "tau": tau}, consistent=False)
