"""Whether data were fitted is told from their samples: in any format, cut, rounded or split."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

import rrrgen
from rrrgen.base.errors import InputError
from rrrgen.cli.main import cli
from rrrgen.lab.data.recordings import Log, open_log
from rrrgen.lab.data.uniform_stream import LogStream
from rrrgen.lab.identify.held_out_data import Split
from rrrgen.lab.identify.scores import SMALLEST, common_share, fingerprint
from rrrgen.robot.file import dumps
from rrrgen.robot.identity import identify
from rrrgen.robot.spec import FitSpec
from samples.recordings import fourier_motion, write_log


def recording(joints=2, seed=0, rate=500.0, seconds=20.0, noise=0.02, resolution=1e-5):
    t = np.arange(round(rate * seconds)) / rate
    q, dq, ddq = fourier_motion(t, joints, seed)
    rng = np.random.default_rng(seed)
    tau = 3.0 * ddq + dq + 0.5 * np.sign(dq) + noise * rng.normal(size=q.shape)
    return Log(tuple(f"j{i}" for i in range(joints)), t, np.round(q / resolution) * resolution, tau, period=1 / rate)


def changed(log, q=None, tau=None, rows=slice(None), start=0.0, slower=1):
    q, tau = (log.q if q is None else q), (log.tau if tau is None else tau)
    return Log(log.joints, log.t[rows] - start, q[rows], tau[rows], period=slower * log.period)


def digits(x, count):
    return np.vectorize(lambda value: float(f"{value:.{count}g}"))(x)


@pytest.mark.parametrize("joints", [1, 2, 6])
def test_the_same_samples_are_told_from_others(joints):
    log = recording(joints)
    known = fingerprint([log])
    assert len(known.hashes) == SMALLEST
    assert known.windows > 9000
    same = common_share([known], [log])
    assert (same.label, same.share, same.looked) == ("its own data", 1.0, SMALLEST)
    for seed in range(1, 6):
        other = common_share([known], [recording(joints, seed)])
        assert (other.label, other.share) == ("held-out data", 0.0)
        assert other.looked > 300
    # the same motion measured once more is another measurement
    again = recording(joints)
    rng = np.random.default_rng(99)
    again = changed(again, tau=again.tau + 0.5 * rng.normal(size=again.tau.shape))
    assert common_share([known], [again]).label == "held-out data"


def test_noise_free_recordings_of_one_joint_are_told_apart_too():
    known = fingerprint([recording(1, 0, noise=0.0, resolution=1e-12)])
    for seed in range(1, 6):
        assert common_share([known], [recording(1, seed, noise=0.0, resolution=1e-12)]).share < 0.01


@pytest.mark.parametrize(("count", "least"), [(9, 0.999), (7, 0.98), (6, 0.8), (5, 0.1)])
def test_how_many_digits_it_takes_to_know_samples_again(count, least):
    log = recording(3)
    rounded = changed(log, digits(log.q, count), digits(log.tau, count))
    assert common_share([fingerprint([log])], [rounded]).share > least


def test_units_offsets_of_the_clock_and_gaps_do_not_matter():
    log = recording(3)
    q = np.radians(np.degrees(log.q))
    known = fingerprint([log])
    assert not np.array_equal(q, log.q)
    assert common_share([known], [changed(log, q, log.tau * 1e3 * 1e-3, start=-1234.5)]).share > 0.99
    some = np.random.default_rng(0).random(len(log.t)) > 0.05
    assert common_share([known], [changed(log, rows=some)]).label == "its own data"
    assert common_share([known], [changed(log, rows=slice(None, None, 2), slower=2)]).label == "its own data"
    holed = np.where(np.arange(len(log.t))[:, None] % 1000 < 10, np.nan, log.tau)
    assert common_share([known], [changed(log, tau=holed)]).label == "its own data"


def test_parts_are_recognised_and_measured():
    log, other = recording(3), recording(3, 1)
    known = fingerprint([log])
    part = changed(log, rows=slice(4000, 5000), start=8.0)
    assert common_share([known], [part]).label == "its own data"
    mixed = common_share([known], [part, other])
    assert mixed.label == "partly its own data"
    assert mixed.share == pytest.approx(1 / 11, abs=0.04)
    both = common_share([known, fingerprint([other])], [log, other])
    assert both.label == "its own data"
    assert fingerprint([log, other]).windows == known.windows + fingerprint([other]).windows


@pytest.mark.parametrize("split", ["first:0.6", "blocks:2"])
def test_only_the_fitted_part_is_its_own(split):
    log = recording(3)
    chosen = Split.parse(split).with_guard(0.1)
    known = fingerprint([log], chosen)
    whole = common_share([known], [log])
    assert whole.label == "partly its own data"
    assert whole.share == pytest.approx(0.6 if split == "first:0.6" else 0.5, abs=0.07)
    held_out = Split.parse(split).is_scored(log.t, *log.span)
    first = int(np.argmax(held_out))
    last = first + int(np.argmin(held_out[first:])) if not held_out[first:].all() else len(log.t)
    assert common_share([known], [changed(log, rows=slice(first, last))]).label == "held-out data"


def test_blocks_of_a_file_without_a_fitted_sample_are_no_obstacle(tmp_path):
    log = recording(2, seconds=6.0)
    write_log(tmp_path / "log.csv", log)
    split = Split.parse("first:0.5")
    streamed = fingerprint([LogStream(open_log(tmp_path / "log.csv"), chunk=500)], split)
    assert streamed == fingerprint([log], split)


MAPPING = """
schema: rrrgen-log/1
files: {file}
time: {{column: "{t}", unit: s}}
units: {{position: {unit}, torque: N*m}}
joints:
  - {{name: j0, position: "{q}0{e}", torque: "{tau}0{e}"}}
  - {{name: j1, position: "{q}1{e}", torque: "{tau}1{e}"}}
