"""The whole way from recordings to parameters, figures and robot files, with compiled models."""

import json
from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import cumulative_trapezoid

import rrrgen
from rrrgen.base.errors import InputError
from rrrgen.lab.data.kalman import kalman_matrices
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.data.recordings import Log, check_robot, load_stream, open_log
from rrrgen.lab.data.run_folder import RunFolder, plain
from rrrgen.lab.data.uniform_stream import LogStream
from rrrgen.lab.identify.cross_validation import convergence
from rrrgen.lab.identify.figures import bode_data, plot_bode, plot_whiteness
from rrrgen.lab.identify.held_out_data import Split
from rrrgen.lab.identify.identification import Options, identify
from rrrgen.lab.identify.parameters import DriveTerms
from rrrgen.lab.identify.regressor import FullRegressor
from rrrgen.lab.identify.results import as_record, identified_spec, write_identification
from rrrgen.robot.spec import DriveSpec, FrictionSpec, standard_parameters
from samples.recordings import fourier_motion, write_log

PERIOD, N = 2e-3, 4000
ENCODER = 1e-5
SIGMA = np.array([0.3, 0.15, 0.08])
FRICTION = np.array([2.0, 1.0, 0.5, 3.0, 1.5, 0.8])  # viscous, then Coulomb
TERMS = DriveTerms.everywhere(3, "viscous", "coulomb")


@pytest.fixture(scope="module")
def arm():
    return rrrgen.compile("rrr")


def phi_of(spec):
    """Standard parameters (10n,) of the links of a robot file."""
    return np.array([float(value) for link in spec.links for value in standard_parameters(link)])


def experiment(arm, seed, noise=SIGMA):
    t = PERIOD * np.arange(N)
    q, dq, ddq = fourier_motion(t, 3, seed, base=0.125, harmonics=12)
    rng = np.random.default_rng(seed + 1000)
    tau = FullRegressor(arm, TERMS)(q, dq, ddq) @ np.concatenate([arm.beta, FRICTION])
    measured = np.round(q / ENCODER) * ENCODER
    names = tuple(joint.name for joint in arm.spec.joints)
    return Log(names, t, measured, tau + noise * rng.normal(size=q.shape), period=PERIOD), (q, dq, ddq, tau)


@pytest.fixture(scope="module")
def logs(arm):
    return [experiment(arm, seed)[0] for seed in (1, 2)]


KALMAN = Processing("kalman", decimate=5)
BUTTERWORTH = Processing("butterworth", cutoff=20.0, decimate=10)


@pytest.fixture(scope="module")
def result(arm, logs):
    return identify(arm, logs, KALMAN, Options(terms=TERMS, essential=True, poses=500))


def test_virtual_rrr_within_three_reported_deviations(arm, result):
    truth = result.structure.G @ np.concatenate([arm.beta, FRICTION])
    assert result.structure.rank == 21
    assert np.max(np.abs(result.estimate.x - truth) / result.estimate.std) < 3.0
    assert result.indefinite["consistent"] == 0.0


def test_validation_error_beyond_the_noise_is_below_one_percent(arm, result):
    """Torque without noise on a motion that was not fitted, against the identified model."""
    _, (q, dq, ddq, tau) = experiment(arm, 7)
    W = FullRegressor(arm, TERMS)(q, dq, ddq)
    for theta in (result.theta, result.consistent.theta):
        error = np.sqrt(np.mean((W @ theta - tau) ** 2, axis=0)) / np.sqrt(np.mean(tau**2, axis=0))
        assert np.all(error < 0.01)


def one_joint_moves():
    """A planar arm whose robot file states drives and friction, and a recording with noise in which q2 stands."""
    rigid = rrrgen.compile("planar2r", backend="numpy")
    stated = {"friction": FrictionSpec(0.7, 1.5), "drive": DriveSpec(inertia=0.05)}
    spec = replace(rigid.spec, joints=tuple(replace(joint, **stated) for joint in rigid.spec.joints))
    t = PERIOD * np.arange(N)
    q, dq, ddq = fourier_motion(t, 2, 3, base=0.125, harmonics=6)
    q[:, 1], dq[:, 1], ddq[:, 1] = 0.3, 0.0, 0.0
    tau = rigid.inverse_dynamics(q, dq, ddq, rigid.beta) + 0.05 * ddq + 0.7 * dq + 1.5 * np.sign(dq)
    tau += 0.1 * np.random.default_rng(3).normal(size=q.shape)
    return rrrgen.compile(spec, backend="numpy"), Log(("q1", "q2"), t, q, tau, period=PERIOD)


