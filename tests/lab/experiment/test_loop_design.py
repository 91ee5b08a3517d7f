"""The control loop of the virtual robot is designed from the arm: stable with its margin, whatever the arm."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
from click.testing import CliRunner

import rrrgen
from rrrgen.cli.main import cli
from rrrgen.lab.data.recordings import read_log
from rrrgen.lab.design.fourier_series import FourierTrajectory
from rrrgen.lab.experiment.experiment_file import Experiment, loads_experiment
from rrrgen.lab.experiment.loop_design import BANDWIDTH, MARGIN, NOISE, SLOWEST, check_loop, design_loop
from rrrgen.lab.experiment.setup import arm_of, simulate_motion
from rrrgen.robot.file import bundled_path, loads_spec


def run(*arguments):
    return CliRunner().invoke(cli, [str(a) for a in arguments], standalone_mode=False, catch_exceptions=False)


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    """The arm that `rrrgen new` writes, whose lightest direction is ten times lighter than its joints alone."""
    path = tmp_path_factory.mktemp("loop") / "demo.yaml"
    assert run("new", "demo", "-o", path).return_value in (None, 0)
    return path


@pytest.fixture(scope="module")
def trajectory(demo):
    path = demo.parent / "trajectory.json"
    path.write_text(json.dumps(motion_of(3).to_json()))
    return path


def motion_of(joints: int, amplitude: float = 0.5) -> FourierTrajectory:
    rng = np.random.default_rng(2)
    return FourierTrajectory.from_coefficients(rng.uniform(-amplitude, amplitude, (11, joints)), 0.2)


def growing(model, design, poses, period: float) -> float:
    """The largest closed-loop pole at these poses, from the filter's own matrices and M(q): not the code under test."""
    n, worst = model.n, 0.0
    E, k = np.asarray(design.observer.E), np.asarray(design.observer.k)
    kp, kd = np.diag(design.controller.kp), np.diag(design.controller.kd)
    X = np.zeros((n, 3, 5 * n))  # the filtered deviation from [q, dq, predictions]
    for i in range(n):
        X[i, :, 2 * n + 3 * i : 2 * n + 3 * i + 3] = np.eye(3) - np.outer(k[i], [1, 0, 0])
        X[i, :, i] = k[i]
    torque = -kp @ X[:, 0] - kd @ X[:, 1]
    for M in model.mass_matrix(poses):
        A = np.zeros((5 * n, 5 * n))
        A[:n, :n], A[:n, n : 2 * n], A[n : 2 * n, n : 2 * n] = np.eye(n), period * np.eye(n), np.eye(n)
        ddq = np.linalg.solve(M, torque)
        A[:n] += 0.5 * period**2 * ddq
        A[n : 2 * n] += period * ddq
        A[2 * n :] = np.einsum("irs,isj->irj", E, X).reshape(3 * n, 5 * n)
        worst = max(worst, float(np.abs(np.linalg.eigvals(A)).max()))
    return worst


@pytest.mark.parametrize(
    ("name", "rate"),
    [("demo", 250.0), ("demo", 1000.0), ("demo", 5000.0), ("rrr", 250.0), ("scara", 1000.0), ("gantry", 5000.0)],
)
@pytest.mark.sweep(but=["demo-250.0", "gantry-5000.0", "scara-1000.0"])
def test_default_loops_are_robust_at_every_rate(demo, name: str, rate: float) -> None:
    """Stable by an analysis of its own at poses between those of the design; a loop too fast for the rate is slowed."""
    model = rrrgen.compile(demo if name == "demo" else name)
    motion, experiment = motion_of(model.n, 0.2), Experiment(period=1.0 / rate)
    design = design_loop(arm_of(experiment, model, motion.evaluate, 5.0), experiment.control)
    assert design.robust
    assert design.margin.modulus >= MARGIN
    poses = motion.evaluate(np.linspace(0.0, 5.0, 333))[0]
    assert growing(model, design, poses, experiment.period) < 1.0
    assert design.bandwidth is not None
    if rate >= 1000.0:
        assert min(design.bandwidth) >= BANDWIDTH


