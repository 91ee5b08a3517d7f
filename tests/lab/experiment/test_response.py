"""Simulated response experiments: the linearised arm, every signal, verdicts, clipped torques."""

from __future__ import annotations

import numpy as np
import pytest

from lab.experiment.simulated_response import EXACT, NOISY, experiment, record, simulated, truth
from rrrgen.lab.response.estimation import estimate_one


def test_without_noise_the_response_is_that_of_the_linearised_arm():
    """Also by the indirect method: the controller that is written down is the one that ran."""
    found = experiment("period: 1 s, periods: 2, settle: 4, band: [1 Hz, 200 Hz], rms: 3", EXACT)
    design, (signals,), controller = simulated(found)
    for method in ("local_polynomial", "indirect"):
        response = estimate_one(record(signals), 1.0, controller, method)
        assert len(response.frequency) == 200
        expected = truth(found, design, response.frequency)
        assert np.abs(response.P / expected - 1.0).max() < 1e-5
        assert response.findings == ()
    integrator = -response.P * (2.0 * np.pi * response.frequency) ** 2  # 1 for (14.35), but for hold and delay
    assert np.allclose(np.abs(integrator[:3]), 1.0, atol=0.1)
    lead = np.angle(integrator, deg=True) + 360.0 * 1.5e-3 * response.frequency
    assert lead[response.frequency == 28.0] > 25.0  # the phase lead of a swinging base, as in Fig. 14.14


@pytest.mark.parametrize("signal", ["multisine", "odd_multisine", "noise", "swept_sine"])
@pytest.mark.sweep(but=["noise", "odd_multisine"])
def test_every_signal_gives_a_response_within_its_band(signal):
    found = experiment(f"signal: {signal}, period: 1 s, periods: 10, settle: 3, band: [1 Hz, 180 Hz]")
    design, (signals,), _ = simulated(found)
    response = estimate_one(record(signals), None if signal == "noise" else 1.0)
    assert ("noise" if signal == "noise" else "periodic") in response.method
    assert response.findings == ()
    use = (response.frequency >= 1.0) & (response.frequency <= 179.0)
    expected = truth(found, design, response.frequency[use])
    held = np.abs(response.P[use] - expected) < response.band95[use] * np.abs(response.P[use])
    assert 0.88 < np.mean(held) <= 1.0
    assert np.mean(response.trusted[use]) > 0.7
    if signal == "odd_multisine":
        measured = response.details["distortion"]["detection_lines"]
        assert set(measured) == {"even", "odd"}
        assert max(measured.values()) < 1.5


def test_a_joint_that_turns_round_under_friction_gets_the_verdict_no():
    """At a stated speed below what the excitation adds; the speed that is chosen is trusted under the same friction."""
    section = "signal: odd_multisine, period: 1 s, periods: 6, settle: 3, band: [1 Hz, 180 Hz]"
    verdicts = []
    for more in (section, f"{section}, speed: 0.0300038"):
        _, (signals,), _ = simulated(experiment(more))
        assert signals.clipped == 0
        verdicts.append(estimate_one(record(signals), 1.0).findings)
    assert verdicts[0] == ()
    assert verdicts[1]


def test_clipped_torques_are_told():
    """The drives of the virtual arm are weaker than those of the robot file, which the design knows."""
    weak = NOISY + "  torque_limit: [8, 30, 15]\n"
    _, (signals,), _ = simulated(experiment("period: 1 s, periods: 2, settle: 1, band: [1 Hz, 150 Hz]", weak))
    assert signals.clipped > 10