@pytest.mark.parametrize("error", ["none", "drift"])
def test_a_joint_that_stands_keeps_the_drive_of_the_robot_file(error):
    """Nothing tells its inertia and friction, and only their sign bounds them: they must not become 1e12 or 20."""
    arm, log = one_joint_moves()
    if error == "drift":
        walk = 2e-6 * np.cumsum(np.random.default_rng(4).normal(size=N))
        log = replace(log, q=log.q + np.column_stack([np.zeros(N), walk]))
    method = KALMAN if error == "drift" else BUTTERWORTH
    estimate = identify(arm, [log], method, Options(poses=10))
    assert estimate.known == {"Ia2": 0.05, "fv2": 0.7, "fc2": 1.5}
    identified = identified_spec(arm.spec, estimate.consistent).joints[1]
    assert (identified.drive.inertia, identified.friction.viscous, identified.friction.coulomb) == (0.05, 0.7, 1.5)
    assert "this motion does not excite Ia2 at all: it stays at 0.05, as in the robot file" in estimate.motion_notes
    at = {name: k for k, name in enumerate(estimate.names)}
    friction = [at["fv1"], at["fc1"]]
    for x, std in ((estimate.estimate.x, estimate.estimate.std), (estimate.delivered.x, estimate.delivered.std)):
        assert np.all(np.abs(x[friction] - [0.7, 1.5]) < 4.0 * std[friction])
    if error == "none":
        assert np.all(estimate.delivered.std < 0.05)


def second_joint_moves(arm):
    """A recording with noise of a planar ``arm`` of which the first joint stands."""
    t = PERIOD * np.arange(N)
    q, dq, ddq = fourier_motion(t, 2, 3, base=0.125, harmonics=6)
    q[:, 0], dq[:, 0], ddq[:, 0] = 0.3, 0.0, 0.0
    tau = arm.inverse_dynamics(q, dq, ddq, arm.beta) + 0.1 * np.random.default_rng(3).normal(size=q.shape)
    return Log(("q1", "q2"), t, q, tau, period=PERIOD)


def test_a_first_joint_that_stands_keeps_the_links_of_the_robot_file():
    """Its inertia acts on no torque while the second one moves: both estimates keep it where the file has it."""
    rigid = rrrgen.compile("planar2r", backend="numpy")
    estimate = identify(rigid, [second_joint_moves(rigid)], BUTTERWORTH, Options(poses=10))
    name = rigid.base_parameter_names[0]
    assert estimate.known == {name: pytest.approx(rigid.beta[0])}
    assert estimate.theta[0] == pytest.approx(rigid.beta[0])
    assert estimate.consistent.theta[0] == pytest.approx(rigid.beta[0], rel=1e-6)
    assert f"this motion does not excite {name} at all" in estimate.motion_notes[0]


@pytest.mark.filterwarnings("ignore:Solution may be inaccurate")
def test_links_that_no_body_is_are_not_kept():
    """The file has a moment of inertia of -5 kg m^2, which the motion does not contradict: the prior decides."""
    rigid = rrrgen.compile("planar2r", backend="numpy")
    first, last = rigid.spec.links
    impossible = replace(first, inertia=(*first.inertia[:2], sp.Integer(-5), *first.inertia[3:]))
    arm = rrrgen.compile(replace(rigid.spec, links=(impossible, last)), backend="numpy")
    estimate = identify(arm, [second_joint_moves(rigid)], BUTTERWORTH, Options(poses=10))
    assert estimate.known == {}
    assert estimate.consistent.theta[0] > 0.0


