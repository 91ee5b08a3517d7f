"""Frequency responses by feedback linearisation of the virtual arm, against its linearised equations."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

import rrrgen
from lab.experiment.simulated_response import ARM, EXACT, NOISY, arm, experiment, record, simulated, truth
from rrrgen.base.errors import InputError
from rrrgen.cli.main import cli
from rrrgen.cli.main import run as run_command
from rrrgen.lab.data.recordings import read_log
from rrrgen.lab.design.plan import ResponseDesign
from rrrgen.lab.experiment.experiment_file import loads_experiment
from rrrgen.lab.experiment.feedback_linearisation import linearised_log
from rrrgen.lab.experiment.response import (
    recorded_run,
    response_design,
    response_margin,
    response_plan,
)
from rrrgen.lab.experiment.setup import limited_spec
from rrrgen.lab.plant.recording_files import write_recording, write_responses
from rrrgen.lab.response.estimation import estimate_one, estimate_responses
from rrrgen.lab.response.response_file import load_response


def test_the_kalman_filter_in_the_loop_is_part_of_the_controller_that_is_written():
    control = "control: {observer: kalman, jerk: 2000}\n"
    found = experiment("period: 1 s, periods: 2, settle: 4, band: [1 Hz, 60 Hz], rms: 3", EXACT, control)
    _, (signals,), controller = simulated(found)
    assert len(controller.denominator) == 4
    direct = estimate_one(record(signals), 1.0)
    indirect = estimate_one(record(signals), 1.0, controller, "indirect")
    assert np.abs(indirect.P / direct.P - 1.0).max() < 1e-3


def test_postures_and_realisations_become_response_files(tmp_path):
    found = experiment(
        "period: 0.5 s, periods: 4, settle: 2, band: [4 Hz, 150 Hz], postures: [[0, 0, 90 deg], [0, 0, 0]]"
    )
    design, signals, controller = simulated(found)
    (path,) = write_responses(tmp_path / "postures", design, signals, controller)
    assert load_response(path).several == "postures"
    folded, stretched = estimate_responses(load_response(path))
    for k, response in enumerate((folded, stretched)):
        expected = truth(found, design, response.frequency, k)
        assert np.median(np.abs(response.P / expected - 1.0)) < 0.1
    found = experiment("period: 0.5 s, periods: 4, settle: 2, band: [4 Hz, 150 Hz], realisations: 2")
    design, signals, controller = simulated(found)
    assert not np.allclose(signals[0].n, signals[1].n)
    (path,) = write_responses(tmp_path / "realisations", design, signals, controller)
    (mean,) = estimate_responses(load_response(path))
    assert mean.details["realisations"] == 2
    assert mean.findings == ()


def test_commands_lead_from_the_excitation_to_the_resonances(tmp_path):
    """excite -> simulate -> frf -> response-model."""
    file = tmp_path / "arm.yaml"
    file.write_text(f"{ARM}{NOISY}response: {{period: 1 s, periods: 6, settle: 3, band: [1 Hz, 120 Hz]}}\n")

    def run(*arguments):
        result = CliRunner().invoke(cli, [str(a) for a in arguments], standalone_mode=False, catch_exceptions=False)
        assert result.return_value == 0, result.output
        return result.output

    run("experiment", "excite", "rrr", "--response", "q1", "--experiment", file, "-o", tmp_path / "excitation")
    designed = tmp_path / "excitation/results/response_excitation.json"
    assert (tmp_path / "excitation/figures/response_excitation.png").is_file()
    rows = np.loadtxt(tmp_path / "excitation/results/q1_posture1_realisation1.csv", delimiter=",", skiprows=1)
    assert rows.shape == (9000, 8)
    run("experiment", "simulate", "rrr", "--response", designed, "--experiment", file, "-o", tmp_path / "arm")
    run("response", "frf", tmp_path / "arm/results/response.yaml", "-o", tmp_path / "frf")
    run("response", "model", tmp_path / "frf/results/frf.json", "-o", tmp_path / "model")
    model = json.loads((tmp_path / "model/results/response_model.json").read_text())
    found = [each["frequency"] for each in model["resonances"]]
    assert min(abs(f - 28.0) for f in found) < 0.5


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (("experiment", "excite", "rrr", "--response", "q9", "-o", "out"), InputError.exit_code),
        (("experiment", "excite", "rrr", "--response", "-", "-o", "out"), InputError.exit_code),
        (("experiment", "excite", "rrr", "--response", "q1", "--harmonics", "3", "-o", "out"), 2),
        (("experiment", "simulate", "rrr", "--response", "other.json", "-o", "out"), InputError.exit_code),
        (("experiment", "simulate", "rrr", "--response", "other.json", "--writing", "-o", "out"), 2),
    ],
)
def test_experiments_that_cannot_be_are_refused(tmp_path, monkeypatch, arguments, code):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "other.json").write_text("{}")
    assert run_command(list(arguments)) == code


@pytest.fixture(scope="module")
def logged(tmp_path_factory):
    """A designed run of the arm on its flexible base, as positions and torques after a second at rest."""
    folder, model = tmp_path_factory.mktemp("logged"), arm()
    section = "response: {joint: q1, period: 1 s, periods: 4, settle: 3, band: [1 Hz, 150 Hz]}\n"
    rigid = "\n".join(line for line in ARM.splitlines() if "law:" not in line and "flexible_joints" not in line)
    found = loads_experiment(f"{rigid}\n  torque_record: command\n  torque_noise: 0.05\n{section}", 3)
    design = response_design(found, model, response_plan(found))
    signals, recording = recorded_run(found, model, design, 0)
    (folder / "design.json").write_text(json.dumps(design.to_json()))
    rest = 1000
    still = model.bias(recording.q[:1], np.zeros((1, 3)))
    before = replace(
        recording,
        t=1e-3 * np.arange(rest + len(recording.t)),
        q=np.vstack([np.repeat(recording.q[:1], rest, axis=0), recording.q]),
        tau=np.vstack([np.repeat(still, rest, axis=0), recording.tau]),
        reference=np.vstack([np.repeat(recording.reference[:1], rest, axis=0), recording.reference]),
    )
    write_recording(folder, "log", before, joints=("q1", "q2", "q3"))
    return folder, model, signals


def test_a_recording_of_torques_gives_the_input_that_the_controller_computed(logged):
    folder, model, signals = logged
    design = ResponseDesign.from_json(json.loads((folder / "design.json").read_text()))
    found = linearised_log(model, read_log(folder / "log.yaml"), design, design.runs[0])
    assert len(found.u) == len(signals.u) - 1  # aligned to the sample where the excitation acts, after the delay
    assert np.std(found.u - signals.u[:-1]) < 0.1  # the noise of the torque
    assert np.std(signals.u) > 3.0
    a, b = estimate_one(record(found), 1.0), estimate_one(record(signals), 1.0)
    advance = np.exp(2j * np.pi * b.frequency * 1e-3)
    assert np.median(np.abs(a.P / (b.P * advance) - 1.0)) < 0.05


def test_the_command_writes_a_recording_that_frf_reads(logged, tmp_path):
    folder, _, _ = logged
    arguments = ["--log", folder / "log.yaml", "--response", folder / "design.json", "-o", tmp_path / "run"]
    result = CliRunner().invoke(cli, ["response", "linearise", "rrr", *map(str, arguments)], standalone_mode=False)
    assert result.return_value == 0, result.output
    (response,) = estimate_responses(load_response(tmp_path / "run/results/response.yaml"))
    assert response.findings == ()
    assert np.mean(response.trusted) > 0.7


def test_a_recording_of_something_else_is_refused(logged, tmp_path):
    folder, model, _ = logged
    design = ResponseDesign.from_json(json.loads((folder / "design.json").read_text()))
    log = read_log(folder / "log.yaml")
    rng = np.random.default_rng(1)
    with pytest.raises(InputError, match="is not in the recording"):
        linearised_log(model, replace(log, tau=rng.normal(size=log.tau.shape)), design, design.runs[0])
    with pytest.raises(InputError, match="from the designed motion"):
        linearised_log(model, replace(log, q=log.q + np.array([0.0, 1.0, 0.0])), design, design.runs[0])
    short = replace(log, t=log.t[:3500], q=log.q[:3500], tau=log.tau[:3500])
    with pytest.raises(InputError, match="still settling"):
        linearised_log(model, short, design, design.runs[0])
    with pytest.raises(InputError, match="no torques"):
        linearised_log(model, replace(log, tau=None), design, design.runs[0])
    options = ["--log", str(folder / "log.yaml"), "--response", str(folder / "design.json"), "--run", "q9"]
    assert run_command(["response", "linearise", "rrr", *options, "-o", str(tmp_path / "out")]) == 2


@pytest.mark.parametrize("delay", [1, 30])
def test_the_loop_of_a_response_experiment_has_a_margin(delay: int) -> None:
    """Thirty samples late, loops of 6 Hz are unstable."""
    found = experiment("period: 0.5 s, periods: 2, settle: 1, band: [4 Hz, 150 Hz]")
    found = replace(found, virtual_robot={**found.virtual_robot, "delay": delay})
    margin = response_margin(found, arm(), response_design(found, arm(), response_plan(found)))
    assert margin.unstable == (delay == 30)


LIMITED = """schema: rrrgen-experiment/1
excitation: {limits: {lower: [-1, .2, -1], upper: [1, .6, 1], speed: .5, acceleration: 3}}
response: {joint: q2, period: 1 s, periods: 4, settle: 1, band: [5 Hz, 50 Hz]}
"""


@pytest.mark.parametrize("kind", ["--response", "--friction"])
def test_motions_of_one_joint_keep_to_the_limits_of_the_experiment_file(kind: str, tmp_path):
    """They had no effect on these motions."""
    file, folder = tmp_path / "limited.yaml", tmp_path / "run"
    file.write_text(LIMITED, encoding="utf-8")
    assert run_command(["experiment", "excite", "rrr", kind, "q2", "--experiment", str(file), "-o", str(folder)]) == 0
    files = list((folder / "results").glob("*.csv"))
    assert files
    for path in files:
        table = np.genfromtxt(path, delimiter=",", names=True)
        assert table["q2"].min() >= 0.2
        assert table["q2"].max() <= 0.6
        assert np.abs(table["dq2"]).max() <= 0.5
        if kind == "--friction":
            assert np.abs(table["ddq2"]).max() <= 3.0
        else:
            assert np.abs(table["n"]).max() <= 0.4 * 3.0 + 1e-9


@pytest.mark.parametrize(
    ("limits", "fault"), [("box: {z: [0.4, ~]}", "no box"), ("upper: -10", "leave joint q1 no range")]
)
def test_limits_that_motions_of_one_joint_cannot_keep_are_refused(limits: str, fault: str):
    robot = rrrgen.load_spec("rrr")
    robot = replace(robot, joints=tuple(replace(j, limits=replace(j.limits, lower=-3.0)) for j in robot.joints))
    file = loads_experiment(f"schema: rrrgen-experiment/1\nexcitation: {{limits: {{{limits}}}}}\n", 3)
    with pytest.raises(InputError, match=fault):
        limited_spec(file, robot)
