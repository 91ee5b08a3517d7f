"""Tables of numbers in the formats of other programs; a damaged file may only crash the process that reads it."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import Fault, InputError, InternalError, MissingExtraError
from rrrgen.lab.data.mapping import FileSource
from rrrgen.lab.data.tables import Table, check_rows, seconds_for, table_fault

# ------------------------------------------------------------------------------------------------------------------
# Tables whose files are read in a separate process, so that a damaged file can crash only that process.
# ------------------------------------------------------------------------------------------------------------------

_START = "import sys; sys.path[:] = {path!r}; from rrrgen.lab.data.tables.reading_process import serve; serve()"


class GuardedTable:
    """A table whose file is read by a library with native code, in a separate process with limited time and memory.

    If that process crashes, hangs or runs out of memory, the caller receives an :class:`InputError` with the reason.
    """

    def __init__(self, source: FileSource) -> None:
        self.source, self.path = source, source.path
        with _borrow_process(source) as process:
            self.columns: tuple[str, ...] = tuple(process.ask({"columns": True})["columns"])
            process.free = True

    def chunks(self, wanted: Sequence[str | int], size: int) -> Iterator[Array]:
        """Iterate over blocks of the wanted columns; abandoning the iteration ends the reading process."""
        rows = 0
        with _borrow_process(self.source) as process:
            answer = process.ask({"wanted": list(wanted), "size": size})
            while "rows" in answer:
                block = process.block(int(answer["rows"]), len(wanted), size)
                rows += len(block)
                check_rows(self.path, rows)
                yield block
                answer = process.answer()
            process.free = True


class _Process:
    """A child process that reads one file at a time and answers requests for its contents.

    ``free`` is True once it has sent the last answer to a request, so that it can serve another file.
    """

    def __init__(self) -> None:
        path = [os.path.abspath(folder) for folder in sys.path]
        self._popen = subprocess.Popen(
            [sys.executable, "-P", "-c", _START.format(path=path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        assert self._popen.stdin is not None
        assert self._popen.stdout is not None
        self._to, self._from = self._popen.stdin, self._popen.stdout
        self.free = False
        self._source: FileSource | None = None
        self._asked = 0.0

    def serves(self, source: FileSource) -> _Process:
        """Assign the process to the file ``source``; returns itself."""
        self._source, self.free = source, False
        return self

    def alive(self) -> bool:
        """Whether the process is still running."""
        return self._popen.poll() is None

    def ask(self, request: dict[str, Any]) -> dict[str, Any]:
        """Send a request and return the first answer to it."""
        assert self._source is not None
        source = {**asdict(self._source), "path": os.path.abspath(self._source.path)}
        with contextlib.suppress(BrokenPipeError, OSError):  # the process has ended: the missing answer reports it
            self._to.write(json.dumps({"source": source, **request}).encode() + b"\n")
            self._to.flush()
        return self.answer()

    def answer(self) -> dict[str, Any]:
        """Wait for the next answer; raises the error that the process reports for the file."""
        self._asked = time.monotonic()
        line = self._from.readline()
        if not line.endswith(b"\n"):
            raise self._end_error()
        answer: dict[str, Any] = json.loads(line)
        if "faults" in answer:
            self.free = True
            raise InputError([Fault(*self._restore_path(entry)) for entry in answer["faults"]])
        if "missing" in answer:
            self.free = True
            raise MissingExtraError(*answer["missing"])
        if "internal" in answer:
            raise InternalError(f"{answer['internal']} (reading {self._path})")
        return answer

    def block(self, rows: int, width: int, size: int) -> Array:
        """Read the block of numbers (rows, width) that follows an answer; ``size`` is the largest number of rows."""
        if not 0 <= rows <= size:
            raise InternalError(f"a block of {rows} rows, where at most {size} were asked for")
        numbers = np.empty((rows, width))
        if numbers.size and self._from.readinto(numbers.data.cast("B")) != numbers.nbytes:  # type: ignore[attr-defined]
            raise self._end_error()
        return numbers

    def end(self) -> None:
        """Kill the process and close its pipes."""
        with contextlib.suppress(OSError):
            self._popen.kill()
        with contextlib.suppress(OSError):
            self._to.close()
        self._from.close()
        self._popen.wait()

    @property
    def _path(self) -> Path:
        assert self._source is not None
        return self._source.path

    def _restore_path(self, entry: list[Any]) -> list[Any]:
        """Fields ``entry`` of a fault that the process reported, with the path of the file as the caller wrote it."""
        return [str(self._path) if entry[0] == os.path.abspath(self._path) else entry[0], *entry[1:]]

    def _end_error(self) -> InputError:
        """The error for a process that ended without an answer: time limit, crash or memory limit."""
        waited = time.monotonic() - self._asked
        status = self._popen.wait()
        if waited >= 0.9 * seconds_for(self._path):
            hint = "the file is damaged; if its disk is slow, set RRRGEN_READ_SECONDS to more than 60"
            return table_fault(self._path, f"reading was given up after {waited:.0f} s", hint)
        how = f"exit status {status}"
        if status < 0:
            with contextlib.suppress(ValueError):
                how = signal.Signals(-status).name
        return table_fault(
            self._path,
            f"the library that reads such files was brought down by it ({how})",
            "the file is damaged, or larger than this machine's memory allows",
        )


_idle: dict[int, list[_Process]] = {}
"""Idle reading processes by the id of the process that started them; a forked process must not share its parent's."""


