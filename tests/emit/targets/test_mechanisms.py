"""Joints that follow others and branches, exported and read by other programs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rrrgen.base.errors import DerivationError
from rrrgen.exporting import export_robot
from rrrgen.robot.file import load_spec, loads_spec
from rrrgen.robot.importers.importing import import_robot
from rrrgen.robot.importers.interface import ChainChoice
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import chain_of, nominal_parameters

PALLETISER = Path(__file__).resolve().parents[3] / "examples" / "palletiser" / "robot.yaml"

MIMIC = """\
schema: rrrgen/1
name: gripper_arm
convention: standard
units: {angle: deg, length: m}
gravity: [0, 0, -9.81]
joints:
  - {name: lift, type: prismatic, alpha: 20, a: 0.1, theta: 10, limits: {lower: 0, upper: 0.5}}
  - {name: swing, type: revolute, alpha: 90, a: 0.3, d: 0.1, theta: 30, friction: {viscous: 0.3}}
  - {name: twin, type: revolute, alpha: 0, a: 0.2, d: 0.05, theta: -15, follows: {swing: -3/2}}
links:
  - {mass: 3, com: [0.1, 0.02, 0.03], inertia: {about: com, xx: 0.2, yy: 0.3, zz: 0.25, xy: 0.01}}
  - {mass: 2, com: [-0.1, 0.05, 0.01], inertia: {about: com, xx: 0.02, yy: 0.1, zz: 0.1, xz: 0.01}}
  - {mass: 1, com: [-0.05, 0.01, 0], inertia: {about: com, xx: 0.01, yy: 0.03, zz: 0.03, yz: 0.002}}
