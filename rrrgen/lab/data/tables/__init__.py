"""Recorded tables, which are read in chunks: their interface, and functions shared by the readers of all formats."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import Fault, InputError, RrrgenError
from rrrgen.base.yamltext.suggestions import did_you_mean

ROWS_PER_BYTE = 1000
"""Upper bound on rows per byte of any compressed file: deflate and zstd need a byte for some hundred equal rows."""


class Table(Protocol):
    """Interface of a table of numbers that is read in chunks; a missing entry is NaN."""

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of the columns."""
        ...

    def chunks(self, wanted: Sequence[str | int], size: int) -> Iterator[Array]:
        """Iterate over blocks of the ``wanted`` columns (by name or number), up to ``size`` rows at a time.

        Each block has the shape (rows, len(wanted)).
        """
        ...


def table_fault(path: Path, message: str, hint: str = "", line: int = 0, column: int = 0, text: str = "") -> InputError:
    """An :class:`InputError` located in a recorded file; ``text`` is the line quoted in the message."""
    return InputError([Fault(str(path), line, column, message, text, hint)])


@contextlib.contextmanager
def foreign_reader(path: Path, what: str, hint: str = "was it copied completely?") -> Iterator[None]:
    """Context of calls into a library that reads the file: any exception it raises becomes an InputError on the file.

    Libraries raise nearly anything on damaged files (AssertionError, struct.error, RuntimeError, MemoryError, ...), so
    nothing narrower would do. ``what`` names what the file should be, e.g. "an HDF5 file".
    """
    try:
        yield
    except RrrgenError:
        raise
    except MemoryError:
        raise table_fault(path, "reading takes more memory than there is", f"is it {what}? {hint}") from None
    except Exception as error:
        reason = " ".join(str(error).split())[:300] or type(error).__name__
        raise table_fault(path, f"damaged, or not {what}: {reason}", hint) from None


def bytes_of(path: Path) -> int:
    """Size in bytes of a file, or of all files in a folder; 0 if it cannot be determined."""
    try:
        if path.is_dir():
            return sum(file.stat().st_size for file in path.iterdir() if file.is_file())
        return path.stat().st_size
    except OSError:
        return 0


def seconds_for(path: Path) -> float:
    """Time limit (s) for reading one block of the file ``path``.

    It is a minute (or ``$RRRGEN_READ_SECONDS``) plus a second per 20 MB of the file.
    """
    try:
        patience = float(os.environ.get("RRRGEN_READ_SECONDS", ""))
    except ValueError:
        patience = 60.0
    return max(patience, 0.1) + bytes_of(path) / 20e6


def check_rows(path: Path, rows: int) -> None:
    """Raise :class:`InputError` if a file claims or delivers more ``rows`` than its bytes can hold."""
    most = ROWS_PER_BYTE * (bytes_of(path) + 1000)
    if rows > most:
        raise table_fault(path, f"{rows} rows, more than the file's {bytes_of(path)} bytes can hold", "it is damaged")


def unknown_column(path: Path, wanted: str | int, columns: Sequence[str]) -> InputError:
    """The error for a ``wanted`` column that is not among ``columns``."""
    shown = ", ".join(columns[:40]) + (", ..." if len(columns) > 40 else "")
    hint = f"{did_you_mean(str(wanted), columns)} there are: {shown}".strip()
    return table_fault(path, f"no column '{wanted}'", hint)


def named_column(path: Path, wanted: str | int, columns: Sequence[str]) -> int:
    """Index (from 0) of the column with the name ``wanted``, or with that number counted from 1.

    Raises :class:`InputError` if there is no such column or its name occurs more than once.
    """
    if isinstance(wanted, int):
        if not 1 <= wanted <= len(columns):
            raise table_fault(path, f"column {wanted} of a table with {len(columns)} columns", "columns count from 1")
        return wanted - 1
    if wanted in columns:
        if list(columns).count(wanted) > 1:
            raise table_fault(path, f"the column name '{wanted}' occurs more than once", "give its number instead")
        return list(columns).index(wanted)
    raise unknown_column(path, wanted, columns)


def indexed_name(wanted: str) -> tuple[str, int | None]:
    """Split a column of a two-dimensional array into name and index from 0; the index is None for a plain name.

    ``q[2]`` counts from 0 as in Python, ``q(3)`` from 1 as in MATLAB; both give ("q", 2).
    """
    match = re.fullmatch(r"\s*(.*?)\s*(?:\[\s*(\d+)\s*\]|\(\s*(\d+)\s*\))\s*", wanted)
    if match is None:
        return wanted.strip(), None
    return match.group(1), int(match.group(2)) if match.group(2) is not None else int(match.group(3)) - 1


def blocks(columns: Sequence[Array], size: int) -> Iterator[Array]:
    """Iterate over blocks (up to ``size`` rows, len(columns)) of columns that can be sliced."""
    length = len(columns[0]) if columns else 0
    for start in range(0, length, size):
        yield np.column_stack([np.asarray(column[start : start + size], float) for column in columns])
