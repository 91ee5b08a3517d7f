"""Recordings as they are: every format and unit gives the same log, every fault is found, named, and survived."""

import numpy as np
import pytest

from rrrgen.base.errors import InputError
from rrrgen.lab.data.mapping import loads_mapping
from rrrgen.lab.data.recordings import Log, load_stream, open_log, read_log
from rrrgen.lab.data.uniform_stream import LogStream
from samples.recordings import fourier_motion, write_log

ROUND_OFF = 1e-12  # relative: one multiplication and one addition per number
TEXT = 1e-9  # numbers written with ten decimals

N, PERIOD = 600, 0.002
T = PERIOD * np.arange(N)
Q = fourier_motion(T, 2, 3)[0]
TAU = np.column_stack([5 * np.sin(3 * T), 2 * np.cos(5 * T) + 0.1])

PLAIN = """
schema: rrrgen-log/1
files: {file}
time: {{column: t, unit: s}}
units: {{position: rad, torque: N*m}}
joints:
  - {{name: a, position: {q1}, torque: {tau1}}}
  - {{name: b, position: {q2}, torque: {tau2}}}
"""


def mapped(tmp_path, file, q1="q1", q2="q2", tau1="tau1", tau2="tau2"):
    text = PLAIN.format(file=file, q1=q1, q2=q2, tau1=tau1, tau2=tau2)
    return loads_mapping(text, str(tmp_path / "log.yaml"))


def read(mapping, **options):
    return load_stream(LogStream(mapping, **options))


def table():
    return np.column_stack([T, Q, TAU])


def write_csv(path, separator=",", decimal=".", header="t,q1,q2,tau1,tau2", before="", rows=None):
    lines = [before] if before else []
    if header:
        lines.append(header.replace(",", separator))
    for row in table() if rows is None else rows:
        cells = ["" if np.isnan(v) else f"{v:.10f}".replace(".", decimal) for v in row]
        lines.append(separator.join(cells))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


@pytest.mark.parametrize(
    ("separator", "decimal", "header", "before"),
    [
        (",", ".", "t,q1,q2,tau1,tau2", ""),
        (";", ",", "t,q1,q2,tau1,tau2", ""),
        ("\t", ",", "t,q1,q2,tau1,tau2", "# a comment of the logger"),
        (" ", ".", "t,q1,q2,tau1,tau2", ""),
        ("|", ".", "t,q1,q2,tau1,tau2\ns,rad,rad,Nm,Nm", ""),
        (";", ".", "\ufefft,q1,q2,tau1,tau2", ""),
    ],
)
def test_text_tables_are_read_whatever_their_separators(tmp_path, separator, decimal, header, before):
    write_csv(tmp_path / "log.csv", separator, decimal, header, before)
    log = read(mapped(tmp_path, "log.csv"))
    np.testing.assert_allclose(log.q, Q, atol=TEXT)
    np.testing.assert_allclose(log.tau, TAU, atol=TEXT)
    assert log.findings == ()
    assert log.period == pytest.approx(PERIOD, rel=1e-6)


def test_a_table_without_header_is_addressed_by_numbers(tmp_path):
    write_csv(tmp_path / "log.csv", ";", ",", header="")
    mapping = loads_mapping(
        PLAIN.format(file="log.csv", q1=2, q2=3, tau1=4, tau2=5).replace("column: t,", "column: 1,"),
        str(tmp_path / "log.yaml"),
    )
    np.testing.assert_allclose(read(mapping).q, Q, atol=TEXT)


def test_decimal_comma_with_comma_separator_is_refused(tmp_path):
    (tmp_path / "log.csv").write_text("t,q1\n0,0,1,5\n0,1,1,6\n")
    with pytest.raises(InputError):
        read(mapped(tmp_path, "log.csv"))


def write_containers(folder):
    import scipy.io

    np.savez(folder / "log.npz", t=T, q=Q, tau=TAU.T.copy())
    np.save(folder / "rows.npy", table())
    np.save(folder / "columns.npy", np.asfortranarray(table()))
    np.save(folder / "across.npy", np.ascontiguousarray(table().T))
    kind = [("t", "f8"), ("q1", "f4"), ("q2", "f8"), ("tau1", "f8"), ("tau2", "f8")]
    np.save(folder / "record.npy", np.array([tuple(row) for row in table()], dtype=kind))
    scipy.io.savemat(folder / "v5.mat", {"log": {"t": T[None], "q": Q, "tau": TAU}})
    return folder


@pytest.mark.parametrize(
    ("file", "time", "columns", "tolerance"),
    [
        ("log.npz", "t", ("q[0]", "q(2)", "tau[0]", "tau[1]"), 0.0),
        ("rows.npy", "data[0]", ("2", "3", "data[3]", "data(5)"), 0.0),
        ("columns.npy", "1", ("2", "3", "4", "5"), 0.0),
        ("across.npy", "data[0]", ("data[1]", "data[2]", "data[3]", "data[4]"), 0.0),
        ("record.npy", "t", ("q1", "q2", "tau1", "tau2"), 1e-6),
        ("v5.mat", "log.t", ("log.q(1)", "log.q(2)", "log.tau(1)", "log.tau(2)"), 0.0),
    ],
)
def test_containers_of_arrays(tmp_path, file, time, columns, tolerance):
    write_containers(tmp_path)
    names = [column if column.isdecimal() else f'"{column}"' for column in columns]
    text = PLAIN.format(file=file, q1=names[0], q2=names[1], tau1=names[2], tau2=names[3])
    mapping = loads_mapping(text.replace("column: t,", f'column: "{time}",'), str(tmp_path / "log.yaml"))
    for chunk in (100_000, 77):
        log = read(mapping, chunk=chunk)
        np.testing.assert_allclose(log.q, Q, rtol=0, atol=tolerance)
        np.testing.assert_array_equal(log.tau, TAU)


