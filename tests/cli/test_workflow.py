"""The commands of the identification workflow and of inverse kinematics, from end to end on a small robot."""

import csv
import json

import click
import numpy as np
import pytest
from click.testing import CliRunner

import rrrgen
from rrrgen.cli.main import cli
from rrrgen.lab.design.fourier_series import FourierTrajectory


def run(*arguments):
    return CliRunner().invoke(cli, [str(a) for a in arguments], standalone_mode=False, catch_exceptions=False)


@pytest.fixture(scope="module")
def experiment(tmp_path_factory):
    """A motion of planar2r, recorded on the virtual robot."""
    folder = tmp_path_factory.mktemp("workflow")
    rng = np.random.default_rng(2)
    motion = FourierTrajectory.from_coefficients(rng.uniform(-0.8, 0.8, (11, 2)), 0.2)
    trajectory = folder / "trajectory.json"
    trajectory.write_text(json.dumps(motion.to_json()))
    noise = ["--torque-noise", 0.01, "--rate", 500]
    result = run("experiment", "simulate", "planar2r", "--trajectory", trajectory, *noise, "-o", folder / "experiment")
    assert result.return_value == 0, result.output
    return folder


def test_simulate_writes_a_recording_that_identify_takes(experiment):
    log = experiment / "experiment" / "results" / "log.yaml"
    out = experiment / "identified"
    # a saturated motion: its bandwidth would leave the noise of the torque in
    result = run("identify", "planar2r", "--log", log, "--split", "blocks:0.5", "--decimate", 10, "-o", out, "--json")
    assert result.return_value == 0, result.output
    record = json.loads((out / "results" / "identification.json").read_text())
    assert record["held_out"]["relative_error"] < 0.02
    assert (out / "results" / "robot.yaml").is_file()
    assert (out / "figures" / "torques.svg").is_file()


def test_validate_passes_the_true_robot_and_fails_a_wrong_one(experiment, tmp_path):
    log = experiment / "experiment" / "results" / "log.yaml"
    good = run("experiment", "validate", "planar2r", "--log", log, "-o", tmp_path / "good")
    assert good.return_value == 0, good.output
    assert "scored on data of unknown origin; passed" in good.output  # nothing says what the bundled robot comes from
    record = json.loads((tmp_path / "good" / "results" / "validation.json").read_text())
    # the figure that the limit holds for is printed with the rows that it is of
    assert f"relative error {100 * record['relative_error']:.3g} %, of {record['measured_on']}" in good.output
    assert f"{100 * record['share']:.0f} % of the rows" in record["measured_on"]
    strict = run(
        "experiment", "validate", "planar2r", "--log", log, "--relative-error", 1e-6, "-o", tmp_path / "strict"
    )
    assert strict.return_value == 1
    assert "FAILED" in strict.output


WRITING = """
schema: rrrgen-experiment/1
period: 4 ms
writing: {text: R, duration: 5.5 s, start: [-1, -1.5, 2]}
virtual_robot:
  friction: {law: lugre, joints: [&j {coulomb: 1, stiction_excess: 0.3, viscous: 0.5, stribeck_speed: 0.1,
    sigma0: 300, sigma1: 3}, *j, *j]}
  flexible_base: {frequency: 28 Hz}
  torque_noise: 0.02
"""


def test_simulate_writes_letters_with_the_virtual_robot_of_an_experiment_file(tmp_path):
    file = tmp_path / "experiment.yaml"
    file.write_text(WRITING)
    result = run(
        "experiment",
        "simulate",
        "rrr",
        "--writing",
        "--experiment",
        file,
        "--seed",
        3,
        "-o",
        tmp_path / "run",
        "--json",
    )
    assert result.return_value == 0, result.output
    assert json.loads(result.output)["samples"] == 1375
    record = json.loads((tmp_path / "run" / "run.json").read_text())
    assert record["seed"] == 3
    assert set(record["inputs"]) == {"experiment"}
    rows = np.genfromtxt(tmp_path / "run" / "results" / "log.csv", delimiter=",", names=True)
    tips = rrrgen.compile("rrr").forward_kinematics(np.column_stack([rows[f"q_q{i}"] for i in (1, 2, 3)]))[:, :3, 3]
    assert np.abs(tips[:, 1] + 0.4).max() < 0.05  # in the window's plane
    assert np.ptp(tips[:, 2]) > 0.2


def test_simulate_must_know_what_to_follow():
    with pytest.raises(click.UsageError, match="--trajectory FILE, --reference LOG, --writing"):
        run("experiment", "simulate", "rrr", "-o", "nowhere")


def test_reconstruct_writes_the_motion(experiment, tmp_path):
    log = experiment / "experiment" / "results" / "log.yaml"
    result = run("experiment", "reconstruct", log, "--method", "butterworth", "--cutoff", 20, "-o", tmp_path / "motion")
    assert result.return_value == 0, result.output
    with (tmp_path / "motion" / "results" / "motion.csv").open() as file:
        rows = list(csv.reader(file))
    assert rows[0][0] == "t"
    assert len(rows[0]) == 7
    assert len(rows) == 2501


def test_a_run_folder_of_other_settings_is_refused(experiment):
    log = experiment / "experiment" / "results" / "log.yaml"
    with pytest.raises(Exception, match="another folder"):
        run("identify", "planar2r", "--log", log, "--split", "first:0.6", "-o", experiment / "experiment")