"""


def test_every_format_gives_the_same_hashes(tmp_path):
    from scipy.io import savemat

    log = recording(2, seconds=5.0)
    write_log(tmp_path / "plain.csv", log)
    table = np.column_stack([log.t, np.degrees(log.q), log.tau])
    header = "zeit;w0;w1;m0;m1"
    text = [";".join(f"{v:.9g}".replace(".", ",") for v in row) for row in table]
    (tmp_path / "comma.csv").write_text("\n".join([header, *text]) + "\n")
    np.savez(tmp_path / "arrays.npz", t=log.t, q=log.q, tau=log.tau)
    savemat(tmp_path / "cell.mat", {"t": log.t, "q": np.degrees(log.q), "tau": log.tau})
    formats = {
        "comma.csv": {"t": "zeit", "unit": "deg", "q": "w", "tau": "m", "e": ""},
        "arrays.npz": {"t": "t", "unit": "rad", "q": "q[", "tau": "tau[", "e": "]"},
        "cell.mat": {"t": "t", "unit": "deg", "q": "q[", "tau": "tau[", "e": "]"},
    }
    known = fingerprint([LogStream(open_log(tmp_path / "plain.csv"))])
    assert known == fingerprint([LogStream(open_log(tmp_path / "plain.csv"), chunk=333)])
    for file, names in formats.items():
        (tmp_path / "log.yaml").write_text(MAPPING.format(file=file, **names))
        found = common_share([known], [LogStream(open_log(tmp_path / "log.yaml"))])
        assert found.share > 0.99, file


def test_the_provenance_of_a_robot_file_is_read_back_and_changes_nothing_else():
    spec = rrrgen.load_spec("planar2r")
    fits = (
        FitSpec(tuple(range(3, 30)), 400, 'rrrgen "x"', "a.csv, b.csv", "all"),
        FitSpec((0, 2**48 - 1), 2),
    )
    from dataclasses import replace

    text = dumps(replace(spec, provenance=fits))
    back = rrrgen.loads_spec(text)
    assert back.faults == ()
    assert back.provenance == fits
    assert dumps(back) == text
    assert identify(back).model_hash == identify(spec).model_hash


@pytest.mark.parametrize(
    ("old", "new", "message", "line_holds"),
    [
        ("method: rrrgen-samples/1", "method: md5", "method: 'md5' is not allowed", "md5"),
        ("windows: 400", "windows: many", "windows of fit 1 of provenance is 'many', not a whole number", "many"),
        ("windows: 400", "windows: 3", "fewer than its 27 hashes", "windows: 3"),
        ('"0000000000030', '"x000000000030', "has the line 'x0000", "x0000"),
        ('"0000000000030', '"ffff000000030', "not in rising order", "ffff"),
        ("    windows: 400\n", "", "needs the key 'windows'", "method"),
        ("    windows: 400\n", "    windows: 400\n    wnidows: 3\n", "unknown key 'wnidows'", "wnidows"),
    ],
)
def test_faults_of_the_provenance_are_located(old, new, message, line_holds):
    from dataclasses import replace

    text = dumps(replace(rrrgen.load_spec("planar2r"), provenance=(FitSpec(tuple(range(3, 30)), 400),)))
    assert old in text
    with pytest.raises(InputError) as caught:
        rrrgen.loads_spec(text.replace(old, new, 1))
    fault = caught.value.faults[0]
    assert message in fault.message
    assert fault.line > 0
    assert line_holds in text.replace(old, new, 1).splitlines()[fault.line - 1] + fault.source_line


def run(*arguments):
    return CliRunner().invoke(cli, [str(a) for a in arguments], standalone_mode=False, catch_exceptions=False)


def test_validate_knows_by_itself_what_was_fitted(tmp_path):
    model = rrrgen.compile("planar2r")
    for seed in (1, 2):
        t = np.arange(1000) / 125.0
        q, dq, ddq = fourier_motion(t, 2, seed)
        tau = model.inverse_dynamics(q, dq, ddq) + 0.2 * np.random.default_rng(seed).normal(size=q.shape)
        write_log(tmp_path / f"{seed}.csv", Log(("q1", "q2"), t, np.round(q, 6), tau, period=8e-3))
    np.savez(
        tmp_path / "same.npz",
        **{
            n: np.genfromtxt(tmp_path / "1.csv", names=True, delimiter=",")[n]
            for n in ("t", "q_q1", "q_q2", "tau_q1", "tau_q2")
        },
    )
    fit = run("identify", "planar2r", "--log", tmp_path / "1.csv", "-o", tmp_path / "fit")
    assert fit.return_value == 0, fit.output
    robot = tmp_path / "fit" / "results" / "robot.yaml"
    assert 'recordings: "1.csv"' in robot.read_text()
    for number, (log, words, label, code) in enumerate(
        [
            ("same.npz", ("--require-held-out", "--decimate", 2), "its own data", 1),
            ("2.csv", ("--require-held-out",), "held-out data", 0),
        ]
    ):
        out = tmp_path / f"out{number}"
        result = run("experiment", "validate", robot, "--log", tmp_path / log, *words, "-o", out)
        assert result.return_value == code, result.output
        assert f"scored on {label} (" in result.output
        record = json.loads((out / "results" / "validation.json").read_text())
        assert record["scored_on"] == label
        assert record["share_of_own_data"] == (0.0 if label == "held-out data" else 1.0)
    unknown = run(
        "experiment",
        "validate",
        "planar2r",
        "--log",
        tmp_path / "1.csv",
        "--require-held-out",
        "-o",
        tmp_path / "unknown",
    )
    assert unknown.return_value == 1
    assert "data of unknown origin" in unknown.output
    words = ("--require-held-out", "--fitted-on", "none")
    said = run("experiment", "validate", "planar2r", "--log", tmp_path / "1.csv", *words, "-o", tmp_path / "said")
    assert said.return_value == 0
    assert "scored on held-out data; passed" in said.output
