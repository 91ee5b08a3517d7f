"""The writer of all files of rrrgen: of a set of files all or none are written, with LF line ends, reproducibly."""

from __future__ import annotations

import difflib
import errno
import hashlib
import json
import os
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

from rrrgen.base.errors import Fault, InputError, InternalError, OutputError, cannot_write, storage_error
from rrrgen.base.exchange import (
    FILES,
    CannotExchangeError,
    complete,
    hold_lock,
    move_in,
    remove,
    remove_abandoned,
    replace_directory,
    staging_directory,
    staging_file,
)

MANIFEST = "manifest.json"
MANIFEST_SCHEMA = "rrrgen-manifest/"

INSIDE = "new"
"""Output name of a staging directory inside the output directory."""

Contents = str | bytes


def write(files: Mapping[str, Contents], directory: Path, leftovers: Collection[str] = ()) -> None:
    """Write ``files`` (relative path -> contents) below ``directory``, all or none.

    If the system can exchange two directories, the directory is in its old or its new state even if the process is
    killed (:mod:`rrrgen.base.exchange`). Otherwise, or if another process works in the directory and would stay in
    the old state, files are moved one by one, and the next run completes an interrupted one
    (:mod:`rrrgen.base.exchange`). Files listed in an earlier manifest but no longer emitted are removed, and so are
    ``leftovers``; other files stay. Staging files of ended processes are removed. Raises OutputError if the directory
    cannot be written, InputError if a file that no manifest lists would be replaced by one that the new manifest lists,
    StorageError if the disk is full.
    """
    for name in files:
        _check_path(name)
    directory = Path(os.path.realpath(directory))
    if directory.exists() and not directory.is_dir():
        raise OutputError(f"cannot write to {directory}: it is not a directory")
    try:
        directory.parent.mkdir(parents=True, exist_ok=True)
        remove_abandoned(directory.parent, directory.name)
        if not directory.exists() and _appear(files, directory):
            return
        with _locked_directory(directory):
            if not os.access(directory, os.W_OK | os.X_OK):
                raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
            remove_abandoned(directory, INSIDE)
            complete(directory, MANIFEST)
            if not _is_up_to_date(files, directory, leftovers):
                _check_obstacles(files, directory)
                _refuse_to_replace(_unknown_files(files, directory), directory)
                _replace(files, directory, leftovers)
    except OSError as error:
        raise cannot_write(directory, error) from error


def _appear(files: Mapping[str, Contents], directory: Path) -> bool:
    """Create the complete directory; False if another process has created it first."""
    with _staging(directory.parent, directory.name) as staging:
        _fill(staging, files)
        staging.chmod(0o777 & ~_umask())  # it was made private
        try:
            os.rename(staging, directory)
        except OSError:
            if directory.is_dir():
                return False
            raise
    return True


def _check_obstacles(files: Mapping[str, Contents], directory: Path) -> None:
    """Raise OutputError if a directory exists where a file must be written, or a file where a directory is needed."""
    for name in files:
        place = directory / name
        if place.is_dir():
            raise OutputError(f"cannot write {place}: a directory of that name is in the way")
        for folder in PurePosixPath(name).parents:
            if (directory / folder).exists() and not (directory / folder).is_dir():
                raise OutputError(f"cannot write {place}: {directory / folder} is a file, not a directory")


def _unknown_files(files: Mapping[str, Contents], directory: Path) -> list[str]:
    """Those of ``files`` listed in their manifest that exist with other contents and are of no earlier run."""
    if MANIFEST not in files:
        return []
    earlier, manifest = listed_files(directory), _read(directory / MANIFEST)
    if earlier == [MANIFEST] and manifest is not None:
        if MANIFEST_SCHEMA.encode() in manifest:  # damaged, as by a merge: nobody knows what it listed
            return []
        earlier = []
    planned = [*_files_of(as_bytes(files[MANIFEST])), MANIFEST]
    new = [name for name in planned if name in files and name not in earlier and (directory / name).is_file()]
    return [name for name in new if _read(directory / name) != as_bytes(files[name])]


def _refuse_to_replace(names: Collection[str], directory: Path) -> None:
    hint = "move it, or choose another folder"
    message = "the file exists already, and no earlier run has written it"
    if names:
        raise InputError([Fault(str(directory / name), 0, 0, message, hint=hint) for name in names])


@contextmanager
def _locked_directory(directory: Path) -> Iterator[None]:
    """Lock ``directory`` against other runs of rrrgen; tries again if it was replaced while waiting for the lock."""
    while True:
        with hold_lock(directory) as held:
            if held is None or os.path.samestat(os.stat(directory), os.fstat(held)):
                yield
                return


