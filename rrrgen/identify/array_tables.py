"""Tables in containers of arrays: NumPy, MATLAB v5 and v7.3, HDF5, Parquet.

A column is an array by name, ``q``; one column of a two-dimensional array is ``q[2]`` (counted from 0) or ``q(3)``
(counted from 1). The longer axis of an array is time.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rrrgen.errors import InputError
from rrrgen.identify.columns import Array
from rrrgen.identify.tables import Table, blocks, indexed_name, named_column, table_fault, unknown_column


def open_arrays(path: Path, kind: str) -> Table:
    """The table of a container; MATLAB v7.3 files are HDF5 and recognised by their content."""
    if kind == "npy":
        return NpyTable(path)
    if kind == "npz":
        return NpzTable(path)
    with path.open("rb") as stream:
        head = stream.read(512)
    # HDF5 starts at once, or after MATLAB's own 512 bytes of text
    if kind == "hdf5" or b"MATLAB 7.3" in head[:116] or head.startswith(b"\x89HDF"):
        return Hdf5Table(path)
    return MatTable(path)


def column_of(path: Path, name: str, array: Any, index: int | None) -> Any:
    """One column of an array of one or two dimensions, as a slice that is not read yet where the array is on disk."""
    shape = array.shape
    long = [size for size in shape if size != 1]
    if len(long) > 2:
        raise table_fault(path, f"'{name}' has {len(shape)} dimensions", "a column has one, a table two")
    if len(shape) < 2 or len(long) < 2:
        if index not in (None, 0):
            raise table_fault(path, f"'{name}' has one column only", f"write {name}")
        return _Column(array, None, None)
    if len(shape) != 2:
        raise table_fault(path, f"'{name}' has {len(shape)} dimensions", "a column has one, a table two")
    if shape[0] == shape[1]:
        raise table_fault(path, f"'{name}' is square ({shape[0]} x {shape[1]}): which axis is time?")
    axis = 0 if shape[0] > shape[1] else 1
    width = shape[1 - axis]
    if index is None:
        raise table_fault(path, f"'{name}' has {width} columns", f"write {name}[0] to {name}[{width - 1}]")
    if index >= width:
        raise table_fault(path, f"column {name}[{index}] of {width}", "columns count from 0 in [ ], from 1 in ( )")
    return _Column(array, axis, index)


class _Column:
    """A lazily sliced column of an array in memory, memory-mapped, or in HDF5."""

    def __init__(self, array: Any, axis: int | None, index: int | None) -> None:
        self.array, self.axis, self.index = array, axis, index

    def __len__(self) -> int:
        return int(np.prod(self.array.shape)) if self.axis is None else int(self.array.shape[self.axis])

    def __getitem__(self, part: slice) -> Array:
        if self.axis is None:
            shape = self.array.shape
            longest = int(np.argmax(shape)) if shape else 0
            place = tuple(part if i == longest else 0 for i in range(len(shape)))
            return np.asarray(self.array[place], float)
        if self.axis == 0:
            return np.asarray(self.array[part, self.index], float)
        return np.asarray(self.array[self.index, part], float)


class _ArrayTable:
    """A container of named arrays."""

    path: Path
    columns: tuple[str, ...]

    def array(self, name: str) -> Any:
        """The array of that name, or None."""
        raise KeyError(name)

    def chunks(self, wanted: Sequence[str | int], size: int) -> Iterator[Array]:
        """Blocks of the wanted columns, which must be equally long."""
        found = []
        for column in wanted:
            name, index = indexed_name(str(column))
            array = self.array(name)
            if array is None:
                raise unknown_column(self.path, name, self.columns)
            found.append(column_of(self.path, name, array, index))
        lengths = {len(column) for column in found}
        if len(lengths) > 1:
            named = ", ".join(f"{name}: {len(column)}" for name, column in zip(wanted, found, strict=True))
            raise table_fault(self.path, f"columns of different lengths ({named})")
        yield from blocks(found, size)


class NpyTable(_ArrayTable):
    """One array in a .npy file, mapped into memory; its columns are named by their numbers from 1, or ``data[k]``."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.data = _numpy(path, lambda: np.load(path, mmap_mode="r", allow_pickle=False))
        if self.data.dtype.names:
            self.columns = tuple(self.data.dtype.names)
        else:
            width = 1 if self.data.ndim < 2 else min(self.data.shape)
            self.columns = tuple(str(i + 1) for i in range(width))

    def array(self, name: str) -> Any:
        """A field of a record array, a numbered column, or the array itself as ``data``."""
        if self.data.dtype.names:
            return self.data[name] if name in self.columns else None
        if name == "data":
            return self.data
        if name in self.columns:
            axis = 0 if self.data.ndim < 2 or self.data.shape[0] > self.data.shape[1] else 1
            flat = self.data if self.data.ndim < 2 else np.moveaxis(self.data, axis, 0)[:, int(name) - 1]
            return flat
        return None


