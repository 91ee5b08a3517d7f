"""A payload on a known arm, and drive gains by a known payload: against truth, with friction that has changed."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import rrrgen
from rrrgen.base.errors import DerivationError, InputError
from rrrgen.cli.main import run
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.identify.drive_gains import identify_gains
from rrrgen.lab.identify.payload import identify_payload
from rrrgen.lab.identify.rows import inertial, standard_of
from rrrgen.robot.model.inertial_parameters import standard_parameters
from rrrgen.runtime import load
from samples.recordings import fourier_motion, write_log

LOGGED = Processing("logged", decimate=2)
MASS, COM, TENSOR = 2.3, np.array([0.03, -0.02, 0.09]), np.array([0.012, 0.010, 0.006, 0.001, -0.0005, 0.0008])


def recording(model, seed, carried=True, noise=0.05, friction=0.0, seconds=15.0, gains=1.0, size=0.8):
    """Torques of the arm with the payload by the compiled add_payload, which shares nothing with the estimation."""
    t = 0.01 * np.arange(round(seconds / 0.01))
    q, dq, ddq = fourier_motion(t, model.n, seed, base=1 / 7, size=size)
    xx, yy, zz, xy, xz, yz = TENSOR
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    beta = model.add_payload(MASS, COM, tensor) if carried else model.beta
    tau = model.inverse_dynamics(q, dq, ddq, beta) + model.friction(dq) + friction * (0.3 * np.sign(dq) + 0.2 * dq)
    tau = (tau + noise * np.random.default_rng(seed).normal(size=tau.shape)) / gains
    return Log(tuple(joint.name for joint in model.spec.joints), t, q, tau, dq=dq, ddq=ddq, period=0.01)


@pytest.fixture(scope="module")
def puma():
    return rrrgen.compile("puma560", backend="numpy")


@pytest.fixture(scope="module")
def planar():
    return rrrgen.compile("planar2r", backend="numpy")


def test_a_body_converts_both_ways():
    phi = standard_of(MASS, COM, TENSOR)
    assert inertial(phi) == pytest.approx([MASS, *COM, *TENSOR])
    steiner = TENSOR[0] + MASS * (COM[1] ** 2 + COM[2] ** 2)
    assert phi[4] == pytest.approx(steiner)


def test_the_payload_of_a_six_joint_arm(puma):
    """Friction 0.3 N m and 0.2 N m s/rad off: all ten values within three of their deviations, mass within 1 %."""
    found = identify_payload(puma, [recording(puma, 1, friction=1.0)], LOGGED)
    truth = np.array([MASS, *COM, *TENSOR])
    assert np.all(np.abs(found.values - truth) < 3.5 * found.std)
    assert found.values[0] == pytest.approx(MASS, rel=0.01)
    assert found.values[1:4] == pytest.approx(COM, abs=2e-3)
    assert found.std[0] < 0.02
    assert found.error_with < 0.1 * found.error_without
    assert found.friction["fc1"] == pytest.approx(0.3, abs=0.05)
    spec = found.carried_by(puma.spec)
    before, after = (np.array(standard_parameters(s.links[-1]), float) for s in (puma.spec, spec))
    assert after - before == pytest.approx(found.phi)
    biased = identify_payload(puma, [recording(puma, 1, friction=1.0)], LOGGED, correct_friction=False)
    assert biased.error_with > 2 * found.error_with


def test_what_a_planar_arm_cannot_tell_is_said(planar):
    found = identify_payload(planar, [recording(planar, 2)], LOGGED)
    assert found.values[0] == pytest.approx(MASS, rel=0.02)
    assert any("mz has no effect" in note for note in found.notes)
    assert set(found.undetermined) == {"com_z", "Ixx", "Iyy", "Ixy", "Ixz", "Iyz"}
    table = {line.split()[0]: line for line in found.lines()}
    assert "not determined" in table["Ixx"]
    assert "not determined" not in table["Izz"]


def test_no_payload_and_no_links_are_refused(planar):
    with pytest.raises(DerivationError, match="the mass of the payload is not determined"):
        identify_payload(planar, [recording(planar, 3, carried=False)], LOGGED)
    with pytest.raises(InputError, match="too little data: 10 rows"):
        identify_payload(planar, [recording(planar, 3, seconds=0.2)], LOGGED)
    still = recording(planar, 3)
    noise = 1e-6 * np.random.default_rng(3).normal(size=still.q.shape)
    still = replace(still, q=0.3 + noise, dq=noise, ddq=noise)
    with pytest.raises(InputError, match="no joint moves"):
        identify_payload(planar, [still], LOGGED)
    bare = rrrgen.compile(replace(planar.spec, links=None), backend="numpy")
    with pytest.raises(InputError, match="no links"):
        identify_payload(bare, [recording(planar, 3)], LOGGED)


def test_a_joint_that_stands_is_held_by_friction(puma):
    """Its motor gives no torque at all, whatever the payload weighs: that must not tell where the payload is."""
    log = recording(puma, 1, seconds=10.0)
    q, dq, ddq = log.q.copy(), log.dq.copy(), log.ddq.copy()
    q[:, 5], dq[:, 5], ddq[:, 5] = 0.4, 0.0, 0.0
    xx, yy, zz, xy, xz, yz = TENSOR
    beta = puma.add_payload(MASS, COM, np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    tau = puma.inverse_dynamics(q, dq, ddq, beta) + puma.friction(dq)
    tau += 0.05 * np.random.default_rng(1).normal(size=tau.shape)
    tau[:, 5] = 0.0
    found = identify_payload(puma, [replace(log, q=q, dq=dq, ddq=ddq, tau=tau)], LOGGED)
    assert found.values[1:4] == pytest.approx(COM, abs=3e-3)
    assert "flange: standing" in found.notes[0]
    assert "fc6" not in found.friction
    assert not found.undetermined


def test_gains_without_knowing_the_arm(planar):
    """Gains 0.8 and 1.25 from the payload alone; deviations agree with the spread of repeated experiments."""
    gains = np.array([0.8, 1.25])
    body = standard_of(MASS, COM, TENSOR)
    results = []
    for seed in range(5):
        logs = [recording(planar, 10 + seed + 20 * carried, carried, gains=gains, friction=1.0) for carried in (0, 1)]
        results.append(identify_gains(planar, logs[:1], logs[1:], body, LOGGED))
    values = np.array([each.gain for each in results])
    assert np.mean(values, axis=0) == pytest.approx(gains, rel=0.005)
    spread = np.mean(((values - gains) / [each.std for each in results]) ** 2)
    assert 0.2 < spread < 3.0
    assert results[0].relative_error < 0.2 * results[0].fallen_from


def test_gains_without_a_payload_that_matters_are_refused(planar):
    logs = [recording(planar, 5 + k, carried=False, noise=1.0, seconds=4.0) for k in (0, 1)]
    with pytest.raises(DerivationError, match="is not determined"):
        identify_gains(planar, logs[:1], logs[1:], standard_of(0.01, np.zeros(3), np.zeros(6)), LOGGED)


def test_gains_that_the_payload_does_not_tell_are_marked(planar):
    """A wrong sign is a negative gain; the same recording twice tells none, nor do exchanged ones."""
    logs = [recording(planar, 5 + k, carried=k == 1) for k in (0, 1)]
    body = standard_of(MASS, COM, TENSOR)
    wrong = [replace(log, tau=log.tau * np.array([1.0, -1.0])) for log in logs]
    found = identify_gains(planar, wrong[:1], wrong[1:], body, LOGGED)
    assert found.gain == pytest.approx([1.0, -1.0], rel=0.02)
    assert found.notes == ("q2: the sign of the recorded torque is wrong",)
    still = [replace(log, q=log.q * [1, 0], dq=log.dq * [1, 0], ddq=log.ddq * [1, 0]) for log in logs]
    found = identify_gains(planar, still[:1], still[1:], body, LOGGED)
    assert found.undetermined == ("q2",)
    assert found.to_json()["gain"]["q2"] is None
    assert "q2: standing" in found.notes[0]
    for first, second, message in ((0, 0, "is the same with the payload"), (1, 0, "are the recordings exchanged")):
        with pytest.raises(DerivationError, match=message):
            identify_gains(planar, [logs[first]], [logs[second]], body, LOGGED)


def test_the_commands(tmp_path, planar, monkeypatch, capsys):
    monkeypatch.setattr(load, "compile", partial(load.compile, backend="numpy"))
    write_log(tmp_path / "empty.csv", recording(planar, 7, carried=False))
    write_log(tmp_path / "carrying.csv", recording(planar, 8))
    empty, carrying = str(tmp_path / "empty.csv"), str(tmp_path / "carrying.csv")
    assert run(["experiment", "payload", "planar2r", "--log", carrying, "-o", str(tmp_path / "p")]) == 0
    assert "mass kg" in capsys.readouterr().out
    record = json.loads((tmp_path / "p" / "results" / "payload.json").read_text())
    assert record["values"]["mass"] == pytest.approx(MASS, rel=0.02)
    loaded = str(tmp_path / "p" / "results" / "robot.yaml")
    assert run(["experiment", "validate", loaded, "--log", carrying, "-o", str(tmp_path / "v")]) == 0
    assert run(["experiment", "payload", "planar2r", "--log", empty, "-o", str(tmp_path / "none")]) == 4
    words = ["--log", empty, "--loaded", carrying, "--mass", "2.3", "--com", "0.03", "-0.02", "0.09"]
    tensor = ["--inertia", *(str(v) for v in TENSOR)]
    assert run(["experiment", "drive-gains", "planar2r", *words, *tensor, "-o", str(tmp_path / "g")]) == 0
    gains = json.loads((tmp_path / "g" / "results" / "drive_gains.json").read_text())["gain"]
    assert list(gains.values()) == pytest.approx([1.0, 1.0], rel=0.05)
    assert run(["experiment", "drive-gains", "planar2r", "--log", empty, "-o", str(tmp_path / "h")]) == 2
