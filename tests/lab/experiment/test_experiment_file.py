"""Experiment files: what they say is done, and what is wrong in them is found in its place."""

from __future__ import annotations

import numpy as np
import pytest

import rrrgen
from lab.experiment.whole_file import FULL
from rrrgen.base.errors import InputError
from rrrgen.lab.experiment.experiment_file import loads_experiment
from rrrgen.lab.experiment.setup import problem_of


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


def test_limits_that_a_file_does_not_state_are_those_of_the_robot_file_but_for_torques() -> None:
    """A file with a speed alone took the end stops away: a prismatic joint was sent to -674 km, all limits met."""
    scara = rrrgen.compile("scara")
    of_robot = problem_of(loads_experiment("schema: rrrgen-experiment/1\n", 4), scara).limits
    assert of_robot.position_lower is not None
    own = loads_experiment("schema: rrrgen-experiment/1\nexcitation: {limits: {speed: 2, upper: .1}}\n", 4)
    limits = problem_of(own, scara).limits
    assert (limits.speed, limits.position_upper) == ((2.0,) * 4, (0.1,) * 4)
    assert limits.position_lower == of_robot.position_lower
    assert limits.acceleration == of_robot.acceleration
    assert limits.torque is None


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


def test_half_a_pair_leaves_one_side_of_the_box_open_and_is_a_fault_of_the_plane():
    box = "schema: rrrgen-experiment/1\nexcitation: {limits: {box: {z: [0.4, ~]}}}\n"
    limits = loads_experiment(box, 3).limits
    assert (limits.box_lower, limits.box_upper) == ((None, None, 0.4), (None, None, None))
    with pytest.raises(InputError, match=r"plane.yaml:2:\d+: error: z is .*, not a value"):
        loads_experiment("schema: rrrgen-experiment/1\nwriting: {plane: {z: [0.4, ~]}}\n", 3, "plane.yaml")


@pytest.mark.parametrize(
    ("value", "fault"), [("4 -", "bandwidth: '4 -' is not"), ("[1, x, 0]", "bandwidth must be positive")]
)
def test_a_bandwidth_that_is_no_number_is_a_fault_in_place(value: str, fault: str) -> None:
    with pytest.raises(InputError, match=rf"mine.yaml:2:\d+: error: {fault}"):
        loads_experiment(f"schema: rrrgen-experiment/1\ncontrol: {{kind: pd, bandwidth: {value}}}\n", 3, "mine.yaml")


@pytest.mark.parametrize(
    "key", ["starts: 0", "max_iterations: 0", "harmonics: 0", "row_weights: [1, 1, -1]", "limits: {speed: [0, 1, 1]}"]
)
def test_excitations_that_cannot_be_searched_are_faults_in_place(key: str) -> None:
    """No start ended in an index outside of an empty list."""
    name = key.rsplit("{", maxsplit=1)[-1].split(":", maxsplit=1)[0]
    with pytest.raises(InputError, match=rf"mine.yaml:2:\d+: error: {name} must be positive"):
        loads_experiment(f"schema: rrrgen-experiment/1\nexcitation: {{{key}}}\n", 3, "mine.yaml")


@pytest.mark.parametrize(
    ("section", "key", "fault"),
    [
        ("virtual_robot", "torque_noise: -1", "not be negative"),
        ("virtual_robot", "encoder_resolution: [0, 1e-5, -1e-5]", "not be negative"),
        ("virtual_robot", "torque_resolution: -1 mN*m", "not be negative"),
        ("virtual_robot", "disturbance: -1", "not be negative"),
        ("virtual_robot", "torque_limit: -5", "be positive"),
        ("control", "jerk: [10, 0, 10]", "be positive"),
        ("control", "damping: 0", "be positive"),
    ],
)
def test_signs_of_a_virtual_robot_and_its_control_are_checked_in_place(section: str, key: str, fault: str) -> None:
    """A negative torque limit held every torque at its value."""
    with pytest.raises(InputError, match=rf"mine.yaml:2:\d+: error: {key.split(':')[0]} must {fault}"):
        loads_experiment(f"schema: rrrgen-experiment/1\n{section}: {{{key}}}\n", 3, "mine.yaml")


def test_gains_beside_a_bandwidth_are_a_fault_in_place() -> None:
    """The bandwidth was ignored."""
    text = "schema: rrrgen-experiment/1\ncontrol: {kp: 90, kd: 20, bandwidth: 5 Hz}\n"
    with pytest.raises(InputError, match=r"mine.yaml:2:27: error: bandwidth has no effect beside kp and kd"):
        loads_experiment(text, 3, "mine.yaml")
