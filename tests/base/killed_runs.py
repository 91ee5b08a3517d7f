"""Runs that are killed at any step of writing a folder."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

from rrrgen.base import exchange
from rrrgen.base.files import checksum, write


def state(**contents):
    listed = {name: checksum(text) for name, text in contents.items()}
    return {**contents, "manifest.json": json.dumps({"files": listed})}


OLD = state(**{"a.h": "1", "sub/b.c": "2", "gone/c.c": "3", "same.h": "same"})
NEW = state(**{"a.h": "new 1", "sub/b.c": "new 2", "more/d.c": "4", "same.h": "same"})
FOREIGN = {"notes.txt": "my own", "sub/mine.c": "my own too", "build/deep/x.o": "built"}
STEPS = [(os, "replace"), (os, "rename"), (os, "link"), (os, "unlink"), (os, "rmdir"), (exchange, "exchange")]


def contents(folder: Path) -> dict[str, str]:
    found = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_text() for path in found}


def prepare(folder: Path) -> tuple[Path, dict[str, int]]:
    """The old state with files of the user; and the numbers of these files."""
    out = folder / "out"
    write(OLD, out)
    for name, text in FOREIGN.items():
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        (out / name).write_text(text)
    (out / "link").symlink_to("notes.txt")
    return out, {name: (out / name).stat().st_ino for name in FOREIGN}


def in_child(action) -> int:
    """The signal that ended a forked process, negative, or its exit status."""
    process = os.fork()
    if not process:
        status = 9
        try:
            action()
            status = 0
        finally:
            os._exit(status)
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])


def killed_at(step: int, after: bool, action) -> bool:
    """Run ``action`` in a process that is killed before (or after) its ``step``-th change; False if it has fewer."""

    def run():
        count = 0

        def counting(original):
            def call(*arguments, **options):
                nonlocal count
                count += 1
                if count == step and not after:
                    os.kill(os.getpid(), signal.SIGKILL)
                try:
                    return original(*arguments, **options)
                finally:
                    if count == step and after:
                        os.kill(os.getpid(), signal.SIGKILL)

            return call

        for module, name in STEPS:
            setattr(module, name, counting(getattr(module, name)))
        action()

    code = in_child(run)
    assert code in (0, -signal.SIGKILL)
    return code != 0


def own(found: dict[str, str]) -> dict[str, str]:
    """What is neither the user's nor left behind by the killed process."""
    return {name: text for name, text in found.items() if name not in FOREIGN and name != "link"}