def test_the_loop_of_a_new_arm_follows_and_a_slow_observer_does_not(demo) -> None:
    """With the default settings the torque was a thousand times what the motion takes."""
    model, motion = rrrgen.compile(demo), motion_of(3)
    experiment = Experiment()
    arm = arm_of(experiment, model, motion.evaluate, 2.0)
    loop = design_loop(arm, experiment.control)
    recording, _ = simulate_motion(experiment, model, motion.evaluate, 2.0, loop=loop)
    assert check_loop(recording, arm, loop).ok
    assert np.all(np.abs(recording.held).max(axis=0) < 1.5 * arm.load)  # the arm starts with a deviation: it overshoots
    slow = loads_experiment("schema: rrrgen-experiment/1\ncontrol: {bandwidth: 4, jerk: 20}\n", 3, "slow.yaml")
    unstable = design_loop(arm, slow.control)
    assert unstable.margin.unstable
    (warning,) = unstable.warnings
    assert str(warning).startswith(
        "slow.yaml:2:11: warning: `bandwidth`, `jerk` make a loop that is not robust: unstable"
    )
    assert "without them: PD control of " in warning.hint
    assert "modulus margin 0.5" in warning.hint
    recording, _ = simulate_motion(slow, model, motion.evaluate, 2.0, loop=unstable)
    tracking = check_loop(recording, arm, unstable)
    assert not tracking.ok
    assert {swing.joint for swing in tracking.oscillations} >= {1, 2}
    # the loop of the posture in which it swings: within a factor of two of that of the worst posture
    assert all(0.5 < swing.frequency / unstable.margin.frequency < 2.0 for swing in tracking.oscillations)


@pytest.mark.parametrize("rate", [250.0, 1000.0])
def test_joints_get_the_bandwidth_that_their_load_needs_as_far_as_the_margin_lasts(rate: float) -> None:
    """With one bandwidth for all joints, 1.3 Hz at 250 Hz, the wrist of the UR5 was 1.6 rad away from its motion.

    At 1 kHz every joint alone is stiff enough; at 250 Hz the load of the arm would bend it by half its motion, so that
    the torques of the model are fed forward.
    """
    model = rrrgen.compile("ur5")
    motion = motion_of(6, 0.2)
    experiment = Experiment(period=1.0 / rate)
    arm = arm_of(experiment, model, motion.evaluate, 4.0)
    loop = design_loop(arm, experiment.control)
    assert loop.robust
    assert max(loop.bandwidth) > 2.0 * min(loop.bandwidth)
    assert (loop.feedforward is not None) == (rate < 1000.0)
    poses = motion.evaluate(np.linspace(0.0, 4.0, 101))[0]
    assert growing(model, loop, poses, experiment.period) < 1.0
    recording, _ = simulate_motion(experiment, model, motion.evaluate, 4.0, loop=loop)
    tracking = check_loop(recording, arm, loop)
    assert tracking.ok
    assert np.all(np.array(tracking.deviation) < 0.1 * np.array(tracking.span))


def test_feedforward_is_recorded_and_known_to_the_controller_file(demo, trajectory, tmp_path) -> None:
    """The loop of the recorded controller reproduces the recorded torques: it is fed what the recording holds."""
    fed = tmp_path / "fed.yaml"
    fed.write_text("schema: rrrgen-experiment/1\ncontrol: {bandwidth: [2, 2, 3], feedforward: true}\n")
    arguments = ["--trajectory", trajectory, "--experiment", fed, "--torque-noise", 0.01, "-o", tmp_path / "recorded"]
    simulated = run("experiment", "simulate", demo, *arguments)
    assert simulated.return_value == 0, simulated.output
    assert "PD control of 2, 2, 3 Hz with the torques of the model fed forward" in simulated.output
    results = tmp_path / "recorded" / "results"
    assert "feedforward: {column: ff_q1, unit: N*m}" in (results / "log.yaml").read_text()
    options = ["--log", results / "log.yaml", "--controller", results / "log_controller.yaml"]
    validated = run("experiment", "validate", demo, *options, "-o", tmp_path / "validated", "--json")
    assert validated.return_value == 0, validated.output


def test_coarse_encoders_get_a_slower_loop(demo) -> None:
    """Their steps would shake the drives: the torque of the noise stays below a tenth of that of the motion."""
    model, motion = rrrgen.compile(demo), motion_of(3)
    coarse = loads_experiment("schema: rrrgen-experiment/1\nvirtual_robot: {encoder_resolution: 2e-3}\n", 3)
    arm = arm_of(coarse, model, motion.evaluate, 2.0)
    design = design_loop(arm, coarse.control)
    assert design.robust
    assert np.all(design.noise <= NOISE * arm.load)
    assert min(design.bandwidth) < BANDWIDTH
    assert any("encoder steps" in line for line in design.lines())


def test_stated_gains_are_kept(demo) -> None:
    model, motion = rrrgen.compile(demo), motion_of(3)
    text = "schema: rrrgen-experiment/1\ncontrol: {kp: [900, 800, 100], kd: [50, 40, 5]}\n"
    stated = loads_experiment(text, 3)
    design = design_loop(arm_of(stated, model, motion.evaluate, 2.0), stated.control)
    assert design.controller.kp == (900.0, 800.0, 100.0)
    assert design.controller.kd == (50.0, 40.0, 5.0)
    assert design.robust
    assert design.warnings == ()


