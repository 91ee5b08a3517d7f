"""Exported robots, loaded by the programs they are for, have the poses and torques of the robot file."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from click.testing import CliRunner

from cli.test_coupled_wrist import WRIST
from emit.targets.arm import arm
from emit.targets.compared import mujoco_answers, only, ours, states
from oracles.random_robots import random_robot, to_yaml
from rrrgen.base.errors import InputError
from rrrgen.cli.main import cli
from rrrgen.exporting import export_robot
from rrrgen.robot.file import load_spec, loads_spec
from rrrgen.robot.importers.importing import import_robot
from rrrgen.robot.importers.interface import ChainChoice
from samples.draws import draws

AGREE = 1e-12  # relative; both sides compute with doubles


@cache
def specs():
    bundled = [load_spec(name) for name in ("rrr", "scara", "stanford", "panda")]
    robots = [random_robot(seed, right_angles=0.5) for seed in range(draws(3))]
    robots += [replace(robot, signs=tuple((-1, -1, 1)[i % 3] for i in range(robot.n))) for robot in robots]
    return [*bundled, *(loads_spec(to_yaml(robot)) for robot in robots)]


def close(found, expected):
    np.testing.assert_allclose(found, expected, atol=AGREE * max(1.0, np.abs(expected).max()), rtol=0)


def test_urdf_in_pinocchio():
    pin = pytest.importorskip("pinocchio")
    for spec in specs():
        model = pin.buildModelFromXML(only(export_robot(spec, "urdf")))
        model.gravity.linear = np.array([float(spec.nominal(g)) for g in spec.gravity])
        data = model.createData()
        q, dq, ddq = states(spec)
        poses, torques = [], []
        for state in zip(q, dq, ddq, strict=True):
            full = pin.neutral(model)
            for joint, value in zip(list(model.joints)[1:], state[0], strict=True):
                full[joint.idx_q : joint.idx_q + joint.nq] = value if joint.nq == 1 else (np.cos(value), np.sin(value))
            pin.framesForwardKinematics(model, data, full)
            poses.append(data.oMf[model.getFrameId("tip")].homogeneous)
            torques.append(pin.rnea(model, data, full, *state[1:]))
        expected = ours(spec, q, dq, ddq, drives=False)
        close(np.stack(poses), expected[0])
        close(np.stack(torques), expected[1])


def test_mjcf_in_mujoco():
    for spec in specs():
        q, dq, ddq = states(spec)
        viscous = np.array([(j.friction.viscous or 0.0) if j.friction else 0.0 for j in spec.joints])
        poses, torques = mujoco_answers(only(export_robot(spec, "mjcf")), spec, q, dq, ddq)
        expected = ours(spec, q, dq, ddq)
        close(poses, expected[0])
        close(torques, expected[1] + viscous * dq)


def test_coupled_drives_are_tendons():
    spec = loads_spec(WRIST)
    q, dq, ddq = states(spec)
    _, torques = mujoco_answers(only(export_robot(spec, "mjcf")), spec, q, dq, ddq)
    W = np.array(spec.drives.motor_from_joint, dtype=float)
    viscous = W.T @ np.diag([1e-4, 2e-4]) @ W
    close(torques, ours(spec, q, dq, ddq)[1] + dq @ viscous)
    assert any("coupled drives are left out" in note for note in export_robot(spec, "urdf").notes)


def test_coupled_drives_come_back(tmp_path):
    spec = loads_spec(WRIST)
    (tmp_path / "w.xml").write_text(only(export_robot(spec, "mjcf")))
    again = import_robot(tmp_path / "w.xml", chain=ChainChoice(tip="tip")).spec
    q, dq, ddq = states(spec)
    close(ours(again, q, dq, ddq)[1], ours(spec, q, dq, ddq)[1])
    W, V = (np.array(each.drives.motor_from_joint, dtype=float) for each in (spec, again))
    np.testing.assert_allclose(V, W, atol=1e-12)
    assert [m.name for m in again.drives.motors] == ["left", "right"]
    assert again.drives.motors[1].torque_limit == 1.0
    assert again.drives.motors[0].friction == spec.drives.motors[0].friction


def test_round_trips(tmp_path):
    for spec in specs():
        q, dq, ddq = states(spec)
        poses, torques = ours(spec, q, dq, ddq)
        for target in ("urdf", "par", "mjcf"):
            exported = export_robot(spec, target)
            (tmp_path / f"r.{target}").write_text(only(exported))
            values = dict(re.findall(r"--set (\w+)=(\S+)", " ".join(exported.notes)))
            again = import_robot(tmp_path / f"r.{target}", values=values).spec
            again = replace(again, gravity=spec.gravity) if target == "urdf" else again
            found = ours(again, q, dq, ddq)
            close(found[0], poses)
            close(found[1], torques if target == "par" else ours(spec, q, dq, ddq, drives=False)[1])
            if target == "urdf":
                assert [j.limits.velocity for j in again.joints] == [j.limits.velocity for j in spec.joints]


def test_friction_and_drive_inertia_come_back_from_par(tmp_path):
    spec = arm()
    (tmp_path / "arm.par").write_text(only(export_robot(spec, "par")))
    again = import_robot(tmp_path / "arm.par").spec
    assert [joint.drive.inertia for joint in again.joints] == [0.05, 0.02]
    assert [(joint.friction.viscous, joint.friction.coulomb) for joint in again.joints] == [(0.4, 0.6), (0.2, 0.3)]


def test_several_targets_are_all_written_or_none(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    both = ["export", "rrr", "--to", "urdf", "--to", "mjcf"]
    named = CliRunner().invoke(cli, [*both, "-o", "arm.xml"])
    assert "-o names one file or folder, but --to 2 targets: urdf, mjcf" in str(named.exception)
    (tmp_path / "rrr.xml").write_text("mine")
    taken = CliRunner().invoke(cli, both)
    assert "rrr.xml: error: the file exists already" in str(taken.exception)
    assert [path.name for path in tmp_path.iterdir()] == ["rrr.xml"]
    done = CliRunner().invoke(cli, [*both, "--force"])
    assert done.exit_code == 0, done.output
    assert (tmp_path / "rrr.urdf").read_text().startswith("<?xml")
    assert "<mujoco" in (tmp_path / "rrr.xml").read_text()


def test_command(tmp_path):
    run = CliRunner().invoke(cli, ["export", "rrr", "--to", "urdf", "-o", str(tmp_path / "a.urdf")])
    assert run.exit_code == 0, run.output
    assert "limits of the acceleration are left out" in run.output
    assert (tmp_path / "a.urdf").read_text().startswith("<?xml")
    again = CliRunner().invoke(cli, ["export", "rrr", "--to", "urdf", "-o", str(tmp_path / "a.urdf")])
    assert isinstance(again.exception, InputError)
    (tmp_path / "beta.json").write_text(json.dumps({"a": "b"}))
    bad = CliRunner().invoke(cli, ["export", "rrr", "--to", "urdf", "--beta", str(tmp_path / "beta.json")])
    assert "no object of names and numbers" in str(bad.exception)
