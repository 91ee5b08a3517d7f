"""Responses from averaged spectra: indirect, instrumental, and signals that can be averaged."""

import numpy as np
import pytest

from lab.response.periodic import SAMPLES, errors
from rrrgen.base.errors import DerivationError, InputError
from rrrgen.lab.response.estimation import estimate_one
from samples.flexible_joint import CONTROLLER, PERIOD, flexible_joint, multisine, record


def test_indirect_method_needs_the_controller_as_implemented(periodic):
    found = estimate_one(periodic, controller=CONTROLLER, method="indirect")
    wrong, _, held, _, _ = errors(found)
    low = found.frequency[: len(wrong)] < 8.0
    assert np.median(wrong[low]) < 0.02  # beyond the bandwidth S tends to 1, and 1/S - 1 to noise
    assert 0.85 < np.mean(held) < 0.99
    with pytest.raises(InputError, match="needs the controller"):
        estimate_one(periodic, method="indirect")


@pytest.mark.parametrize("kind", ["periodic", pytest.param("noisy", marks=pytest.mark.sweep)])
def test_instrumental_estimate_is_unbiased_where_the_direct_one_is_not(kind, request):
    rng = np.random.default_rng(5)
    n = multisine(rng, SAMPLES) if kind == "periodic" else 7.0 * rng.standard_normal(SAMPLES)
    disturbed = record(rng, n, disturbance=20.0)
    medians = {}
    for method in ("instrumental", "direct"):
        found = estimate_one(disturbed, method=method)
        use = found.frequency < 3.0
        medians[method] = np.median(np.abs(found.P / flexible_joint().response(found.frequency) - 1)[use])
    assert medians["direct"] > 1.2 * medians["instrumental"]
    good = estimate_one(request.getfixturevalue(kind), method="instrumental")
    assert np.median(errors(good)[0]) < 0.05


def test_a_sweep_that_is_not_repeated_cannot_be_averaged():
    """Each line is excited in one window or two, and what rings on in the next had errors of sixty times the band."""
    t = PERIOD * np.arange(SAMPLES)
    swept = record(np.random.default_rng(0), 7.0 * np.sin(2.0 * np.pi * (0.5 * t + 150.0 / 40.0 * t**2)))
    for method in ("instrumental", "direct"):
        with pytest.raises(DerivationError, match="moves through its band"):
            estimate_one(swept, method=method)
    wrong, band, _, _, _ = errors(estimate_one(swept), 140.0)
    assert np.max(wrong / band) < 2.0


def test_a_sine_is_averaged_at_its_own_line_alone():
    """Its trend in a window is no drift; without it, harmonics appeared at which there is no excitation."""
    sine = 7.0 * np.sin(2.0 * np.pi * 5.0 * PERIOD * np.arange(SAMPLES))
    found = estimate_one(record(np.random.default_rng(0), sine), method="instrumental")
    assert found.frequency == pytest.approx([5.0])