def test_simulate_exits_with_one_where_the_loop_oscillates(demo, trajectory, tmp_path) -> None:
    good = run("experiment", "simulate", demo, "--trajectory", trajectory, "--duration", 1, "-o", tmp_path / "good")
    assert good.return_value == 0, good.output
    assert "modulus margin 0.5" in good.output
    fast = ["--rate", 200, "--bandwidth", 5, "--duration", 2]
    bad = run("experiment", "simulate", demo, "--trajectory", trajectory, *fast, "-o", tmp_path / "bad")
    assert bad.return_value == 1
    assert "--bandwidth: warning: `bandwidth` makes a loop that is not robust: unstable" in bad.stderr
    assert "FAIL q3 oscillates at" in bad.stderr
    assert "FAIL q3 does not follow the motion" in bad.stderr
    told = run("experiment", "simulate", demo, "--trajectory", trajectory, *fast, "-o", tmp_path / "bad", "--json")
    assert told.return_value == 1
    content = json.loads(told.stdout)
    assert content["loop"]["stable"] is False
    assert content["tracking"]["ok"] is False


@pytest.mark.sweep
def test_every_second_row_of_a_recording_tells_the_same_friction(demo, trajectory, tmp_path) -> None:
    """Of a loop that oscillated, these rows put every friction value 3 to 5 of its deviations off."""
    robot, text = tmp_path / "rubbing.yaml", demo.read_text()
    rows = text.split("\n")
    place = next(k for k, row in enumerate(rows) if row.startswith("    limits:"))
    rows.insert(place, "    friction: {viscous: 0.8, coulomb: 2.0}")
    robot.write_text("\n".join(rows).replace("theta: 0,\n", "theta: 0, friction: {viscous: 0.5, coulomb: 1.2},\n"))
    noise = ["--torque-noise", 0.1, "-o", tmp_path / "recorded"]
    assert run("experiment", "simulate", robot, "--trajectory", trajectory, *noise).return_value == 0
    results = tmp_path / "recorded" / "results"
    lines = (results / "log.csv").read_text().splitlines()
    (results / "log.csv").write_text("\n".join([lines[0], *lines[1::2]]) + "\n")
    log = ["--log", results / "log.yaml", "-o", tmp_path / "found"]
    found = run("identify", robot, *log)
    assert found.return_value == 0, found.output
    assert json.loads((tmp_path / "found" / "results" / "identification.json").read_text())["diagnoses"] == []
    with (tmp_path / "found" / "results" / "parameters.csv").open() as file:
        values = {row["parameter"]: (float(row["value"]), float(row["std"])) for row in csv.DictReader(file)}
    truth = {"fv1": 0.8, "fc1": 2.0, "fv2": 0.5, "fc2": 1.2, "fv3": 0.5, "fc3": 1.2}
    for name, true in truth.items():
        value, std = values[name]
        assert abs(value - true) < 3.0 * std, name
        assert std < 0.05 * true, name


def test_a_loop_that_runs_away_is_a_failed_check(demo, trajectory, tmp_path) -> None:
    wild = tmp_path / "wild.yaml"
    wild.write_text("schema: rrrgen-experiment/1\ncontrol: {kp: 1e9, kd: 1e7}\n")
    arguments = [str(a) for a in ("experiment", "simulate", demo, "--trajectory", trajectory, "--experiment", wild)]
    from rrrgen.base.errors import UnstableLoopError

    with pytest.raises(UnstableLoopError, match="ran away") as caught, np.errstate(all="ignore"):
        run(*arguments, "-o", tmp_path / "wild")
    assert caught.value.exit_code == 1


@pytest.mark.parametrize("reference", [True, False])
@pytest.mark.parametrize("stable", [True, False])
@pytest.mark.sweep(but=["True-True", "False-False"])
def test_identification_says_that_the_loop_of_a_recording_oscillates(
    demo, trajectory, tmp_path, stable: bool, reference: bool
) -> None:
    """It gave wrong diagnoses of columns and units instead."""
    slow = tmp_path / "slow.yaml"
    control = "" if stable else "control: {bandwidth: 4, jerk: 20}\n"
    slow.write_text(f"schema: rrrgen-experiment/1\n{control}")
    options = ["--trajectory", trajectory, "--experiment", slow, "--duration", 4, "-o", tmp_path / "recorded"]
    assert run("experiment", "simulate", demo, *options).return_value == (0 if stable else 1)
    mapping = tmp_path / "recorded" / "results" / "log.yaml"
    if not reference:
        lines = mapping.read_text().splitlines()
        mapping.write_text("\n".join(line for line in lines if "reference:" not in line) + "\n")
    found = rrrgen.identify(str(demo), str(mapping))
    said = [note for note in found.notes if "oscillates" in note]
    assert len(said) == (0 if stable else 1)
    if not stable:
        assert found.notes[0] == said[0]
        frequency = float(said[0].split(" at ")[1].split(" Hz")[0])
        assert 20.0 < frequency < 100.0


