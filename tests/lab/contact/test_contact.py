"""Thresholds of contact detection: extreme values, arms that are touched or left alone, and the command."""

from __future__ import annotations

import json
import subprocess

import numpy as np
import pytest
from scipy.signal import lfilter

import rrrgen
from lab.contact.simulation import FRICTION, RESOLUTION, WIDTH, Arms, Ts, forces, ratios, visibility
from rrrgen.base.errors import InputError
from rrrgen.cli.main import run
from rrrgen.lab.contact import (
    block_maxima,
    contact_thresholds,
    expected_detection,
    fit_gumbel,
    observer_residuals,
    residual_covariance,
    step_responses,
)
from rrrgen.lab.data.kalman import KalmanSmoother


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
    found = contact_thresholds([noise[:60_000]], 0.01, 20.0, 100.0)
    assert found.blocks == 600
    over = ratios(noise[60_000:, None], found, 20.0 * 0.01 / Ts)[:, 0] > 1.0
    assert fewest <= np.count_nonzero(over.reshape(-1, 100).any(axis=1)) <= most


REST = (0.0, 0.5, 0.8)


@pytest.fixture(scope="module")
def model():
    return rrrgen.compile("rrr")


@pytest.fixture(scope="module")
def arms(model):
    """Twice sixty arms on different motions, and their residuals: the second sixty are touched from 1.4 s on."""
    both = Arms(model, 120, FRICTION, q0=REST, errors=1)
    return both, both.run(1.56, np.concatenate([np.zeros((60, 3)), forces(60)]), at=1.4)[500:]


@pytest.fixture(scope="module")
def free(arms):
    """Positions and residuals of arms alone: what a recording without contact tells."""
    return np.array(arms[0].seen)[500:, :60, :, 0], arms[1][:, :60]


@pytest.fixture(scope="module")
def touched(arms):
    """The same for the arms with 10 N at their tips in the last 0.16 s."""
    return np.array(arms[0].seen)[500:, 60:, :, 0], arms[1][:, 60:]


@pytest.fixture(scope="module")
def responses(arms):
    return step_responses([arms[0].matrices] * 3, 50.0, 0.3)


def test_contacts_are_detected_in_time_and_nothing_else_is(model, free, touched, responses):
    found = contact_thresholds(list(free[1].transpose(1, 0, 2)), Ts, 50.0, 3600.0)
    q, r = touched
    over = ratios(r, found) > 1.0
    assert not over[:900].any()  # 54 s without a contact
    delays = np.where(over[900:].any(axis=0), over[900:].argmax(axis=0), np.inf)
    poses = model.jacobian(q[900])
    seen = visibility(poses, forces(60), found, responses) > 1.25  # the tip has hardly a lever arm in some directions
    assert np.count_nonzero(seen) >= 57
    assert delays[seen].max() <= 10
    assert np.count_nonzero(delays > 15) <= 1
    expected = expected_detection(found, poses, responses, Ts, 50.0, 10.0)
    assert abs(1e3 * expected.median - np.median(delays)) <= 2
    assert expected.missed < 0.02


def test_the_changes_of_residuals_show_contacts_that_the_residuals_hide(model, free, touched, responses):
    """600 contacts of 5 N, whose responses are added to residuals alone: 5 % are late, without the changes 20 %."""
    found = contact_thresholds(list(free[1].transpose(1, 0, 2)), Ts, 50.0, 3600.0)
    q, r = touched
    J = model.jacobian(q[:900:90]).reshape(600, 6, 3)[:, :3]
    torques = np.einsum("kij,ki->kj", J, forces(600, 5.0))
    before = np.stack([r[start + 40 : start + 90] for start in range(0, 900, 90)], axis=1).reshape(50, 600, 3)
    after = before + np.concatenate([np.zeros((34, 3)), responses[:16]])[:, None] * torques
    late = 1 - np.mean(ratios(after, found).max(axis=0) > 1.0)
    without = 1 - np.mean(np.any(np.abs(after) > found.levels, axis=(0, 2)))
    assert late < 0.06
    assert without > 0.15


