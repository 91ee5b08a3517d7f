"""A virtual robot with a coupled wrist by the command line: what is identified is what was simulated."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
from click.testing import CliRunner

import rrrgen
from rrrgen.base.errors import InputError
from rrrgen.cli.main import cli
from rrrgen.lab.design.fourier_series import FourierTrajectory
from rrrgen.lab.experiment.experiment_file import loads_experiment
from rrrgen.lab.experiment.setup import simulate_motion
from rrrgen.robot.file import load_spec
from rrrgen.verify import verify

WRIST = """schema: rrrgen/1
name: wrist
convention: standard
units: {angle: deg, length: m}
gravity: [0, 0, -9.81]
joints:
  - {name: pitch, type: revolute, alpha: 90, a: 0, d: 0}
  - {name: roll, type: revolute, alpha: 0, a: 0.1, d: 0.05, friction: {coulomb: 0.05}}
links:
  - {mass: 2, com: [0.02, 0.05, 0], inertia: {about: com, xx: 0.01, yy: 0.01, zz: 0.02}}
  - {mass: 1, com: [-0.02, 0.03, 0.06], inertia: {about: com, xx: 0.01, yy: 0.008, zz: 0.012}}
drives:
  joint_from_drive:
    - [1, 0]
    - [-1, 1]
  motors:
    - {name: left, gear_ratio: 45, inertia: 2e-5, friction: {viscous: 1e-4, coulomb: 0.008}}
    - {name: right, gear_ratio: 32, inertia: 3e-5, friction: {viscous: 2e-4, coulomb: 0.01}, torque_limit: 1}
"""
NOISE = 0.002  # N m
WITHIN = 4.0  # standard deviations; the seed is fixed, so that the outcome is
PARAMETERS = ("fc2", "fv_left", "fc_left", "Ia_right", "fv_right", "fc_right")


def run(*arguments):
    return CliRunner().invoke(cli, [str(a) for a in arguments], standalone_mode=False, catch_exceptions=False)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("wrist")
    (place / "wrist.yaml").write_text(WRIST)
    rng = np.random.default_rng(4)
    motion = FourierTrajectory.from_coefficients(rng.uniform(-0.6, 0.6, (9, 2)), 0.5)
    (place / "motion.json").write_text(json.dumps(motion.to_json()))
    return place


@pytest.fixture(scope="module")
def recorded(folder):
    done = run("experiment", "simulate", folder / "wrist.yaml", "--trajectory", folder / "motion.json",
               "--torque-noise", NOISE,
               "--rate", 500, "--bandwidth", 4, "--seed", 2, "-o", folder / "recording")  # fmt: skip
    assert done.return_value == 0, done.output
    return folder / "recording" / "results" / "log.yaml"


@pytest.fixture(scope="module")
def identified(folder, recorded):
    given = load_spec(folder / "wrist.yaml")
    done = run("identify", folder / "wrist.yaml", "--log", recorded, "-o", folder / "identified")
    assert done.return_value == 0, done.output
    assert given.drives is not None
    return load_spec(folder / "identified" / "results" / "robot.yaml")


def torques(spec, states, backend="c"):
    model = rrrgen.compile(spec, backend=backend)
    q, dq, ddq = states
    return model.inverse_dynamics(q, dq, ddq) + model.friction(dq)


def states(count=200):
    rng = np.random.default_rng(0)
    return [rng.uniform(-limit, limit, (count, 2)) for limit in (2.0, 3.0, 10.0)]


@pytest.mark.sweep
def test_the_written_file_is_the_robot_that_was_simulated(folder, identified):
    truth = torques(load_spec(folder / "wrist.yaml"), states())
    found = torques(identified, states())
    assert np.linalg.norm(found - truth) < 0.02 * np.linalg.norm(truth)
    assert np.linalg.norm(found) > 1.0
    left, right = identified.drives.motors
    assert (left.gear_ratio, right.gear_ratio, right.torque_limit) == (45, 32, 1.0)
    held = (left.friction.coulomb, right.friction.coulomb, left.friction.viscous, right.friction.viscous, right.inertia)
    np.testing.assert_allclose(held, (0.008, 0.01, 1e-4, 2e-4, 3e-5), rtol=0.05)


@pytest.mark.sweep
def test_emitted_code_numpy_and_the_reference_agree_on_it(identified):
    assert np.abs(torques(identified, states()) - torques(identified, states(), "numpy")).max() < 1e-12
    report = verify(rrrgen.compile(identified), samples=20)
    assert report.ok, report.to_text()


def test_the_estimates_lie_within_their_deviations(folder, identified):
    with (folder / "identified" / "results" / "parameters.csv").open() as stream:
        rows = {row["parameter"]: (float(row["value"]), float(row["std"])) for row in csv.DictReader(stream)}
    model = rrrgen.compile(folder / "wrist.yaml", backend="numpy")
    truth = dict(zip(model.identification_parameter_names, model.identification_parameters, strict=True))
    for name in PARAMETERS:
        value, std = rows[name]
        assert abs(value - truth[name]) < WITHIN * std, name


def test_a_validation_of_the_written_file_passes(folder, recorded, identified):
    written = folder / "identified" / "results" / "robot.yaml"
    done = run(
        "experiment", "validate", written, "--log", recorded, "--relative-error", 0.05, "-o", folder / "validated"
    )
    assert done.return_value == 0, done.output


def test_a_motor_saturates_at_its_own_limit(folder):
    text = WRIST.replace("torque_limit: 1}", "torque_limit: 0.06}")
    model = rrrgen.compile(rrrgen.robot.file.loads_spec(text), backend="numpy")
    motion = FourierTrajectory.from_json(json.loads((folder / "motion.json").read_text()))
    experiment = loads_experiment("schema: rrrgen-experiment/1\nperiod: 5 ms\n", 2)
    recording, _ = simulate_motion(experiment, model, motion.evaluate, 0.5)
    W = np.array(model.spec.drives.motor_from_joint, dtype=float)
    at_motors = np.linalg.solve(W.T, recording.true_tau.T).T
    assert 0.059 < np.abs(at_motors[:, 1]).max() <= 0.06 + 1e-12
    assert recording.saturated.any(axis=0).all()  # the right motor moves with both joints


def test_flexible_joints_are_refused_for_coupled_drives(folder):
    model = rrrgen.compile(folder / "wrist.yaml", backend="numpy")
    motion = FourierTrajectory.from_json(json.loads((folder / "motion.json").read_text()))
    flexible = "{rotor_inertia: 0.1, stiffness: 1e4, damping: 5}"
    text = f"schema: rrrgen-experiment/1\nvirtual_robot: {{flexible_joints: {flexible}}}\n"
    with pytest.raises(InputError, match="the drives of this robot are coupled"):
        simulate_motion(loads_experiment(text, 2), model, motion.evaluate, 0.1)


@pytest.mark.parametrize("law", ["coulomb_viscous", "lugre"])
def test_friction_on_the_controller_is_that_of_joints_and_motors(folder, law):
    done = run("generate", folder / "wrist.yaml", "--no-casadi-files", "--friction", law, "-o", folder / "firmware")
    assert done.return_value == 0, done.output
    header = (folder / "firmware" / "wrist_friction.h").read_text()
    assert "rows joint roll, left, right" in " ".join(header.replace("*", " ").split())