"""


REVERSED = (
    MIMIC.replace("theta: 30, friction: {viscous: 0.3}", "theta: 30, sign: -1, limits: {lower: -60, upper: 115}, "
                  "friction: {viscous: 0.3, coulomb: 0.2}, drive: {inertia: 0.4}")
    + "base: {translation: [0.3, 0, 1], rpy: [0, 30, 0]}\ntool: {translation: [0.1, 0.02, -0.3], rpy: [20, 0, 10]}\n"
)  # fmt: skip
"""The leader turns the other way, with a motor and friction; the arm has a base and a tool."""


def oracle(spec):
    return NewtonEuler(chain_of(spec), nominal_parameters(spec))


@pytest.mark.parametrize("target", ["urdf", "mjcf"])
def test_mimic_joints_come_back_from_urdf_and_mjcf(target, tmp_path):
    spec = loads_spec(MIMIC)
    ((name, text),) = export_robot(spec, target).files.items()
    (tmp_path / name).write_text(text, encoding="utf-8")
    back = import_robot(tmp_path / name, chain=ChainChoice(tip="tip")).spec
    assert [joint.name for joint in back.joints] == ["lift", "swing"]
    assert back.joints[1].friction.viscous == pytest.approx(0.3)
    states = np.random.default_rng(5).uniform(-2, 2, (3, 8, 2))
    poses = [oracle(each).forward_kinematics(states[0]) for each in (spec, back)]
    assert np.abs(poses[0] - poses[1]).max() < 1e-9
    torques = [oracle(each).inverse_dynamics(*states) for each in (spec, back)]
    assert np.abs(torques[0] - torques[1]).max() < 1e-9 * np.abs(torques[0]).max()


def test_a_reversed_leader_with_motor_and_friction_in_pinocchio():
    """Pinocchio moves mimic joints with their leader: its coordinates are q."""
    pin = pytest.importorskip("pinocchio")
    spec = loads_spec(REVERSED)
    exported = export_robot(spec, "urdf")
    assert any("drive inertia is left out" in note for note in exported.notes)
    model = pin.buildModelFromXML(exported.files["gripper_arm.urdf"], mimic=True)
    assert (model.nv, model.nq, model.upperPositionLimit[1]) == (2, 2, pytest.approx(np.radians(115)))
    data, ours, inertia = model.createData(), oracle(spec), chain_of(spec).drive_inertia
    for q, dq, ddq in np.random.default_rng(7).uniform(-1, 1, (4, 3, 2)):
        torque = ours.inverse_dynamics(q[None], dq[None], ddq[None])[0] - inertia @ ddq
        np.testing.assert_allclose(pin.rnea(model, data, q, dq, ddq), torque, rtol=1e-12, atol=1e-12)
        pin.framesForwardKinematics(model, data, q)
        tip = data.oMf[model.getFrameId("tip")].homogeneous
        np.testing.assert_allclose(tip, ours.forward_kinematics(q[None])[0], atol=1e-14)


def test_a_reversed_leader_with_motor_and_friction_in_mujoco(tmp_path):
    mujoco = pytest.importorskip("mujoco")
    spec = loads_spec(REVERSED)
    text = export_robot(spec, "mjcf").files["gripper_arm.xml"]
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data, ours = mujoco.MjData(model), oracle(spec)
    S = np.array([[1, 0], [0, 1], [0, -1.5]])
    assert [model.joint(k).name for k in range(3)] == [row.name for row in spec.rows]
    assert model.dof_frictionloss[1] == 0.2
    for q, dq, ddq in np.random.default_rng(8).uniform(-1, 1, (4, 3, 2)):
        data.qpos[:], data.qvel[:], data.qacc[:] = S @ q, S @ dq, S @ ddq
        mujoco.mj_inverse(model, data)
        torque = ours.inverse_dynamics(q[None], dq[None], ddq[None])[0] + [0, 0.3 * dq[1]]
        np.testing.assert_allclose(S.T @ data.qfrc_inverse, torque, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(data.site("tip").xpos, ours.forward_kinematics(q[None])[0, :3, 3], atol=1e-14)
    (tmp_path / "arm.xml").write_text(text, encoding="utf-8")
    back = import_robot(tmp_path / "arm.xml", chain=ChainChoice(tip="tip")).spec
    states = np.random.default_rng(9).uniform(-1, 1, (3, 4, 2))
    torques = [oracle(each).inverse_dynamics(*states) for each in (spec, back)]
    np.testing.assert_allclose(torques[1], torques[0], rtol=1e-9, atol=1e-9)
    assert back.joints[1].friction == spec.joints[1].friction
    assert (back.joints[1].limits.lower, back.joints[1].limits.upper) == pytest.approx(np.radians([-60, 115]))


def test_the_palletiser_is_a_constrained_tree_in_mujoco():
    mujoco = pytest.importorskip("mujoco")
    spec = load_spec(PALLETISER)
    exported = export_robot(spec, "mjcf")
    assert any("softly" in note for note in exported.notes)
    model = mujoco.MjModel.from_xml_string(exported.files["palletiser.xml"])
    data, ours = mujoco.MjData(model), oracle(spec)
    S = np.zeros((model.nv, spec.n))
    order = [int(model.joint(row.name).dofadr[0]) for row in spec.rows]
    S[order] = [[float(v) for v in row] for row in spec.mechanism.matrix]
    for q in np.random.default_rng(6).uniform(-1, 1, (5, spec.n)):
        data.qpos[:] = S @ q
        mujoco.mj_forward(model, data)
        J = np.reshape(data.efc_J, (-1, model.nv))[data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY]
        assert np.abs(J @ S).max() < 1e-12
        assert np.linalg.matrix_rank(J) == model.nv - spec.n
        M = np.array([_product(mujoco, model, data, unit) for unit in np.eye(model.nv)])
        assert np.abs(S.T @ M @ S - ours.mass_matrix(q[None])[0]).max() < 1e-10 * np.abs(M).max()
        assert np.abs(data.site("tip").xpos - ours.forward_kinematics(q[None])[0, :3, 3]).max() < 1e-12


def _product(mujoco, model, data, unit):
    row = np.zeros(model.nv)
    mujoco.mj_mulM(model, data, row, unit)
    return row


def test_what_a_format_cannot_say_is_refused():
    spec = load_spec(PALLETISER)
    with pytest.raises(DerivationError, match="in a URDF it may follow one joint"):
        export_robot(spec, "urdf")
    with pytest.raises(DerivationError, match="not exported to par, but to"):
        export_robot(spec, "par")
    own = loads_spec(MIMIC.replace("follows: {swing: -3/2}", "follows: {twin: 1, swing: -3/2}"))
    with pytest.raises(DerivationError, match="has a drive and a coupling"):
        export_robot(own, "mjcf")


@pytest.mark.parametrize("target", ["embedded", "mjcf", "par", "ros2", "urdf"])
def test_targets_that_take_no_closed_loops_name_those_that_do(target):
    spec = load_spec(PALLETISER.with_name("unequal.yaml"))
    with pytest.raises(
        DerivationError, match=f"closed loops are not exported to {target}, but to cuda, fmu, jax, matlab, wheel"
    ):
        export_robot(spec, target)


def test_a_simulation_does_not_hold_loops_that_are_solved_by_newtons_method():
    spec = load_spec(PALLETISER.parents[1] / "linkages" / "six_bar.yaml")
    with pytest.raises(
        DerivationError, match="a plant for simulation does not exist with loops solved by Newton's method"
    ):
        export_robot(spec, "fmu")