def test_the_covariance_of_a_force_is_that_of_its_errors(model, free, touched):
    """It contains the mean errors of the model; variances alone predict errors that are too small."""
    q, r = free
    poses = model.jacobian(q[::10])
    found = residual_covariance(r[::10].reshape(-1, 3), poses.reshape(-1, 6, 3))
    assert 1.0 <= found.enlarged < 1.3
    q, r = touched
    J = model.jacobian(q[-60:])  # the lag of r is over

    def normalised(covariance):
        load = model.external_force(J, r[-60:], covariance)
        e = load.F - forces(60)
        return np.einsum("...i,...ij,...j", e, np.linalg.inv(load.P), e) / 3

    squares = normalised(found.matrix)
    assert 0.5 < squares.mean() < 1.2
    assert np.mean(squares < 7.815 / 3) >= 0.95
    assert normalised(np.diag(free[1].var(axis=(0, 1)))).mean() > 1.3


def test_a_covariance_that_changes_with_the_motion_is_enlarged():
    """Residuals that point in the direction of the force at each pose, which their second moment does not tell."""
    rng = np.random.default_rng(4)
    n, J = 4, np.zeros((20_000, 6, 4))
    J[:, :3] = np.linalg.qr(rng.normal(size=(20_000, n, n))).Q[:, :3]
    e = np.einsum("kij,ki->kj", J[:, :3], rng.normal(size=(20_000, 3)))
    found = residual_covariance(e, J)
    assert found.enlarged == pytest.approx(4 / 3, rel=0.02)
    np.testing.assert_allclose(found.matrix, np.eye(n), atol=0.03)
    assert residual_covariance(rng.normal(size=(20_000, n)), J).enlarged == pytest.approx(1.0, abs=0.02)
    with pytest.raises(InputError, match="depend on each other"):
        residual_covariance(np.ones((100, 2)), J[:100, :, :2])


def test_residuals_of_a_recording_are_those_of_the_controller(model):
    """Positions and torques of one arm, recorded: the same residuals, whatever the filters were at the start."""
    arms = Arms(model, 1, model.friction_parameters, seed=5)
    arms.believed, arms.beta = model.friction_parameters, model.beta
    r = arms.run(0.8)[:, 0]
    q, tau = np.array(arms.readings)[:, 0], np.array(arms.torques)[:, 0]
    kalman = KalmanSmoother(RESOLUTION**2 / 12, 300.0**2, smooth=False)
    found = observer_residuals(model, q, tau, Ts, kalman, 50.0, WIDTH)
    np.testing.assert_allclose(found[-200:], r[-200:], atol=0.02)


def test_too_little_is_refused():
    with pytest.raises(InputError, match="too few: record at least 30 s"):
        contact_thresholds([np.zeros((5000, 2))], 1e-3, 50.0)
    with pytest.raises(InputError, match="no longer"):
        contact_thresholds([np.zeros((50000, 2))], 1e-3, 50.0, seconds_per_alarm=0.5)


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
    arguments = [
        "experiment",
        "contact-thresholds",
        "pendulum",
        "--log",
        str(tmp_path / "log.csv"),
        "-o",
        str(tmp_path / "run"),
    ]
    assert run([*arguments, "--gain", "20"]) == 0
    said = capsys.readouterr().out
    assert "one false alarm in 3600 s" in said
    assert "10 N at the tip: detected after" in said
    results = tmp_path / "run" / "results"
    record = json.loads((results / "contact.json").read_text())
    assert 0.01 < record["levels"][0] < 1.0
    source = '#include "pendulum_contact.h"\nstatic const double t[1] = PENDULUM_CONTACT_THRESHOLDS;\n'
    source += "static const double c[1] = PENDULUM_CONTACT_CHANGE_THRESHOLDS, S[1] = PENDULUM_CONTACT_COVARIANCE;\n"
    source += (
        "int main(void) { return !(t[0] > c[0] && c[0] * c[0] > S[0] && S[0] > 0.0 && PENDULUM_CONTACT_GAIN > 0.0 "
    )
    source += "&& PENDULUM_CONTACT_PERIOD > 0.0); }\n"
    (results / "main.c").write_text(source)
    subprocess.run(["gcc", "-std=c99", "-Wall", "-Werror", "main.c", "-o", "main"], cwd=results, check=True)
    assert subprocess.run([results / "main"], check=False).returncode == 0
    assert run([*arguments, "--block", "5", "--fresh"]) == InputError.exit_code
    assert "7 blocks of 5 s" in capsys.readouterr().err
