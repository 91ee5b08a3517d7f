"""Presliding against an independent simulation of bristles, with micro-slip, below break-away."""

import math

import numpy as np
import pytest

from rrrgen.base.errors import DerivationError
from rrrgen.lab.friction.presliding import presliding
from rrrgen.lab.response.response_file import ResponseRecording
from samples.stick_slip_joint import Joint, bristles, multisine

JOINT = Joint("lugre", sigma0=1e4, sigma1=10.0, gravity=0.0)
BREAK_AWAY = JOINT.coulomb + JOINT.excess
PERIOD = 1e-3


def recording(level, resolution=1e-9):
    torque = multisine(1, level)
    q = bristles(JOINT, torque, PERIOD, substeps=4)
    return ResponseRecording(f"level {level}", PERIOD, torque, torque, np.round(q / resolution) * resolution)


def estimate(records, resolution=1e-9):
    return presliding(records, resolution, BREAK_AWAY, JOINT.viscous, (0.0, 0.0), 0.0)


@pytest.fixture(scope="module")
def levels():
    return [recording(0.15), recording(0.3)]


def test_two_levels_tell_stiffness_inertia_and_damping(levels):
    found = estimate(levels)
    assert found.sigma0[0] == pytest.approx(JOINT.sigma0, rel=0.02)
    assert found.inertia[0] == pytest.approx(JOINT.inertia, rel=0.03)
    assert found.sigma1[0] == pytest.approx(JOINT.sigma1, rel=0.05)
    assert found.resonance == pytest.approx(math.sqrt(JOINT.sigma0 / JOINT.inertia) / (2 * math.pi), rel=0.02)


def test_micro_slip_grows_with_the_amplitude_and_is_told_from_damping(levels):
    """Without the rate at which bristles forget, damping is 11 % too large at a tenth of break-away."""
    low, high = (estimate([each]) for each in levels)
    assert high.levels[0].slip == pytest.approx(2.0 * low.levels[0].slip, rel=0.2)
    assert low.sigma1[0] == pytest.approx(JOINT.sigma1, rel=0.03)
    assert "one amplitude" in low.notes[0]


def test_too_few_encoder_steps_leave_the_stiffness_alone(levels):
    step = float(np.std(levels[0].q)) / 3.0
    found = estimate([recording(0.15, step), recording(0.3, step)], step)
    assert found.sigma1 is None
    assert found.inertia is None
    assert found.sigma0[0] == pytest.approx(JOINT.sigma0, rel=0.1)


def test_stiff_bristles_are_found_whatever_the_phases():
    """With these phases a search from a single guess ends at a resonance of megahertz and a third of the stiffness."""
    joint = Joint("lugre", sigma0=1e5, sigma1=30.0, gravity=0.0)
    torques = [multisine(22, level) for level in (0.15, 0.3)]
    motion = [(torque, bristles(joint, torque, PERIOD, substeps=10)) for torque in torques]
    step = math.sqrt(2.0) * float(np.std(motion[0][1])) / 100.0
    found = estimate([ResponseRecording("rest", PERIOD, u, u, np.round(q / step) * step) for u, q in motion], step)
    for (value, std), actual in zip(
        (found.sigma0, found.inertia, found.sigma1), (1e5, joint.inertia, 30.0), strict=True
    ):
        assert value == pytest.approx(actual, rel=0.02)
        assert abs(value - actual) < 3.0 * std


def test_break_away_and_noise_are_refused(levels):
    torque = 4.0 * levels[1].u
    with pytest.raises(DerivationError, match="break-away"):
        estimate([ResponseRecording("strong", PERIOD, torque, torque, levels[1].q)])
    noise = 0.02 * np.random.default_rng(0).normal(size=len(torque))
    with pytest.raises(DerivationError, match="does not repeat"):
        estimate([ResponseRecording("noise", PERIOD, noise, noise, levels[1].q)])
