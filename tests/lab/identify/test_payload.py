"""A payload on a known arm, and drive gains by a known payload: against truth, with friction that has changed."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import rrrgen
from lab.identify.carried_payload import COM, LOGGED, MASS, TENSOR, recording
from rrrgen.base.errors import DerivationError, InputError
from rrrgen.cli.main import run
from rrrgen.lab.identify.payload import identify_payload
from rrrgen.lab.identify.rows import inertial, standard_of
from rrrgen.robot.spec import standard_parameters
from rrrgen.runtime import load
from samples.recordings import write_log


@pytest.fixture(scope="module")
def puma():
    return rrrgen.compile("puma560", backend="numpy")


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


def test_a_load_that_was_taken_off_is_no_payload(planar):
    """The robot file has 2 kg more than the arm: the unconstrained mass is -2 kg, and the best body is a wrong one."""
    first, last = planar.spec.links
    loaded = rrrgen.compile(replace(planar.spec, links=(first, replace(last, mass=last.mass + 2))), backend="numpy")
    with pytest.raises(
        DerivationError, match=r"no payload explains the torques: .* a mass of -2(\.0\d)? \+- "
    ) as caught:
        identify_payload(loaded, [recording(planar, 3, carried=False)], LOGGED)
    assert "no body has" in str(caught.value)


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


def _torque(model, q, dq, ddq):
    """Torques (N, n) of the arm that carries the payload, with noise."""
    xx, yy, zz, xy, xz, yz = TENSOR
    beta = model.add_payload(MASS, COM, np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    tau = model.inverse_dynamics(q, dq, ddq, beta) + model.friction(dq)
    return tau + 0.05 * np.random.default_rng(4).normal(size=tau.shape)


def test_one_moving_joint_does_not_tell_the_mass(planar):
    """One joint sees two first moments and an inertia of the load, which bodies of any mass have: 3 for 4 numbers."""
    log = recording(planar, 4)
    q, dq, ddq = log.q.copy(), log.dq.copy(), log.ddq.copy()
    q[:, 1], dq[:, 1], ddq[:, 1] = 0.3, 0.0, 0.0
    stands = replace(log, q=q, dq=dq, ddq=ddq, tau=_torque(planar, q, dq, ddq))
    with pytest.raises(DerivationError, match=r"mass of the payload is not determined.*q2: standing"):
        identify_payload(planar, [stands], LOGGED)
    spec = replace(planar.spec, joints=planar.spec.joints[:1], links=planar.spec.links[:1])
    arm = rrrgen.compile(spec, backend="numpy")
    q, dq, ddq = q[:, :1], dq[:, :1], ddq[:, :1]
    alone = replace(log, joints=log.joints[:1], q=q, dq=dq, ddq=ddq, tau=_torque(arm, q, dq, ddq))
    with pytest.raises(DerivationError, match="mass of the payload is not determined"):
        identify_payload(arm, [alone], LOGGED)


def test_a_joint_that_hardly_moves_does_not_tell_the_mass(planar):
    """The torques tell the mass to 0.6 kg or worse: that no body has less inertia must not look like a measurement."""
    log = recording(planar, 4)
    q, dq, ddq = log.q.copy(), log.dq.copy(), log.ddq.copy()
    q[:, 1], dq[:, 1], ddq[:, 1] = 0.3 + 2e-3 * (q[:, 1] - q[0, 1]), 2e-3 * dq[:, 1], 2e-3 * ddq[:, 1]
    creeps = replace(log, q=q, dq=dq, ddq=ddq, tau=_torque(planar, q, dq, ddq))
    with pytest.raises(DerivationError, match="mass of the payload is not determined"):
        identify_payload(planar, [creeps], LOGGED)


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
