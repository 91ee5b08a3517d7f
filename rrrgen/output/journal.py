"""Replaces files in a directory one by one, where it cannot be replaced as a whole; an interruption is made up for.

    1. all new files are complete in a staging directory inside the directory
    2. that is renamed to ``.rrrgen-commit``: from now on the new state is decided
    3. the old manifest goes, so that a mixed directory is never taken for a whole one
    4. the new files move to their places, files that are no longer emitted go, the new manifest comes last
    5. ``.rrrgen-commit`` goes

Whatever ends the process before 2. has changed nothing; after 2., the next run completes 3. to 5. first.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from pathlib import Path, PurePosixPath

from rrrgen.output.staging import remove

COMMIT = ".rrrgen-commit"
STALE = "stale.json"
"""In the commit: the names of the files that are no longer emitted."""

FILES = "files"
"""In the commit: the new files."""


def move_in(staging: Path, directory: Path, stale: Iterable[str], manifest: str) -> None:
    """Move the new files in ``staging / FILES`` into ``directory`` and remove the ``stale`` ones."""
    (staging / STALE).write_text(json.dumps(sorted(stale)), encoding="utf-8")
    os.rename(staging, directory / COMMIT)
    try:
        complete(directory, manifest)
    except BaseException:  # told to end in between: once more, and then obey
        complete(directory, manifest)
        raise


def complete(directory: Path, manifest: str) -> None:
    """Finish what an earlier run has decided and not completed, if anything."""
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
    """Remove the files that are no longer emitted, none outside the directory."""
    try:
        names = json.loads((commit / STALE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return
    for name in map(PurePosixPath, names):
        if not name.is_absolute() and ".." not in name.parts:
            (directory / name).unlink(missing_ok=True)