@pytest.mark.parametrize(("share", "step"), [(0.5, 1e-5), (0.01, 1e-7)])
def test_a_flickering_encoder_of_a_standing_joint_leaves_the_rows_of_the_other(share, step):
    """The smoother of a joint without motion must not reach over the whole recording: no row is left then."""
    arm, log = one_joint_moves()
    flicker = step * (np.random.default_rng(5).random(N) < share)
    log = replace(log, q=log.q + np.column_stack([np.zeros(N), flicker]))
    estimate = identify(arm, [log], KALMAN, Options(poses=10))
    assert estimate.estimate.counts[0] > 0.5 * N / 5
    assert estimate.estimate.counts[1] == 0
    at = [estimate.names.index(name) for name in ("fv1", "fc1")]
    assert np.all(np.abs(estimate.estimate.x[at] - [0.7, 1.5]) < 4.0 * estimate.estimate.std[at])
    assert np.all(estimate.delivered.std > 0.0)
    assert any("q2: standing" in note for note in estimate.motion_notes)


def test_balanced_links_leave_thirteen_parameters(arm, logs):
    """Links 2 and 3 of the bundled arm are balanced in y: p4 = p15 = 0, said either way."""
    names = list(arm.base_parameter_names)
    assert [arm.beta[names.index(name)] for name in ("p4", "p15")] == [0.0, 0.0]
    by_link = identify(arm, logs, KALMAN, Options(terms=TERMS, fixed_standard={"my2": 0.0, "my3": 0.0}, poses=10))
    by_name = identify(arm, logs, KALMAN, Options(terms=TERMS, fixed={"p4": 0.0, "p15": 0.0}, poses=10))
    for found in (by_link, by_name):
        assert found.structure.rank == 13 + 6
        assert found.theta[names.index("p4")] == 0.0
        truth = np.concatenate([np.delete(arm.beta, [3, 14]), FRICTION])
        assert np.max(np.abs(found.estimate.x - truth) / found.estimate.std) < 3.0
    np.testing.assert_allclose(by_link.estimate.x, by_name.estimate.x, rtol=1e-9)
    assert by_link.consistent.phi[12] == pytest.approx(0.0, abs=1e-12)
    for found in (by_link, by_name):
        links = identified_spec(arm.spec, found.consistent)
        np.testing.assert_allclose((arm.base_projection @ phi_of(links))[[3, 14]], 0.0, atol=1e-9)


def test_known_friction_can_be_fixed_by_name(arm, logs):
    fixed = {f"{kind}{i + 1}": FRICTION[3 * k + i] for k, kind in enumerate(("fv", "fc")) for i in range(3)}
    found = identify(arm, logs, KALMAN, Options(terms=TERMS, fixed=fixed, poses=10))
    assert found.structure.rank == 15
    np.testing.assert_array_equal(found.theta[15:], FRICTION)
    assert found.consistent.theta[15:] == pytest.approx(FRICTION)
    # the robot file has them too, and so the error that is reported for it
    spec = identified_spec(arm.spec, found.consistent)
    stated = [joint.friction for joint in spec.joints]
    assert [f.viscous for f in stated] + [f.coulomb for f in stated] == FRICTION.tolist()
    theta = np.concatenate([arm.base_projection @ phi_of(spec), FRICTION])
    residual = np.concatenate([(rows.W @ theta - rows.tau)[rows.use] for rows in found.blocks])
    measured = np.concatenate([rows.tau[rows.use] for rows in found.blocks])
    error = np.linalg.norm(residual) / np.linalg.norm(measured)
    assert found.consistent_fit["relative_error"] == pytest.approx(error, rel=1e-9)


@pytest.mark.parametrize(
    ("fixed", "message"),
    [({"fv9": 1.0}, "no parameter 'fv9'"), ({"fc2": -3.0}, "'fc2' is -3; it must not be negative")],
)
def test_known_values_that_no_parameter_has_are_refused(arm, logs, fixed, message):
    with pytest.raises(InputError, match=message):
        identify(arm, logs[:1], KALMAN, Options(terms=TERMS, fixed=fixed))