def _replace(files: Mapping[str, Contents], directory: Path, leftovers: Collection[str]) -> None:
    """Replace the contents of an existing directory."""
    stale = _stale_files(files, directory, leftovers)
    try:
        with _staging(directory.parent, directory.name) as staging:
            _fill(staging, files)
            replace_directory(staging, directory, stale | set(files))
            return
    except CannotExchangeError:
        pass
    except OSError as error:
        # the parent may be closed to this user
        if storage_error(directory, error):
            raise
    with _staging(directory, INSIDE) as staging:
        _fill(staging / FILES, files)
        move_in(staging, directory, stale, MANIFEST)


@contextmanager
def _staging(place: Path, name: str) -> Iterator[Path]:
    """Create and lock a staging directory in ``place``; it is removed at the end unless it has been renamed."""
    staging = staging_directory(place, name)
    try:
        with hold_lock(staging):
            yield staging
    finally:
        remove(staging)


def _fill(folder: Path, files: Mapping[str, Contents]) -> None:
    for name, contents in files.items():
        place = folder / name
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(as_bytes(contents))


def _is_up_to_date(files: Mapping[str, Contents], directory: Path, leftovers: Collection[str]) -> bool:
    """Whether every file exists with its contents, and no file is left that is no longer emitted."""
    if _stale_files(files, directory, leftovers):
        return False
    return all(_read(directory / name) == as_bytes(contents) for name, contents in files.items())


def _stale_files(files: Mapping[str, Contents], directory: Path, leftovers: Collection[str]) -> set[str]:
    return {*listed_files(directory), *leftovers} - set(files)


def _read(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except OSError:
        return None


def write_file(file: Path, contents: Contents) -> None:
    """Write one file atomically, with the permissions of the umask; other files in the directory are not touched.

    A symbolic link stays one: the file that it leads to is written. What is no file, such as a pipe or a device
    (/dev/stdout), is written to and stays what it is.

    Raises OutputError if the file cannot be written, StorageError if the disk is full.
    """
    file = Path(os.path.abspath(file))
    if file.is_dir():
        raise OutputError(f"cannot write {file}: it is a directory")
    if file.exists() and not file.is_file():
        _write_into(file, contents)
        return
    file = Path(os.path.realpath(file))
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        remove_abandoned(file.parent, file.name)
        handle, staged = staging_file(file.parent, file.name)
    except OSError as error:
        raise cannot_write(file, error) from error
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(as_bytes(contents))
            stream.flush()
            if os.name == "nt":  # Windows can rename only closed files, and the file is not locked there
                stream.close()
            os.chmod(staged, 0o666 & ~_umask())  # it was made private
            os.replace(staged, file)
    except OSError as error:
        raise cannot_write(file, error) from error
    finally:
        staged.unlink(missing_ok=True)


def _write_into(device: Path, contents: Contents) -> None:
    """Write into a pipe or a device."""
    try:
        with device.open("wb") as stream:
            stream.write(as_bytes(contents))
    except OSError as error:
        raise cannot_write(device, error) from error


def differences(files: Mapping[str, Contents], directory: Path, leftovers: Collection[str] = ()) -> str:
    """A unified diff from the contents of ``directory`` to ``files``; empty if nothing would change.

    ``leftovers`` are removed like files that an earlier manifest lists.
    """
    stale = _stale_files(files, directory, leftovers)
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
    """The files listed in the manifest of an earlier run, and the manifest; empty if there is none."""
    manifest = directory / MANIFEST
    return [*_files_of(_read(manifest) or b""), MANIFEST] if manifest.is_file() else []


def _files_of(manifest: bytes) -> list[str]:
    """The files that a manifest lists; empty for a text that is none."""
    try:
        entries = json.loads(manifest.decode("utf-8"))["files"]
        return [str(PurePosixPath(_check_path(name))) for name in entries]
    except (ValueError, KeyError, TypeError, InternalError):
        return []


def as_bytes(contents: Contents) -> bytes:
    """The bytes to write: text is encoded as UTF-8."""
    return contents if isinstance(contents, bytes) else contents.encode("utf-8")


def checksum(contents: Contents) -> str:
    """SHA-256, in hexadecimal, of the bytes to write."""
    return hashlib.sha256(as_bytes(contents)).hexdigest()


def _check_path(name: str) -> str:
    """Check that the path ``name`` stays below the output directory and return it; raises InternalError otherwise."""
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or not path.parts:
        raise InternalError(f"a backend wants to write outside the output directory: {name}")
    return name


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
