"""Experiment files: what they say is done, and what is wrong in them is found in its place."""

from __future__ import annotations

import numpy as np
import pytest

import rrrgen
from rrrgen.base.errors import InputError
from rrrgen.lab.design.fourier_series import FourierTrajectory
from rrrgen.lab.experiment.experiment_file import loads_experiment
from rrrgen.lab.experiment.loop_design import design_loop
from rrrgen.lab.experiment.setup import arm_of, plant_of, problem_of, simulate_motion, writing_path
from rrrgen.lab.plant.plant import FlexibleJoints
from rrrgen.robot.file import dumps, loads_spec

FULL = """
schema: rrrgen-experiment/1
period: 2 ms
seed: 7
excitation:
  harmonics: 6
  base_frequency: 0.2 Hz
  objective: logdet
  at_rest: true
  starts: 3
  limits:
    lower: -170 deg
    upper: [170 deg, 2, 3.0]
    speed: [2*pi, 3*pi, 3*pi]
    acceleration: 60
    torque: [60, 30, 15 N*m]
    box: {z: [0.2, 900 mm]}
writing:
  text: RR
  duration: 8 s
  peak_speed: 700 mm/s
  pace: [1, 0.6]
  plane: {x: [-0.2, 0.2], y: -0.42, z: [0.4, 0.8]}
  start: [-1, -1.5, 2]
virtual_robot:
  friction:
    law: stribeck
    joints:
      - {coulomb: 3, stiction_excess: 0.5, viscous: 1, stribeck_speed: 0.1}
      - {coulomb: 1.5, viscous: 0.3, stribeck_speed: 0.1}
      - {coulomb: 0.8, viscous: 0.2, stribeck_speed: 0.1}
  encoder_resolution: 1e-5
  torque_noise: [0.1, 0.05, 20 mN*m]
  torque_record: command
control: {kind: pd, bandwidth: 5 Hz, damping: 0.9, observer: kalman}
"""


@pytest.fixture(scope="module")
def model():
    return rrrgen.compile("rrr")


def test_everything_in_a_file_arrives_in_si(model) -> None:
    found = loads_experiment(FULL, 3)
    assert (found.period, found.seed, found.starts) == (0.002, 7, 3)
    assert found.limits is not None
    assert found.limits.position_lower == pytest.approx((-np.radians(170),) * 3)
    assert found.limits.position_upper == pytest.approx((np.radians(170), 2.0, 3.0))
    assert found.limits.box_lower == (None, None, 0.2)
    assert found.limits.box_upper == (None, None, pytest.approx(0.9))
    assert found.writing["peak_speed"] == pytest.approx(0.7)
    assert found.writing["plane"].y == -0.42
    assert found.branch == (-1.0, -1.5, 2.0)
    assert found.virtual_robot["torque_noise"] == pytest.approx((0.1, 0.05, 0.02))
    assert found.virtual_robot["friction"].parameters[0].tolist() == [0.5, 3.0, 1.0, 0.1]
    assert found.control.bandwidth == (5.0, 5.0, 5.0)
    problem = problem_of(found, model)
    assert (problem.harmonics, problem.objective, problem.at_rest, problem.sample_period) == (6, "logdet", True, 0.002)
    assert problem.torque is not None
    assert problem.tip is not None


def test_an_almost_empty_file_means_the_defaults(model) -> None:
    found = loads_experiment("schema: rrrgen-experiment/1\n", 3)
    problem = problem_of(found, model)
    assert problem.limits.speed == pytest.approx((2 * np.pi, 3 * np.pi, 3 * np.pi))
    assert problem.limits.torque == (60.0, 30.0, 15.0)  # of the drives
    assert problem.sample_period == 1e-3


def test_faults_are_found_together_and_in_place() -> None:
    text = """schema: rrrgen-experiment/1
excitation:
  harmonic: 6
  limits: {speed: [1, 2], torque: 3 m}
writing: {duration: -1, plane: {x: [1, 0]}}
virtual_robot:
  friction: {law: stribek, joints: [{}, {}, {}]}
  torque_record: late
control: {kp: 3}
"""
    with pytest.raises(InputError) as caught:
        loads_experiment(text, 3, "mine.yaml")
    shown = str(caught.value)
    for part in (
        "mine.yaml:3:3: error: unknown key 'harmonic'",
        "did you mean 'harmonics'",
        "speed has 2 entries for 3 joints",
        "mine.yaml:4",
        "duration must be positive",
        "x[0] < x[1]",
        "friction law 'stribek'",
        "torque_record is 'late'",
        "both kp and kd",
    ):
        assert part in shown, part
    with pytest.raises(InputError, match="needs the key 'schema'"):
        loads_experiment("seed: 1\n", 3)


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


def test_half_a_pair_leaves_one_side_of_the_box_open_and_is_a_fault_of_the_plane():
    box = "schema: rrrgen-experiment/1\nexcitation: {limits: {box: {z: [0.4, ~]}}}\n"
    limits = loads_experiment(box, 3).limits
    assert (limits.box_lower, limits.box_upper) == ((None, None, 0.4), (None, None, None))
    with pytest.raises(InputError, match=r"plane.yaml:2:\d+: error: z is .*, not a value"):
        loads_experiment("schema: rrrgen-experiment/1\nwriting: {plane: {z: [0.4, ~]}}\n", 3, "plane.yaml")
