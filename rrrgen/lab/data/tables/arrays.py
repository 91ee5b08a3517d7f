"""Tables in containers of arrays: NumPy, MATLAB v5 and v7.3, HDF5, Parquet.

A column is an array by name, ``q``; one column of a two-dimensional array is ``q[2]`` (counted from 0) or ``q(3)``
(counted from 1). The longer axis of an array is time.
"""

from __future__ import annotations

import contextlib
import math
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import MissingExtraError
from rrrgen.lab.data.tables import (
    Table,
    blocks,
    bytes_of,
    check_rows,
    foreign_reader,
    indexed_name,
    named_column,
    table_fault,
    unknown_column,
)

NUMBERS = "fiub"
"""NumPy kinds of real numbers; complex numbers, texts and dates are not accepted."""

MAT, HDF5, PARQUET, NUMPY = "a MATLAB file", "an HDF5 file", "a Parquet file", "a NumPy file"


def open_arrays(path: Path, kind: str) -> Table:
    """Open a container of arrays; MATLAB v7.3 files are HDF5 and are recognised by their content."""
    if kind == "npy":
        return NpyTable(path)
    if kind == "npz":
        return NpzTable(path)
    with foreign_reader(path, MAT), path.open("rb") as stream:
        head = stream.read(512)
    # HDF5 starts at once, or after MATLAB's own 512 bytes of text
    if kind == "hdf5" or b"MATLAB 7.3" in head[:116] or head.startswith(b"\x89HDF"):
        return Hdf5Table(path)
    return MatTable(path)


def column_of(path: Path, name: str, array: Any, index: int | None) -> Any:
    """One column of an array of one or two dimensions, read lazily if the array is on disk.

    ``index`` selects the column of a two-dimensional array. Raises :class:`InputError` for other shapes and types.
    """
    shape = array.shape
    if array.dtype.kind not in NUMBERS:
        raise table_fault(path, f"'{name}' is of type {array.dtype}, not numbers")
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
    """One column of an array in memory, memory-mapped, or in HDF5, of which only the rows asked for are read."""

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
    """Base of tables over a container of named arrays: the file ``path`` and the names of its ``columns``."""

    path: Path
    columns: tuple[str, ...]

    def array(self, name: str) -> Any:
        """The array called ``name``, None if the container has none."""
        raise KeyError(name)

    def check_length(self, rows: int) -> None:
        """Raise :class:`InputError` if the columns have more ``rows`` than the file can hold."""
        check_rows(self.path, rows)

    def chunks(self, wanted: Sequence[str | int], size: int) -> Iterator[Array]:
        """Iterate over blocks (up to ``size`` rows, columns) of the ``wanted`` columns.

        Raises :class:`InputError` if the columns differ in length.
        """
        columns = []
        for column in wanted:
            name, index = indexed_name(str(column))
            array = self.array(name)
            if array is None:
                raise unknown_column(self.path, name, self.columns)
            columns.append(column_of(self.path, name, array, index))
        lengths = {len(column) for column in columns}
        self.check_length(max(lengths, default=0))
        if len(lengths) > 1:
            named = ", ".join(f"{name}: {len(column)}" for name, column in zip(wanted, columns, strict=True))
            raise table_fault(self.path, f"columns of different lengths ({named})")
        pieces = blocks(columns, size)
        while True:
            with foreign_reader(self.path, "a container of arrays"):
                block = next(pieces, None)
            if block is None:
                return
            yield block


class MemoryTable(_ArrayTable):
    """Columns ``arrays`` (N,) by name that a caller holds in memory; ``path`` names them in messages."""

    def __init__(self, path: Path, arrays: Mapping[str, Array]) -> None:
        self.path, self.arrays, self.columns = path, arrays, tuple(arrays)

    def array(self, name: str) -> Any:
        """The array called ``name``, None if there is none."""
        return self.arrays.get(name)

    def check_length(self, rows: int) -> None:
        """Arrays in memory have any number of ``rows``: no file bounds them."""


