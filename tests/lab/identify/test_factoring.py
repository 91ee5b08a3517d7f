"""Long recordings: constant memory, several processes, interruption, and always the same result."""

import os
import signal
import subprocess
import sys
import textwrap
import time

import numpy as np
import pytest

import rrrgen
from lab.identify.streams import PERIOD, PROCESSINGS, TERMS, N, recording
from rrrgen.base.errors import InputError
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.data.recordings import open_log, read_log
from rrrgen.lab.data.uniform_stream import LogStream
from rrrgen.lab.estimate.regression import weighted_least_squares
from rrrgen.lab.estimate.tsqr import factor_rows
from rrrgen.lab.identify.bandwidth import motion_bandwidth
from rrrgen.lab.identify.factoring import (
    FittedRows,
    factor_recordings,
    fits_in_memory,
    rows_of_recordings,
    score,
)
from rrrgen.lab.identify.held_out_data import Split
from rrrgen.lab.identify.observations import Observations, RowMaker
from rrrgen.lab.identify.regressor import FullRegressor
from samples.recordings import fourier_motion

SAME = 1e-9  # relative: the accuracy promised for streams against recordings in memory


@pytest.mark.parametrize("processing", PROCESSINGS, ids=lambda p: f"{p.method}-{p.decimate}")
def test_a_stream_gives_what_the_recording_in_memory_gives(tmp_path, processing):
    path, regressor, _ = recording(tmp_path)
    maker = RowMaker(regressor, processing, len(regressor.names))
    split = Split.parse("blocks:0.5")
    whole = factor_recordings(Observations((read_log(path),), maker), split)
    stream = factor_recordings(Observations((LogStream(open_log(path), chunk=500),), maker), split)
    for a, b in ((whole.fit, stream.fit), (whole.score, stream.score)):
        np.testing.assert_array_equal(a.counts, b.counts)
        xa, xb = (weighted_least_squares(f, regressor.names).x for f in (a, b))
        np.testing.assert_allclose(xb, xa, rtol=SAME, atol=SAME * np.abs(xa).max())


def test_scores_are_those_of_the_rows(tmp_path):
    path, regressor, x = recording(tmp_path)
    observations = Observations((read_log(path),), RowMaker(regressor, PROCESSINGS[0], len(regressor.names)))
    factors = factor_recordings(observations, Split.parse("first:0.5"))
    rows = list(observations)
    tau = np.concatenate([r.tau for r in rows])
    residual = np.concatenate([r.tau - r.W @ x for r in rows])
    second = np.concatenate([r.t for r in rows]) >= 0.5 * PERIOD * (N - 1)
    found = score(factors.score, x)
    assert found["relative_error"] == pytest.approx(np.linalg.norm(residual[second]) / np.linalg.norm(tau[second]))
    np.testing.assert_allclose(found["joint_rms"], np.sqrt(np.mean(residual[second] ** 2, axis=0)))
    assert score(factor_rows(rows[0].use_only(np.zeros(len(rows[0].t), bool))), x)["relative_error"] is None


def test_several_recordings_do_not_run_into_one_another(tmp_path):
    paths = [recording(tmp_path, seed)[0] for seed in (0, 1)]
    _, regressor, _ = recording(tmp_path, 0)
    maker = RowMaker(regressor, PROCESSINGS[1], len(regressor.names))
    logs = [read_log(path) for path in paths]
    together = factor_recordings(Observations(tuple(logs), maker))
    apart = [factor_recordings(Observations((log,), maker)).fit for log in logs]
    merged = apart[0].merge(apart[1])
    np.testing.assert_allclose(together.fit.R, merged.R, atol=1e-12 * np.abs(merged.R).max())
    segments = {int(s) for rows in Observations(tuple(logs), maker) for s in rows.segment}
    assert segments == {0, 1}