@pytest.mark.parametrize("method", ["ordinary", "robust"])
def test_other_estimators(arm, logs, method):
    spoiled = Log(logs[0].joints, logs[0].t, logs[0].q, logs[0].tau.copy(), period=PERIOD)
    if method == "robust":
        hit = np.random.default_rng(0).random(spoiled.tau.shape) < 0.02
        spoiled.tau[hit] += 20.0
    options = Options(method=method, terms=TERMS, poses=10, consistent=False)
    found = identify(arm, [spoiled], Processing("butterworth", cutoff=20.0, decimate=2), options)
    truth = found.structure.G @ np.concatenate([arm.beta, FRICTION])
    assert np.max(np.abs(found.estimate.x - truth) / found.estimate.std) < 4.0
    with pytest.raises(InputError, match="unknown method"):
        identify(arm, [spoiled], KALMAN, Options(method="magic", terms=TERMS))


def test_a_recording_on_disk_gives_the_same(arm, logs, result, tmp_path):
    streams = []
    for k, log in enumerate(logs):
        write_log(tmp_path / f"{k}.csv", log)
        streams.append(LogStream(open_log(tmp_path / f"{k}.csv"), chunk=3000))
    found = identify(arm, streams, result.processing, Options(terms=TERMS, poses=10))
    np.testing.assert_allclose(found.estimate.x, result.estimate.x, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.estimate.std, result.estimate.std, rtol=1e-6)


