"""Torque ripple is found with amplitude, order and deviation, and taken off; a joint without it passes in silence."""

import numpy as np
import pytest

from lab.friction.test_drift import recorded
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.friction.estimation import estimate_friction
from rrrgen.lab.friction.joint_recording import joint_data
from rrrgen.lab.friction.ripple import Ripple, find_ripples, without_ripples
from samples.stick_slip_joint import Joint, record


def rippled(seed, *ripples, fall=0.0):
    """The joint of the drift, with ripples (amplitude, order, phase)."""
    data = recorded(fall, seed)
    for amplitude, order, phase in ripples:
        data.u[:] += amplitude * np.cos(order * data.q - phase)
    return data


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.sweep)])
def test_a_joint_without_ripple_passes_in_silence(seed):
    assert find_ripples(rippled(seed, fall=0.05), 2, 0.0, True) == ()


@pytest.mark.sweep(but=["0-34.5"])
@pytest.mark.parametrize(("seed", "order"), [(0, 34.5), pytest.param(1, 6.0, marks=pytest.mark.sweep), (2, 101.0)])
def test_amplitude_and_order_are_those_of_the_joint(seed, order):
    (found,) = find_ripples(rippled(seed, (0.06, order, 1.0)), 2, 0.0, True)
    assert abs(found.amplitude - 0.06) < 4.0 * found.amplitude_std
    assert found.amplitude_std < 0.006
    assert abs(found.order - order) < 4.0 * found.order_std
    assert found.order_std < 0.02 * order
    assert np.cos(found.phase - 1.0) > 0.9
    assert "per revolution" in found.line
    assert "explains" in found.sentence


def test_two_ripples_of_a_sliding_joint_are_found_in_turn():
    """A joint in metres: the period is printed, and half a period may be more than a revolution."""
    found = find_ripples(rippled(3, (0.1, 40.0, 0.5), (0.05, 23.0, 2.0)), 2, 0.0, False)
    assert [round(each.order) for each in found] == [40, 23]
    assert "period 0.157" in found[0].line
    assert found[1].amplitude == pytest.approx(0.05, rel=0.15)


def test_the_ripple_is_taken_off_where_the_torque_acts():
    """The torque of sample k acts from k to k + 1, and ``delay`` periods later."""
    data = rippled(0)
    ripple = Ripple(0.2, 0.0, 30.0, 0.0, 0.7, 0.5, 9.0, 0.0, True)
    clean, delay = data.u.copy(), 1.5
    k = np.arange(len(data.q))
    data.u[:] += ripple.torque(np.interp(k + 0.5 + delay, k, data.q))
    assert without_ripples(data, [ripple], delay).u == pytest.approx(clean, abs=1e-3)


def test_friction_and_ripple_are_estimated_together():
    """With the ripple in the errors the held-out error is twice as large; the friction is within its deviations."""
    truth = Joint("coulomb_viscous")
    made = record(truth, seed=3, period=2e-3, substeps=20, torque_noise=0.01)
    t, q = made["t"], made["q"]
    ahead = np.interp(np.arange(len(q)) + 0.5, np.arange(len(q)), q)
    tau = made["tau"] + 0.05 * np.cos(30.0 * ahead - 1.0)
    data = joint_data(Log(("q",), t, q[:, None], tau[:, None]), "q")
    found = estimate_friction(data, 2, ("coulomb_viscous",))
    (ripple,) = found.ripples
    assert abs(ripple.amplitude - 0.05) < 4.0 * ripple.amplitude_std
    assert abs(ripple.order - 30.0) < 4.0 * ripple.order_std
    values = {"inertia": truth.inertia, "coulomb": truth.coulomb, "viscous": truth.viscous, "gravity": truth.gravity}
    for name, value in values.items():
        assert abs(found.chosen.values[name] - value) < 3.0 * found.chosen.std[name], name
    assert found.chosen.score.held_out < 1.35
    assert found.notes[0].startswith("the torque ripples with the position: ")
    assert found.lines()[-1].split()[:2] == ["ripple", f"{ripple.amplitude:.5g}"]
    assert found.to_json()["ripples"] == [ripple.to_json()]