def test_matlab_73(tmp_path):
    h5py = pytest.importorskip("h5py", reason="h5py reads MATLAB v7.3")
    with h5py.File(tmp_path / "log.mat", "w", userblock_size=512) as file:
        # MATLAB stores its arrays with the axes reversed
        file["log/t"], file["log/q"], file["log/tau"] = T[None], Q.T.copy(), TAU.T.copy()
    with (tmp_path / "log.mat").open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512))
    mapping = mapped(tmp_path, "log.mat", '"log.q(1)"', '"log.q(2)"', '"log.tau(1)"', '"log.tau(2)"')
    mapping = loads_mapping(
        PLAIN.format(
            file="log.mat", q1='"log.q(1)"', q2='"log.q(2)"', tau1='"log.tau(1)"', tau2='"log.tau(2)"'
        ).replace("column: t,", "column: log.t,"),
        str(tmp_path / "log.yaml"),
    )
    log = read(mapping, chunk=100)
    np.testing.assert_array_equal(log.q, Q)
    np.testing.assert_array_equal(log.tau, TAU)


def test_parquet(tmp_path):
    pyarrow = pytest.importorskip("pyarrow", reason="pyarrow reads Parquet")
    parquet = pytest.importorskip("pyarrow.parquet")
    names = ("t", "q1", "q2", "tau1", "tau2")
    content = pyarrow.table(dict(zip(names, table().T, strict=True)))
    parquet.write_table(content, tmp_path / "log.parquet", row_group_size=100)
    log = read(mapped(tmp_path, "log.parquet"))
    np.testing.assert_array_equal(log.q, Q)
    np.testing.assert_array_equal(log.tau, TAU)


@pytest.mark.parametrize("storage", ["SQLITE3", "MCAP"])
def test_ros_recordings(tmp_path, storage):
    rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="rosbags reads ROS recordings")
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kinds = store.types
    state, header = kinds["sensor_msgs/msg/JointState"], kinds["std_msgs/msg/Header"]
    stamp = kinds["builtin_interfaces/msg/Time"]
    with rosbag2.Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin[storage]) as writer:
        topic = writer.add_connection("/joint_states", state.__msgtype__, typestore=store)
        for k in range(N):
            ns = 10**9 + round(T[k] * 1e9)
            # a gripper publishes on the same topic, and the arm's joints come in another order than in the mapping
            for names, q, tau in ((["grip"], [0.1], [0.0]), (["b", "a"], Q[k, ::-1], TAU[k, ::-1])):
                head = header(stamp=stamp(sec=ns // 10**9, nanosec=ns % 10**9), frame_id="")
                message = state(
                    header=head,
                    name=names,
                    position=np.array(q),
                    velocity=np.array([]),
                    effort=np.array(tau),
                )
                writer.write(topic, ns, store.serialize_cdr(message, state.__msgtype__))
    mapping = mapped(tmp_path, "bag", "position.a", "position.b", "effort.a", "effort.b")
    for path in (tmp_path / "bag", next(p for p in (tmp_path / "bag").iterdir() if p.suffix in (".mcap", ".db3"))):
        log = read_log(path, mapping)
        np.testing.assert_array_equal(log.q, Q)
        np.testing.assert_array_equal(log.tau, TAU)


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


def kinds(log):
    return {finding.kind: finding.count for finding in log.findings}


def test_disorder_and_duplicates_are_put_right(tmp_path):
    rows = table()
    order = np.arange(N)
    order[[100, 101]] = order[[101, 100]]
    rows = rows[np.insert(order, 300, 300)]
    write_csv(tmp_path / "log.csv", rows=rows)
    log = read(mapped(tmp_path, "log.csv"))
    np.testing.assert_allclose(log.q, Q, atol=TEXT)
    assert kinds(log) == {"rows out of order": 1, "duplicate instants": 1}


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


def test_a_word_among_the_numbers_is_located(tmp_path):
    write_csv(tmp_path / "log.csv")
    lines = (tmp_path / "log.csv").read_text().splitlines()
    lines[200] = lines[200].replace(lines[200].split(",")[3], "overrun")
    (tmp_path / "log.csv").write_text("\n".join(lines))
    with pytest.raises(InputError) as caught:
        read(mapped(tmp_path, "log.csv"))
    (fault,) = caught.value.faults
    assert (fault.line, fault.column) == (201, lines[200].index("overrun") + 1)


def test_a_line_that_breaks_off_is_located(tmp_path):
    write_csv(tmp_path / "log.csv")
    text = (tmp_path / "log.csv").read_text().rstrip()
    (tmp_path / "log.csv").write_text(text[:-20])
    with pytest.raises(InputError) as caught:
        read(mapped(tmp_path, "log.csv"))
    assert caught.value.faults[0].line == N + 1


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
