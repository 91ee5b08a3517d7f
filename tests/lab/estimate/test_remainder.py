"""What held-out errors leave beyond noise: silent on noise, said of growth and of errors that follow each other."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from rrrgen.lab.estimate.remainder import Errors, Piece, all_errors, remainder_notes, remainder_record, remainders

PERIOD = 0.02


def piece(errors, period=PERIOD, start=0.0, segment=0):
    t = start + period * np.arange(len(errors))
    measured = 10.0 * np.sin(np.outer(t, [1.0, 2.0]))
    return Piece(t, measured, errors, np.full(len(t), segment, np.int64))


def slow(random, seconds, samples=1500):
    a = np.exp(-PERIOD / seconds)
    return lfilter([np.sqrt(1.0 - a * a)], [1.0, -a], random.normal(size=(samples, 2)), axis=0)


def found(held_out, fitted=None):
    before = None if fitted is None else Errors.of([piece(fitted)])
    return remainders(Errors.of([piece(held_out)]), before, ("q1", "q2"))


def test_noise_leaves_nothing():
    """White noise, noise filtered over two samples, and slow noise of 0.1 s, in 80 joints each: no false alarm."""
    random = np.random.default_rng(3)
    alarms = 0
    for _ in range(40):
        white = random.normal(size=(1500, 2)), random.normal(size=(1500, 2))
        for each in (white, tuple(lfilter([0.5, 1.0, 0.5], 1.0, e, axis=0) for e in white)):
            alarms += sum(joint.is_left for joint in found(*each))
        alarms += sum(joint.is_left for joint in found(slow(random, 0.1), slow(random, 0.1)))
    assert alarms == 0


def test_growth_is_said_with_its_causes():
    random = np.random.default_rng(1)
    held_out = random.normal(size=(1500, 2)) * [1.0, 1.5]
    first, second = found(held_out, random.normal(size=(1500, 2)))
    assert not first.is_left
    assert second.grown
    assert not second.follows
    assert second.growth == pytest.approx(1.5, rel=0.1)
    (note,) = remainder_notes([first, second])
    assert note.startswith("noise does not explain the held-out torque errors of q2 (1.")
    assert "times that in sample" in note
    assert "changed" in note
    assert "ripple" not in note
    record = remainder_record([first, second])
    assert [each["is_left"] for each in record] == [False, True]
    assert record[1]["growth"] == second.growth


def test_errors_that_follow_each_other_are_said():
    """A ripple of the size of the noise: half of the squares; the same error on fitted data is no growth."""
    random = np.random.default_rng(2)
    t = PERIOD * np.arange(1500)
    ripple = np.sqrt(2.0) * np.sin(6.0 * np.sin(0.7 * t))
    held_out, fitted = (random.normal(size=(1500, 2)) + np.outer(ripple, [0.0, 1.0]) for _ in range(2))
    first, second = found(held_out, fitted)
    assert not first.is_left
    assert second.follows
    assert not second.grown
    assert 0.2 < second.predictable < 0.55
    (note,) = remainder_notes([first, second])
    assert "of its squares follow from errors 0.16 s before" in note
    assert "ripple" in note
    assert "changed" not in note
    assert remainder_notes([first]) == ()


def test_blocks_of_samples_and_gaps_count_as_one_recording():
    random = np.random.default_rng(4)
    errors = slow(random, 0.5)
    errors[random.random(errors.shape) < 0.1] = np.nan
    whole = Errors.of([piece(errors)])
    cut = [piece(errors)]
    parts = [
        Piece(cut[0].t[a:b], cut[0].measured[a:b], errors[a:b], cut[0].segment[a:b])
        for a, b in ((0, 7), (7, 400), (400, 403), (403, 1500))
    ]
    streamed = Errors.of(parts)
    assert streamed.products == pytest.approx(whole.products, rel=1e-12)
    assert np.array_equal(streamed.pairs, whole.pairs)
    for output in (0, 1):
        assert streamed.predictable(output) == pytest.approx(whole.predictable(output), rel=1e-9)
        assert streamed.mean_square(output) == pytest.approx(whole.mean_square(output), rel=1e-9)
    # no pair spans two stretches
    ones = np.ones((10, 2))
    two = Errors.of([piece(ones, 0.2), piece(ones, 0.2, start=5.0, segment=1)])
    assert two.pairs[:, 0].tolist() == [20, 18, 16, 14, 12, 10, 8]
    one = Errors.of([piece(ones, 0.2)])
    both = all_errors([one, None, one])
    assert np.array_equal(both.pairs, two.pairs)
    assert np.array_equal(both.products, two.products)


def test_negligible_and_missing_errors_say_nothing():
    t = PERIOD * np.arange(1500)
    round_off = 1e-10 * np.sin(np.outer(t, [0.5, 0.7]))
    left = found(round_off)
    assert all(joint.follows and not joint.is_left for joint in left)
    assert all(joint.growth is None for joint in left)
    assert Errors.of([]) is None
    assert Errors.of([piece(np.full((5, 2), np.nan))]) is None
    assert all_errors([None]) is None
    assert remainders(None, None, ("q1",)) == ()
    assert found(round_off[:8])[0].predictable == 0.0  # too short for the lags
