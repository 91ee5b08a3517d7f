"""Recordings that are slower than their controller: signals between their samples, and parameters fitted to them."""

from __future__ import annotations

import math

import numpy as np
import pytest

import rrrgen
from rrrgen.lab.closed_loop.fine_grid import FineGrid

INERTIA, VISCOUS, T = 0.5, 0.4, 1e-3
KP, KD = 700.0, 38.0
ROBOT = """
schema: rrrgen/1
name: wheel
convention: standard
units: {angle: rad, length: m}
gravity: [0, 0, -9.81]
joints:
  - {name: wheel, type: revolute, a: 0.5, alpha: 0, d: 0, theta: 0, friction: {viscous: 0, coulomb: 0}}
"""
CONTROLLER = f"""
schema: rrrgen-controller/1
rate: 1 kHz
signals:
  speed: {{difference: position}}
  wanted: WANTED
  force: {{sum: {{reference: {KP}, position: {-KP}, wanted: {KD}, speed: {-KD}, feedforward: 1}}}}
torque: force
joints: [wheel]
"""
WANTED = {
    "difference": "{difference: reference}",
    "recorded": "{sum: {reference_velocity: 1}}",
    "none": "{sum: {constant: 0}}",
}


def recorded_wheel(wanted, seconds=13.0):
    """Arrays at 1 kHz of a wheel with viscous friction, whose torque is held between samples: solved exactly.

    The recording starts after a second, when the loop has settled.
    """
    t = T * np.arange(round(seconds / T))
    rates, sizes, phases = (np.array(x)[:, None] for x in ((3.0, 8.2, 13.0), (0.5, 0.4, 0.1), (0.0, 1.0, 2.0)))
    reference = np.sum(sizes * (np.sin(rates * t + phases) - np.sin(phases)), axis=0)
    speed = np.sum(sizes * rates * np.cos(rates * t + phases), axis=0)
    fed = INERTIA * np.sum(-sizes * rates**2 * np.sin(rates * t + phases), axis=0)
    given = {"difference": np.diff(reference, prepend=reference[0]) / T, "recorded": speed, "none": 0.0 * t}[wanted]
    decay = math.exp(-VISCOUS * T / INERTIA)
    q, dq, last = 0.0, float(speed[0]), 0.0
    rows = []
    for r, s, f in zip(reference.tolist(), given.tolist(), fed.tolist(), strict=True):
        u = KP * (r - q) + KD * (s - (q - last) / T) + f
        rows.append((q, u))
        last, end = q, u / VISCOUS
        q += end * T + (dq - end) * (1.0 - decay) * INERTIA / VISCOUS
        dq = end + (dq - end) * decay
    position, torque = np.array(rows).T
    arrays = {"t": t, "q": position, "tau": torque, "reference": reference, "feedforward": fed}
    arrays |= {"reference_velocity": speed} if wanted == "recorded" else {}
    return {key: values[round(1.0 / T) :] for key, values in arrays.items()}


@pytest.mark.sweep(but=["difference-10", "recorded-4"])
@pytest.mark.parametrize("every", [2, 4, 10])
@pytest.mark.parametrize("wanted", WANTED)
def test_a_recording_slower_than_its_controller_gives_the_true_inertia(tmp_path, wanted, every):
    """Straight lines between the samples of the reference made the inertia 3 to 30 % too large."""
    (tmp_path / "robot.yaml").write_text(ROBOT)
    (tmp_path / "controller.yaml").write_text(CONTROLLER.replace("WANTED", WANTED[wanted]))
    arrays = {key: values[::every] for key, values in recorded_wheel(wanted).items()}
    options = {"controller": tmp_path / "controller.yaml", "consistent": False}
    result = rrrgen.identify(tmp_path / "robot.yaml", arrays, **options)
    values = dict(zip(result.names, result.values, strict=True))
    assert values["Izz1R"] == pytest.approx(INERTIA, rel=1e-3)
    assert values["fv1"] == pytest.approx(VISCOUS, rel=5e-3)
    assert "warning: controller" not in str(result)
    assert "times as large" not in str(result)


def test_a_fit_that_moves_the_joint_away_is_noted(tmp_path):
    """A lag in the torque that is recorded, not in the one that acts: inertia makes up for it, the joint moves away."""
    (tmp_path / "robot.yaml").write_text(ROBOT)
    acting = CONTROLLER.replace("WANTED", WANTED["difference"]).replace("torque: force", "torque: late\nacts: force")
    late = f"  lag: {{difference: reference, over: 4}}\n  late: {{sum: {{force: 1, lag: {KD}, wanted: {-KD}}}}}\n"
    (tmp_path / "controller.yaml").write_text(acting.replace("torque:", f"{late}torque:"))
    options = {"controller": tmp_path / "controller.yaml", "consistent": False}
    result = rrrgen.identify(tmp_path / "robot.yaml", recorded_wheel("difference"), **options)
    scores = result.closed_loop.start, result.closed_loop.fit
    before, after = (score.position[0] for score in scores)
    assert scores[1].relative_error < scores[0].relative_error
    assert f"made the position error of wheel {after / before:.2g} times as large" in str(result)
    assert after > 3.0 * before


def test_smooth_signals_have_their_values_and_speeds_between_the_samples():
    grid = FineGrid(100, 8)
    at = np.arange(99 * 8 + 1) / 8
    fine = grid.smooth(np.column_stack([np.sin(0.3 * np.arange(100)), np.arange(100.0) ** 3]))
    np.testing.assert_allclose(fine[:, 0], np.sin(0.3 * at), atol=2e-5)
    np.testing.assert_allclose(fine[:, 1], at**3, rtol=1e-12, atol=1e-9)
    backwards = (fine[8::8, 0] - fine[7:-1:8, 0]) * 8
    np.testing.assert_allclose(backwards, 0.3 * np.cos(0.3 * (at[8::8] - 1 / 16)), atol=2e-4)


def test_signals_do_not_ring_at_steps_and_kinks():
    numbers = np.arange(40.0)
    step, ramp = np.where(numbers < 17, -1.0, 2.0), np.maximum(numbers - 20.0, 0.0)
    apart = np.where(numbers < 20, np.sin(0.1 * numbers), 5.0 + np.cos(0.1 * numbers))
    fine = FineGrid(40, 5).smooth(np.column_stack([step, ramp, apart]))
    at = np.arange(39 * 5 + 1) / 5
    assert fine[:, 0].min() >= -1.0 - 1e-12
    assert fine[:, 0].max() <= 2.0 + 1e-12
    assert set(fine[(at <= 16) | (at >= 17), 0].round(12)) == {-1.0, 2.0}
    np.testing.assert_allclose(fine[:, 1], np.maximum(at - 20.0, 0.0), atol=1e-12)
    left, right = at <= 19, at >= 20
    np.testing.assert_allclose(fine[left, 2], np.sin(0.1 * at[left]), atol=1e-6)
    np.testing.assert_allclose(fine[right, 2], 5.0 + np.cos(0.1 * at[right]), atol=1e-6)


@pytest.mark.parametrize("count", [1, 2, 3, 7])
def test_few_samples_are_interpolated_by_polynomials_of_lower_degree(count):
    line = 2.0 * np.arange(float(count))[:, None]
    np.testing.assert_allclose(FineGrid(count, 3).smooth(line)[:, 0], 2.0 * np.arange((count - 1) * 3 + 1) / 3)


def test_the_samples_themselves_stay():
    values = np.random.default_rng(0).normal(size=(30, 2))
    assert (FineGrid(30, 4).smooth(values)[::4] == values).all()
    assert (FineGrid(30, 1).smooth(values) == values).all()
