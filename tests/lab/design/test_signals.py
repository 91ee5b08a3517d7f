"""Signals that excite a band: their band, rms and peak."""

from __future__ import annotations

import numpy as np
import pytest

from lab.design.bands import BAND, RATE, SAMPLES
from rrrgen.base.errors import InputError
from rrrgen.lab.design.signals import SIGNALS, excitation_signal


def lines(signal):
    amplitude = np.abs(np.fft.rfft(signal))
    return np.flatnonzero(amplitude > 1e-3 * amplitude.max()), amplitude


@pytest.mark.parametrize("kind", SIGNALS)
def test_signals_have_their_band_and_unit_rms(kind):
    signal = excitation_signal(kind, BAND, SAMPLES, RATE, np.random.default_rng(1))
    assert np.sqrt(np.mean(signal**2)) == pytest.approx(1.0)
    assert abs(np.mean(signal)) < 1e-12
    excited, amplitude = lines(signal)
    inside = (excited >= 1) & (excited <= 400)
    if kind == "swept_sine":
        assert np.sum(amplitude[1:401] ** 2) > 0.98 * np.sum(amplitude**2)
        assert np.abs(signal).max() < 1.5
    else:
        assert inside.all()
    if kind == "multisine":
        assert np.array_equal(excited, np.arange(1, 401))
        assert np.allclose(amplitude[1:401], amplitude[1])
        assert np.abs(signal).max() < 3.3
    if kind == "odd_multisine":
        assert np.all(excited % 2 == 1)
        assert len(excited) == 150  # of 200 odd lines one in four is left out
        groups = np.setdiff1d(np.arange(1, 400, 2), excited).reshape(-1) // 8
        assert np.array_equal(groups, np.arange(50))


def test_the_draw_is_the_one_with_the_smallest_peak():
    one = [np.abs(excitation_signal("multisine", BAND, 500, RATE, np.random.default_rng(k))).max() for k in range(5)]
    assert max(one) < 3.0


@pytest.mark.parametrize("band", [(0.0, 10.0), (20.0, 10.0), (1.0, 500.0), (10.0, 11.0)])
def test_bands_that_cannot_be_are_refused(band):
    with pytest.raises(InputError, match="band"):
        excitation_signal("multisine", band, SAMPLES, RATE, np.random.default_rng(0))
