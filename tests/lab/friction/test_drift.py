"""A drift of the friction is reported with its size; friction that stays as it is passes in silence."""

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d

from rrrgen.lab.data.recordings import Log
from rrrgen.lab.friction.drift import friction_drift
from rrrgen.lab.friction.estimation import estimate_friction
from rrrgen.lab.friction.joint_recording import JointData, joint_data
from samples.stick_slip_joint import Joint, record

PERIOD, SECONDS = 1e-3, 40.0


def recorded(fall, seed):
    """A joint on fast, then slow sines, whose torque is computed here; viscous friction falls by the share ``fall``."""
    random = np.random.default_rng(seed)
    t = np.arange(round(SECONDS / PERIOD)) * PERIOD
    q, dq, ddq = np.zeros((3, len(t)))
    for f in (0.1, 0.3, 0.7, 1.1, 2.3):
        w, phase, size = 2 * np.pi * f, random.uniform(0, 2 * np.pi), 0.5
        q += size / w * np.sin(w * t + phase)
        dq += size * np.cos(w * t + phase)
        ddq -= size * w * np.sin(w * t + phase)
    viscous = 0.8 * (1 - fall * (t / SECONDS - 0.5))
    sign = np.sign(dq)
    tau = (
        0.3 * ddq + 2.0 * np.sin(q) + 1.0 * np.cos(q) + viscous * dq + sign * (1.2 + 0.4 * np.exp(-((dq / 0.05) ** 2)))
    )
    tau += 0.05 * random.normal(size=len(t))
    held = np.round(q / 1e-5) * 1e-5
    return JointData("q1", PERIOD, held, tau, np.ones(len(t), bool), ((0, len(t)),), 1e-5)


@pytest.mark.parametrize("seed", range(3))
def test_friction_that_stays_passes_in_silence(seed):
    drift = friction_drift(recorded(0.0, seed), 2, 0.0)
    assert not drift.is_certain
    assert abs(drift.viscous) < 0.05 * 0.8


@pytest.mark.parametrize("seed", range(3))
def test_a_fall_by_35_percent_is_reported_with_its_size(seed):
    drift = friction_drift(recorded(0.35, seed), 2, 0.0)
    assert drift.is_certain
    assert drift.viscous == pytest.approx(-0.35 * 0.8, abs=0.05)
    assert abs(drift.coulomb) < 0.05
    assert drift.mean_coulomb == pytest.approx(1.2, abs=0.05)
    assert "viscous friction changes by -" in drift.sentence


def test_a_delay_between_those_tried_does_not_change_the_drift():
    """Half a sampling period left of the delay had made the drift of a joint at 1 kHz 43 % too large."""
    truth = Joint("stribeck")
    made = record(truth, seed=2, substeps=4, torque_noise=0.01)
    t, q = made["t"], made["q"]
    tau = made["tau"] - 0.35 * truth.viscous * (t / t[-1] - 0.5) * made["v"]
    data = joint_data(Log(("q",), t, q[:, None], tau[:, None]), "q")
    for delay in (0.0, 0.5):
        drift = friction_drift(data, 2, delay)
        assert drift.is_certain
        assert drift.viscous == pytest.approx(-0.35 * truth.viscous, rel=0.03)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.sweep(but=["0"])
def test_the_friction_that_drifts_is_that_of_the_middle_of_the_recording(seed):
    """Without the drift in the fit, Coulomb and viscous friction were six deviations off."""
    truth = Joint("stribeck")
    made = record(truth, seed=seed, period=2e-3, substeps=20, torque_noise=0.01)
    t, q = made["t"], made["q"]
    dq = uniform_filter1d(np.gradient(q, t[1] - t[0]), 7)
    tau = made["tau"] - 0.35 * truth.viscous * (t / t[-1] - 0.5) * dq
    found = estimate_friction(joint_data(Log(("q",), t, q[:, None], tau[:, None]), "q"), 2, ("stribeck",))
    values = {"inertia": truth.inertia, "coulomb": truth.coulomb, "viscous": truth.viscous, "gravity": truth.gravity}
    for name, value in (values | {"stiction_excess": truth.excess, "stribeck_speed": truth.speed}).items():
        assert abs(found.chosen.values[name] - value) < 3.0 * found.chosen.std[name], name
    assert found.notes[0].startswith("friction drifts: from beginning to end viscous friction changes by -0.04")
    assert found.to_json()["drift"]["viscous"] == pytest.approx(-0.35 * truth.viscous, rel=0.1)


def heated(fall, seed, over):
    """A joint that moves fast in the first half, slowly in the second; friction falls with the time or the energy."""
    random = np.random.default_rng([seed, 7])
    t = np.arange(round(SECONDS / PERIOD)) * PERIOD
    pace = 0.6 + 0.4 * np.tanh(0.5 * SECONDS - t)  # 1, then 0.2
    phi = np.cumsum(pace) * PERIOD
    q, dq, ddq = np.zeros((3, len(t)))
    for f in (0.1, 0.3, 0.7, 1.1, 2.3):
        w, phase, size = 2 * np.pi * f, random.uniform(0, 2 * np.pi), 0.7
        q += size / w * np.sin(w * phi + phase)
        dq += size * pace * np.cos(w * phi + phase)
        ddq += size * (np.gradient(pace, PERIOD) * np.cos(w * phi + phase) - pace**2 * w * np.sin(w * phi + phase))
    energy = np.cumsum(1.2 * np.abs(dq) + 0.8 * dq**2)
    s = (t / SECONDS if over == "time" else energy / energy[-1]) - 0.5
    tau = 0.3 * ddq + 2.0 * np.sin(q) + np.cos(q) + (1 - fall * s) * (0.8 * dq + 1.2 * np.sign(dq))
    tau += 0.05 * random.normal(size=len(t))
    held = np.round(q / 1e-5) * 1e-5
    return JointData("q1", PERIOD, held, tau, np.ones(len(t), bool), ((0, len(t)),), 1e-5)


@pytest.mark.parametrize("over", ["time", "energy"])
@pytest.mark.parametrize(
    "seed", [0, pytest.param(1, marks=pytest.mark.sweep), pytest.param(2, marks=pytest.mark.sweep)]
)
def test_time_and_dissipated_energy_are_told_apart_where_the_motion_slows_down(seed, over):
    data = heated(0.35, seed, over)
    drift = friction_drift(data, 2, 0.0)
    assert drift.is_certain
    assert drift.over == over
    assert drift.viscous == pytest.approx(-0.35 * 0.8, abs=0.06)
    assert drift.coulomb == pytest.approx(-0.35 * 1.2, abs=0.06)
    assert ("with the energy that it has dissipated" in drift.sentence) == (over == "energy")
    again = friction_drift(drift.remove_from(data), 2, 0.0)
    assert abs(again.viscous) < 0.05
    assert abs(again.coulomb) < 0.05


def test_a_short_recording_is_not_judged():
    whole = recorded(0.35, 0)
    count = 10_000
    short = JointData("q1", PERIOD, whole.q[:count], whole.u[:count], whole.usable[:count], ((0, count),), 1e-5)
    assert friction_drift(short, 2, 0.0) is None
