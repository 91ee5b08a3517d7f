"""Files that lie or break off: what is said, where, and within which bounds of time and memory."""

from __future__ import annotations

import os
import struct
import sys
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest

from rrrgen.base.errors import InputError
from rrrgen.lab.data.mapping import FileSource
from rrrgen.lab.data.tables import formats
from rrrgen.lab.data.tables.formats import open_table
from rrrgen.lab.data.tables.reading_process import _Memory


def read(path: Path, columns, **source):
    return list(open_table(FileSource("log", path, **source)).chunks(columns, 1000))


def npy_header(shape: str, kind: str = "<f8") -> bytes:
    text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode()


@pytest.mark.parametrize("shape", ["(1000000000000,)", "(1000000000000, 5)", "(5, 1000000000000)", "(-1, 5)"])
@pytest.mark.parametrize("container", ["npy", "npz"])
def test_a_header_that_claims_too_much_is_refused_at_once(tmp_path, shape, container):
    data = npy_header(shape) + bytes(80)
    path = tmp_path / f"log.{container}"
    if container == "npz":
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("data.npy", data)
    else:
        path.write_bytes(data)
    start = time.monotonic()
    with pytest.raises(InputError, match=r"log\.np.: error: the file is shorter than its header says \("):
        read(path, ["data[0]"])
    assert time.monotonic() - start < 5.0


def test_an_hdf5_file_that_claims_too_much_is_refused_at_once(tmp_path):
    h5py = pytest.importorskip("h5py", reason="h5py reads HDF5")
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file.create_dataset("q", shape=(10**12,), chunks=(1000,), dtype="f8")  # nothing of it is written
    start = time.monotonic()
    with pytest.raises(InputError, match=r"log\.h5: error: 1000000000000 rows, more than the file's \d+ bytes"):
        read(tmp_path / "log.h5", ["q"])
    assert time.monotonic() - start < 5.0


@pytest.mark.parametrize("kind", ["|O", "<c16", "<U4", "<M8[s]", "|V8"])
def test_arrays_of_anything_but_numbers_are_refused(tmp_path, kind):
    (tmp_path / "log.npy").write_bytes(npy_header("(4,)", kind) + bytes(400))
    with pytest.raises(InputError, match="not an array of numbers"):
        read(tmp_path / "log.npy", ["1"])
    np.savez(tmp_path / "log.npz", q=np.array(["a", "b"]), z=np.array([1j, 2j]))
    for name in ("q", "z"):
        with pytest.raises(InputError, match=f"'{name}' is of type .*, not numbers"):
            read(tmp_path / "log.npz", [name])


@pytest.mark.parametrize("rows", [10, 5000])
def test_one_wrong_byte_in_a_text_is_located_however_late_it_comes(tmp_path, rows):
    lines = [b"t,q"] + [b"%d,%d" % (k, k) for k in range(rows)]
    lines[rows - 3] = b"7,\xfc\xff"
    (tmp_path / "log.csv").write_bytes(b"\n".join(lines) + b"\n")
    with pytest.raises(InputError) as caught:
        read(tmp_path / "log.csv", ["t", "q"])
    (fault,) = caught.value.faults
    assert (fault.line, fault.column) == (rows - 2, 3)
    assert "not text in utf-8-sig: byte 0xfc" in fault.message


@pytest.mark.parametrize("text", ["1_0", "１", "0x10", "1e", "--1", "1 2"])
def test_what_only_python_takes_for_a_number_is_none(tmp_path, text):
    (tmp_path / "log.csv").write_text(f"t;q\n1.5;2\n3;{text}\n", encoding="utf-8")
    with pytest.raises(InputError, match=rf"log.csv:3:3: error: '{text}' is not a number"):
        read(tmp_path / "log.csv", ["t", "q"])


def test_an_unending_line_is_refused_without_reading_it_all(tmp_path):
    (tmp_path / "log.csv").write_bytes(b"t,q\n1,2\n" + b"3" * 2_000_000)
    with pytest.raises(InputError, match="a line of more than 1000000 characters"):
        read(tmp_path / "log.csv", ["t", "q"])


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="a pipe without a writer stands for a library that hangs")
def test_a_reader_that_hangs_is_given_up(tmp_path, monkeypatch):
    os.mkfifo(tmp_path / "log.parquet")
    monkeypatch.setenv("RRRGEN_READ_SECONDS", "0.5")
    monkeypatch.setattr(formats, "_idle", {})
    start = time.monotonic()
    with pytest.raises(InputError, match=r"(?s)log\.parquet: error: reading was given up after .* RRRGEN_READ_SECONDS"):
        read(tmp_path / "log.parquet", ["q"])
    assert time.monotonic() - start < 10.0


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux keeps the limit of memory")
def test_the_memory_of_the_reading_process_is_bounded():
    process = os.fork()
    if not process:
        status = 1
        try:
            _Memory().allow(1 << 28)
            np.ones(1 << 24)
            try:
                np.ones(1 << 27)
            except MemoryError:
                status = 0
        finally:
            os._exit(status)
    assert os.waitpid(process, 0)[1] == 0


def test_reading_goes_on_after_a_crash(tmp_path, monkeypatch):
    """The process that a file has brought down is replaced; one whose iteration is given up is not used again."""
    scipy_io = pytest.importorskip("scipy.io", reason="SciPy reads MATLAB v5")
    scipy_io.savemat(tmp_path / "log.mat", {"q": np.arange(5000.0)[:, None], "p": np.ones((5000, 1))})
    table = open_table(FileSource("log", tmp_path / "log.mat"))
    blocks = table.chunks(["q"], 100)
    next(blocks)
    blocks.close()
    assert len(np.concatenate(list(table.chunks(["q", "p"], 100)))) == 5000
    for process in formats._idle[os.getpid()]:
        process._popen.kill()
        process._popen.wait()
    np.testing.assert_array_equal(np.concatenate(list(table.chunks(["q"], 999)))[:, 0], np.arange(5000.0))
