"""Atomic replacement of a directory: the new state is completed beside the old one, then the two are exchanged.

The system call that exchanges two directories (Linux ``renameat2``, macOS ``renamex_np``) is atomic: even if the
process is killed, the directory is in its old or its new state. Files of the user in it are hard-linked into the new
state, so they stay the same files. A directory that cannot be replaced as a whole is changed file by file, with a
journal by which the next run completes an interrupted replacement.

Unfinished output stands in staging files and directories: recognizable by name, and locked while a process uses them.
A lock belongs to an open file. It therefore ends with the process that holds it, even if that is killed, and it works
between containers that share a folder. On a file system without locks nothing is ever treated as abandoned.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterable, Iterator, Set
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

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
def hold_lock(path: Path, wait: bool = True) -> Iterator[int | None]:
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
            with hold_lock(path, wait=False) as abandoned:
                if abandoned is not None:
                    remove(path)


def remove(path: Path) -> None:
    """Remove a file, or a directory with its contents; errors are ignored."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with contextlib.suppress(OSError):
            path.unlink()


AT_FDCWD = -100
RENAME_EXCHANGE = 2  # Linux, <linux/fs.h>
RENAME_SWAP = 2  # macOS, <sys/stdio.h>
MAX_LINKED_FILES = 20_000  # files of the user; linking more would take longer than generating


class CannotExchangeError(Exception):
    """This directory cannot be replaced as a whole; nothing has been changed."""


def exchange(one: Path, other: Path) -> None:
    """Exchange two directories atomically. Raises OSError if the system or the file system does not support it."""
    if sys.platform not in ("linux", "darwin"):
        raise OSError("this system cannot exchange directories")
    library = ctypes.CDLL(None, use_errno=True)
    names = os.fsencode(one), os.fsencode(other)
    if sys.platform == "linux" and hasattr(library, "renameat2"):
        failed = library.renameat2(AT_FDCWD, names[0], AT_FDCWD, names[1], RENAME_EXCHANGE)
    elif sys.platform == "darwin" and hasattr(library, "renamex_np"):
        failed = library.renamex_np(names[0], names[1], RENAME_SWAP)
    else:
        raise OSError("the C library of this system cannot exchange directories")
    if failed:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


def replace_directory(staging: Path, directory: Path, replaced: Set[str]) -> None:
    """Replace ``directory`` by ``staging``, the complete new state, and remove the old state.

    ``replaced`` are the files of the old state (relative, with /) that rrrgen has written; all others move to the new
    state. Raises CannotExchangeError, before anything has been changed, if the exchange is not possible.
    """
    if _in_use(directory):
        raise CannotExchangeError("a process works in it, and would stay behind in the old state")
    try:
        linked = _link_foreign(directory, staging, replaced)
        _copy_rights(directory, staging)
        os.utime(staging)
        exchange(staging, directory)
    except (OSError, NotImplementedError) as error:
        raise CannotExchangeError(str(error)) from None
    # from here on ``staging`` is the old state
    _rescue(staging, directory, replaced, linked)
    remove(staging)


def _in_use(directory: Path) -> bool:
    """Whether a process (a shell, an editor, make) has its working directory in ``directory``.

    Processes that this one may not inspect are overlooked.
    """
    target, places = _number(str(directory)), ["."]
    with contextlib.suppress(OSError), os.scandir("/proc") as entries:
        places += [f"{entry.path}/cwd" for entry in entries if entry.name.isdecimal()]
    return any(target == number for place in places for number in _upwards(place))


def _upwards(place: str) -> Iterator[tuple[int, int]]:
    """Yield the directory ``place`` and its parents up to the root, each as (device, inode).

    Paths are not compared, because a process in a container may see the same directories under other paths.
    """
    last = None
    while (number := _number(place)) is not None and number != last:
        yield number
        last, place = number, f"{place}/.."


def _number(path: str) -> tuple[int, int] | None:
    """Device and inode of ``path``; None if it cannot be read (a process of another user, or one that has ended)."""
    try:
        status = os.stat(path)
    except OSError:
        return None
    return status.st_dev, status.st_ino


def _link_foreign(directory: Path, staging: Path, replaced: Set[str]) -> dict[str, int]:
    """Hard-link every file of the user into ``staging``; returns relative path -> inode."""
    linked: dict[str, int] = {}
    device = directory.stat().st_dev
    for entry in _foreign(directory, replaced):
        name = entry.relative_to(directory).as_posix()
        status = entry.lstat()
        place = staging / name
        if stat.S_ISDIR(status.st_mode):
            if status.st_dev != device:
                raise OSError(f"{entry} is a file system of its own")
            place.mkdir(parents=True, exist_ok=True)
            continue
        if len(linked) >= MAX_LINKED_FILES:
            raise OSError(f"more than {MAX_LINKED_FILES} other files")
        place.parent.mkdir(parents=True, exist_ok=True)
        os.link(entry, place, follow_symlinks=False)
        linked[name] = status.st_ino
    return linked


