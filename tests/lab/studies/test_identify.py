"""Identification as a function: from arrays without files, with the numbers and the files of the command."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

import rrrgen
from rrrgen.base.errors import DerivationError, InputError
from rrrgen.cli.main import cli
from rrrgen.lab.data.recordings import Log
from samples.recordings import fourier_motion, write_log

OPTIONS = {"split": "blocks:1", "decimate": 4, "consistent": False}


@pytest.fixture(scope="module")
def arrays():
    """A recording of planar2r: exact torques of its compiled model with a little noise."""
    t = np.arange(2000) / 200.0
    q, dq, ddq = fourier_motion(t, 2, seed=4)
    tau = rrrgen.compile("planar2r").inverse_dynamics(q, dq, ddq)
    return {"t": t, "q": q, "tau": tau + 0.01 * np.random.default_rng(1).normal(size=tau.shape)}


@pytest.fixture(scope="module")
def result(arrays):
    return rrrgen.identify("planar2r", arrays, **OPTIONS)


def test_arrays_give_the_numbers_of_the_command(arrays, result, tmp_path):
    write_log(tmp_path / "log.csv", Log(joints=("q1", "q2"), **arrays))
    given = ["--split", "blocks:1", "--decimate", "4", "--no-consistent", "--json"]
    command = ["identify", "planar2r", "--log", str(tmp_path / "log.csv"), "-o", str(tmp_path / "run"), *given]
    run = CliRunner().invoke(cli, command, standalone_mode=False, catch_exceptions=False)
    assert run.return_value == 0, run.output
    own, wanted = result.to_json(), json.loads(run.stdout)
    own["repairs"][0].pop("recording"), wanted["repairs"][0].pop("recording")  # the name of the file
    assert own == wanted


@pytest.mark.parametrize("study", [rrrgen.identify, rrrgen.validate])
@pytest.mark.parametrize("torque", [0.0, np.nan, np.inf, 1e-200, 1e200])
def test_a_joint_without_a_recorded_torque_is_named(arrays, study, torque):
    """A column of zeros, as loggers write for a drive that is not read, ended in a failed decomposition."""
    silent = arrays["tau"].copy()
    silent[:, 1] = torque
    with pytest.raises(InputError, match="no torque of q2 was recorded"):
        study("planar2r", arrays | {"tau": silent})


@pytest.mark.parametrize("torque", [0.0, np.nan])
def test_a_joint_whose_torque_is_recorded_for_half_of_the_time_only(arrays, torque):
    half = arrays["tau"].copy()
    half[:1000, 1] = torque
    found = rrrgen.identify("planar2r", arrays | {"tau": half}, **OPTIONS)
    assert np.isfinite(found.values).all()
    if np.isnan(torque):
        whole = rrrgen.identify("planar2r", arrays, **OPTIONS)
        assert (np.abs(found.values - whole.values) < 5 * np.hypot(found.std, whole.std)).all()


def test_precise_torques_of_the_wrong_sign_are_diagnosed():
    """No physically consistent estimate is near: the error was that of the solver, and the diagnosis came too late."""
    t = np.arange(2000) / 200.0
    q, dq, ddq = fourier_motion(t, 3, seed=4)
    tau = -rrrgen.compile("rrr").inverse_dynamics(q, dq, ddq)
    with pytest.raises(DerivationError, match="no arm that can be built is near the least-squares estimate") as caught:
        rrrgen.identify("rrr", {"t": t, "q": q, "tau": tau}, decimate=4)
    for joint in ("q1", "q2", "q3"):
        assert f"diagnosis: the torque or the position of joint {joint} has the wrong sign" in str(caught.value)


def test_the_estimate_is_that_of_the_model(result):
    spec = rrrgen.load_spec("planar2r")
    model = rrrgen.compile(spec)
    truth = dict(zip(model.base_parameter_names, model.beta, strict=True))
    for name in result.names:
        if name in truth:
            # the noise is 1e-2 of about 5 N m; the filters cost less than that
            assert float(result[name]) == pytest.approx(truth[name], abs=0.02 * max(map(abs, truth.values())))
    with pytest.raises(KeyError, match="there are"):
        result["nothing"]


def test_saving_writes_what_a_run_writes(arrays, result, tmp_path):
    rrrgen.identify("planar2r", arrays, folder=tmp_path / "run", **OPTIONS)
    result.save(tmp_path / "saved")
    files = {file.relative_to(tmp_path / "run") for file in (tmp_path / "run").rglob("*") if file.is_file()}
    assert {str(file) for file in files} >= {"run.json", "results/parameters.csv", "figures/torques.svg"}
    for file in files - {file for file in files if file.parts[0] == "checkpoints"}:
        assert (tmp_path / "saved" / file).read_bytes() == (tmp_path / "run" / file).read_bytes(), file


def test_a_folder_does_not_mix_recordings(arrays, result, tmp_path):
    result.save(tmp_path)
    other = {**arrays, "tau": arrays["tau"] * 1.001}
    with pytest.raises(rrrgen.InputError, match="other inputs, settings or seed"):
        rrrgen.identify("planar2r", other, folder=tmp_path, **OPTIONS)


def test_an_interrupted_run_goes_on_to_the_same_result(arrays, tmp_path, monkeypatch):
    """Recordings that do not fit in memory are factored window by window; no window is factored twice."""
    monkeypatch.setattr("rrrgen.lab.identify.identification.fits_in_memory", lambda observations: False)
    counts = []

    def count(done, total, message):
        if message.endswith("samples"):
            counts.append(done)

    def interrupt(done, total, message):
        count(done, total, message)
        if len(counts) == 2:
            raise KeyboardInterrupt

    options = {"decimate": 4, "consistent": False}
    with pytest.raises(KeyboardInterrupt):
        rrrgen.identify("planar2r", arrays, folder=tmp_path, progress=interrupt, **options)
    assert json.loads((tmp_path / "run.json").read_text())["status"] == "interrupted"
    resumed = rrrgen.identify("planar2r", arrays, folder=tmp_path, progress=count, **options)
    assert json.loads((tmp_path / "run.json").read_text())["status"] == "finished"
    together = counts.copy()
    counts.clear()
    assert resumed.to_json() == rrrgen.identify("planar2r", arrays, progress=count, **options).to_json()
    assert together == counts


def test_without_a_folder_nothing_is_written(arrays, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rrrgen.identify("planar2r", arrays, **OPTIONS)
    assert list(tmp_path.iterdir()) == []


def test_a_result_prints_draws_and_shows_itself(result):
    assert "relative" in repr(result) or "%" in repr(result)
    assert result._repr_html_().count("<tr>") == len(result.names) + 1
    assert result.plot("torques").axes
    with pytest.raises(rrrgen.InputError, match="did you mean 'torques'"):
        result.plot("torqes")


def test_the_identified_robot_compiles(arrays):
    pytest.importorskip("cvxpy")
    result = rrrgen.identify("planar2r", arrays, split="blocks:1", decimate=4)
    model = rrrgen.compile(result.spec)
    t, q = arrays["t"], arrays["q"]
    _, dq, ddq = fourier_motion(t, 2, seed=4)
    tau = model.inverse_dynamics(q, dq, ddq)
    # noise of 0.01 N m on the torques
    assert np.sqrt(np.mean((tau - arrays["tau"]) ** 2)) < 0.02


def test_findings_come_before_the_fit_and_progress_is_told(arrays):
    findings, messages = [], []
    damaged = {**arrays, "t": arrays["t"].copy()}
    damaged["t"][[500, 501]] = damaged["t"][[501, 500]]
    rrrgen.identify(
        "planar2r",
        damaged,
        findings=findings.append,
        progress=lambda done, total, message: messages.append(message),
        **OPTIONS,
    )
    assert "rows out of order" in [finding.kind for repairs in findings[:1] for finding in repairs.findings]
    assert "diagnosis" in messages


def test_several_recordings_and_models_are_taken(arrays):
    half = len(arrays["t"]) // 2
    parts = [{key: values[rows] for key, values in arrays.items()} for rows in (slice(0, half), slice(half, None))]
    result = rrrgen.identify(rrrgen.compile("planar2r"), parts, decimate=4, consistent=False)
    assert len(result.recordings) == 2


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"tua": 1}, "did you mean 'tau'"),
        ({"q": np.zeros((2000, 3))}, r"'q' has the shape \(2000, 3\), not \(2000, 2\)"),
        ({"tau": ["a"] * 2000}, "'tau' does not hold numbers"),
    ],
)
def test_arrays_that_are_no_recording_are_refused(arrays, change, message):
    with pytest.raises(rrrgen.InputError, match=message):
        rrrgen.identify("planar2r", {**arrays, **change})


def test_a_recording_that_is_given_twice_is_refused(arrays, tmp_path):
    with pytest.raises(rrrgen.InputError, match="log1 and log2 are one recording, given twice"):
        rrrgen.identify("planar2r", [arrays, dict(arrays)], **OPTIONS)
    write_log(tmp_path / "log.csv", Log(joints=("q1", "q2"), **arrays))
    with pytest.raises(rrrgen.InputError, match=r"log\.csv is given twice"):
        rrrgen.identify("planar2r", [tmp_path / "log.csv", tmp_path / "." / "log.csv"], **OPTIONS)


def test_the_same_file_by_two_mapping_files_is_one_recording(arrays, tmp_path):
    write_log(tmp_path / "log.csv", Log(joints=("q1", "q2"), **arrays))
    rows = "".join(
        f"  - {{name: {name}, position: {{column: q_{name}, unit: rad}}, torque: {{column: tau_{name}, unit: N*m}}}}\n"
        for name in ("q1", "q2")
    )
    head = "schema: rrrgen-log/1\nfiles: log.csv\ntime: {column: t, unit: s}\njoints:\n"
    (tmp_path / "log.yaml").write_text(head + rows)
    with pytest.raises(rrrgen.InputError, match=r"log\.csv and .*log\.yaml are one recording, given twice"):
        rrrgen.identify("planar2r", [tmp_path / "log.csv", tmp_path / "log.yaml"], **OPTIONS)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"spilt": "none"}, "did you mean 'split'"),
        ({"estimator": "robsut"}, "did you mean 'robust'"),
        ({"cross_validate": 2, "split": "first:0.5"}, "^cross_validate holds out every part in turn: leave split away"),
        ({"guard": 1}, "^guard keeps away from the borders of split: give a split, too"),
        ({"split": "first:0.6", "guard": 30}, "^no row is left to fit .*without 30 s on .*a smaller guard"),
        ({"split": "first:0.6", "guard": 3.99}, "^no row is held out .*without 3.99 s on .*a smaller guard"),
        ({"tests": "x.csv"}, "^tests scores the simulated loop: give its controller, too"),
        ({"fix": "my2"}, "'my2' is not NAME=VALUE"),
        ({"fix": "my2=1e999"}, "'my2=1e999' is not NAME=VALUE"),
        ({"fix": ["fv1=3", "my2=0", "fv1=4"]}, "^fix gives fv1 two values, 3 and 4"),
        ({"split": "blocks:100"}, "^no row is held out: between blocks of 100 s there is none in recordings of 9.99 s"),
        ({"cutoff": 0.05}, "^no row is left: a filter with a cut-off of 0.05 Hz needs more than the 9.99 s"),
        ({"friction": ["stribeck", "dahl"]}, "^two friction laws at all joints, stribeck and dahl"),
        ({"method": "kalman", "cutoff": 3}, "cutoff belongs to method butterworth, not to kalman"),
    ],
)
def test_options_that_make_no_sense_are_refused(arrays, options, message):
    with pytest.raises(rrrgen.InputError, match=message):
        rrrgen.identify("planar2r", arrays, **options)
