"""A recording as a uniform stream: disorder, holes, jitter, clipped and missing torques, in chunks of any size."""

import numpy as np
import pytest

from lab.data.three_joints import PERIOD, TAU, TEXT, N, Q, T, kinds, mapped, read, table, write_csv
from rrrgen.base.errors import InputError
from rrrgen.lab.data.uniform_stream import LogStream
from rrrgen.lab.studies.sources import mapping_of_arrays
from samples.recordings import fourier_motion


def test_disorder_and_duplicates_are_put_right(tmp_path):
    rows = table()
    order = np.arange(N)
    order[[100, 101]] = order[[101, 100]]
    rows = rows[np.insert(order, 300, 300)]
    write_csv(tmp_path / "log.csv", rows=rows)
    log = read(mapped(tmp_path, "log.csv"))
    np.testing.assert_allclose(log.q, Q, atol=TEXT)
    assert kinds(log) == {"rows out of order": 1, "duplicate times": 1}


def test_short_holes_are_bridged_and_long_ones_split(tmp_path):
    rows = np.delete(table(), [100, 101, *range(300, 340)], axis=0)
    rows[200, 1] = np.nan
    write_csv(tmp_path / "log.csv", rows=rows)
    log = read(mapped(tmp_path, "log.csv"))
    found = kinds(log)
    assert found["bridged holes"] == 2
    assert found["splitting holes"] == 1
    assert found["rows without all positions"] == 1
    assert list(np.unique(log.segment)) == [0, 1]
    index = np.round(log.t / PERIOD).astype(int)
    assert sorted(set(range(N)) - set(index)) == list(range(300, 340))
    # cubic interpolation over a hole of h: |error| <= h^4 max|q''''|; 6 ms and 2.7e3 rad/s^4 here
    np.testing.assert_allclose(log.q, Q[index], atol=4e-6)
    assert not log.valid[(index == 100) | (index == 101)].any()
    assert log.valid[(index > 110) & (index < 190)].all()


def test_missing_torques_are_marked_not_invented(tmp_path):
    rows = table()
    rows[50:53, 3] = np.nan
    write_csv(tmp_path / "log.csv", rows=rows)
    log = read(mapped(tmp_path, "log.csv"))
    expected = np.ones((N, 2), bool)
    expected[50:53, 0] = False
    np.testing.assert_array_equal(log.valid, expected)
    assert kinds(log) == {"missing torques": 3}


def test_jittered_samples_are_moved_to_uniform_instants(tmp_path):
    rng = np.random.default_rng(5)
    t = T + rng.uniform(-0.3, 0.3, N) * PERIOD
    q = fourier_motion(t, 2, 3)[0]
    write_csv(tmp_path / "log.csv", rows=np.column_stack([t, q, np.zeros((N, 2))]))
    log = read(mapped(tmp_path, "log.csv"))
    assert "jitter" in kinds(log)
    steps = np.diff(log.t)
    np.testing.assert_allclose(steps, steps[0], rtol=1e-9)
    inner = slice(5, -5)
    exact = fourier_motion(log.t, 2, 3)[0]
    assert np.max(np.abs(log.q - exact)[inner]) < 1e-7
    # taking the samples as if they were uniform would be a thousand times worse
    assert np.max(np.abs(q[: len(log.t)] - exact[: len(q)])) > 1e-4


def stream_of(t):
    return LogStream(mapping_of_arrays({"t": t, "q": np.sin(t)[:, None]}, ("a",), "log"))


@pytest.mark.parametrize("rows", [200, 4000, 12000])
@pytest.mark.parametrize("dropped", [0.03, 0.1, 0.4])
@pytest.mark.parametrize("jitter", [0.0, 0.02])  # standard deviation of the stamps, periods
def test_rows_dropped_at_random_leave_the_period(rows, dropped, jitter):
    rng = np.random.default_rng(rows)
    index = np.flatnonzero(rng.random(rows) >= dropped)
    stream = stream_of(0.005 * (index + jitter * rng.standard_normal(len(index))))
    assert stream.period == pytest.approx(0.005, rel=1e-9 if not jitter else 2e-3)
    counts = {finding.kind: finding.count for finding in stream.repairs.findings}
    assert ("jitter" in counts) == (jitter > 0.0)
    assert counts["bridged holes"] + counts.get("splitting holes", 0) == np.sum(np.diff(index) > 1)


