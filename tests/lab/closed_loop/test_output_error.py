"""Closed-loop output error on recordings of a drive with known truth, simulated independently of the package."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib.resources import files

import pytest
from click.testing import CliRunner

import rrrgen
from rrrgen.base.errors import DerivationError, InputError
from rrrgen.cli.main import cli
from rrrgen.lab.closed_loop.controller import load_controller, loads_controller
from rrrgen.lab.closed_loop.refinement import closed_loop_estimate
from rrrgen.lab.closed_loop.validation import validate_loop
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.data.recordings import open_log
from rrrgen.lab.data.uniform_stream import LogStream
from rrrgen.lab.identify.friction_choice import LawChoice
from rrrgen.lab.identify.identification import Options, identify
from rrrgen.robot.file import load_spec
from samples.linear_drive import CONTROLLER, DAHL, MASS, TRUTH, record, write_drive

LAWS = (
    "{law: dahl_load_dependent, coulomb: 1.5, excess: 0.4, decay_speed: 0.1, viscous: 2, load_ratio: 0.1, "
    "presliding: 1e-3}",
    "{law: dahl_load_dependent, coulomb: 1, viscous: 1, load_ratio: 0.12, presliding: 2e-3, decay_speed: 1}",
    "{law: lugre, sigma0: 400, sigma1: 1, stiction_excess: 0.2, coulomb: 0.6, viscous: 0.3, stribeck_speed: 0.3}",
)
EXPERIMENT = """
schema: rrrgen-experiment/1
virtual_robot: {torque_noise: 0.02, delay: 1}
"""


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    """Robot, controller, a recording to fit and one with pulses of force that is not fitted."""
    folder = tmp_path_factory.mktemp("drive")
    robot, controller = write_drive(folder)
    return folder, robot, controller, record(folder, "fit", 1), record(folder, "test", 2, 4.0, pulses=True)


def run(*words):
    return CliRunner().invoke(cli, [str(word) for word in words])


@pytest.fixture(scope="module")
def fitted(drive):
    folder, robot, controller, log, test = drive
    law = ("--friction", "asymmetric_exponential")
    done = run("identify", robot, "--log", log, "--controller", controller, "--test", test, *law, "-o", folder / "out")
    assert done.exit_code == 0, done.output
    return folder / "out", done.output


def test_the_truth_is_found_and_written(fitted):
    folder, _ = fitted
    found = json.loads((folder / "results/closed_loop.json").read_text())["parameters"]
    for name, value in TRUTH.items():
        tolerance = 0.005 if name == "m1R" else 0.03
        assert found[name] == pytest.approx(value, rel=tolerance), name
    law = load_spec(folder / "results/robot.yaml").joints[0].friction.law
    assert law.name == "asymmetric_exponential"
    assert law.values[-1] == pytest.approx(found["decay_speed1"], rel=1e-9)


def test_scores_on_screen_and_in_the_record(fitted):
    folder, output = fitted
    record = json.loads((folder / "results/closed_loop.json").read_text())
    assert record["controller_error"][0] < 1e-6  # the controller is exactly that of the recording
    assert record["fit"]["relative_error"] < 0.01
    assert record["test"]["relative_error"] < 0.01  # with forces that the fitted recording did not have
    assert record["fit"]["relative_error"] < 0.5 * record["inverse_dynamics"]["relative_error"]
    assert "recordings not fitted: relative torque error" in output
    assert "diagnosis" not in output
    assert record["held_out_remainder"] == []  # nothing of the fitted recording was held out
    assert record["held_out_notes"] == []
    assert [each["is_left"] for each in record["test_remainder"]] == [False]
    for line in ("viscous_p: viscous friction, dq > 0", "viscous_n: viscous friction, dq < 0"):
        assert f"names: {line}" in output


def test_the_written_robot_file_scores_the_same(drive, fitted):
    _, _, controller, _, test = drive
    model = rrrgen.compile(fitted[0] / "results/robot.yaml")
    found = validate_loop(model, load_controller(controller), [LogStream(open_log(test))], Processing("differences"))
    wanted = json.loads((fitted[0] / "results/closed_loop.json").read_text())["test"]
    assert found.score.relative_error == pytest.approx(wanted["relative_error"], rel=1e-3)
    assert not found.left[0].is_left
    assert found.to_json()["held_out_notes"] == []
    # ten times as much viscous friction is an error that lasts
    friction = model.spec.joints[0].friction
    law = replace(friction.law, values=tuple(10.0 * v if k in (0, 1) else v for k, v in enumerate(friction.law.values)))
    joint = replace(model.spec.joints[0], friction=replace(friction, law=law))
    wrong = rrrgen.compile(replace(model.spec, joints=(joint,)), backend="numpy")
    found = validate_loop(wrong, load_controller(controller), [LogStream(open_log(test))], Processing("differences"))
    assert found.left[0].is_left
    assert (
        "note: noise does not explain the held-out torque errors of the simulated loop of slide"
        in found.lines(["slide"])[-1]
    )
    assert len(found.to_json()["held_out_notes"]) == 1


def test_the_simulated_loop_keeps_the_guard_band_too(drive, fitted):
    """Its samples next to the border of the split were scored although the options leave them out."""
    options = {"controller": drive[2], "split": "first:0.5", "method": "differences"}
    close, far = (
        rrrgen.validate(fitted[0] / "results/robot.yaml", drive[4], guard=guard, **options).closed_loop.score
        for guard in (0.0, 0.5)
    )
    assert close.count - far.count == pytest.approx(500, abs=1)  # 0.5 s at 1 kHz


def test_another_controller_is_told(drive, fitted):
    model = rrrgen.compile(fitted[0] / "results/robot.yaml")
    recordings = [LogStream(open_log(drive[3]))]
    late = loads_controller(CONTROLLER.replace("{delayed: volts, by: 1}", "{delayed: volts, by: 3}"))
    found = validate_loop(model, late, recordings, Processing("differences"))
    assert "warning: controller computed from the measured motion" in found.lines(["slide"])[0]
    early = loads_controller(CONTROLLER.replace("{delayed: volts, by: 1}", "{sum: {volts: 1}}"))
    found = validate_loop(model, early, recordings, Processing("differences"))
    assert "a delay of 1 periods fits better" in found.lines(["slide"])[0]
    crude = loads_controller(CONTROLLER.replace("{difference: averaged}", "{difference: position}"))
    found = validate_loop(model, crude, recordings, Processing("differences"))
    assert "look at differences, averages, filters" in found.lines(["slide"])[0]
    unstable = loads_controller(CONTROLLER.replace("position: -160.0", "position: 160.0"))
    with pytest.raises(DerivationError, match=r"the simulated loop diverges .* s after the start of the recording"):
        validate_loop(model, unstable, recordings, Processing("differences"))


@pytest.mark.usefixtures("no_figures")
def test_a_feedforward_torque_may_be_recorded_in_the_test_alone(drive, fitted, tmp_path):
    """Forces are often applied in the validation only: the recording that is fitted has no column of them."""
    folder, _, controller, log, test = drive
    bare = folder / "without.yaml"
    bare.write_text("".join(line for line in log.read_text().splitlines(True) if "feedforward" not in line))
    robot = fitted[0] / "results/robot.yaml"
    done = run("experiment", "validate", robot, "--log", bare, "--controller", controller, "-o", tmp_path / "bare")
    assert done.exit_code == 0, done.output
    assert "no feed-forward torque is recorded" in done.output
    limited = ("--relative-error", 1e-7)
    done = run(
        "experiment", "validate", robot, "--log", test, "--controller", controller, *limited, "-o", tmp_path / "test"
    )
    assert "the limit holds for the simulated loop" in done.output
    assert "; FAILED: relative error of the simulated loop" in done.output  # not of inverse dynamics without pulses


def test_the_fitted_recording_is_no_test(drive, tmp_path):
    """It was scored as a recording that is not fitted."""
    folder, robot, controller, log, test = drive
    again = folder / "again.yaml"  # another mapping file of the same data
    again.write_text(log.read_text())
    for named in (log, again):
        words = ("--log", log, "--controller", controller, "--test", test, "--test", named, "-o", tmp_path / "out")
        done = run("identify", robot, *words)
        assert f"{named.name} is fitted: --test are scored as recordings that were not" in done.output
        assert done.exit_code == 2


def test_a_controller_that_does_not_fit_is_refused_before_the_fit(drive, tmp_path):
    _, robot, _, log, _ = drive
    other = tmp_path / "controller.yaml"
    for text, message in (
        (CONTROLLER.replace("reference: 160", "reference_velocity: 160"), "the controller uses 'reference_velocity'"),
        (CONTROLLER.replace("name: slide", "name: slider"), "the controller has the joints slider"),
    ):
        other.write_text(text)
        done = run("identify", robot, "--log", log, "--controller", other, "-o", tmp_path / "out")
        assert message in str(done.exception)
        assert not (tmp_path / "out").exists()


def test_what_does_not_fit_is_refused(drive, fitted):
    folder, _, _, log, _ = drive
    bare = folder / "bare.yaml"
    bare.write_text("".join(line for line in log.read_text().splitlines(keepends=True) if "reference" not in line))
    model = rrrgen.compile(fitted[0] / "results/robot.yaml")
    for text, path, message in (
        (CONTROLLER, bare, "give the mapping file a column 'reference'"),
        (CONTROLLER.replace("name: slide", "name: slider"), log, "the controller has the joints slider"),
        (CONTROLLER.replace("rate: 1 kHz", "rate: 700 Hz"), log, "one must be a whole multiple of the other"),
    ):
        with pytest.raises(InputError, match=message):
            validate_loop(model, loads_controller(text), [LogStream(open_log(path))], Processing("differences"))


@pytest.mark.parametrize(("resolution", "biased"), [(5e-8, False), (1e-5, True)])
def test_instruments_from_the_simulated_loop_tell_bias(drive, tmp_path, resolution, biased):
    """A coarse encoder and plain differences make least squares lose mass; instruments find what is missing."""
    model, options = rrrgen.compile(drive[1]), Options(consistent=False)
    log = LogStream(open_log(record(tmp_path, "log", 1, 8.0, resolution=resolution)))
    found = identify(model, [log], Processing("differences", decimate=5), options)
    bias = closed_loop_estimate(found, [log], loads_controller(CONTROLLER), options).bias
    assert bias is not None
    assert bool(bias.significant) == biased
    mass = found.estimate.x[0]
    assert mass + bias.difference[0] == pytest.approx(MASS, rel=0.01)
    assert (mass < 0.98 * MASS) == biased


@pytest.mark.parametrize("law", ["dahl", "lugre"])
def test_friction_with_a_state_is_simulated_and_found(drive, tmp_path, law):
    """Dahl's law: at every reversal the bristles bend before the drive slides. LuGre contains it, with a ratio of 1."""
    log = LogStream(open_log(record(tmp_path, "log", 3, 4.0, presliding=DAHL["presliding1"])))
    model, options = rrrgen.compile(drive[1]), Options(friction=LawChoice(law))
    found = identify(model, [log], Processing("differences", decimate=5), options)
    loop = closed_loop_estimate(found, [log], loads_controller(CONTROLLER), options)
    known = dict(zip(loop.names, loop.theta, strict=True))
    assert known.get("stiction_ratio1", 1.0) == pytest.approx(1.0, abs=0.01)
    assert known["m1R"] == pytest.approx(MASS, rel=2e-3)
    for name, value in DAHL.items():
        assert known[name] == pytest.approx(value, rel=0.02), name
    assert loop.fit.relative_error < 2e-3


@pytest.mark.sweep
def test_the_virtual_arm_writes_its_controller(tmp_path):
    """Three coupled joints, a Kalman observer, a delay, noise, friction with a state and of the load in the loop.

    The written controller is the simulated one. The virtual arm computes the load from accelerations, the simulated
    loop from the torques less friction.
    """
    first, *others = (files("rrrgen.robot") / "robots/rrr.yaml").read_text().split("    drive:")
    rows = [f"    friction: {law}\n    drive:{text}" for law, text in zip(LAWS, others, strict=True)]
    robot = tmp_path / "robot.yaml"
    robot.write_text(first + "".join(rows))
    (tmp_path / "experiment.yaml").write_text(EXPERIMENT)
    to = ("--writing", "--experiment", tmp_path / "experiment.yaml", "--duration", 0.5, "-o", tmp_path / "sim")
    assert run("experiment", "simulate", robot, *to).exit_code == 0
    results = tmp_path / "sim/results"
    log = LogStream(open_log(results / "log.yaml"))
    controller = load_controller(results / "log_controller.yaml")
    found = validate_loop(rrrgen.compile(robot), controller, [log], Processing("differences"))
    assert found.score.relative_error < 0.01
    assert "warning" not in found.lines(log.joints)[0]
