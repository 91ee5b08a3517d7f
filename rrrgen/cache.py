"""Where results of earlier runs live: the user's cache directory, addressed by the hash of what produced them."""

from __future__ import annotations

import contextlib
import hashlib
import os
import sys
import tempfile
from functools import cache
from pathlib import Path


@cache
def cache_directory() -> Path:
    """The directory for built extensions, derived models and translated templates, created private to the user.

    ``$RRRGEN_CACHE`` if set, else ``rrrgen`` below the user's cache directory; a temporary directory of this process
    where that cannot be written.
    """
    directory = _wanted_directory()
    try:
        directory.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=directory):
            return directory
    except OSError:
        return Path(tempfile.mkdtemp(prefix="rrrgen-"))


def _wanted_directory() -> Path:
    chosen = os.environ.get("RRRGEN_CACHE")
    if chosen:
        return Path(chosen).expanduser().absolute()
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "rrrgen"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache").expanduser().absolute() / "rrrgen"


def prune(most: int = 500) -> None:
    """Forget the results that were not used for longest when there are more than ``most``."""
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
    """Write ``data`` so that a reader sees all of it or none, also while other processes do the same."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}-")
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
