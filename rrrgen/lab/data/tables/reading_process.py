"""Entry point of the reading process, in which a damaged file may crash, block or exhaust a library with native code.

HDF5, MATLAB and Parquet files and ROS recordings are parsed by native code. A damaged file can crash it by a signal,
make it loop forever, or make it request any amount of memory. The parent process
(:mod:`rrrgen.lab.data.tables.formats`) writes one request a line to standard input,
``{"source": ..., "columns": true}`` or ``{"source": ..., "wanted": [...], "size": n}``, and reads answers: one line of
JSON each, which for a block of rows precedes its numbers as raw doubles. Nothing in an answer can be executed.
"""

from __future__ import annotations

import contextlib
import faulthandler
import json
import os
import sys
from collections.abc import Iterator
from dataclasses import astuple
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError, MissingExtraError
from rrrgen.lab.data.mapping import FileSource
from rrrgen.lab.data.tables import Table, bytes_of, seconds_for

MEMORY = 2 << 30  # bytes allowed in addition to EXPANSION times the size of the file, which may be compressed
EXPANSION = 64


def serve() -> None:
    """Answer the requests of the parent process until it closes standard input."""
    answers = os.fdopen(os.dup(1), "wb")
    # libraries that print must not disturb the answers
    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 1)
    memory = _Memory()
    opened = _Opened()
    with open(quiet, "wb") as nowhere, contextlib.suppress(BrokenPipeError, KeyboardInterrupt):
        for line in sys.stdin.buffer:
            request = json.loads(line)
            source = FileSource(**{**request["source"], "path": Path(request["source"]["path"])})
            memory.allow(MEMORY + EXPANSION * bytes_of(source.path))
            watch = _Watch(nowhere.fileno(), seconds_for(source.path))
            _answer(request, source, opened, watch, answers)


def _answer(request: dict[str, Any], source: FileSource, opened: _Opened, watch: _Watch, answers: BinaryIO) -> None:
    """Write the answers to one request; the last one is ``end`` or an error."""
    try:
        with watch:
            table = opened.table(source)
        if "wanted" in request:
            for block in watch.each(table.chunks(request["wanted"], request["size"])):
                _send(answers, {"rows": len(block)}, np.ascontiguousarray(block, float))
            _send(answers, {"end": True})
        else:
            _send(answers, {"columns": list(table.columns)})
    except InputError as error:
        _send(answers, {"faults": [astuple(fault) for fault in error.faults]})
    except MissingExtraError as error:
        _send(answers, {"missing": [error.purpose, error.package, error.extra]})
    except BrokenPipeError:
        raise
    except Exception as error:  # a fault of rrrgen's own code, reported as such
        _send(answers, {"internal": f"{type(error).__name__}: {error}"})


def _send(answers: BinaryIO, content: dict[str, Any], block: Array | None = None) -> None:
    answers.write(json.dumps(content).encode() + b"\n")
    if block is not None:
        answers.write(block.data if block.size else b"")
    answers.flush()


class _Opened:
    """Cache of the last table opened, because a request for its columns is followed by one for its rows."""

    def __init__(self) -> None:
        self._key: tuple[Any, ...] = ()
        self._table: Table | None = None

    def table(self, source: FileSource) -> Table:
        """The table of ``source``, opened anew if the file has changed."""
        from rrrgen.lab.data.tables.formats import open_here

        key = (source, _stamp(source.path))
        if self._table is None or key != self._key:
            self._table = None
            self._table, self._key = open_here(source), key
        return self._table


def _stamp(path: Path) -> tuple[int, ...]:
    try:
        status = path.stat()
    except OSError:
        return ()
    return status.st_mtime_ns, status.st_size, status.st_ino


class _Watch:
    """Watchdog: ends this process if a step takes longer than ``seconds``, even within native code."""

    def __init__(self, log: int, seconds: float) -> None:
        self._log, self._seconds = log, seconds

    def __enter__(self) -> None:
        faulthandler.dump_traceback_later(self._seconds, exit=True, file=self._log)

    def __exit__(self, *error: object) -> None:
        faulthandler.cancel_dump_traceback_later()

    def each(self, blocks: Iterator[Array]) -> Iterator[Array]:
        """Iterate over ``blocks`` with a time limit on reading each one; the time between the reads is not limited."""
        while True:
            with self:
                block = next(blocks, None)
            if block is None:
                return
            yield block


class _Memory:
    """Sets the limit on the address space of this process, on systems that support one."""

    def __init__(self) -> None:
        self._base = self._address_space()

    def allow(self, more: int) -> None:
        """Limit the address space to ``more`` bytes beyond what Python and its libraries had taken at the start."""
        if sys.platform == "win32":
            return
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        _, most = resource.getrlimit(resource.RLIMIT_AS)
        limit = self._base + more
        if most != resource.RLIM_INFINITY:
            limit = min(limit, most)
        with contextlib.suppress(ValueError, OSError):  # macOS knows the limit and refuses to set it
            resource.setrlimit(resource.RLIMIT_AS, (limit, most))

    def _address_space(self) -> int:
        try:
            pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        except (OSError, ValueError):
            return 1 << 30
        return pages * os.sysconf("SC_PAGE_SIZE")