class NpyTable(_ArrayTable):
    """Table in a .npy file, which holds one array; its columns are named "1", "2", .. or ``data[0]``, ``data[1]``, ..

    The file is not memory-mapped, because it may be larger than the address space allowed to the process.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with foreign_reader(path, NUMPY), path.open("rb") as stream:
            self.data = _ArrayFile(path, stream)
        if self.data.dtype.names:
            self.columns = tuple(self.data.dtype.names)
        else:
            width = 1 if len(self.data.shape) < 2 else min(self.data.shape)
            self.columns = tuple(str(i + 1) for i in range(width))

    def array(self, name: str) -> Any:
        """The array of the file under the name ``data``, None for any other ``name``."""
        return self.data if name == "data" and not self.data.dtype.names else None

    def chunks(self, wanted: Sequence[str | int], size: int) -> Iterator[Array]:
        """Iterate over blocks (up to ``size`` rows, columns) of the ``wanted`` columns."""
        if self.data.dtype.names:
            places = [self.columns[named_column(self.path, name, self.columns)] for name in wanted]
            for start in range(0, self.data.shape[0], size):
                piece = self.data.rows(start, size)
                yield np.column_stack([piece[place].astype(float) for place in places])
            return
        if len(self.data.shape) == 2 and self.data.shape[0] == self.data.shape[1]:
            raise table_fault(self.path, "the array is square: which axis is time?")
        numbers = [self._number(name) for name in wanted]
        by_rows = len(self.data.shape) < 2 or self.data.shape[0] > self.data.shape[1]
        length = self.data.shape[0] if by_rows else self.data.shape[1]
        for start in range(0, length, size):
            if by_rows:
                piece = self.data.rows(start, size).reshape(min(size, length - start), -1)
                yield piece[:, numbers].astype(float)
            else:
                yield np.column_stack([self.data.row_part(k, start, size) for k in numbers])

    def _number(self, name: str | int) -> int:
        base, index = indexed_name(str(name))
        if index is None:
            return named_column(self.path, int(base) if base.isdecimal() else base, self.columns)
        if base != "data" or index >= len(self.columns):
            raise unknown_column(self.path, name, self.columns)
        return index


class _ArrayFile:
    """An array of one or two dimensions in a .npy file, read in pieces."""

    def __init__(self, path: Path, stream: BinaryIO) -> None:
        self.shape, self.fortran, self.dtype = read_array_header(stream)
        self.path, self.offset = path, stream.tell()
        kinds = [self.dtype[name] for name in self.dtype.names] if self.dtype.names else [self.dtype]
        if len(self.shape) not in (1, 2) or not all(kind.kind in NUMBERS for kind in kinds):
            raise ValueError("not an array of numbers of one or two dimensions")
        if self.dtype.names and len(self.shape) != 1:
            raise ValueError("a table of named columns has one dimension")
        check_array(path, self.shape, self.dtype, bytes_of(path) - self.offset)

    def rows(self, start: int, count: int) -> NDArray[Any]:
        """Read ``count`` rows of the array from row ``start`` on."""
        count = min(count, self.shape[0] - start)
        width = self.shape[1] if len(self.shape) == 2 else 1
        if self.fortran and width > 1:
            return np.column_stack([self._piece(k * self.shape[0] + start, count) for k in range(width)])
        return self._piece(start * width, count * width).reshape((count, *self.shape[1:]))

    def row_part(self, row: int, start: int, count: int) -> NDArray[Any]:
        """Read ``count`` entries of one ``row`` of a two-dimensional array, from entry ``start`` on."""
        count = min(count, self.shape[1] - start)
        if not self.fortran:
            return self._piece(row * self.shape[1] + start, count).astype(float)
        height = self.shape[0]
        return self._piece(start * height, count * height).reshape(count, height)[:, row].astype(float)

    def _piece(self, first: int, count: int) -> NDArray[Any]:
        with self.path.open("rb") as stream:
            stream.seek(self.offset + first * self.dtype.itemsize)
            values = np.fromfile(stream, self.dtype, count)
        if len(values) < count:
            raise table_fault(self.path, "the file is shorter than its header says", "was it copied completely?")
        return values


class NpzTable(_ArrayTable):
    """Arrays of a .npz file; each array is loaded once, when it is first asked for."""

    def __init__(self, path: Path) -> None:
        self.path = path
        with foreign_reader(path, NUMPY):
            self.file = zipfile.ZipFile(path)
            self.members = {entry.filename.removesuffix(".npy"): entry for entry in self.file.infolist()}
        self.columns = tuple(self.members)

    def array(self, name: str) -> Any:
        """The array called ``name``, read into memory; None if the file has none."""
        if name not in self.members:
            return None
        entry = self.members[name]
        with foreign_reader(self.path, NUMPY), self.file.open(entry) as stream:
            # the true size is at most what deflate can make of the bytes, whatever the header claims
            size = min(entry.file_size, 1100 * bytes_of(self.path))
            shape, fortran, dtype = read_array_header(stream)
            check_array(self.path, shape, dtype, size)
            if dtype.kind not in NUMBERS:
                raise table_fault(self.path, f"'{name}' is of type {dtype}, not numbers")
            data = stream.read(math.prod(shape) * dtype.itemsize)
            return np.frombuffer(data, dtype).reshape(shape, order="F" if fortran else "C")


class MatTable(_ArrayTable):
    """Arrays of a MATLAB v5 file; the field q of a struct ``log`` has the name ``log.q``."""

    def __init__(self, path: Path) -> None:
        try:
            from scipy.io import loadmat
        except ImportError:
            raise MissingExtraError("reading MATLAB files", "scipy", "identify") from None
        self.path = path
        self.arrays: dict[str, Any] = {}
        with foreign_reader(path, MAT, "save it with -v7 or -v7.3"):
            for name, value in loadmat(path, squeeze_me=True, struct_as_record=False).items():
                if not name.startswith("__"):
                    self._collect(name, value)
        self.columns = tuple(self.arrays)

    def array(self, name: str) -> Any:
        """The array called ``name``, read into memory; None if the file has none."""
        return self.arrays.get(name)

    def _collect(self, name: str, value: Any) -> None:
        fields = getattr(value, "_fieldnames", None)
        if fields:
            for field in fields:
                self._collect(f"{name}.{field}", getattr(value, field))
        elif isinstance(value, np.ndarray) and value.dtype.kind in NUMBERS:
            self.arrays[name] = value


class Hdf5Table(_ArrayTable):
    """Datasets of an HDF5 or MATLAB v7.3 file, read slice by slice; q in the group ``log`` has the name ``log.q``."""

    def __init__(self, path: Path) -> None:
        try:
            import h5py
        except ImportError:
            raise MissingExtraError("reading MATLAB v7.3 and HDF5 files", "h5py", "logs") from None
        self.path = path
        names: list[str] = []

        def collect(name: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset) and item.dtype.kind in NUMBERS and not name.startswith("#"):
                names.append(name)

        with foreign_reader(path, HDF5):
            self.file = h5py.File(path, "r")
            self.file.visititems(collect)
        self.places = {name.replace("/", "."): name for name in names}
        self.columns = tuple(self.places)

    def array(self, name: str) -> Any:
        """The dataset called ``name``, still on disk, or None."""
        with foreign_reader(self.path, HDF5):
            return self.file[self.places[name]] if name in self.places else None


class ParquetTable:
    """A Parquet file, read batch by batch."""

    def __init__(self, path: Path) -> None:
        try:
            import pyarrow
            import pyarrow.parquet
        except ImportError:
            raise MissingExtraError("reading Parquet files", "pyarrow", "logs") from None
        self.path = path
        with foreign_reader(path, PARQUET), pyarrow.parquet.ParquetFile(path) as file:
            self.columns = tuple(file.schema_arrow.names)
            check_rows(path, file.metadata.num_rows)

    def chunks(self, wanted: Sequence[str | int], size: int) -> Iterator[Array]:
        """Iterate over blocks (up to ``size`` rows, columns) of the ``wanted`` columns; an empty entry is NaN."""
        import pyarrow
        import pyarrow.parquet

        names = [self.columns[named_column(self.path, name, self.columns)] for name in wanted]
        with contextlib.ExitStack() as stack:
            with foreign_reader(self.path, PARQUET):
                file = stack.enter_context(pyarrow.parquet.ParquetFile(self.path))
                batches = file.iter_batches(batch_size=size, columns=sorted(set(names)))
            while True:
                with foreign_reader(self.path, PARQUET):
                    batch = next(batches, None)
                if batch is None:
                    return
                try:
                    numbers = [batch.column(name).cast(pyarrow.float64()) for name in names]
                except pyarrow.ArrowException as error:
                    raise table_fault(self.path, f"a column is not numeric: {error}") from None
                yield np.column_stack([column.to_numpy(zero_copy_only=False) for column in numbers])


def read_array_header(stream: Any) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Read the header of an array in NumPy's format: its shape, whether it is in Fortran order, and its type."""
    version = np.lib.format.read_magic(stream)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, fortran, dtype = read(stream)
    return shape, fortran, dtype


def check_array(path: Path, shape: tuple[int, ...], dtype: np.dtype[Any], size: int) -> None:
    """Raise :class:`InputError` if the header claims an array larger than the ``size`` bytes present."""
    if min(shape, default=0) < 0 or math.prod(shape) * dtype.itemsize > size:
        claim = " x ".join(str(length) for length in shape)
        raise table_fault(
            path, f"the file is shorter than its header says ({claim} of {dtype})", "was it copied completely?"
        )
