"""What an experiment file sets up: the virtual robot, its flexible parts and rotors, its loops and its path."""

from __future__ import annotations

import numpy as np
import pytest

import rrrgen
from lab.experiment.whole_file import FULL
from rrrgen.base.errors import DerivationError, InputError
from rrrgen.lab.design.fourier_series import FourierTrajectory
from rrrgen.lab.experiment.experiment_file import loads_experiment
from rrrgen.lab.experiment.loop_design import design_loop
from rrrgen.lab.experiment.setup import arm_of, plant_of, simulate_motion, writing_path
from rrrgen.lab.plant.plant import FlexibleJoints
from rrrgen.robot.file import dumps, loads_spec


@pytest.mark.parametrize(
    "control",
    [
        "control: {bandwidth: 4 Hz}",
        "control: {kind: computed_torque, bandwidth: 4 Hz, observer: difference}",
        "control: {kp: [800, 300, 30], kd: [60, 25, 2], jerk: 100}",
    ],
)
def test_the_virtual_robot_runs_as_described(model, control: str) -> None:
    rng = np.random.default_rng(0)
    motion = FourierTrajectory(rng.normal(size=3), rng.normal(size=(3, 3)), rng.normal(size=(3, 3)), 0.5)
    text = "schema: rrrgen-experiment/1\nvirtual_robot: {encoder_resolution: 1e-5, torque_noise: 0.01}\n" + control
    recording, instruments = simulate_motion(loads_experiment(text, 3), model, motion.evaluate, 0.1)
    assert recording.q.shape == (100, 3)
    assert np.abs(recording.true_q - recording.reference).max() < 0.05
    assert instruments.torque_limit == (60.0, 30.0, 15.0)  # from the robot file
    again, _ = simulate_motion(loads_experiment(text, 3), model, motion.evaluate, 0.1)
    assert np.array_equal(recording.tau, again.tau)


def test_flexible_parts_reach_the_plant(model) -> None:
    text = """
schema: rrrgen-experiment/1
virtual_robot:
  flexible_joints: {rotor_inertia: [0.2, 0.1, 0.02], stiffness: 20000, damping: 20}
  flexible_base: {inertia: 5, frequency: 28 Hz, damping_ratio: 0.1}
control: {bandwidth: 4 Hz, jerk: 50}
"""
    still = FourierTrajectory(np.array([0.1, 0.2, 0.3]), np.zeros((3, 1)), np.zeros((3, 1)), 1.0)
    recording, _ = simulate_motion(loads_experiment(text, 3), model, still.evaluate, 0.02)
    assert np.all(np.isfinite(recording.true_q))
    with pytest.raises(InputError, match="flexible_joints needs the keys 'stiffness', 'damping'"):
        loads_experiment("schema: rrrgen-experiment/1\nvirtual_robot: {flexible_joints: {rotor_inertia: 1}}\n", 3)


ELASTIC = """
schema: rrrgen/1
name: elastic
convention: standard
units: {angle: rad, length: m}
gravity: [0, -9.81, 0]
joints:
  - {name: a, type: revolute, alpha: 0, a: 0.5, d: 0, theta: 0, drive: {inertia: 0.2, stiffness: 9 N*m/rad, damping: 2}}
  - {name: b, type: revolute, alpha: 0, a: 0.4, d: 0, theta: 0, drive: {inertia: 0.1, stiffness: 4000}}
links:
  - {mass: 2, com: [-0.2, 0, 0], inertia: {about: com, products: tensor, xx: 0.01, yy: 0.02, zz: 0.02}}
  - {mass: 1, com: [-0.2, 0, 0], inertia: {about: com, products: tensor, xx: 0.01, yy: 0.02, zz: 0.02}}
"""


