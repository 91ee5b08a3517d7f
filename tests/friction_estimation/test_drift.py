"""A drift of the friction is reported with its size; friction that stays as it is passes in silence."""

import numpy as np
import pytest

from rrrgen.lab.friction.drift import friction_drift
from rrrgen.lab.friction.joint_recording import JointData

PERIOD, SECONDS = 1e-3, 40.0


def recorded(fall, seed):
    """A joint on fast, then slow sines, whose torque is computed here; viscous friction falls by the share ``fall``."""
    random = np.random.default_rng(seed)
    t = np.arange(round(SECONDS / PERIOD)) * PERIOD
    q, dq, ddq = np.zeros((3, len(t)))
    for f in (0.1, 0.3, 0.7, 1.1, 2.3):
        w, phase, size = 2 * np.pi * f, random.uniform(0, 2 * np.pi), 0.5
        q += size / w * np.sin(w * t + phase)
        dq += size * np.cos(w * t + phase)
        ddq -= size * w * np.sin(w * t + phase)
    viscous = 0.8 * (1 - fall * (t / SECONDS - 0.5))
    sign = np.sign(dq)
    tau = (
        0.3 * ddq + 2.0 * np.sin(q) + 1.0 * np.cos(q) + viscous * dq + sign * (1.2 + 0.4 * np.exp(-((dq / 0.05) ** 2)))
    )
    tau += 0.05 * random.normal(size=len(t))
    held = np.round(q / 1e-5) * 1e-5
    return JointData("q1", PERIOD, held, tau, np.ones(len(t), bool), ((0, len(t)),), 1e-5)


@pytest.mark.parametrize("seed", range(3))
def test_friction_that_stays_passes_in_silence(seed):
    drift = friction_drift(recorded(0.0, seed), 2, 0.0)
    assert not drift.is_certain
    assert abs(drift.viscous) < 0.05 * 0.8


@pytest.mark.parametrize("seed", range(3))
def test_a_fall_by_35_percent_is_reported_with_its_size(seed):
    drift = friction_drift(recorded(0.35, seed), 2, 0.0)
    assert drift.is_certain
    assert drift.viscous == pytest.approx(-0.35 * 0.8, abs=0.05)
    assert abs(drift.coulomb) < 0.05
    assert drift.mean_coulomb == pytest.approx(1.2, abs=0.05)
    assert "viscous friction changes by -" in drift.sentence


def test_a_short_recording_is_not_judged():
    whole = recorded(0.35, 0)
    count = 10_000
    short = JointData("q1", PERIOD, whole.q[:count], whole.u[:count], whole.usable[:count], ((0, count),), 1e-5)
    assert friction_drift(short, 2, 0.0) is None
