"""Where results of earlier runs live: the user's cache directory, addressed by the hash of what produced them.

Libraries in it are loaded and their code is run, so it must be the user's own, as must every file in it; each file is
checked against its checksum before it is used.
"""

from __future__ import annotations

import contextlib
import glob
import hashlib
import os
import shutil
import stat
import sys
import tempfile
import time
from functools import cache
from pathlib import Path

from rrrgen.errors import StorageError, storage_error

TRUSTED_OWNERS = {os.geteuid(), 0} if hasattr(os, "geteuid") else set()
"""Users whose files are loaded: the own one, and root, who could do anything anyway."""

OTHERS_MAY_WRITE = stat.S_IWGRP | stat.S_IWOTH
CHECKSUM_BYTES = 32

ABANDONED = 86400.0
"""Seconds after which an unfinished file or build directory belongs to a process that was killed."""


@cache
def cache_directory() -> Path:
    """The directory for built extensions, derived models and translated templates, created private to the user.

    ``$RRRGEN_CACHE`` if set, else ``rrrgen`` below the user's cache directory; a temporary directory of this process
    where that cannot be written. Raises StorageError where another user could put code into it that would be run.
    """
    directory = _wanted_directory()
    try:
        directory.mkdir(mode=0o700, parents=True, exist_ok=True)
        status = directory.stat()
        _check_trusted(directory, status)
        with tempfile.TemporaryFile(dir=directory):
            return directory
    except OSError:
        return Path(tempfile.mkdtemp(prefix="rrrgen-"))


def _check_trusted(path: Path, status: os.stat_result) -> None:
    """Raise StorageError unless nobody but the user can have written ``path``; on Windows its access list decides."""
    if not TRUSTED_OWNERS:
        return
    if status.st_uid not in TRUSTED_OWNERS:
        raise StorageError(
            f"the cache {path} belongs to another user (number {status.st_uid}), whose code would be run from it. "
            "Set RRRGEN_CACHE to a directory of your own"
        )
    if status.st_mode & OTHERS_MAY_WRITE:
        raise StorageError(
            f"other users may write to the cache {path}, and code is run from it. Empty it and take away their right "
            f"(chmod go-w {path}), or set RRRGEN_CACHE to a directory of your own"
        )


def _wanted_directory() -> Path:
    chosen = os.environ.get("RRRGEN_CACHE")
    if chosen:
        return Path(chosen).expanduser().absolute()
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "rrrgen"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache").expanduser().absolute() / "rrrgen"


def prune(most: int = 500) -> None:
    """Forget the results not used for longest when there are more than ``most``, and what killed builds have left."""
    for path in cache_directory().glob(".*"):
        if time.time() - _last_use(path) > ABANDONED:
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)
    entries = [path for path in cache_directory().iterdir() if path.is_file()]
    if len(entries) <= most:
        return
    ages = sorted((_last_use(path), path) for path in entries)
    for _, path in ages[: len(entries) - most * 3 // 4]:
        path.unlink(missing_ok=True)


def touch(path: Path) -> None:
    """Note that a result was used; a cache that is read-only by now loses nothing but this note."""
    with contextlib.suppress(OSError):
        os.utime(path)


def _last_use(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:  # another process was faster
        return 0.0


def digest(*parts: str) -> str:
    """SHA-256 of ``parts``, each with its length in front so that no two lists run into one another."""
    state = hashlib.sha256()
    for part in parts:
        data = part.encode()
        state.update(len(data).to_bytes(8, "little"))
        state.update(data)
    return state.hexdigest()


def store(path: Path, data: bytes) -> None:
    """Write ``data`` so that a reader sees all of it or none, after a power failure too, and only the user may read it.

    Raises StorageError where the disk is full.
    """
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}-")
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(name, path)
    except OSError as error:
        raise storage_error(path, error) or error from error
    finally:
        with contextlib.suppress(OSError):
            os.unlink(name)


def keep(name: str, data: bytes) -> None:
    """Remember ``data`` under ``name``, with its checksum in front."""
    store(cache_directory() / name, hashlib.sha256(data).digest() + data)


def recall(name: str) -> bytes | None:
    """What was kept under ``name``; None where nothing was, or where it is damaged."""
    content = _content(cache_directory() / name)
    if content is None:
        return None
    data = content[CHECKSUM_BYTES:]
    touch(cache_directory() / name)
    return data if hashlib.sha256(data).digest() == content[:CHECKSUM_BYTES] else None


def keep_library(stem: str, data: bytes) -> Path:
    """Remember a library; its file must be as the linker wrote it, so the checksum becomes part of the file's name."""
    path = cache_directory() / f"{stem}.{hashlib.sha256(data).hexdigest()[:32]}.so"
    store(path, data)
    return path


def recall_library(stem: str) -> Path | None:
    """The file of a library that was kept; loading one that is cut off would end the process, so damaged ones go."""
    for path in sorted(cache_directory().glob(f"{glob.escape(stem)}.*.so")):
        content = _content(path)
        if content is not None and hashlib.sha256(content).hexdigest()[:32] == path.name.split(".")[-2]:
            touch(path)
            return path
        with contextlib.suppress(OSError):
            path.unlink()
    return None


def _content(path: Path) -> bytes | None:
    """What a file holds that nobody else can have written; None where there is none."""
    try:
        with path.open("rb") as stream:
            _check_trusted(path, os.fstat(stream.fileno()))
            return stream.read()
    except OSError:
        return None