@contextlib.contextmanager
def _borrow_process(source: FileSource) -> Iterator[_Process]:
    """Context with a process that reads ``source``; if it has answered completely, it is kept for the next file."""
    waiting = _idle.setdefault(os.getpid(), [])
    process = waiting.pop() if waiting else _Process()
    if not process.alive():
        process.end()
        process = _Process()
    try:
        yield process.serves(source)
    finally:
        if process.free:
            waiting.append(process)
        else:
            process.end()


# ------------------------------------------------------------------------------------------------------------------
# Chooses the reader of a recorded file from its declared format or its suffix.
# ------------------------------------------------------------------------------------------------------------------

SUFFIXES = {
    ".csv": "csv", ".tsv": "csv", ".txt": "csv", ".dat": "csv", ".log": "csv", ".asc": "csv",
    ".npy": "npy", ".npz": "npz", ".mat": "mat", ".h5": "hdf5", ".hdf5": "hdf5", ".parquet": "parquet",
    ".pq": "parquet", ".mcap": "rosbag", ".db3": "rosbag", ".bag": "rosbag",
}  # fmt: skip

NATIVE = ("mat", "hdf5", "parquet", "rosbag")
"""Formats read in a separate process, because libraries parse them in native code or decompress without bounds."""


def open_table(source: FileSource) -> Table:
    """Open one file as a table, in a separate process for native formats; raises :class:`InputError` if unreadable."""
    if source.arrays is not None:
        from rrrgen.lab.data.tables.arrays import MemoryTable

        return MemoryTable(source.path, source.arrays)
    if kind_of(source) in NATIVE:
        return GuardedTable(source)
    return open_here(source)


def open_here(source: FileSource) -> Table:
    """Open one file as a table in this process; raises :class:`InputError` if it cannot be read."""
    kind, path = kind_of(source), source.path
    if kind == "csv":
        from rrrgen.lab.data.tables.csv import CsvTable

        return CsvTable(source)
    if kind == "parquet":
        from rrrgen.lab.data.tables.arrays import ParquetTable

        return ParquetTable(path)
    if kind == "rosbag":
        from rrrgen.lab.data.tables.ros_bags import BagTable

        return BagTable(source)
    from rrrgen.lab.data.tables import arrays as array_tables

    return array_tables.open_arrays(path, kind)


def kind_of(source: FileSource) -> str:
    """The format of a file: as declared, by its suffix, or a ROS recording for a folder.

    Raises :class:`InputError` if the file does not exist or its format is not known.
    """
    path = source.path
    try:
        folder = path.is_dir()
        if not folder and not path.exists():
            raise table_fault(path, "there is no such file")
    except (OSError, ValueError) as error:  # a name too long, a zero byte in it
        raise table_fault(path, f"cannot be opened: {error}") from None
    kind = source.format or ("rosbag" if folder else SUFFIXES.get(path.suffix.lower()))
    if kind is None:
        allowed = " | ".join(sorted(set(SUFFIXES.values())))
        raise table_fault(path, f"the format of '{path.name}' is not known", f"name it with format: {allowed}")
    if folder and kind != "rosbag":
        raise table_fault(path, f"a folder, where a file in the format {kind} is needed")
    return kind