def test_an_interrupted_run_goes_on_to_the_same_bits(tmp_path):
    path, regressor, _ = recording(tmp_path)
    maker = RowMaker(regressor, PROCESSINGS[0], len(regressor.names))
    observations = Observations((LogStream(open_log(path), chunk=500),), maker)
    whole = factor_recordings(observations)
    done = []

    def interrupt(count, total, message):
        done.append(count)
        if len(done) == 4:
            raise KeyboardInterrupt

    state = tmp_path / "state.npz"
    with pytest.raises(KeyboardInterrupt):
        factor_recordings(observations, checkpoint=state, digest="a", progress=interrupt)
    seen = []
    again = factor_recordings(
        observations, checkpoint=state, digest="a", progress=lambda count, total, message: seen.append(count)
    )
    assert seen[0] > done[-1]
    assert seen[-1] == N
    np.testing.assert_array_equal(again.fit.R, whole.fit.R)
    # another digest, or a damaged state, starts over
    for prepare in (lambda: "b", lambda: state.write_bytes(b"damaged") and "a"):
        digest = prepare()
        seen.clear()
        other = factor_recordings(
            observations, checkpoint=state, digest=digest, progress=lambda count, total, message: seen.append(count)
        )
        assert seen[0] == done[0]
        np.testing.assert_array_equal(other.fit.R, whole.fit.R)


def test_two_processes_give_the_same_bits(tmp_path):
    path, regressor, _ = recording(tmp_path)
    maker = RowMaker(regressor, PROCESSINGS[1], len(regressor.names))
    observations = Observations((LogStream(open_log(path), chunk=1500),), maker)
    alone = factor_recordings(observations)
    together = factor_recordings(observations, jobs=2)
    np.testing.assert_array_equal(together.fit.R, alone.fit.R)


def test_a_dask_cluster_survives_the_loss_of_a_worker(tmp_path):
    pytest.importorskip("distributed", reason="dask[distributed] runs clusters")
    from distributed import LocalCluster

    path, regressor, _ = recording(tmp_path)
    maker = RowMaker(regressor, PROCESSINGS[1], len(regressor.names))
    observations = Observations((LogStream(open_log(path), chunk=1500),), maker)
    alone = factor_recordings(observations)
    with LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster:  # which is replaced
        victim = next(iter(cluster.workers.values())).pid

        def kill(count, total, message, killed=[]):  # noqa: B006 - remembers that it has been done
            if not killed:
                killed.append(os.kill(victim, signal.SIGKILL))
                time.sleep(0.1)

        together = factor_recordings(observations, cluster=cluster.scheduler_address, progress=kill)
    np.testing.assert_array_equal(together.fit.R, alone.fit.R)


def test_a_cluster_that_does_not_answer_is_an_input_error(tmp_path):
    pytest.importorskip("distributed", reason="dask[distributed] runs clusters")
    path, regressor, _ = recording(tmp_path)
    maker = RowMaker(regressor, PROCESSINGS[0], len(regressor.names))
    with pytest.raises(InputError, match="no Dask scheduler answers"):
        factor_recordings(Observations((read_log(path),), maker), cluster="not-an-address://x:1")


def test_rows_in_memory_and_rows_computed_anew_are_the_same(tmp_path):
    path, regressor, _ = recording(tmp_path)
    observations = Observations((read_log(path),), RowMaker(regressor, PROCESSINGS[1], len(regressor.names)))
    split = Split.parse("blocks:0.7")
    factors, fitted, scored = rows_of_recordings(observations, split)
    expected = factor_recordings(observations, split)
    np.testing.assert_allclose(factors.fit.R, expected.fit.R, atol=1e-11 * np.abs(expected.fit.R).max())
    np.testing.assert_array_equal(factors.score.counts, expected.score.counts)
    again = list(FittedRows(observations, split))
    np.testing.assert_array_equal(np.concatenate([r.W for r in again]), np.concatenate([r.W for r in fitted]))
    np.testing.assert_array_equal(np.concatenate([r.use for r in again]), np.concatenate([r.use for r in fitted]))
    assert not any((a.use & b.use).any() for a, b in zip(fitted, scored, strict=True))
    assert fits_in_memory(observations)
    assert not fits_in_memory(observations, limit=1000)


