"""Drive gains from a known payload, without knowing the arm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lab.identify.carried_payload import COM, LOGGED, MASS, TENSOR, recording
from rrrgen.base.errors import DerivationError
from rrrgen.lab.identify.drive_gains import identify_gains
from rrrgen.lab.identify.rows import standard_of


def test_gains_without_knowing_the_arm(planar):
    """Gains 0.8 and 1.25 from the payload alone; deviations agree with the spread of repeated experiments."""
    gains = np.array([0.8, 1.25])
    body = standard_of(MASS, COM, TENSOR)
    results = []
    for seed in range(5):
        logs = [recording(planar, 10 + seed + 20 * carried, carried, gains=gains, friction=1.0) for carried in (0, 1)]
        results.append(identify_gains(planar, logs[:1], logs[1:], body, LOGGED))
    values = np.array([each.gain for each in results])
    assert np.mean(values, axis=0) == pytest.approx(gains, rel=0.005)
    spread = np.mean(((values - gains) / [each.std for each in results]) ** 2)
    assert 0.2 < spread < 3.0
    assert results[0].relative_error < 0.2 * results[0].fallen_from


def test_gains_without_a_payload_that_matters_are_refused(planar):
    logs = [recording(planar, 5 + k, carried=False, noise=1.0, seconds=4.0) for k in (0, 1)]
    with pytest.raises(DerivationError, match="is not determined"):
        identify_gains(planar, logs[:1], logs[1:], standard_of(0.01, np.zeros(3), np.zeros(6)), LOGGED)


def test_gains_that_the_payload_does_not_tell_are_marked(planar):
    """A wrong sign is a negative gain; the same recording twice tells none, nor do exchanged ones."""
    logs = [recording(planar, 5 + k, carried=k == 1) for k in (0, 1)]
    body = standard_of(MASS, COM, TENSOR)
    wrong = [replace(log, tau=log.tau * np.array([1.0, -1.0])) for log in logs]
    found = identify_gains(planar, wrong[:1], wrong[1:], body, LOGGED)
    assert found.gain == pytest.approx([1.0, -1.0], rel=0.02)
    assert found.notes == ("q2: the sign of the recorded torque is wrong",)
    still = [replace(log, q=log.q * [1, 0], dq=log.dq * [1, 0], ddq=log.ddq * [1, 0]) for log in logs]
    found = identify_gains(planar, still[:1], still[1:], body, LOGGED)
    assert found.undetermined == ("q2",)
    assert found.to_json()["gain"]["q2"] is None
    assert "q2: standing" in found.notes[0]
    for first, second, message in ((0, 0, "is the same with the payload"), (1, 0, "are the recordings exchanged")):
        with pytest.raises(DerivationError, match=message):
            identify_gains(planar, [logs[first]], [logs[second]], body, LOGGED)
