"""The user's cache of results of earlier runs, addressed by the hash of their inputs.

Cached libraries are loaded and their code is run. The directory and every file in it must therefore belong to the user
and be writable by nobody else, and every file is checked against its checksum before use.
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
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

from rrrgen.base.errors import StorageError, storage_error

TRUSTED_OWNERS = {os.geteuid(), 0} if hasattr(os, "geteuid") else set()
"""User ids whose files are loaded: the current user, and root, who could replace any file anyway."""

OTHERS_MAY_WRITE = stat.S_IWGRP | stat.S_IWOTH
CHECKSUM_BYTES = 32

ABANDONED = 86400.0
"""Age in seconds beyond which an unfinished file or build directory was left by a killed process."""


@cache
def cache_directory() -> Path:
    """The directory for built extensions, derived models and compiled templates, created with access for the user only.

    ``$RRRGEN_CACHE`` if set, else ``rrrgen`` below the user's cache directory; if that cannot be written, a temporary
    directory of this process. Raises StorageError if another user could place code in it.
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
    """Raise StorageError if another user may have written ``path``. No check on Windows, which uses access lists."""
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
    if sys.platform == "win32" and (local := os.environ.get("LOCALAPPDATA")):
        return Path(local) / "rrrgen" / "Cache"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache").expanduser().absolute() / "rrrgen"


def prune(most: int = 500) -> None:
    """Delete the least recently used results when there are more than ``most``, and leftovers of killed builds."""
    for path in cache_directory().glob(".*"):
        if time.time() - _last_use(path) > ABANDONED:
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            else:
                _discard(path)
    entries = [path for path in cache_directory().iterdir() if path.is_file()]
    if len(entries) <= most:
        return
    ages = sorted((_last_use(path), path) for path in entries)
    for _, path in ages[: len(entries) - most * 3 // 4]:
        _discard(path)


def _discard(path: Path) -> None:
    """Delete a file, unless it is gone already or, on Windows, loaded by a process."""
    with contextlib.suppress(OSError):
        path.unlink()


def touch(path: Path) -> None:
    """Mark a cached file as used just now; silently ignored if the cache has become read-only."""
    with contextlib.suppress(OSError):
        os.utime(path)


def _last_use(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:  # another process has deleted it
        return 0.0


def digest(*parts: str) -> str:
    """SHA-256 of ``parts`` as hexadecimal text; each part is preceded by its length, so that lists never collide."""
    state = hashlib.sha256()
    for part in parts:
        data = part.encode()
        state.update(len(data).to_bytes(8, "little"))
        state.update(data)
    return state.hexdigest()


@cache
def compiler_hash() -> str:
    """The hash of all source files of this package and of the version of Python: another one may compute otherwise."""
    root = Path(__file__).resolve().parents[1]
    parts = [sys.version]
    for path in sorted(root.rglob("*.py")):
        parts += [path.relative_to(root).as_posix(), path.read_text(encoding="utf-8")]
    return digest(*parts)


def store(path: Path, data: bytes) -> None:
    """Write ``data`` to ``path`` atomically, even across a power failure, readable by the user only.

    Raises StorageError if the disk is full.
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
    """Cache ``data`` under ``name``, preceded by its checksum."""
    store(cache_directory() / name, hashlib.sha256(data).digest() + data)


def recall(name: str) -> bytes | None:
    """The data cached under ``name``; None if there is none or its checksum does not match."""
    content = _content(cache_directory() / name)
    if content is None:
        return None
    data = content[CHECKSUM_BYTES:]
    touch(cache_directory() / name)
    return data if hashlib.sha256(data).digest() == content[:CHECKSUM_BYTES] else None


def keep_library(stem: str, data: bytes) -> Path:
    """Cache a shared library and return its path; the checksum is in the file name, since the file must not change."""
    path = cache_directory() / f"{stem}.{hashlib.sha256(data).hexdigest()[:32]}{EXTENSION_SUFFIXES[-1]}"
    try:
        store(path, data)
    except PermissionError:  # Windows: another process has built the same library and loaded it
        if not path.exists():
            raise
    return path


def recall_library(stem: str) -> Path | None:
    """The path of a cached library, or None. Damaged ones are deleted: loading a truncated one would crash."""
    for path in sorted(cache_directory().glob(f"{glob.escape(stem)}.*{EXTENSION_SUFFIXES[-1]}")):
        content = _content(path)
        if content is not None and hashlib.sha256(content).hexdigest()[:32] == path.name.split(".")[-2]:
            touch(path)
            return path
        _discard(path)
    return None


def _content(path: Path) -> bytes | None:
    """The content of a cache file, or None if it cannot be read. Raises StorageError if others may write to it."""
    try:
        with path.open("rb") as stream:
            _check_trusted(path, os.fstat(stream.fileno()))
            return stream.read()
    except OSError:
        return None
