"""Replacement of files one by one, for a directory that cannot be replaced as a whole.

An interrupted replacement is completed by the next run. The steps are:

    1. complete all new files in a staging directory inside the directory
    2. rename that to ``.rrrgen-commit``: this commits the new state
    3. remove the old manifest, so that a mixture of old and new files is never taken for a complete directory
    4. move the new files to their places, remove files that are no longer emitted, move the new manifest last
    5. remove ``.rrrgen-commit``

A process killed before step 2 has changed nothing; after step 2, the next run first completes steps 3 to 5.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from pathlib import Path, PurePosixPath

from rrrgen.base.staging import remove

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
    for name in sorted(names, key=lambda each: (each == manifest, each)):
        if name == manifest:
            _remove_stale(commit, directory)
        place = directory / name
        place.parent.mkdir(parents=True, exist_ok=True)
        os.replace(files / name, place)
    _remove_stale(commit, directory)
    remove(commit)


def _remove_stale(commit: Path, directory: Path) -> None:
    """Remove the files that are no longer emitted; names that lead outside ``directory`` are ignored."""
    try:
        names = json.loads((commit / STALE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return
    for name in map(PurePosixPath, names):
        if not name.is_absolute() and ".." not in name.parts:
            (directory / name).unlink(missing_ok=True)
