"""Oscillations are told from motion, noise, friction and transients."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from rrrgen.lab.plant.tracking import check_tracking, oscillation

TS, LOAD, LOOP = 1e-3, 10.0, 4.0
T = np.arange(6000) * TS
MOTION = 8.0 * np.sin(2 * np.pi * 0.7 * T) + 2.0 * np.sin(2 * np.pi * 1.4 * T)


def seen(added, expected=MOTION):
    return oscillation(expected + added, expected, LOAD, 0, TS, LOOP)


@pytest.mark.parametrize("frequency", [15.0, 36.0, 180.0, 490.0])
def test_a_swing_is_found_with_its_frequency_and_amplitude(frequency: float) -> None:
    found = seen(3.0 * np.sin(2 * np.pi * frequency * T) * (T > 2.0))
    assert found is not None
    assert found.frequency == pytest.approx(frequency, abs=2.0)  # windows of 0.5 s
    assert found.amplitude == pytest.approx(3.0, rel=0.2)  # between two lines a Hann window loses 15 %
    assert found.start == pytest.approx(2.0, abs=0.3)
    growing = seen(0.01 * np.exp(1.5 * T) * np.sin(2 * np.pi * frequency * T))
    assert growing is not None
    assert growing.stop == pytest.approx(6.0, abs=0.3)


def test_what_is_no_oscillation_is_not_told() -> None:
    rng = np.random.default_rng(3)
    assert seen(0.0 * T) is None
    assert seen(0.5 * np.sin(2 * np.pi * 36.0 * T)) is None  # small
    assert seen(3.0 * rng.normal(size=len(T))) is None  # noise
    assert seen(3.0 * np.sign(np.cos(2 * np.pi * 0.7 * T))) is None  # Coulomb friction
    assert seen(5.0 * np.exp(-8.0 * (T % 2.0)) * np.sin(2 * np.pi * 30.0 * T)) is None  # transients that decay
    fast = 8.0 * np.sin(2 * np.pi * 20.0 * T)
    assert seen(-0.4 * fast, expected=fast) is None  # a motion as fast, which the loop follows in part


@pytest.mark.parametrize(("steps", "stable"), [(0.2, True), (3.0, False)])
def test_a_joint_may_jump_between_two_steps_of_its_encoder(steps: float, stable: bool) -> None:
    """Torques then swing by what the gains make of one step, in a loop that is stable."""
    step, swing = 1e-5, np.sin(2 * np.pi * 108.0 * T)
    reference = np.zeros((len(T), 1))
    recording = SimpleNamespace(
        true_q=reference + (steps * step * swing)[:, None],
        reference=reference,
        held=(3.0 * swing)[:, None],
        period=TS,
    )
    torques, one = np.full((len(T), 1), 1e-3), np.ones(1)
    tracking = check_tracking(recording, torques, LOAD * one, 1e3 * one, LOOP, step * one, np.array([False]))
    assert tracking.ok is stable
