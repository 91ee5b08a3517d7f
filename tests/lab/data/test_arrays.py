"""Containers of arrays as recordings: NumPy, MATLAB, HDF5, Parquet."""

import numpy as np
import pytest

from lab.data.three_joints import PLAIN, TAU, Q, T, mapped, read, table
from rrrgen.base.errors import InputError
from rrrgen.lab.data import tables
from rrrgen.lab.data.mapping import FileSource, loads_mapping
from rrrgen.lab.data.tables.formats import open_table


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


def test_arrays_in_memory_have_any_number_of_rows(tmp_path, monkeypatch):
    """A file cannot hold more rows than its bytes allow; arrays in memory have no file, whose limit must not apply."""
    monkeypatch.setattr(tables, "ROWS_PER_BYTE", 0.0)
    values = np.arange(50.0)
    memory = open_table(FileSource("log", tmp_path / "log", arrays={"q": values}))
    np.testing.assert_array_equal(np.concatenate(list(memory.chunks(["q"], 20)))[:, 0], values)
    np.savez(tmp_path / "log.npz", q=values)
    with pytest.raises(InputError, match="50 rows, more than the file's"):
        next(iter(open_table(FileSource("log", tmp_path / "log.npz")).chunks(["q"], 20)))
