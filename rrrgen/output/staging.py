"""Places for what is not finished: named so that a later run recognises what an ended process has left, and locked.

A lock belongs to an open file, so it ends with the process that holds it, however that ends, and it holds between
containers that share a folder. Where the file system has no locks, nothing is ever taken for abandoned.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

MARK = ".rrrgen-"


def staging_directory(place: Path, name: str) -> Path:
    """A new, empty, private directory in ``place`` for something that will be called ``name``."""
    return Path(tempfile.mkdtemp(dir=place, prefix=f".{name}{MARK}"))


def staging_file(place: Path, name: str) -> tuple[int, Path]:
    """A new, empty, private file in ``place`` for something that will be called ``name``, open and locked."""
    handle, staged = tempfile.mkstemp(dir=place, prefix=f".{name}{MARK}")
    _try_lock(handle)
    return handle, Path(staged)


@contextmanager
def locked(path: Path, wait: bool = True) -> Iterator[int | None]:
    """Hold the lock of a file or directory; yields its handle, or None where there is no lock to be had.

    ``wait`` for another process to give it up.
    """
    handle = -1
    with contextlib.suppress(OSError):
        handle = os.open(path, os.O_RDONLY)
    try:
        yield handle if handle >= 0 and _try_lock(handle, wait) else None
    finally:
        if handle >= 0:
            os.close(handle)


def _try_lock(handle: int, wait: bool = False) -> bool:
    try:
        import fcntl
    except ImportError:  # Windows
        return False
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except OSError:
        return False
    return True


def is_staged(path: Path, name: str | None = None) -> bool:
    """Whether ``path`` is called like something unfinished: of ``name``, or of anything."""
    return path.name.startswith(f".{name}{MARK}") if name is not None else path.name[:1] == "." and MARK in path.name


def remove_abandoned(place: Path, name: str | None = None) -> None:
    """Remove what ended processes have left unfinished in ``place``: of ``name``, or of anything."""
    with contextlib.suppress(OSError):
        for path in [entry for entry in place.iterdir() if is_staged(entry, name)]:
            with locked(path, wait=False) as abandoned:
                if abandoned is not None:
                    remove(path)


def remove(path: Path) -> None:
    """Remove a file, or a directory with all that is in it, as far as that is possible."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with contextlib.suppress(OSError):
            path.unlink()
