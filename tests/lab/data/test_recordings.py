"""Recordings as they are: every format and unit gives the same log, every fault is found, named, and survived."""

import numpy as np
import pytest

from lab.data.three_joints import PERIOD, PLAIN, TAU, TEXT, Q, T, mapped, read, table, write_csv
from rrrgen.base.errors import InputError
from rrrgen.lab.data.mapping import loads_mapping
from rrrgen.lab.data.recordings import Log, open_log, read_log
from samples.recordings import write_log

ROUND_OFF = 1e-12  # relative: one multiplication and one addition per number


def test_units_signs_zeros_and_the_torque_source(tmp_path):
    rng = np.random.default_rng(0)
    counts = np.round(Q[:, 0] / (2 * np.pi) * 4096 * 50)
    raw = np.column_stack([T * 1e3, counts, np.degrees(-Q[:, 1]) + 7.0, TAU[:, 0] / (0.12 * 50), -TAU[:, 1] / 12 * 100])
    offset = rng.uniform(-0.2, 0.2)
    raw[:, 3] += offset
    (tmp_path / "log.csv").write_text(
        "ms,enc,angle,current,load\n" + "\n".join(",".join(f"{v:.12g}" for v in row) for row in raw)
    )
    mapping = loads_mapping(
        f"""
schema: rrrgen-log/1
files: log.csv
time: {{column: ms, unit: ms}}
joints:
  - name: a
    side: motor
    gear_ratio: 50
    position: {{column: enc, unit: counts, counts_per_turn: 4096}}
    torque: {{column: current, unit: A, constant: 0.12 N*m/A, zero: {offset!r}}}
  - name: b
    position: {{column: angle, unit: deg, sign: -1, zero: 7}}
    torque: {{column: load, unit: "%", rated: 12 N*m, sign: -1}}
    zero: 0 rad
""",
        str(tmp_path / "log.yaml"),
    )
    log = read(mapping)
    half_count = np.pi / 4096 / 50
    assert np.max(np.abs(log.q[:, 0] - Q[:, 0])) <= half_count * (1 + 1e-9)
    np.testing.assert_allclose(log.q[:, 1], Q[:, 1], atol=1e-9)
    np.testing.assert_allclose(log.tau, TAU, atol=1e-9)


def test_a_coupling_matrix_keeps_the_power(tmp_path):
    N2 = np.array([[30.0, 0.0], [-12.0, 40.0]])
    zero = np.array([-np.pi / 2, 0.3])
    motor = (Q - zero) @ N2.T
    motor_torque = np.linalg.solve(N2.T, TAU.T).T
    np.savez(tmp_path / "log.npz", t=T, q=motor, tau=motor_torque)
    text = PLAIN.format(file="log.npz", q1='"q[0]"', q2='"q[1]"', tau1='"tau[0]"', tau2='"tau[1]"')
    text = text.replace("joints:", "side: motor\ntransmission: {matrix: [[30, 0], [-12, 40]]}\njoints:")
    text = text.replace("{name: a,", "{name: a, zero: -pi/2,").replace("{name: b,", "{name: b, zero: 0.3,")
    log = read(loads_mapping(text, str(tmp_path / "log.yaml")))
    np.testing.assert_allclose(log.q, Q, rtol=ROUND_OFF, atol=1e-14)
    np.testing.assert_allclose(log.tau, TAU, rtol=ROUND_OFF, atol=1e-14)
    power = np.sum(motor_torque[1:] * np.diff(motor, axis=0), axis=1)
    np.testing.assert_allclose(np.sum(log.tau[1:] * np.diff(log.q, axis=0), axis=1), power, atol=1e-13)


def test_wrapped_encoders_become_continuous(tmp_path):
    turning = np.column_stack([3.0 * T * 2 * np.pi, Q[:, 1]])
    np.savez(tmp_path / "log.npz", t=T, q=np.degrees(turning) % 360.0, tau=TAU)
    text = PLAIN.format(
        file="log.npz", q1='{column: "q[0]", wraps_at: 360}', q2='"q[1]"', tau1='"tau[0]"', tau2='"tau[1]"'
    )
    log = read(loads_mapping(text.replace("position: rad", "position: deg"), str(tmp_path / "log.yaml")), chunk=50)
    np.testing.assert_allclose(log.q[:, 0], turning[:, 0], atol=1e-10)
    assert [finding.kind for finding in log.findings] == ["encoder wraps"]


# -- faults of the recording ---------------------------------------------------------------------------------------


def test_files_of_different_length_are_an_error(tmp_path):
    np.save(tmp_path / "q.npy", Q)
    np.save(tmp_path / "tau.npy", TAU[:-3])
    mapping = loads_mapping(
        """
schema: rrrgen-log/1
files: {q: q.npy, tau: tau.npy}
time: {rate: 500 Hz}
units: {position: rad, torque: N*m}
joints:
  - {name: a, position: {file: q, column: 1}, torque: {file: tau, column: 1}}
  - {name: b, position: {file: q, column: 2}, torque: {file: tau, column: 2}}
""",
        str(tmp_path / "log.yaml"),
    )
    with pytest.raises(InputError, match="not equally long"):
        read(mapping)


def test_an_unknown_column_names_the_known_ones(tmp_path):
    write_csv(tmp_path / "log.csv")
    with pytest.raises(InputError, match="did you mean 'tau1'"):
        read(mapped(tmp_path, "log.csv", tau1="tao1"))


@pytest.mark.parametrize("name", ["log.npz", "log.npy", "log.mat", "log.h5", "log.parquet", "log.csv"])
def test_garbage_is_a_fault_of_the_file(tmp_path, name):
    (tmp_path / name).write_bytes(b"\x93NUMPY\x00\xff\xfe garbage \x00" * 20)
    with pytest.raises(InputError):
        read(mapped(tmp_path, name))


def test_own_recordings_need_no_mapping_and_read_back_equal(tmp_path):
    log = Log(("a", "b"), T, Q, TAU, dq=Q * 2, period=PERIOD)
    write_log(tmp_path / "own.csv", log)
    found = read_log(tmp_path / "own.csv", joints=("a", "b"))
    for name in ("q", "tau", "dq"):
        np.testing.assert_array_equal(getattr(found, name), getattr(log, name))
    np.testing.assert_allclose(found.t, T, atol=1e-13)
    with pytest.raises(InputError, match="not those of the robot"):
        read_log(tmp_path / "own.csv", joints=("b", "a"))


def test_another_recording_with_the_same_mapping(tmp_path):
    write_csv(tmp_path / "log.csv")
    write_csv(tmp_path / "second.csv", rows=table() * [1, 2, 2, 2, 2])
    (tmp_path / "log.yaml").write_text(PLAIN.format(file="log.csv", q1="q1", q2="q2", tau1="tau1", tau2="tau2"))
    np.testing.assert_allclose(read_log(tmp_path / "second.csv", tmp_path / "log.yaml").q, 2 * Q, atol=TEXT)
    assert open_log(tmp_path / "log.yaml").names == ("a", "b")
