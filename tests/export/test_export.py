"""Exported robots, loaded by the programs they are for, have the poses and torques of the robot file."""

from __future__ import annotations

import json
import re
import zipfile
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from click.testing import CliRunner

from cli.test_coupled_wrist import WRIST
from oracles.random_robots import random_robot, to_yaml
from rrrgen.base.errors import DerivationError, InputError
from rrrgen.cli.main import cli
from rrrgen.derive import derive_model
from rrrgen.exporting import export_robot, exporters
from rrrgen.robot.file import load_spec, loads_spec
from rrrgen.robot.importers.importing import import_robot
from rrrgen.robot.importers.interface import ChainChoice
from rrrgen.robot.spec import LinkSpec
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import chain_of, nominal_parameters

AGREE = 1e-12  # relative; both sides compute with doubles


@cache
def specs():
    bundled = [load_spec(name) for name in ("rrr", "scara", "stanford", "panda")]
    robots = [random_robot(seed, right_angles=0.5) for seed in range(6)]
    robots += [replace(robot, signs=tuple((-1, -1, 1)[i % 3] for i in range(robot.n))) for robot in robots]
    return [*bundled, *(loads_spec(to_yaml(robot)) for robot in robots)]


def states(spec, seed=0, count=5):
    random = np.random.default_rng(seed)
    return (random.uniform(-3, 3, (count, spec.n)) for _ in range(3))


def ours(spec, q, dq, ddq, drives=True):
    """Poses and torques without friction by the built-in Newton-Euler recursion."""
    chain = chain_of(spec)
    reference = NewtonEuler(chain, nominal_parameters(spec))
    tau = reference.inverse_dynamics(q, dq, ddq)
    return reference.forward_kinematics(q), tau if drives else tau - ddq @ chain.drive_inertia.T


def close(found, expected):
    np.testing.assert_allclose(found, expected, atol=AGREE * max(1.0, np.abs(expected).max()), rtol=0)


def only(exported):
    ((_, text),) = exported.files.items()
    return text


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


def mujoco_answers(text, spec, q, dq, ddq):
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data, poses, torques = mujoco.MjData(model), [], []
    for state in zip(q, dq, ddq, strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = state
        mujoco.mj_inverse(model, data)
        torques.append(np.array(data.qfrc_inverse))
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = np.reshape(data.site("tip").xmat, (3, 3)), data.site("tip").xpos
        poses.append(T)
    return np.stack(poses), np.stack(torques)


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


def test_links_that_are_no_bodies_are_lifted():
    """All of a link's mass moved to the link before: the same torques, which no simulator accepts as bodies."""
    spec = load_spec("rrr")
    model = derive_model(spec, ())
    K = np.array(model.base_projection, dtype=float)
    beta = K @ nominal_parameters(spec).ravel()
    exported = export_robot(replace(spec, links=None), "mjcf", dict(zip(names_of(model), beta, strict=True)))
    assert "15 base parameters" in exported.notes[0]
    q, dq, ddq = states(spec)
    _, torques = mujoco_answers(only(exported), spec, q, dq, ddq)
    np.testing.assert_allclose(torques, ours(spec, q, dq, ddq)[1], atol=1e-10)
    nothing = (0,) * 3
    weightless = LinkSpec(spec.links[0].mass * 0, nothing, (0,) * 6, "com")
    light = replace(spec, links=(weightless, *spec.links[1:]))
    exported = export_robot(light, "mjcf")
    assert "no bodies" in exported.notes[0]
    _, torques = mujoco_answers(only(exported), light, q, dq, ddq)
    np.testing.assert_allclose(torques, ours(light, q, dq, ddq)[1], atol=1e-10)


def names_of(model):
    return [parameter.name for parameter in model.base_parameters]


def test_what_cannot_be_done_is_refused(tmp_path):
    bare = replace(load_spec("rrr"), links=None)
    with pytest.raises(DerivationError, match="has no links"):
        export_robot(bare, "mjcf")
    with pytest.raises(InputError, match="no value for the base parameters"):
        export_robot(bare, "mjcf", {})
    with pytest.raises(InputError, match="'Izz9R' is no base parameter"):
        export_robot(bare, "urdf", {"Izz9R": 1.0})
    with pytest.raises(DerivationError, match="no rigid bodies"):
        export_robot(bare, "mjcf", dict.fromkeys(names_of(derive_model(bare, ())), -1.0))
    with pytest.raises(InputError, match="there is no target 'urf'; did you mean 'urdf'"):
        export_robot(bare, "urf")
    assert exporters().keys() >= {"urdf", "mjcf", "par"}


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


def test_a_package_has_the_modes_and_parts_that_were_chosen(tmp_path):
    """Also where `generate` writes it; contradictions are refused."""
    words = ["pendulum", "--with", "controller", "--modes", "computed_torque", "--parts", "none"]
    done = CliRunner().invoke(cli, ["export", *words, "--to", "embedded", "-o", str(tmp_path / "a")])
    assert done.exit_code == 0, done.output
    header = (tmp_path / "a" / "src" / "pendulum_controller.h").read_text(encoding="utf-8")
    assert re.search(r"Modes *free, gravity, computed_torque\n.*Parts *none", header)
    with_target = ["generate", *words, "--with", "embedded", "--rate", "500", "--no-casadi-files", "-j", "1"]
    done = CliRunner().invoke(cli, [*with_target, "-o", str(tmp_path / "b")])
    assert done.exit_code == 0, done.output
    own, packed = (
        tmp_path / "b" / "pendulum_controller.c",
        tmp_path / "b" / "embedded" / "src" / "pendulum_controller.c",
    )
    assert own.read_bytes() == packed.read_bytes()
    sample = tmp_path / "b" / "embedded" / "zephyr" / "samples" / "controller" / "src" / "main.c"
    assert "#define PERIOD_US 2000" in sample.read_text(encoding="utf-8")
    for wrong, said in (
        (["--parts", "none,observer"], "leaves all parts out"),
        (["--parts", "obsever"], "did you mean"),
        (["--modes", "gravity", "--to", "urdf"], "belong to --with controller"),
        (["--with", "controller", "--parts", "estimator"], "accelerations"),
    ):
        place = ["-o", str(tmp_path / "c")]
        refused = CliRunner().invoke(cli, ["export", "pendulum", "--to", "embedded", *wrong, *place])
        assert refused.exit_code != 0, wrong
        assert said in refused.output + str(refused.exception), wrong


def test_packages_named_by_their_suffix_are_files(tmp_path, monkeypatch):
    """`-o x.fmu` used to make a folder; the name of a wheel says its platform, so that another name is refused."""
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(cli, ["export", "pendulum", "--to", "fmu", "-o", "x.fmu"])
    assert done.exit_code == 0, done.output
    assert "modelDescription.xml" in zipfile.ZipFile("x.fmu").namelist()
    again = CliRunner().invoke(cli, ["export", "pendulum", "--to", "fmu", "-o", "x.fmu"])
    assert "the file exists already" in str(again.exception)
    CliRunner().invoke(cli, ["export", "pendulum", "--to", "fmu", "-o", "folder"])
    assert {path.name for path in (tmp_path / "folder").iterdir()} == {"pendulum.fmu", "README.md"}
    wheel = CliRunner().invoke(cli, ["export", "pendulum", "--to", "wheel", "-o", "x.whl"])
    assert isinstance(wheel.exception, InputError)
    assert "pendulum_model-" in str(wheel.exception)
    assert not (tmp_path / "x.whl").exists()
