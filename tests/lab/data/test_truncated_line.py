"""A recording that ended in the middle of a line: a located fault, or one row less where that is asked for."""

import numpy as np
import pytest
from click.testing import CliRunner

from rrrgen.base.errors import InputError
from rrrgen.cli.main import cli
from rrrgen.lab.data.recordings import Log, load_stream, open_log
from rrrgen.lab.data.uniform_stream import LogStream
from samples.recordings import write_log


def written(path, rows=200, joints=("q1", "q2")):
    t = np.arange(rows) * 0.01
    q = np.sin(t[:, None] * [2.0, 3.0])
    write_log(path, Log(joints, t, q, 10 * q, period=0.01))
    return path


def read(path, skip):
    return load_stream(LogStream(open_log(path, skip_truncated=skip), chunk=64))


@pytest.mark.parametrize("cut", [1, 5, 21, 45, 70, 85])
def test_a_cut_line_is_a_fault_that_names_the_option_or_is_left_out(tmp_path, cut):
    whole = read(written(tmp_path / "log.csv"), False)
    data = (tmp_path / "log.csv").read_bytes()
    (tmp_path / "log.csv").write_bytes(data[:-cut])
    found = read(tmp_path / "log.csv", True)
    assert len(found) == len(whole) - 1
    np.testing.assert_array_equal(found.tau, whole.tau[:-1])
    kinds = {finding.kind: finding.count for finding in found.repairs.findings}
    assert kinds == {"truncated last line": 1}
    last = (tmp_path / "log.csv").read_text().splitlines()[-1]
    if last.count(",") == 4:  # all entries are there, and nothing tells whether digits are missing
        assert len(read(tmp_path / "log.csv", False)) == len(whole)
        return
    with pytest.raises(InputError) as caught:
        read(tmp_path / "log.csv", False)
    fault = caught.value.faults[0]
    assert (fault.line, fault.column) == (201, len(last) + 1)
    assert "the last line is cut off" in fault.message
    assert "; skip_truncated_line leaves it out" in fault.hint


def test_a_number_cut_in_the_middle_of_its_exponent_is_seen(tmp_path):
    text = written(tmp_path / "log.csv").read_text()
    (tmp_path / "log.csv").write_text(text.rstrip("\n").rsplit(",", 1)[0] + ",1.5e-")
    with pytest.raises(InputError, match=r"the last one '1\.5e-'"):
        read(tmp_path / "log.csv", False)
    assert len(read(tmp_path / "log.csv", True)) == 199


def test_whole_files_stay_whole(tmp_path):
    path = written(tmp_path / "log.csv")
    assert len(read(path, True)) == 200
    assert read(path, True).repairs.findings == ()
    middle = path.read_text().splitlines(keepends=True)
    middle[100] = middle[100][:20] + "\n"
    path.write_text("".join(middle))
    for skip in (False, True):
        with pytest.raises(InputError) as caught:
            read(path, skip)
        assert caught.value.faults[0].line == 101


MAPPING = """
schema: rrrgen-log/1
files: {position: position.csv, torque: torque.csv}
time: {rate: 100 Hz}
units: {position: rad, torque: N*m}
joints:
  - {name: a, position: {file: position, column: 1}, torque: {file: torque, column: 1}}
  - {name: b, position: {file: position, column: 2}, torque: {file: torque, column: 2}}
"""


@pytest.mark.parametrize("rows", [200, 193])  # 193: the cut line stands alone in its chunk
def test_two_files_lose_the_row_together(tmp_path, rows):
    q = np.sin(np.arange(rows)[:, None] * [0.02, 0.03])
    for name, values in (("position", q), ("torque", 10 * q)):
        np.savetxt(tmp_path / f"{name}.csv", values, delimiter=",", fmt="%.9f")
    (tmp_path / "log.yaml").write_text(MAPPING)
    data = (tmp_path / "torque.csv").read_bytes()
    (tmp_path / "torque.csv").write_bytes(data[:-14])
    found = read(tmp_path / "log.yaml", True)
    assert len(found) == rows - 1
    assert len(found.repairs.findings) == 1


def test_the_option_of_the_commands(tmp_path):
    path = written(tmp_path / "log.csv")
    path.write_bytes(path.read_bytes()[:-45])

    def reconstruct(*words):
        arguments = ["experiment", "reconstruct", str(path), *words, "-o", str(tmp_path / "out")]
        return CliRunner().invoke(cli, arguments, standalone_mode=False)

    assert "--skip-truncated-line" in str(reconstruct().exception)
    done = reconstruct("--skip-truncated-line", "--fresh")
    assert done.return_value == 0, done.output
    assert "199 samples" in done.output
    assert "1 last lines were cut off" in done.output