class NpzTable(_ArrayTable):
    """Arrays of a .npz file; each array is loaded once, when it is first asked for."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.file = _numpy(path, lambda: np.load(path, allow_pickle=False))
        self.columns = tuple(self.file.files)

    def array(self, name: str) -> Any:
        """The array, in memory."""
        return _numpy(self.path, lambda: self.file[name]) if name in self.columns else None


class MatTable(_ArrayTable):
    """Arrays of a MATLAB v5 file; a field of a struct is ``log.q``."""

    def __init__(self, path: Path) -> None:
        from scipy.io import loadmat
        from scipy.io.matlab import MatReadError

        self.path = path
        try:
            content = loadmat(path, squeeze_me=True, struct_as_record=False)
        except (MatReadError, ValueError, TypeError, NotImplementedError, OSError, zipfile.BadZipFile) as error:
            raise table_fault(
                path, f"not a MATLAB file that can be read: {error}", "save it with -v7 or -v7.3"
            ) from None
        self.arrays: dict[str, Any] = {}
        for name, value in content.items():
            if not name.startswith("__"):
                self._collect(name, value)
        self.columns = tuple(self.arrays)

    def array(self, name: str) -> Any:
        """The array, in memory."""
        return self.arrays.get(name)

    def _collect(self, name: str, value: Any) -> None:
        fields = getattr(value, "_fieldnames", None)
        if fields:
            for field in fields:
                self._collect(f"{name}.{field}", getattr(value, field))
        elif isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
            self.arrays[name] = value


class Hdf5Table(_ArrayTable):
    """Datasets of an HDF5 or MATLAB v7.3 file; one inside a group is ``log.q``. Read slice by slice."""

    def __init__(self, path: Path) -> None:
        try:
            import h5py
        except ImportError as error:
            raise InputError("MATLAB v7.3 and HDF5 files need the extra 'logs': pip install rrrgen[logs]") from error
        self.path = path
        try:
            self.file = h5py.File(path, "r")
        except OSError as error:
            raise table_fault(path, f"not an HDF5 file: {error}") from None
        names: list[str] = []

        def collect(name: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset) and item.dtype.kind in "fiub" and not name.startswith("#"):
                names.append(name)

        self.file.visititems(collect)
        self.places = {name.replace("/", "."): name for name in names}
        self.columns = tuple(self.places)

    def array(self, name: str) -> Any:
        """The dataset, still on disk."""
        return self.file[self.places[name]] if name in self.places else None


class ParquetTable:
    """A Parquet file, read batch by batch."""

    def __init__(self, path: Path) -> None:
        try:
            import pyarrow
            import pyarrow.parquet
        except ImportError as error:
            raise InputError("Parquet files need the extra 'logs': pip install rrrgen[logs]") from error
        self.path = path
        try:
            self.columns = tuple(pyarrow.parquet.ParquetFile(path).schema_arrow.names)
        except (pyarrow.ArrowException, OSError) as error:
            raise table_fault(path, f"not a Parquet file: {error}") from None

    def chunks(self, wanted: Sequence[str | int], size: int) -> Iterator[Array]:
        """Blocks of the wanted columns; an empty entry is NaN."""
        import pyarrow
        import pyarrow.parquet

        names = [self.columns[named_column(self.path, name, self.columns)] for name in wanted]
        with pyarrow.parquet.ParquetFile(self.path) as file:
            for batch in file.iter_batches(batch_size=size, columns=sorted(set(names))):
                try:
                    numbers = [batch.column(name).cast(pyarrow.float64()) for name in names]
                except pyarrow.ArrowException as error:
                    raise table_fault(self.path, f"a column is not numeric: {error}") from None
                yield np.column_stack([column.to_numpy(zero_copy_only=False) for column in numbers])


def _numpy(path: Path, read: Any) -> Any:
    """What ``read`` loads; NumPy's complaints become faults of the file."""
    try:
        return read()
    except (ValueError, OSError, EOFError, KeyError, zipfile.BadZipFile) as error:
        raise table_fault(path, f"not a NumPy file that can be read: {error}") from None
