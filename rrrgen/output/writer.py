"""The only writer: files go to disk all or none, with LF line ends, and the same bytes every time."""

from __future__ import annotations

import difflib
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path, PurePosixPath

from rrrgen.errors import InputError, InternalError

MANIFEST = "manifest.json"

Contents = str | bytes


def write(files: Mapping[str, Contents], directory: Path) -> None:
    """Write ``files`` (relative path -> contents) below ``directory``.

    Everything is first written to a temporary directory beside the target. A target that does not exist yet appears
    complete; in one that exists, files are replaced one by one, each whole, the manifest last. Files that an earlier
    manifest lists and that are no longer emitted are removed; other files stay. Raises InputError where the place
    cannot be written.
    """
    directory = Path(os.path.abspath(directory))
    if directory.exists() and not directory.is_dir():
        raise InputError(f"cannot write to {directory}: it is not a directory")
    try:
        directory.parent.mkdir(parents=True, exist_ok=True)
        # inside a directory that exists: it may be a mount point, and files cannot be moved between file systems
        place = directory if directory.exists() else directory.parent
        staging = Path(tempfile.mkdtemp(dir=place, prefix=f".{directory.name}-"))
    except OSError as error:
        raise InputError(f"cannot write {directory}: {error.strerror}") from error
    try:
        for name, contents in files.items():
            place = staging / _checked(name)
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(as_bytes(contents))
        _move(staging, directory, list(files))
    except OSError as error:
        raise InputError(f"cannot write {directory}: {error.strerror}") from error
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def write_file(file: Path, contents: Contents) -> None:
    """Write one file, whole or not at all, with the permissions that the umask leaves.

    Unlike :func:`write` it concerns nothing else in the directory. Raises InputError where the place cannot be written.
    """
    file = Path(os.path.abspath(file))
    if file.is_dir():
        raise InputError(f"cannot write {file}: it is a directory")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        handle, staged = tempfile.mkstemp(dir=file.parent, prefix=f".{file.name}-")
    except OSError as error:
        raise InputError(f"cannot write {file}: {error.strerror}") from error
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(as_bytes(contents))
        os.chmod(staged, 0o666 & ~_umask())  # mkstemp made it private
        os.replace(staged, file)
    except OSError as error:
        raise InputError(f"cannot write {file}: {error.strerror}") from error
    finally:
        Path(staged).unlink(missing_ok=True)


def _move(staging: Path, directory: Path, names: list[str]) -> None:
    if not directory.exists():
        staging.chmod(0o777 & ~_umask())  # mkdtemp made it private
        os.replace(staging, directory)
        return
    stale = set(listed_files(directory)) - set(names)
    for name in sorted(names, key=lambda each: (each == MANIFEST, each)):
        place = directory / name
        place.parent.mkdir(parents=True, exist_ok=True)
        os.replace(staging / name, place)
    for name in sorted(stale):
        (directory / name).unlink(missing_ok=True)


def differences(files: Mapping[str, Contents], directory: Path) -> str:
    """A unified diff from what lies in ``directory`` to ``files``; empty where nothing would change."""
    stale = set(listed_files(directory)) - set(files)
    parts = [_difference(name, files.get(name), directory / name) for name in sorted({*files, *stale})]
    return "".join(parts)


def _difference(name: str, new: Contents | None, place: Path) -> str:
    old = place.read_bytes() if place.is_file() else None
    wanted = None if new is None else as_bytes(new)
    if old == wanted:
        return ""
    try:
        before, after = (b"" if data is None else data for data in (old, wanted))
        lines = [data.decode().splitlines(keepends=True) for data in (before, after)]
    except UnicodeDecodeError:
        return f"Binary file {name} differs\n"
    source = f"a/{name}" if old is not None else "/dev/null"
    target = f"b/{name}" if wanted is not None else "/dev/null"
    diff = "".join(
        line if line.endswith("\n") else f"{line}\n\\ No newline at end of file\n"
        for line in difflib.unified_diff(lines[0], lines[1], source, target)
    )
    return diff or f"{name} differs in its presence or its line ends\n"


def listed_files(directory: Path) -> list[str]:
    """The files that the manifest of an earlier run lists, the manifest included; none where there is no manifest."""
    manifest = directory / MANIFEST
    try:
        entries = json.loads(manifest.read_text(encoding="utf-8"))["files"]
        names = [str(PurePosixPath(_checked(name))) for name in entries]
    except (OSError, ValueError, KeyError, TypeError, InternalError):
        return [MANIFEST] if manifest.is_file() else []
    return [*names, MANIFEST]


def as_bytes(contents: Contents) -> bytes:
    """What is written: text as UTF-8 with LF."""
    return contents if isinstance(contents, bytes) else contents.encode("utf-8")


def checksum(contents: Contents) -> str:
    """SHA-256 of what is written."""
    return hashlib.sha256(as_bytes(contents)).hexdigest()


def _checked(name: str) -> str:
    """``name`` if it stays below the output directory."""
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or not path.parts:
        raise InternalError(f"a backend wants to write outside the output directory: {name}")
    return name


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
