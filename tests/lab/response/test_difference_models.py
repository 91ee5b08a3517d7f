"""Difference equations from recordings: exact without noise, unbiased with it, chosen on rows left out."""

import numpy as np
import pytest
from scipy.signal import lfilter

from lab.response.swinging_joint import simulated
from rrrgen.base.errors import DerivationError
from rrrgen.lab.response.difference_models import armax, arx, fit_difference_model, free_run, plant_of_loop
from rrrgen.lab.response.response_file import ResponseRecording
from rrrgen.lab.response.response_model import ResponseModel
from samples.flexible_joint import CONTROLLER, PERIOD, multisine, record

TWO_MODES = (np.array([2.6, -2.9, 1.78, -0.55]), np.array([0.5, -0.3, 0.1]))


def test_difference_equations_of_a_closed_loop_are_judged_by_what_they_can_tell():
    """The joint integrates: its free run drifts, short runs and the loop from n to q do not."""
    rng = np.random.default_rng(5)
    recording = record(rng, multisine(rng, 3000))
    direct = fit_difference_model(recording, (1, 2000), "arx")
    assert "free runs of 50 samples" in direct.fit["protocol"]
    assert direct.fit["value"] > 80.0
    loop = fit_difference_model(recording, (1, 2000), "indirect", CONTROLLER)
    assert "state that the fitted rows lead to" in loop.fit["protocol"]
    assert loop.fit["value"] > 80.0


def test_difference_equation_is_chosen_on_rows_left_out(swinging):
    recording, a = swinging
    model = fit_difference_model(recording, (1, 800))
    assert model.fit["scored_rows"] == [801, 1600]
    assert model.fit["held_out"]
    assert model.fit["free_run_with_state_from_fitted_rows"] > 97.5  # 2 % of noise
    assert model.fit["value"] > 85.0  # the noise of four outputs rings on
    assert model.method == "output_error"
    assert np.allclose(model.a, a, atol=0.01)
    for found, (w, damping) in zip(model.resonances, ((0.366, 0.006), (0.796, 0.005)), strict=True):
        assert 2 * np.pi * found.frequency == pytest.approx(w, rel=5e-3)
        assert found.damping == pytest.approx(damping, rel=0.1)
        assert abs(found.damping - damping) < 4 * found.damping_std


def test_a_resonance_that_moves_after_the_fitted_rows_gets_a_note_and_noise_does_not():
    """Of 45 sound recordings, with noise of a sensor, through the equation or without, none had one."""
    rng = np.random.default_rng(8)
    u, noise = rng.standard_normal((2, 2400))
    b = np.array([0.0, 0.5, 0.3])

    def swings(w):
        return lfilter(b, [1.0, -2.0 * np.exp(-0.02 * w) * np.cos(w), np.exp(-0.04 * w)], u)

    def notes_of(y):
        model = fit_difference_model(ResponseRecording("arm", 5e-3, u, u, y), (1, 1600), "output_error")
        (left,) = model.fit["held_out_remainder"]
        return [line for line in model.lines() if "note: " in line], left["is_left"]

    sound = swings(0.2) + 0.02 * swings(0.2).std() * noise
    assert notes_of(sound) == ([], False)
    moved = np.concatenate([sound[:1600], sound[1600:] + (swings(0.21) - swings(0.2))[1600:]])
    (note,), left = notes_of(moved)
    assert left
    assert "noise does not explain the held-out errors of the free run" in note
    assert "of its squares follow from errors" in note


def test_reported_score_is_that_of_the_written_equation(swinging):
    recording, _ = swinging
    model = fit_difference_model(recording, (1, 800), "arx")
    y = recording.q.copy()
    for k in range(800, 1600):
        y[k] = sum(c * y[k - i] for i, c in enumerate(model.a, 1))
        y[k] += sum(c * recording.u[k - model.delay - j] for j, c in enumerate(model.b))
    q = recording.q[800:]
    score = 100 * (1 - np.linalg.norm(q - y[800:]) / np.linalg.norm(q - q.mean()))
    assert model.fit["value"] == pytest.approx(score, abs=1e-9)


@pytest.mark.parametrize("delay", [0, 1, 2])
def test_least_squares_are_exact_without_noise(delay):
    rng = np.random.default_rng(1)
    u = rng.standard_normal(60)
    b = [1.0, -0.4, 0.3, 0.2, 0.1][: 4 if delay else 5]
    y = simulated(TWO_MODES[0], b, delay, u)
    found = arx(u, y, 0, 60, 4, delay)
    assert np.allclose(found.a, TWO_MODES[0], atol=1e-9)
    assert np.allclose(found.b, b, atol=1e-9)
    assert np.allclose(free_run(found, u, y, 20, 60), y[20:], atol=1e-8)


def test_armax_is_right_where_arx_is_biased():
    """Noise through C/A: least squares on y take it for dynamics."""
    rng = np.random.default_rng(4)
    a, b, c = np.array([1.5, -0.8]), np.array([1.0, 0.5]), np.array([1.0, -0.9, 0.3])
    u, e = rng.standard_normal((2, 2000))
    noise = simulated(a, c, 0, 0.8 * e)
    y = simulated(a, b, 1, u) + noise
    plain = arx(u, y, 0, len(u), 2, 1)
    found = armax(plain, u, y, 0, len(u))
    assert np.abs(plain.a - a).max() > 5 * np.abs(found.a - a).max()
    assert np.abs(np.concatenate([found.a - a, found.b - b])).max() < 0.06


def test_subspace_models_have_the_same_modes(swinging):
    pytest.importorskip("nfoursid", reason="nfoursid is not installed (extra: response)")
    recording, _ = swinging
    model = fit_difference_model(recording, (1, 400), "subspace")
    assert model.method == "subspace"
    assert model.fit["free_run_with_state_from_fitted_rows"] > 95.0
    weak = [mode for mode in model.resonances if mode.damping < 0.01]
    for found, (w, damping) in zip(weak, ((0.366, 0.006), (0.796, 0.005)), strict=True):
        assert 2 * np.pi * found.frequency == pytest.approx(w, rel=5e-3)
        assert found.damping == pytest.approx(damping, rel=0.2)
        assert abs(found.damping - damping) < 4 * found.damping_std
    long = ResponseRecording("long", 1.0, *(np.tile(x, 3) for x in (recording.n, recording.u, recording.q)))
    with pytest.raises(DerivationError, match="choose up to 3000"):
        fit_difference_model(long, (1, 4000), "subspace")
    with pytest.raises(DerivationError, match="too few for subspace"):
        fit_difference_model(recording, (1, 20), "subspace")


def test_plant_follows_from_the_loop_and_its_controller():
    P = ResponseModel("", np.array([1.8, -0.9]), np.array([0.02, 0.01]), 1, PERIOD)
    f = np.array([1.0, 30.0, 200.0])
    N, D = np.array(CONTROLLER.numerator), np.array(CONTROLLER.denominator)
    closed = np.convolve(P.denominator, D)
    added = np.convolve(N, P.numerator)
    size = max(len(closed), len(added))
    closed = np.pad(closed, (0, size - len(closed))) + np.pad(added, (0, size - len(added)))
    a, b = plant_of_loop(-closed[1:], np.convolve(P.b, D), P.delay, CONTROLLER)
    assert np.allclose(ResponseModel("", a, b, P.delay, PERIOD).response(f), P.response(f))
