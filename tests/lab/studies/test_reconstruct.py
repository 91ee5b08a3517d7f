"""Reconstruction as a function: from arrays without files, with the numbers of the command."""

import csv
import json

import numpy as np
import pytest
from click.testing import CliRunner

import rrrgen
from rrrgen.cli.main import cli
from rrrgen.lab.data.recordings import Log
from samples.recordings import fourier_motion, write_log


@pytest.fixture(scope="module")
def motion():
    t = np.arange(1000) / 200.0
    return t, *fourier_motion(t, 2, seed=4)


@pytest.fixture(scope="module")
def result(motion):
    return rrrgen.reconstruct({"t": motion[0], "q": motion[1]})


def test_arrays_give_the_motion_of_the_command(motion, result, tmp_path):
    t, q, _, _ = motion
    write_log(tmp_path / "log.csv", Log(joints=("q1", "q2"), t=t, q=q, tau=np.ones_like(q)))
    command = ["experiment", "reconstruct", str(tmp_path / "log.csv"), "-o", str(tmp_path / "run"), "--json"]
    run = CliRunner().invoke(cli, command, standalone_mode=False, catch_exceptions=False)
    assert run.return_value == 0, run.output
    assert json.loads(run.stdout) == result.to_json()
    with (tmp_path / "run" / "results" / "motion.csv").open() as file:
        header, *rows = csv.reader(file)
    assert header == ["t", "q_q1", "q_q2", "dq_q1", "dq_q2", "ddq_q1", "ddq_q2"]
    own = np.column_stack([result.t, result.q, result.dq, result.ddq])
    assert np.array_equal(np.array(rows, float), own)  # every float reads back exactly
    result.save(tmp_path / "saved")
    for name in ("results/motion.csv", "results/tuning.json", "figures/bode.svg"):
        assert (tmp_path / "saved" / name).read_bytes() == (tmp_path / "run" / name).read_bytes()


def test_the_motion_is_the_true_one(motion, result):
    _, _, dq, ddq = motion
    inner = slice(50, -50)  # a smoother knows less at the ends
    # the positions have no noise: what is left is the band of the smoother
    assert np.abs(result.dq - dq)[inner].max() < 0.01 * np.abs(dq).max()
    assert np.abs(result.ddq - ddq)[inner].max() < 0.05 * np.abs(ddq).max()


def test_another_method_has_no_bode_plot(motion):
    t, q, _, _ = motion
    by_filter = rrrgen.reconstruct({"t": t, "q": q}, cutoff=20)
    assert by_filter.processing.method == "butterworth"
    with pytest.raises(rrrgen.InputError, match="no figures"):
        by_filter.plot()
    assert by_filter._repr_html_().count("<tr>") == 3


def test_one_joint_and_wrong_options(motion):
    t, q, _, _ = motion
    assert rrrgen.reconstruct({"t": t, "q": q[:, 0]}, method="differences").dq.shape == (1000, 1)
    with pytest.raises(rrrgen.InputError, match="did you mean 'cutoff'"):
        rrrgen.reconstruct({"t": t, "q": q}, cutof=20)
    with pytest.raises(rrrgen.InputError, match="no 't'"):
        rrrgen.reconstruct({"q": q})


def test_a_joint_at_rest_is_named_with_the_filter_that_takes_it(motion, tmp_path):
    t, q, _, _ = motion
    resting = q * [1.0, 0.0] + 0.3
    with pytest.raises(rrrgen.InputError, match=r"^joint q2 does not move at all.* method butterworth needs no noise"):
        rrrgen.reconstruct({"t": t, "q": resting})
    with pytest.raises(rrrgen.InputError, match=r"^no joint moves"):
        rrrgen.reconstruct({"t": t, "q": 0.0 * q})
    assert np.abs(rrrgen.reconstruct({"t": t, "q": resting}, method="butterworth").dq[:, 1]).max() < 1e-9
    write_log(tmp_path / "log.csv", Log(joints=("base", "wrist"), t=t, q=resting, tau=np.ones_like(q)))
    command = ["experiment", "reconstruct", str(tmp_path / "log.csv"), "-o", str(tmp_path / "run")]
    run = CliRunner().invoke(cli, command, standalone_mode=False)
    assert "wrist does not move at all" in str(run.exception)
    assert "--method butterworth" in str(run.exception)


@pytest.mark.parametrize("method", ["kalman", "butterworth"])
def test_too_few_samples_for_the_filter_are_refused_with_what_helps_here(motion, method):
    """A reconstruction has no split that could be chosen otherwise, and no decimation."""
    few = {"t": motion[0][:33], "q": motion[1][:33]}
    with pytest.raises(rrrgen.InputError, match=r"no uninterrupted stretch .*: record longer, or name cutoff$"):
        rrrgen.reconstruct(few, method=method)
    assert len(rrrgen.reconstruct(few, method="butterworth", cutoff=20).t) == 33