def test_estimates_settle(result):
    """Fig. 14.12: every parameter comes to rest, and the last point is the estimate."""
    settling = convergence(result.blocks, result.names, result.estimate.weights, result.transform, every=40)
    np.testing.assert_allclose(settling.x[-1], result.estimate.x, rtol=1e-7, atol=1e-9)
    assert settling.samples[-1] == sum(len(rows.t) for rows in result.blocks)
    half = settling.x[len(settling.x) // 2 :]
    assert np.all(np.abs(half - settling.x[-1]) < 6 * result.estimate.std)
    assert settling.condition[-1] == pytest.approx(result.estimate.condition, rel=0.5)


def test_a_run_folder_holds_it_all_and_is_reproducible(arm, logs, tmp_path, every_figure):
    write_log(tmp_path / "log.csv", logs[0])
    log = load_stream(LogStream(open_log(tmp_path / "log.csv")))
    options = Options(split=Split.parse("blocks:1"), poses=50, essential=True)
    found = identify(arm, [log], KALMAN, options)
    with RunFolder(tmp_path / "run", "identify", {"log": tmp_path / "log.csv"}, {}) as folder:
        write_identification(folder, found, arm.spec, points=30)
    results, figures = folder.path / "results", folder.path / "figures"
    for name in ("torques", "torques_held_out", "convergence", "whiteness"):
        assert (figures / f"{name}.svg").read_text().startswith("<?xml")
        assert (figures / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    record = json.loads((results / "identification.json").read_text())
    assert record["identifiable_parameters"] == 15
    assert 0 < record["relative_error_held_out"] < 1  # the friction of this arm is not in its file
    identified = rrrgen.loads_spec((results / "robot.yaml").read_text())
    assert all(link.mass > 0 for link in identified.links)
    # once more: the same numbers to the last bit, and the same bytes of a figure
    again = identify(arm, [log], KALMAN, options)
    assert plain(as_record(again, ("q1", "q2", "q3"))) == record
    with RunFolder(tmp_path / "again", "identify", {"log": tmp_path / "log.csv"}, {}) as other:
        other.figure("whiteness", plot_whiteness(again.whiteness, log.joints))
    for suffix in (".svg", ".png"):
        assert (other.path / f"figures/whiteness{suffix}").read_bytes() == (figures / f"whiteness{suffix}").read_bytes()


def test_bode_plot_of_the_filter():
    matrices = kalman_matrices(1e-3, ENCODER**2 / 12, 400.0)
    data = bode_data(matrices)
    assert data.shape == (400, 4)
    assert 3.2 < data[:, 1].max() < 3.6
    figure = plot_bode([matrices] * 3, ["q1", "q2", "q3"], smoother=True)
    assert len(figure.axes[0].lines) == 6


PRISMATIC = """
schema: rrrgen/1
name: slide
convention: standard
units: {angle: deg, length: mm}
gravity: [0, 0, -9.81]
joints:
  - name: lift
    type: prismatic
    alpha: 0
    a: 0
    theta: 0
    friction: {viscous: 0, coulomb: 0, offset: 0}
    drive: {inertia: 0}
"""

SLIDE_LOG = """
schema: rrrgen-log/1
files: {file}
time: {{column: "{t}", unit: ms}}
joints:
  - name: lift
    position: {{column: "{q}", unit: mm, zero: 250}}
    torque: {{column: "{i}", unit: A, constant: 42 N/A, sign: -1}}
processing: {{method: kalman}}
"""


@pytest.mark.parametrize("kind", ["csv", "mat"])
def test_a_prismatic_drive_never_seen_before(tmp_path, kind):
    """From two YAML files alone: mass 12 kg and drive 3 kg on a vertical axis, which gravity tells apart."""
    (tmp_path / "slide.yaml").write_text(PRISMATIC)
    t = PERIOD * np.arange(3000)
    q, dq, ddq = (0.05 * v for v in fourier_motion(t, 1, 3, base=0.25, harmonics=8, size=3.0))
    rng = np.random.default_rng(5)
    force = 12.0 * (ddq + 9.81) + 3.0 * ddq + 40.0 * dq + 9.0 * np.sign(dq) + 2.0 * rng.normal(size=q.shape)
    column = np.column_stack([t * 1e3, np.round(q * 1e6) / 1e3 + 250.0, -force / 42.0])
    if kind == "csv":
        rows = [";".join(f"{v:.9f}".replace(".", ",") for v in row) for row in column]
        (tmp_path / "log.csv").write_text("Zeit;Weg;Strom\nms;mm;A\n" + "\n".join(rows) + "\n")
        text = SLIDE_LOG.format(file="log.csv", t="Zeit", q="Weg", i="Strom")
    else:
        from scipy.io import savemat

        savemat(tmp_path / "log.mat", {"data": column})
        text = SLIDE_LOG.format(file="log.mat", t="data(1)", q="data(2)", i="data(3)")
    (tmp_path / "log.yaml").write_text(text)
    model = rrrgen.compile(tmp_path / "slide.yaml", backend="numpy")
    mapping = open_log(tmp_path / "log.yaml")
    check_robot(mapping, model.spec)
    log = load_stream(LogStream(mapping))
    found = identify(model, [log], Processing(**mapping.processing), Options(poses=100))
    assert [column.name for column in found.columns][1:] == ["Ia1", "fv1", "fc1", "off1"]
    truth = found.structure.G @ np.array([12.0, 3.0, 40.0, 9.0, 0.0])
    assert np.max(np.abs(found.estimate.x - truth) / found.estimate.std) < 4
    # the offset is no different from the weight of the load on this axis
    assert any("off1 is not identifiable alone" in note for note in found.structural_notes)
    assert found.consistent.phi[0] > 0
    assert found.held_out["rows"] == 0


def test_units_that_do_not_suit_the_joints_are_refused(arm, logs, tmp_path):
    write_log(tmp_path / "log.csv", logs[0])
    rows = "".join(
        f"  - {{name: {j}, position: {{column: q_{j}, unit: mm}}, torque: {{column: tau_{j}, unit: N}}}}\n"
        for j in logs[0].joints
    )
    text = "schema: rrrgen-log/1\nfiles: log.csv\ntime: {column: t, unit: s}\njoints:\n" + rows
    (tmp_path / "log.yaml").write_text(text)
    with pytest.raises(InputError) as caught:
        check_robot(open_log(tmp_path / "log.yaml"), arm.spec)
    assert len(caught.value.faults) == 6
    assert "is revolute, but its position is in mm" in str(caught.value)


def test_recordings_of_another_robot_are_refused(arm):
    with pytest.raises(InputError, match="2 joints"):
        identify(arm, [Log(("a", "b"), np.arange(50.0), np.zeros((50, 2)), np.zeros((50, 2)), period=1.0)], KALMAN)
    with pytest.raises(InputError, match="no torques"):
        identify(
            arm,
            [Log(("a", "b", "c"), PERIOD * np.arange(500), fourier_motion(PERIOD * np.arange(500), 3, 0)[0])],
            Processing("differences"),
            Options(terms=TERMS),
        )


@pytest.fixture
def turntable(tmp_path):
    """Robot file of one vertical joint with viscous and Coulomb friction."""
    file = tmp_path / "turntable.yaml"
    file.write_text(
        "schema: rrrgen/1\nname: turntable\nconvention: standard\ngravity: [0, 0, -9.81]\n"
        "units: {angle: rad, length: m}\njoints: [{name: q1, type: revolute, alpha: 0, a: 0.1, d: 0, theta: 0, "
        "friction: {viscous: 0, coulomb: 0}}]\n",
        encoding="utf-8",
    )
    return file


def test_a_joint_that_sticks_at_its_reversals_does_not_bias_its_friction(turntable):
    """While the joint stands, its torque goes from one Coulomb friction to the other, slowly first.

    The sign of the reconstructed speed is then that of an error: friction came out 5 % and five deviations off.
    """
    truth = np.array([0.07, 0.5, 0.35])  # inertia, viscous and Coulomb friction
    t = np.arange(80_000) * 1e-4
    wave = np.sin(np.pi * t) + 0.4 * np.sin(3 * np.pi * t)
    rate = np.pi * np.cos(np.pi * t) + 1.2 * np.pi * np.cos(3 * np.pi * t)
    dq = np.sign(wave) * np.maximum(np.abs(wave) - 0.16, 0.0)
    rising = np.sign(rate)
    standing = rising * (2.0 * np.clip(0.5 + 0.5 * rising * wave / 0.16, 0.0, 1.0) ** 3 - 1.0)
    held = np.where(dq == 0.0, standing, np.sign(dq))  # friction over its Coulomb part
    q = cumulative_trapezoid(dq, t, initial=0.0)
    tau = truth @ [np.where(dq == 0.0, 0.0, rate), dq, held] + np.random.default_rng(3).normal(0.0, 1e-3, len(t))
    recording = {"t": t[::10], "q": q[::10, None], "tau": tau[::10, None]}
    estimate = rrrgen.identify(turntable, recording).identification.estimate
    assert estimate.names[1:] == ("fv1", "fc1")
    assert np.all(np.abs(estimate.x - truth) < 4.0 * estimate.std), (estimate.x - truth) / estimate.std
    assert estimate.x == pytest.approx(truth, rel=1e-3)


@pytest.mark.parametrize("period", [1.0, 2.0])
def test_the_jump_of_the_acceleration_at_a_reversal_does_not_bias_the_inertia(turntable, period):
    """At 10 rad/s^2, no sample is slow: the sign of the speed changes between two of them, and nothing was left out.

    The inertia came out 2e-3 too large, four deviations.
    """
    inertia, viscous, coulomb = truth = np.array([0.073, 0.514, 0.341])
    step, every = 2e-5, 50
    t = np.arange(300_000) * step
    drive = 1.2 * np.sin(2 * np.pi * t / period) + 0.5 * np.sin(6 * np.pi * t / period + 1.0)
    q, dq, positions = 0.0, 0.3, np.zeros(len(t))
    for k, torque in enumerate(drive.tolist()):
        positions[k] = q
        if dq == 0.0 and abs(torque) <= coulomb:
            continue
        direction = dq or torque
        after = dq + step * (torque - viscous * dq - np.copysign(coulomb, direction)) / inertia
        after = 0.0 if after * dq < 0.0 else after  # at rest before it reverses
        q, dq = q + step * (dq + after) / 2.0, after
    rng = np.random.default_rng(0)
    rows = {
        "t": t[::every],
        "q": positions[::every, None] + rng.normal(0.0, 4e-8, (6000, 1)),
        "tau": drive[::every, None] + rng.normal(0.0, 1e-3, (6000, 1)),
    }
    estimate = rrrgen.identify(turntable, rows).identification.estimate
    assert estimate.x[0] == pytest.approx(truth[0], rel=1e-4)
    assert np.all(np.abs(estimate.x - truth) < 4.0 * estimate.std), (estimate.x - truth) / estimate.std
