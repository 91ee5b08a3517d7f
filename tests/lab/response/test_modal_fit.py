"""Modes fitted to a frequency response: the search, closed loops, and dampings that are hardly known."""

import numpy as np
import pytest

from rrrgen.lab.response.estimation import estimate_one
from rrrgen.lab.response.modal_fit import _Lines, _residual, _slopes, fit_modes
from samples.flexible_joint import MODES, PERIOD, flexible_joint, multisine, record


def test_the_gradient_of_the_search_for_modes_is_exact():
    rng = np.random.default_rng(1)
    frequency = np.linspace(1.0, 200.0, 90)
    P = flexible_joint().response(frequency) * (1.0 + 0.01 * rng.standard_normal(90))
    both = np.stack([P, P * np.exp(0.3j)])  # two responses with one weight each
    weight = 1.0 / (np.array([[0.01], [0.03]]) * np.abs(both))
    lines = _Lines(np.exp(-2j * np.pi * frequency * PERIOD), both, weight, PERIOD)
    for modes, integrators in ((np.log([28.3, 0.021, 95.0, 0.03]), 2), (np.log([40.0, 0.6]), 0)):

        def cost(at, integrators=integrators):
            return 0.5 * float(np.sum(_residual(lines, at, 2, integrators) ** 2))

        gradient = _slopes(lines, modes, 2, integrators).T @ _residual(lines, modes, 2, integrators)
        steps = 1e-6 * np.eye(len(modes))
        numeric = [(cost(modes + step) - cost(modes - step)) / 2e-6 for step in steps]
        assert np.allclose(gradient, numeric, rtol=1e-5, atol=1e-7 * np.abs(gradient).max())


def test_modes_of_a_joint_in_closed_loop():
    rng = np.random.default_rng(2)
    model = fit_modes(estimate_one(record(rng, multisine(rng, 12000))))
    assert len(model.resonances) == len(MODES)
    for found, (frequency, damping, _) in zip(model.resonances, MODES, strict=True):
        assert found.frequency == pytest.approx(frequency, rel=5e-3)
        assert found.damping == pytest.approx(damping, rel=0.1)
        assert abs(found.frequency - frequency) < 4 * found.frequency_std
        assert abs(found.damping - damping) < 4 * found.damping_std
    lines = np.linspace(0.5, 150, 300)
    assert np.quantile(np.abs(model.response(lines) / flexible_joint().response(lines) - 1), 0.9) < 0.03
    assert (len(model.a), model.delay) == (6, 2)


def test_a_damping_that_is_hardly_known_says_so():
    """Five seconds with an encoder of 2e-4 rad: the deviations tell that the recording is too short."""
    rng = np.random.default_rng(6)
    noise = 7.0 * rng.standard_normal(5000)
    short = fit_modes(estimate_one(record(rng, noise, disturbance=0.3, resolution=2e-4)))
    assert any("damping" in mode.uncertain for mode in short.resonances)