@pytest.mark.parametrize("resolution", [0.0, 1e-5, 1e-4])
def test_the_bandwidth_of_a_motion_is_told_through_the_noise_of_its_encoder(resolution):
    t = PERIOD * np.arange(20_000)
    q = np.column_stack([np.sin(2 * np.pi * 0.5 * t), 0.1 * np.sin(2 * np.pi * 6.0 * t)])
    if resolution:
        q = np.round(q / resolution) * resolution
    assert motion_bandwidth(q, PERIOD) == pytest.approx(6.0, abs=0.5)
    with pytest.raises(InputError, match="no joint moves"):
        motion_bandwidth(np.zeros((100, 2)), PERIOD)


LIMITED = """
import resource, sys
import numpy as np
import rrrgen
from pathlib import Path
import scipy.signal, scipy.linalg
sys.path[:0] = [{tests!r}, {identify!r}]
from lab.identify.test_factoring import TERMS
from rrrgen.lab.identify.factoring import factor_recordings
from rrrgen.lab.data.mapping import load_mapping
from rrrgen.lab.data.uniform_stream import LogStream
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.identify.regressor import FullRegressor
from rrrgen.lab.identify.observations import Observations, RowMaker, Window

regressor = FullRegressor(rrrgen.compile("planar2r"), TERMS)
maker = RowMaker(regressor, Processing("butterworth", cutoff=20.0, decimate=50), len(regressor.names))
first = next(LogStream(load_mapping({mapping!r}), chunk=2000).parts())
list(maker.rows(Window(first, 0, len(first))))  # everything that is imported on first use
pages = int(Path("/proc/self/statm").read_text().split()[0])
allowed = pages * resource.getpagesize() + {allowance}
resource.setrlimit(resource.RLIMIT_AS, (allowed, allowed))
stream = LogStream(load_mapping({mapping!r}), chunk=2000)
np.save({out!r}, factor_recordings(Observations((stream,), maker)).fit.R)
"""


@pytest.mark.sweep
def test_a_recording_ten_times_larger_than_the_memory(tmp_path):
    pytest.importorskip("resource", reason="limits of memory are those of POSIX")
    if not os.path.exists("/proc/self/statm"):
        pytest.skip("needs /proc to know the memory in use")
    allowance, rows, columns = 4_000_000, 250_000, 20  # 15 columns that nobody reads; what is read takes 10 MB
    regressor = FullRegressor(rrrgen.compile("planar2r"), TERMS)
    x = np.linspace(0.5, 2.0, len(regressor.names))
    # one motion over and over: the file is large, the answer is known from one of its periods
    t = PERIOD * np.arange(10_000)
    q, dq, ddq = fourier_motion(t, 2, 3, base=0.1)
    tau = regressor(q, dq, ddq) @ x + 0.05 * np.random.default_rng(0).normal(size=q.shape)
    block = np.column_stack([q, tau])
    path = tmp_path / "log.npy"
    data = np.lib.format.open_memmap(path, "w+", np.float64, (rows, columns))
    for start in range(0, rows, len(block)):
        data[start : start + len(block), 0] = PERIOD * np.arange(start, start + len(block))
        data[start : start + len(block), 1:5] = block
    data.flush()
    del data
    assert path.stat().st_size >= 10 * allowance
    mapping = tmp_path / "log.yaml"
    mapping.write_text(
        textwrap.dedent("""
        schema: rrrgen-log/1
        files: log.npy
        time: {column: 1, unit: s}
        units: {position: rad, torque: N*m}
        joints:
          - {name: a, position: 2, torque: 4}
          - {name: b, position: 3, torque: 5}
        """)
    )
    here = os.path.dirname(os.path.abspath(__file__))
    script = LIMITED.format(
        tests=os.path.dirname(here),
        identify=here,
        allowance=allowance,
        mapping=str(mapping),
        out=str(tmp_path / "R.npy"),
    )
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr[-2000:]
    limited = np.load(tmp_path / "R.npy")
    maker = RowMaker(regressor, Processing("butterworth", cutoff=20.0, decimate=50), len(regressor.names))
    whole = factor_recordings(Observations((read_log(mapping, chunk=10 * rows),), maker)).fit
    streamed = type(whole)(limited, whole.counts)
    a, b = (weighted_least_squares(f, regressor.names).x for f in (whole, streamed))
    np.testing.assert_allclose(b, a, rtol=SAME)
