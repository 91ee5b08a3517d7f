"""A sampled resonance lists the true frequencies that it may stand for; a second rate tells them apart."""

import numpy as np
import pytest

from rrrgen.lab.response.fitting import alias_lines, aliases, rates_decide
from rrrgen.lab.response.response_model import Resonance


def sampled(frequency, damping, rate, std=0.0):
    """What is found of a mode in samples: from its discrete-time pole, which is computed here."""
    s = 2 * np.pi * frequency * (-damping + 1j * np.sqrt(1 - damping**2))
    found = np.log(np.exp(s / rate)) * rate
    return Resonance(abs(found) / (2 * np.pi), -found.real / abs(found), std or None)


def test_the_true_mode_is_among_the_candidates_with_its_damping():
    mode = sampled(118.48, 0.0151, 200.0)
    assert mode.frequency == pytest.approx(81.52, abs=0.05)
    found = aliases(mode, 200.0)
    assert [round(each.frequency) for each in found[:4]] == [82, 118, 282, 318]
    assert found[1].frequency == pytest.approx(118.48, rel=1e-9)
    assert found[1].damping == pytest.approx(0.0151, rel=1e-9)
    assert max(each.frequency for each in found) <= 1000.0
    text = "\n".join(alias_lines([mode], 200.0))
    assert "118.5 Hz (damping 0.0151)" in text
    assert "record again at 220 Hz" in text


def test_a_second_rate_decides_unless_its_multiples_coincide():
    assert rates_decide(200.0, 220.0, 1000.0)
    for rate in (250.0, 400.0):
        assert not rates_decide(200.0, rate, 1000.0)