def _foreign(directory: Path, replaced: Set[str]) -> Iterator[Path]:
    """All directories and files below ``directory`` except those in ``replaced``; links are not followed.

    Directories that hold nothing but such files are left out too; an empty directory is somebody's.
    """
    emptied: set[Path] = set()
    for folder, folders, files in os.walk(directory, topdown=False):
        entries = [Path(folder, name) for name in [*folders, *files]]
        others = [
            path for path in entries if path not in emptied and path.relative_to(directory).as_posix() not in replaced
        ]
        if entries and not others:
            emptied.add(Path(folder))
        yield from others


def _copy_rights(directory: Path, staging: Path) -> None:
    """Copy owner, mode and times of every directory, from the bottom up."""
    for folder, _, _ in os.walk(directory, topdown=False):
        target = staging / os.path.relpath(folder, directory)
        if not target.is_dir():
            continue
        before, now = os.stat(folder), os.stat(target)
        if (before.st_uid, before.st_gid) != (now.st_uid, now.st_gid):
            os.chown(target, before.st_uid, before.st_gid)
        shutil.copystat(folder, target)


def _rescue(old: Path, directory: Path, replaced: Set[str], linked: dict[str, int]) -> None:
    """Move files that others wrote to the old directory after the linking of files into the new directory.

    These are files of the user that are missing in ``linked`` (relative path -> inode) or have another inode there.
    """
    for path in _foreign(old, replaced):
        name = path.relative_to(old).as_posix()
        try:
            status = path.lstat()
            if not stat.S_ISDIR(status.st_mode) and linked.get(name) != status.st_ino:
                target = directory / name
                if name in linked or not target.exists():
                    target.parent.mkdir(parents=True, exist_ok=True)
                    os.replace(path, target)
        except OSError:
            continue


# ------------------------------------------------------------------------------------------------------------------
# Replacement of files one by one, for a directory that cannot be replaced as a whole.
#
# An interrupted replacement is completed by the next run. The steps are:
#
#     1. complete all new files in a staging directory inside the directory
#     2. rename that to ``.rrrgen-commit``: this commits the new state
#     3. remove the old manifest, so that a mixture of old and new files is never taken for a complete directory
#     4. move the new files to their places, remove files that are no longer emitted, move the new manifest last
#     5. remove ``.rrrgen-commit``
#
# A process killed before step 2 has changed nothing; after step 2, the next run first completes steps 3 to 5.
# ------------------------------------------------------------------------------------------------------------------

COMMIT = ".rrrgen-commit"
STALE = "stale.json"
"""File in the commit directory that lists the files no longer emitted."""

FILES = "files"
"""Folder in the commit directory that holds the new files."""


def move_in(staging: Path, directory: Path, stale: Iterable[str], manifest: str) -> None:
    """Move the new files from ``staging / FILES`` into ``directory`` and remove the ``stale`` ones."""
    (staging / STALE).write_text(json.dumps(sorted(stale)), encoding="utf-8", newline="\n")
    os.rename(staging, directory / COMMIT)
    try:
        complete(directory, manifest)
    except BaseException:  # interrupted, e.g. by Ctrl-C: complete the commit first
        complete(directory, manifest)
        raise


def complete(directory: Path, manifest: str) -> None:
    """Complete the commit of an interrupted earlier run, if there is one."""
    commit = directory / COMMIT
    if not commit.is_dir():
        return
    files = commit / FILES
    names = sorted(path.relative_to(files).as_posix() for path in files.rglob("*") if not path.is_dir())
    if manifest in names:
        (directory / manifest).unlink(missing_ok=True)
    for name in sorted(names, key=lambda file_name: (file_name == manifest, file_name)):
        if name == manifest:
            _remove_stale(commit, directory)
        place = directory / name
        place.parent.mkdir(parents=True, exist_ok=True)
        os.replace(files / name, place)
    _remove_stale(commit, directory)
    remove(commit)


def _remove_stale(commit: Path, directory: Path) -> None:
    """Remove the files that are no longer emitted, and the directories that this empties.

    Names that lead outside ``directory`` are ignored.
    """
    try:
        names = json.loads((commit / STALE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return
    for name in map(PurePosixPath, names):
        if not name.is_absolute() and ".." not in name.parts:
            (directory / name).unlink(missing_ok=True)
            for parent in name.parents[:-1]:
                with contextlib.suppress(OSError):  # what holds something else stays
                    (directory / parent).rmdir()