def test_flexible_joints_of_the_robot_file() -> None:
    """Stated once, in the robot file: for the virtual robot and for the functions of the model."""
    experiment = loads_experiment("schema: rrrgen-experiment/1\nvirtual_robot: {flexible_joints: from_robot}\n", 2)
    elastic = rrrgen.compile(loads_spec(ELASTIC), backend="numpy")
    plant = plant_of(experiment, elastic)
    assert plant.joints == FlexibleJoints((0.2, 0.1), (9.0, 4000.0), (2.0, 0.0))
    rotors = elastic.elastic_inverse_dynamics(*np.zeros((5, 2)))
    held = elastic.gravity(np.zeros(2))
    np.testing.assert_allclose(rotors.tau, held)
    np.testing.assert_allclose(rotors.theta, held / [9.0, 4000.0])
    again = loads_spec(dumps(elastic.spec))
    assert [joint.drive for joint in again.joints] == [joint.drive for joint in elastic.spec.joints]
    without = loads_spec(ELASTIC.replace(", stiffness: 4000", ""))
    with pytest.raises(InputError, match=r"from_robot needs 'stiffness' under 'drive' .* missing for b"):
        plant_of(experiment, rrrgen.compile(without, backend="numpy"))
    with pytest.raises(ValueError, match="states no 'stiffness' under 'drive' of b: give stiffness="):
        rrrgen.compile(without, backend="numpy").elastic_inverse_dynamics(*np.zeros((5, 2)))
    with pytest.raises(InputError, match="stiffness of joint 2 is 0"):
        loads_spec(ELASTIC.replace("stiffness: 4000", "stiffness: 0"))
    with pytest.raises(InputError, match="from_robot"):
        loads_experiment("schema: rrrgen-experiment/1\nvirtual_robot: {flexible_joints: robot}\n", 2)


def test_writing_path_follows_the_file(model) -> None:
    path = writing_path(loads_experiment(FULL, 3), model)
    t = np.linspace(0.0, 8.0, 200)
    q, _, _ = path.evaluate(t)
    tips = model.forward_kinematics(q)[:, :3, 3]
    assert np.abs(tips - path.task.evaluate(t)[0]).max() < 1e-12
    assert path.task.duration == pytest.approx(8.0)
    assert np.all(q[:, 2] > 0.0)  # elbow down, as the start asks


def test_gains_too_fast_for_the_sampling_are_warned_of_in_place(model) -> None:
    still = FourierTrajectory(np.array([0.1, 0.2, 0.3]), np.zeros((3, 1)), np.zeros((3, 1)), 1.0)
    text = "schema: rrrgen-experiment/1\nperiod: 5 ms\ncontrol: {damping: 1, bandwidth: 40 Hz}\n"
    experiment = loads_experiment(text, 3, "fast.yaml")
    design = design_loop(arm_of(experiment, model, still.evaluate, 0.1), experiment.control)
    assert design.margin.unstable
    (warning,) = design.warnings
    assert str(warning).startswith("fast.yaml:3:11: warning: `damping`, `bandwidth` make a loop that is not robust")


def test_rotors_take_the_place_of_the_drive_inertia(tmp_path) -> None:
    """Behind stiff springs, rotors as heavy as the stated drive inertia move as the rigid arm does."""
    path = tmp_path / "driven.yaml"
    path.write_text(
        "schema: rrrgen/1\nname: driven\nconvention: standard\nunits: {angle: rad, length: m}\n"
        "gravity: [0, -9.81, 0]\njoints:\n"
        "  - {type: revolute, alpha: 0, a: 0.5, d: 0, theta: 0, drive: {inertia: 0.3}}\n"
        "links:\n  - {mass: 1, com: [-0.2, 0, 0], inertia: {about: com, xx: 0.01, yy: 0.02, zz: 0.02}}\n"
    )
    driven = rrrgen.compile(path)
    motion = FourierTrajectory(np.array([0.1]), np.array([[0.2]]), np.array([[0.3]]), 1.0)
    control = "control: {bandwidth: 4 Hz, jerk: 100}\n"
    rotors = "virtual_robot: {flexible_joints: {rotor_inertia: 0.3, stiffness: 1e6, damping: 100}}\n"
    runs = [
        simulate_motion(loads_experiment("schema: rrrgen-experiment/1\n" + text, 1), driven, motion.evaluate, 0.3)[0]
        for text in (control, rotors + control)
    ]
    assert np.abs(runs[0].true_q - runs[1].true_q).max() < 1e-4


def test_a_writing_plane_out_of_reach_is_named_by_the_point_of_the_tip(model) -> None:
    experiment = loads_experiment("schema: rrrgen-experiment/1\nwriting: {plane: {y: -3}}\n", 3)
    path = writing_path(experiment, model)
    with pytest.raises(DerivationError, match=r"the tip cannot reach \[.*, -3.0, .*\] m"):
        path.evaluate(np.zeros(1))
