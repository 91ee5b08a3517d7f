"""Staging files and directories for unfinished output: recognizable by name, and locked while a process uses them.

A lock belongs to an open file. It therefore ends with the process that holds it, even if that is killed, and it works
between containers that share a folder. On a file system without locks nothing is ever treated as abandoned.
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
    """Create an empty, private staging directory in ``place`` for the output ``name``."""
    return Path(tempfile.mkdtemp(dir=place, prefix=f".{name}{MARK}"))


def staging_file(place: Path, name: str) -> tuple[int, Path]:
    """Create an empty, private staging file in ``place`` for the output ``name``; returns locked handle and path."""
    handle, staged = tempfile.mkstemp(dir=place, prefix=f".{name}{MARK}")
    _try_lock(handle)
    return handle, Path(staged)


@contextmanager
def locked(path: Path, wait: bool = True) -> Iterator[int | None]:
    """Hold the lock of a file or directory; yields its handle, or None if it cannot be locked.

    With ``wait``, waits for another process to release the lock.
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
    """Whether ``path`` has the name of a staging file or directory: of the output ``name``, or of any (None)."""
    return path.name.startswith(f".{name}{MARK}") if name is not None else path.name[:1] == "." and MARK in path.name


def remove_abandoned(place: Path, name: str | None = None) -> None:
    """Remove staging files in ``place`` whose process has ended: of the output ``name``, or of any (None)."""
    with contextlib.suppress(OSError):
        for path in [entry for entry in place.iterdir() if is_staged(entry, name)]:
            with locked(path, wait=False) as abandoned:
                if abandoned is not None:
                    remove(path)


def remove(path: Path) -> None:
    """Remove a file, or a directory with its contents; errors are ignored."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with contextlib.suppress(OSError):
            path.unlink()