@pytest.mark.parametrize("periods_per_tick", [0.3, 0.9, 1.02, 1.3, 1.45, 3.33])
@pytest.mark.parametrize("dropped", [0.0, 0.005])
def test_coarse_stamps_are_not_taken_for_dropped_rows(periods_per_tick, dropped):
    rng = np.random.default_rng(1)
    kept = np.flatnonzero(rng.random(8000) >= dropped)
    t = np.floor(kept * periods_per_tick + 0.1) * 0.001
    assert stream_of(t).period == pytest.approx(0.001 * max(1.0, periods_per_tick), rel=0.02)


def test_clipped_torques_are_left_out(tmp_path):
    rng = np.random.default_rng(2)
    tau = TAU + 0.05 * rng.normal(size=TAU.shape)
    tau[:, 0] = np.clip(tau[:, 0], -4.0, 4.0)
    np.savez(tmp_path / "log.npz", t=T, q=Q, tau=tau)
    log = read(mapped(tmp_path, "log.npz", '"q[0]"', '"q[1]"', '"tau[0]"', '"tau[1]"'))
    np.testing.assert_array_equal(log.valid[:, 0], np.abs(tau[:, 0]) < 4.0)
    assert log.valid[:, 1].all()
    assert kinds(log) == {"clipped torque channels": 1}


@pytest.mark.parametrize("step", [0.0, 0.05])
def test_a_smooth_or_quantised_torque_is_not_taken_for_clipped(tmp_path, step):
    tau = np.column_stack([5 * np.sin(2 * T), 2 * np.cos(2 * T)])
    if step:
        tau = np.round(tau / step) * step
    np.savez(tmp_path / "log.npz", t=T, q=Q, tau=tau)
    log = read(mapped(tmp_path, "log.npz", '"q[0]"', '"q[1]"', '"tau[0]"', '"tau[1]"'))
    assert log.valid.all()
    assert log.findings == ()


def test_a_known_limit_marks_saturation(tmp_path):
    np.savez(tmp_path / "log.npz", t=T, q=Q, tau=TAU)
    mapping = mapped(tmp_path, "log.npz", '"q[0]"', '"q[1]"', '{column: "tau[0]", limit: 4.5}', '"tau[1]"')
    log = read(mapping)
    np.testing.assert_array_equal(log.valid[:, 0], np.abs(TAU[:, 0]) < 0.995 * 4.5)


@pytest.mark.parametrize("chunk", [2, 37, 300])
def test_what_is_read_does_not_depend_on_the_chunks(tmp_path, chunk):
    rng = np.random.default_rng(9)
    rows = np.repeat(table(), 2, axis=0)
    rows[:, 0] = 0.5 * PERIOD * (np.arange(len(rows)) + rng.uniform(-0.3, 0.3, len(rows)))
    rows = np.delete(rows, [40, 41, 500, *range(700, 790)], axis=0)
    rows[[20, 21]] = rows[[21, 20]]
    rows[900, 3] = np.nan
    write_csv(tmp_path / "log.csv", rows=rows)
    mapping = mapped(tmp_path, "log.csv")
    whole, pieces = read(mapping), read(mapping, chunk=chunk)
    for name in ("t", "q", "tau", "valid", "segment"):
        np.testing.assert_array_equal(getattr(pieces, name), getattr(whole, name))
    assert pieces.period == pytest.approx(whole.period, rel=1e-12)
    assert {f.kind: f.count for f in pieces.findings} == kinds(whole)


def test_a_clock_that_starts_over_is_an_error(tmp_path):
    write_csv(tmp_path / "log.csv", rows=np.concatenate([table(), table()]))
    with pytest.raises(InputError, match="time jumps back"):
        read(mapped(tmp_path, "log.csv"))


def test_time_that_does_not_advance_is_an_error(tmp_path):
    rows = table()
    rows[:, 0] = 1.0
    write_csv(tmp_path / "log.csv", rows=rows)
    with pytest.raises(InputError, match="does not advance"):
        read(mapped(tmp_path, "log.csv"))
