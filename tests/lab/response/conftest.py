"""Fixtures that several test files of this folder share."""

import numpy as np
import pytest

from lab.response.periodic import SAMPLES
from lab.response.swinging_joint import simulated
from rrrgen.lab.response.response_file import ResponseRecording
from samples.flexible_joint import multisine, record


@pytest.fixture(scope="module")
def swinging():
    """An open loop of two weakly damped modes with measurement noise: rows, and the truth."""
    rng = np.random.default_rng(3)
    a = np.zeros(0)
    denominator = np.ones(1)
    for w, damping in ((0.366, 0.006), (0.796, 0.005)):
        radius = np.exp(-damping * w)
        denominator = np.convolve(denominator, [1, -2 * radius * np.cos(w * np.sqrt(1 - damping**2)), radius**2])
    a = -denominator[1:]
    u = rng.standard_normal(1600)
    y = simulated(a, [1.0, 0.4, -0.8, 0.3, 0.2], 0, u)
    return ResponseRecording("arm", 1.0, u, u, y + 0.02 * y.std() * rng.standard_normal(len(y))), a


@pytest.fixture(scope="module")
def periodic():
    rng = np.random.default_rng(1)
    return record(rng, multisine(rng, SAMPLES))


@pytest.fixture(scope="module")
def noisy():
    rng = np.random.default_rng(2)
    return record(rng, 7.0 * rng.standard_normal(SAMPLES))


@pytest.fixture(scope="module")
def disturbed():
    """With 1 rad/s^2 rms of disturbance, which both methods are tested with."""
    found = {}
    for kind in ("periodic", "noisy"):
        rng = np.random.default_rng(11)
        n = multisine(rng, SAMPLES) if kind == "periodic" else 7.0 * rng.standard_normal(SAMPLES)
        found[kind] = record(rng, n, disturbance=1.0)
    return found
