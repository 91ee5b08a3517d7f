"""Thresholds of contact detection: extreme values, arms that are touched or left alone, and the command."""

from __future__ import annotations

import json
import subprocess

import numpy as np
import pytest
from scipy.signal import lfilter

import rrrgen
from contact.simulation import FRICTION, RESOLUTION, WIDTH, Arms, Ts, visibility
from rrrgen.cli.main import run
from rrrgen.contact.extremes import block_maxima, fit_gumbel
from rrrgen.contact.residuals import observer_residuals, step_responses
from rrrgen.contact.thresholds import contact_thresholds, expected_detection
from rrrgen.errors import InputError
from rrrgen.signals.smoother import KalmanSmoother


def test_the_distribution_of_maxima_is_found():
    x = np.random.default_rng(0).gumbel(2.0, 0.3, 20000)
    found = fit_gumbel(x)
    assert (found.mu, found.beta) == pytest.approx((2.0, 0.3), rel=0.02)
    assert found.level(0.01) == pytest.approx(np.quantile(x, 0.99), rel=0.02)
    np.testing.assert_allclose(block_maxima(np.array([[1.0], [-3.0], [2.0], [0.5], [9.0]]), 2), [[3.0], [2.0]])


@pytest.mark.parametrize(("draw", "fewest", "most"), [("laplace", 20, 70), ("normal", 0, 50)])
def test_the_rate_of_false_alarms_is_as_stated_or_lower(draw, fewest, most):
    """Coloured noise of two joints over 4000 s, with thresholds for one alarm in 100 s: some 40 seconds with alarms."""
    rng = np.random.default_rng(1)
    noise = lfilter([1.0], [1.0, -0.3], getattr(rng, draw)(size=(460_000, 2)), axis=0)
    found = contact_thresholds([noise[:60_000]], 0.01, 100.0)
    assert found.blocks == 600
    over = (np.abs(noise[60_000:]) > found.levels).any(axis=1)
    assert fewest <= np.count_nonzero(over.reshape(-1, 100).any(axis=1)) <= most


@pytest.fixture(scope="module")
def model():
    return rrrgen.compile("rrr")


def test_contacts_are_detected_in_time_and_nothing_else_is(model):
    options = {"friction": FRICTION, "q0": [0.0, 0.5, 0.8]}
    train = Arms(model, 60, seed=1, **options).run(1.5)[500:]
    found = contact_thresholds(list(train.transpose(1, 0, 2)), Ts, 3600.0)
    arms = Arms(model, 60, seed=2, **options)
    F = np.random.default_rng(3).normal(size=(60, 3))
    F *= 10.0 / np.linalg.norm(F, axis=1, keepdims=True)
    r = arms.run(1.5, F, at=1.4)[500:]
    touched = (np.abs(r) > found.levels).any(axis=2)
    assert not touched[:900].any()  # 54 s without a contact
    delays = touched[900:].argmax(axis=0)
    poses, responses = model.jacobian(arms.desired(1.4)[0]), step_responses([arms.matrices] * 3, 50.0, 0.3)
    seen = visibility(poses, F, found.levels, responses[15]) > 1.25  # the tip has hardly a lever arm in some directions
    assert np.count_nonzero(seen) >= 54
    assert touched[900:, seen].any(axis=0).all()
    assert delays[seen].max() <= 15
    expected = expected_detection(found.levels, poses, responses, Ts, 10.0)
    assert abs(1e3 * expected.median - np.median(delays)) <= 2
    assert expected.missed < 0.02


def test_residuals_of_a_recording_are_those_of_the_controller(model):
    """Positions and torques of one arm, recorded: the same residuals, whatever the filters were at the start."""
    arms = Arms(model, 1, model.friction_parameters, seed=5)
    arms.believed, arms.beta = model.friction_parameters, model.beta
    r = arms.run(1.2)[:, 0]
    q, tau = np.array(arms.readings)[:, 0], np.array(arms.torques)[:, 0]
    kalman = KalmanSmoother(RESOLUTION**2 / 12, 300.0**2, smooth=False)
    found = observer_residuals(model, q, tau, Ts, kalman, 50.0, WIDTH)
    np.testing.assert_allclose(found[-200:], r[-200:], atol=0.02)


def test_too_little_is_refused():
    with pytest.raises(InputError, match="too few: record at least 30 s"):
        contact_thresholds([np.zeros((5000, 2))], 1e-3)
    with pytest.raises(InputError, match="no longer"):
        contact_thresholds([np.zeros((50000, 2))], 1e-3, seconds_per_alarm=0.5)


def test_the_command(tmp_path, capsys):
    rng = np.random.default_rng(0)
    m = rrrgen.compile("pendulum", backend="numpy")
    t = 0.01 * np.arange(4000)
    w = np.array([1.0, 2.2, 3.1])
    angle = w * t[:, None]
    q, dq, ddq = (0.3 * each.sum(axis=1) for each in (np.sin(angle), w * np.cos(angle), -w * w * np.sin(angle)))
    tau = m.inverse_dynamics(q[:, None], dq[:, None], ddq[:, None])[:, 0] + 0.02 * rng.normal(size=len(t))
    joint = m.joint_names[0]
    rows = np.column_stack([t, q + 1e-6 * rng.normal(size=len(t)), tau])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=f"t,q_{joint},tau_{joint}", comments="")
    arguments = ["contact-thresholds", "pendulum", "--log", str(tmp_path / "log.csv"), "-o", str(tmp_path / "run")]
    assert run([*arguments, "--gain", "20"]) == 0
    said = capsys.readouterr().out
    assert "one false alarm in 3600 s" in said
    assert "10 N at the tip: detected after" in said
    results = tmp_path / "run" / "results"
    record = json.loads((results / "contact.json").read_text())
    assert 0.01 < record["levels"][0] < 1.0
    source = '#include "pendulum_contact.h"\nstatic const double t[1] = PENDULUM_CONTACT_THRESHOLDS;\n'
    source += (
        "int main(void) { return !(t[0] > 0.0 && PENDULUM_CONTACT_GAIN > 0.0 && PENDULUM_CONTACT_PERIOD > 0.0); }\n"
    )
    (results / "main.c").write_text(source)
    subprocess.run(["gcc", "-std=c99", "-Wall", "-Werror", "main.c", "-o", "main"], cwd=results, check=True)
    assert subprocess.run([results / "main"], check=False).returncode == 0
    assert run([*arguments, "--block", "5", "--fresh"]) == InputError.exit_code
    assert "7 blocks of 5 s" in capsys.readouterr().err
