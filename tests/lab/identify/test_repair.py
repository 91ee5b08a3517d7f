"""What was put right in a recording is counted by kind and channel, told, stored, and warned of where it is much."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

import rrrgen
from rrrgen.cli.main import cli
from rrrgen.lab.data.recordings import open_log
from rrrgen.lab.data.uniform_stream import LogStream
from samples.recordings import fourier_motion

N, PERIOD = 2000, 2e-3


@pytest.fixture(scope="module")
def clean():
    arm = rrrgen.compile("planar2r")
    t = PERIOD * np.arange(N)
    q, dq, ddq = fourier_motion(t, 2, 3)
    tau = np.asarray(arm.inverse_dynamics(q, dq, ddq)) + 0.02 * np.random.default_rng(0).normal(size=q.shape)
    return np.column_stack([t, q, tau])


def written(path, rows):
    lines = ["t,q_q1,q_q2,tau_q1,tau_q2"] + [",".join("" if np.isnan(v) else f"{v:.12g}" for v in row) for row in rows]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def repairs(path, chunk=100_000):
    found = LogStream(open_log(path), chunk=chunk).repairs
    return found, {finding.kind: finding for finding in found.findings}


def spoiled(rows):
    """Every fault that is repaired, in known numbers."""
    rows = rows.copy()
    rows[200:230, 3] = np.nan  # torques of q1
    rows[205:210, 4] = np.nan  # and of q2
    rows[400:403, 2] = np.nan  # positions of q2
    rows[:, 4] = np.minimum(rows[:, 4], np.nanquantile(rows[:, 4], 0.97))
    rows = np.insert(rows, 1000, rows[999], axis=0)  # the same row twice
    again = rows[1100].copy()
    again[1:3] += 0.01
    return np.insert(rows, 1101, again, axis=0)  # the same instant with other values


@pytest.mark.parametrize("chunk", [97, 100_000])
def test_every_repair_is_counted_by_channel(clean, tmp_path, chunk):
    rows = spoiled(clean)
    whole, found = repairs(written(tmp_path / "log.csv", rows), chunk)
    assert whole.rows == N + 2
    assert found["missing torques"].count == 35
    assert dict(found["missing torques"].channels) == {"q1": 30, "q2": 5}
    assert found["missing torques"].share == pytest.approx(30 / (N + 2))
    assert dict(found["rows without all positions"].channels) == {"q1": 0, "q2": 3}
    assert (found["duplicate times"].count, found["repeated stamps"].count) == (1, 1)
    held = np.isfinite(rows[:, 2]) & (rows[:, 4] == np.nanmax(rows[:, 4]))
    assert dict(found["clipped torque channels"].channels) == {"q1": 0, "q2": int(np.sum(held))}


def test_what_touches_more_than_one_percent_of_the_rows_is_warned_of(clean, tmp_path):
    _, found = repairs(written(tmp_path / "log.csv", spoiled(clean)))
    warned = {kind for kind, finding in found.items() if finding.warned}
    assert warned == {"missing torques", "clipped torque channels"}  # 1.5 % and 3 %
    few = clean.copy()
    few[100:110, 3] = np.nan
    whole, found = repairs(written(tmp_path / "few.csv", few))
    assert found["missing torques"].count == 10
    assert whole.warnings() == []


def test_jitter_and_holes_are_counted_in_rows(clean, tmp_path):
    late = clean.copy()
    late[500:540, 0] += 0.2 * PERIOD * np.where(np.arange(40) % 2, 1, -1)
    _, found = repairs(written(tmp_path / "jitter.csv", late))
    assert found["jitter"].rows == pytest.approx(40, abs=2)  # steps into, among and out of the late samples
    _, found = repairs(written(tmp_path / "holes.csv", np.delete(clean, [*range(100, 103), *range(700, 900)], axis=0)))
    assert (found["bridged holes"].count, found["bridged holes"].rows) == (1, 3)
    assert (found["splitting holes"].count, found["splitting holes"].rows) == (1, 200)
    assert found["splitting holes"].warned


def test_a_clean_recording_has_nothing_to_repair(clean, tmp_path):
    whole, _ = repairs(written(tmp_path / "log.csv", clean))
    assert (whole.findings, whole.lines(), whole.warnings()) == ((), [], [])


@pytest.mark.parametrize("command", ["identify", "validate", "reconstruct"])
def test_commands_print_store_and_warn(clean, tmp_path, command):
    log = written(tmp_path / "log.csv", spoiled(clean))
    out = tmp_path / "out"
    arguments = {
        "identify": ["identify", "planar2r", "--log", log, "--no-consistent", "-o", out],
        "validate": ["experiment", "validate", "planar2r", "--log", log, "-o", out],
        "reconstruct": ["experiment", "reconstruct", log, "-o", out],
    }[command]
    result = CliRunner().invoke(cli, [str(a) for a in arguments], standalone_mode=False, catch_exceptions=False)
    assert "35 torques are missing" in result.stdout
    assert "samples by joint: q1 30, q2 5" in result.stdout
    assert "warning: log.csv: 1.5 % of the rows, more than 1 %: 35 torques are missing" in result.stderr
    stored = {"identify": "identification.json", "validate": "validation.json", "reconstruct": "repairs.json"}[command]
    record = json.loads((out / "results" / stored).read_text())["repairs"][0]
    missing = next(finding for finding in record["findings"] if finding["kind"] == "missing torques")
    assert missing["channels"] == {"q1": 30, "q2": 5}
    assert missing["warning"] is True
