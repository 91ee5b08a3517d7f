"""The simulation of one joint over windows: its derivatives, its delay, sticking, closed forms of the motion."""

import numpy as np
import pytest

from rrrgen.lab.friction.candidate_laws import Candidate
from rrrgen.lab.friction.joint_simulation import Torque, Windows, joint_simulation
from rrrgen.robot.friction.laws import LAWS, neural_law

PERIOD = 1e-3
COULOMB = Candidate(LAWS["coulomb_viscous"], 2, ("offset",))
STRIBECK = Candidate(LAWS["stribeck"], 3)
LUGRE = Candidate(LAWS["lugre"], 3)
NEURAL = Candidate(neural_law(3), 3)
RIGID = [0.066, 1.6, 0.3, 0.05]
CASES = {
    "sliding": (STRIBECK, True, [*RIGID, 0.35, 0.6, 0.12, 0.08, 0.3]),
    "sticking": (STRIBECK, False, [*RIGID, 0.35, 0.6, 0.12, 0.08, 0.3]),
    "bristles": (LUGRE, False, [*RIGID, 2e4, 20.0, 0.35, 0.6, 0.12, 0.08, 0.3]),
    "smooth": (NEURAL, False, [*RIGID, 0.6, 0.35, -0.35, 60.0, 20.0, 8.0, 0.12, 0.3]),
}


def windows(samples, starts, lengths, stride=5, period=PERIOD, direction=None):
    """Windows of ``lengths`` sampling periods; what the fit alone needs is zero."""
    lengths, zero = np.array(lengths), np.zeros(len(starts))
    used = np.arange(lengths.max() // stride + 1)[:, None] * stride <= lengths
    torque = Torque(np.asarray(samples, float), np.array(starts))
    return Windows(
        period, stride, torque, torque, np.zeros(used.shape), zero, zero, zero, 1.0, 1.0, used, zero.astype(int), 1e-5,
        direction,
    )  # fmt: skip


def example(count=6):
    """Windows of two lengths under a torque that wanders, with positions, speeds and deflections at their start."""
    random = np.random.default_rng(0)
    torque = 2.0 + np.cumsum(0.05 * random.normal(size=800))
    start = np.stack([random.normal(size=count) * 0.3, random.uniform(0.5, 1.5, count), np.full(count, 3e-5)])
    made = windows(torque, np.arange(count) * 100 + 50, [150, 60] * (count // 2), direction=np.ones(count))
    return made, start


@pytest.mark.parametrize("case", CASES)
def test_derivatives_by_parameters_and_initial_states(case):
    law, slides, values = CASES[case]
    theta, (made, start) = np.array(values), example()
    start = start[: 3 if law.has_bristles else 2]
    run = joint_simulation(law, slides)
    k, n = len(theta), len(start)
    slopes = np.zeros((n, k + n, len(made)))
    slopes[range(n), range(k, k + n)] = 1.0
    _, found = run.positions(theta, made, start, [*range(k), *[-1] * n], slopes)
    for j in range(k + n):
        scale = abs(theta[j]) if j < k else 1e-3
        ends = []
        for step in (1e-6 * scale, -1e-6 * scale):
            if j < k:
                ends.append(run.positions(theta + step * (np.arange(k) == j), made, start)[0])
            else:
                ends.append(run.positions(theta, made, start + step * (np.arange(n) == j - k)[:, None])[0])
        expected = (ends[0] - ends[1]) / (2e-6 * scale)
        assert found[:, j] == pytest.approx(expected, rel=1e-4, abs=1e-4 * np.abs(expected).max() + 1e-12), j


def test_positions_after_the_end_of_a_window_are_zero():
    made, start = example()
    found, _ = joint_simulation(STRIBECK, True).positions(np.array(CASES["sliding"][2]), made, start[:2])
    assert found.shape == (31, len(made))
    assert not found[13:, 1::2].any()
    assert found[:, ::2].all()


def test_a_joint_sticks_below_break_away_and_slides_above():
    made = windows([0.59] * 100 + [0.61] * 100, [0, 100], [90, 90], 10)
    theta = np.array([0.1, 0.0, 0.0, 0.0, 0.6, 0.0])  # inertia, gravity, viscous, Coulomb, delay
    found, _ = joint_simulation(COULOMB, False).positions(theta, made, np.zeros((2, 2)))
    assert found[:, 0] == pytest.approx(0.0)
    assert found[:, 1] == pytest.approx(0.5 * (0.01 / 0.1) * (np.arange(10) * 10 * PERIOD) ** 2, abs=1e-12)


def test_the_joint_stops_within_a_step():
    """Braked by 0.6 N m alone, 0.1 kg m^2 at 0.5 rad/s stop after v^2 J / (2 tau)."""
    theta = np.array([0.1, 0.0, 0.0, 0.0, 0.6, 0.0])
    found, _ = joint_simulation(COULOMB, False).positions(
        theta, windows(np.zeros(200), [0], [150], 150), np.array([[0.0], [0.5037]])
    )
    assert found[-1, 0] == pytest.approx(0.5 * 0.1 * 0.5037**2 / 0.6, rel=1e-9)


def test_a_fractional_delay_interpolates_between_two_samples():
    made = windows(np.arange(10.0), [4], [1], 1, 1.0, np.ones(1))
    theta = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.25])
    found, _ = joint_simulation(COULOMB, True).positions(theta, made, np.zeros((2, 1)))
    assert found[1, 0] == pytest.approx(0.5 * 3.75)