def recorded(robot, folder, record: str, noise: float):
    """The mapping file of a recording of the arm that moves two joints, every 2 ms."""
    experiment, motion = folder / f"{record}.yaml", folder / "motion.json"
    virtual = f"virtual_robot: {{torque_record: {record}, torque_noise: {noise}, encoder_resolution: 1e-6}}"
    experiment.write_text(f"schema: rrrgen-experiment/1\nperiod: 2 ms\n{virtual}\n")
    motion.write_text(json.dumps(motion_of(2).to_json()))
    options = ["--trajectory", motion, "--experiment", experiment, "-o", folder / record]
    assert run("experiment", "simulate", robot, *options).return_value == 0
    return folder / record / "results" / "log.yaml"


def test_recorded_commands_act_half_a_sample_after_their_row(tmp_path) -> None:
    """Aligned with the motion, they are the mean over a period around the sample, which `centred` records."""
    mapping = recorded("planar2r", tmp_path, "command", 0.0)
    assert "torque_delay: 0.001 s\n" in mapping.read_text()
    (part,) = read_log(mapping).parts()
    aligned, centred = part.align_torques(), read_log(recorded("planar2r", tmp_path, "centred", 0.0))
    np.testing.assert_allclose(aligned.tau[1:], centred.tau[1:], rtol=1e-12, atol=1e-12)
    assert aligned.valid[1:].all()
    assert not aligned.valid[0].any()  # nothing is known of the torque before the first row
    assert np.abs(part.tau[1:] - centred.tau[1:]).max() > 1e-3


def test_a_recording_of_commands_tells_every_parameter(tmp_path) -> None:
    robot, text = tmp_path / "rubbing.yaml", bundled_path("planar2r").read_text()
    robot.write_text(text.replace("    theta: 0\n", "    theta: 0\n    friction: {viscous: 0.4, coulomb: 0.3}\n"))
    found, model = rrrgen.identify(str(robot), str(recorded(robot, tmp_path, "command", 0.01))), rrrgen.compile(robot)
    truth = dict(zip(model.base_parameter_names, model.beta, strict=True))
    truth |= dict.fromkeys(("fv1", "fv2"), 0.4) | dict.fromkeys(("fc1", "fc2"), 0.3)
    assert set(found.names) == set(truth)
    for name, value, std in zip(found.names, found.values, found.std, strict=True):
        assert abs(value - truth[name]) < 3.0 * std, name


MAST = """
schema: rrrgen/1
name: mast
convention: standard
units: {angle: rad, length: m}
gravity: [0, 0, -9.81]
joints:
  - {name: turn, type: revolute, alpha: pi/2, a: 0, d: 0, theta: 0, drive: {encoder_resolution: 1e-5}}
  - {name: swing, type: revolute, alpha: 0, a: 1, d: 0, theta: pi/2, drive: {encoder_resolution: 1e-5}}
links:
  - {mass: 1, com: [0, 0, 0], inertia: {about: com, products: positive, xx: 1e-4, yy: 1e-4, zz: 1e-4}}
  - {mass: 2, com: [-0.5, 0, 0], inertia: {about: com, products: positive, xx: 1e-4, yy: 0.17, zz: 0.17}}
"""


def test_joints_whose_inertia_changes_too_much_for_pd_control_get_computed_torque():
    """The pole of a mast: three thousand times heavier to turn when it lies than when it stands.

    Gains for the mean are unstable where it stands, and those that are not are too soft to follow. What a file states
    is kept.
    """
    model = rrrgen.compile(loads_spec(MAST))
    motion = FourierTrajectory.from_coefficients(np.array([[0.0, 0.0], [0.5, 1.2], [0.3, 0.4]]), 0.2)
    experiment = Experiment(period=0.004)
    arm = arm_of(experiment, model, motion.evaluate, 5.0)
    loop = design_loop(arm, experiment.control)
    assert loop.robust
    assert loop.instead is not None
    assert min(loop.instead) < SLOWEST <= min(loop.bandwidth)
    assert loop.lines()[0].startswith("computed torque of 4 Hz")
    assert loop.lines()[1].startswith("not PD control: with this margin it would have ")
    recording, _ = simulate_motion(experiment, model, motion.evaluate, 5.0, loop=loop)
    assert check_loop(recording, arm, loop).ok
    pd = loads_experiment("schema: rrrgen-experiment/1\ncontrol: {kind: pd}\n", 2, "pd.yaml")
    stated = design_loop(arm, pd.control)
    assert stated.instead is None
    assert stated.bandwidth == loop.instead
