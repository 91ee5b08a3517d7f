"""Distortion by friction and quantisation: seen beside noise, refused, or widening the band."""

import numpy as np
import pytest

from lab.response.periodic import SAMPLES
from rrrgen.lab.design.signals import excitation_signal
from rrrgen.lab.response.estimation import combine, estimate_one
from samples.flexible_joint import PERIOD, multisine, record


@pytest.mark.parametrize("kind", ["periodic", "noisy", "odd"])
def test_friction_at_changes_of_direction_is_refused(kind):
    rng = np.random.default_rng(3)
    n = 7.0 * rng.standard_normal(SAMPLES) if kind == "noisy" else multisine(rng, SAMPLES, odd=kind == "odd")
    good = estimate_one(record(rng, n, speed=0.05, friction=0.0))
    assert good.findings == ()
    bad = estimate_one(record(rng, n, speed=0.05, friction=1.0))
    assert {finding.kind for finding in bad.findings} <= {"friction", "distortion"}
    assert bad.findings
    assert not bad.trusted.any()


@pytest.mark.parametrize(("speed", "friction"), [(0.02, 1.0), (0.12, 3.0)])
def test_friction_is_seen_beside_noise_in_a_band(speed, friction):
    """Leakage from the ends of this recording hid the friction beside the band; in the second few samples go back."""
    rng = np.random.default_rng(0)
    n = 7.0 * excitation_signal("noise", (0.5, 220.0), 30000, 1.0 / PERIOD, rng)[5000:25000]
    found = estimate_one(record(rng, n, speed=speed, friction=friction))
    assert [finding.kind for finding in found.findings] == ["friction"]


@pytest.mark.parametrize("kind", ["periodic", "noisy"])
def test_a_joint_that_turns_round_is_refused_where_it_has_friction(kind):
    rng = np.random.default_rng(13)
    n = 7.0 * rng.standard_normal(SAMPLES) if kind == "noisy" else multisine(rng, SAMPLES)
    turning = {"speed": 1.2, "turn_after": 3.7}
    bad = estimate_one(record(rng, n, friction=1.0, **turning))
    assert [finding.kind for finding in bad.findings] == ["friction"]
    assert "changes sign" in bad.findings[0].message
    assert estimate_one(record(rng, n, **turning)).findings == ()


def test_fast_joint_with_the_same_friction_is_trusted():
    rng = np.random.default_rng(3)
    assert estimate_one(record(rng, multisine(rng, SAMPLES), speed=1.0237, friction=1.0)).findings == ()


def test_quantisation_that_repeats_every_period_is_refused():
    rng = np.random.default_rng(4)
    n = multisine(rng, SAMPLES)
    repeating = estimate_one(record(rng, n, speed=0.5, resolution=2e-4, disturbance=0.0))
    assert [finding.kind for finding in repeating.findings] == ["distortion"]
    assert not repeating.trusted.any()
    # at a speed that is no multiple of resolution/period the error averages out, and the band says what is left of it
    assert estimate_one(record(rng, n, speed=0.51237, resolution=2e-4, disturbance=0.0)).findings == ()


def test_realisations_tell_noise_from_distortion():
    rng = np.random.default_rng(6)
    linear = [estimate_one(record(rng, multisine(rng, 8000), disturbance=1.0)) for _ in range(4)]
    mean = combine(linear, "mean")
    assert mean.details["distortion"]["total_over_noise_variance"] < 1.5
    assert mean.findings == ()
    assert np.median(mean.unsmoothed.band95) < 0.6 * np.median(linear[0].unsmoothed.band95)
    assert np.median(mean.band95) < np.median(linear[0].band95)
    rough = [estimate_one(record(rng, multisine(rng, 8000), speed=0.05, friction=2.0)) for _ in range(3)]
    assert combine(rough, "mean").findings[0].kind == "distortion"
