"""Killed anywhere, the output folder is one whole state; the user's own files in it survive; nothing stays behind."""

from __future__ import annotations

import errno
import json
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from rrrgen.base import exchange, journal, staging
from rrrgen.base import files as writer
from rrrgen.base.errors import OutputError, StorageError
from rrrgen.base.files import checksum, write, write_file

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="the writer is killed in a forked process")


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


@pytest.mark.skipif(sys.platform not in ("linux", "darwin"), reason="no system call to exchange directories")
@pytest.mark.parametrize("after", [False, True])
def test_killed_at_any_step_the_folder_is_the_old_state_or_the_new_one(tmp_path, after):
    step, seen = 0, []
    while True:
        step += 1
        folder = tmp_path / str(step)
        out, numbers = prepare(folder)
        killed = killed_at(step, after, lambda out=out: write(NEW, out))
        found = contents(out)
        assert own(found) in (OLD, NEW), step
        seen.append(own(found) == NEW)
        assert {name: (out / name).stat().st_ino for name in FOREIGN} == numbers
        assert {name: found[name] for name in FOREIGN} == FOREIGN
        assert os.readlink(out / "link") == "notes.txt"
        write(NEW, out)
        assert own(contents(out)) == NEW
        assert [path.name for path in folder.iterdir()] == ["out"], "the next run has cleaned up"
        if not killed:
            break
    assert step > 8
    assert seen == sorted(seen)
    assert not seen[0]


@pytest.mark.parametrize("after", [False, True])
def test_where_folders_cannot_be_exchanged_the_next_run_completes_what_was_decided(tmp_path, after, monkeypatch):
    def refuse(*_):
        raise OSError(errno.EINVAL, "no exchange here")

    monkeypatch.setattr(exchange, "exchange", refuse)
    step = 0
    while True:
        step += 1
        folder = tmp_path / str(step)
        out, numbers = prepare(folder)
        killed = killed_at(step, after, lambda out=out: write(NEW, out))
        found = own(contents(out))
        whole = {name: text for name, text in found.items() if not name.startswith((journal.COMMIT, ".new"))}
        decided = (out / journal.COMMIT).exists()
        assert whole in (OLD, NEW) or (decided and whole.get("manifest.json") != OLD["manifest.json"]), step
        other = state(**{"a.h": "third"})
        write(other, out)
        assert own(contents(out)) == other
        assert {name: (out / name).stat().st_ino for name in FOREIGN} == numbers
        assert not [path for path in out.iterdir() if path.name.startswith(".")]
        assert [path.name for path in folder.iterdir()] == ["out"]
        if not killed:
            break
    assert step > 8


@pytest.mark.parametrize("where", ["current", "below", "of another process", "link", "mount"])
def test_folders_that_may_not_be_exchanged_or_have_other_names(tmp_path, monkeypatch, where):
    out, numbers = prepare(tmp_path)
    before, helper = out.stat().st_ino, None
    target = out
    if where == "current":
        monkeypatch.chdir(out)
        target = Path(".")
    elif where == "below":
        monkeypatch.chdir(out / "build")
        target = Path("..")
    elif where == "of another process":
        helper = subprocess.Popen([sys.executable, "-c", "input()"], cwd=out, stdin=subprocess.PIPE)
    elif where == "link":
        target = tmp_path / "link"
        target.symlink_to("out")
    elif where == "mount":
        monkeypatch.setattr(exchange, "exchange", lambda *_: (_ for _ in ()).throw(OSError(errno.EBUSY, "busy")))
    try:
        write(NEW, target)
    finally:
        if helper:
            helper.communicate()
    assert own(contents(out)) == NEW
    assert {name: (out / name).stat().st_ino for name in FOREIGN} == numbers
    if where != "link" and (sys.platform == "linux" or helper is None):
        assert out.stat().st_ino == before, "nobody is left in a folder that is gone"
    assert sorted(path.name for path in tmp_path.iterdir()) == (["link", "out"] if where == "link" else ["out"])


def test_rights_and_what_does_not_change_stay(tmp_path):
    out, _ = prepare(tmp_path)
    out.chmod(0o750)
    (out / "sub").chmod(0o700)
    before = out.stat().st_ino
    write(OLD, out)
    assert out.stat().st_ino == before, "nothing is written where nothing changes"
    write(NEW, out)
    assert out.stat().st_mode & 0o777 == 0o750
    assert (out / "sub").stat().st_mode & 0o777 == 0o700


def test_what_the_user_writes_meanwhile_is_taken_along(tmp_path, monkeypatch):
    out, _ = prepare(tmp_path)
    original = exchange.exchange

    def meanwhile(one, other):
        (out / "late.txt").write_text("made in the last moment")
        (out / "edited").write_text("saved by an editor")
        os.replace(out / "edited", out / "notes.txt")
        original(one, other)

    monkeypatch.setattr(exchange, "exchange", meanwhile)
    write(NEW, out)
    found = contents(out)
    assert found.pop("late.txt") == "made in the last moment"
    assert found["notes.txt"] == "saved by an editor"
    assert own(found) == NEW


@pytest.mark.parametrize("foreign", ["a directory", "a file"])
def test_a_name_of_the_user_in_the_way_is_a_fault_and_changes_nothing(tmp_path, foreign):
    out, _ = prepare(tmp_path)
    if foreign == "a directory":
        (out / "more" / "d.c").mkdir(parents=True)
    else:
        (out / "more").write_text("mine")
    before = contents(out)
    with pytest.raises(OutputError, match=r"in the way|is a file, not a directory"):
        write(NEW, out)
    assert contents(out) == before


def test_two_runs_at_once_leave_one_whole_state(tmp_path):
    out, _ = prepare(tmp_path)
    states = [state(**{"a.h": f"{k}", "sub/b.c": f"{k}"}) for k in range(4)]
    children = []
    for each in states:
        child = os.fork()
        if not child:
            try:
                for _ in range(5):
                    write(each, out)
            finally:
                os._exit(0)
        children.append(child)
    for child in children:
        os.waitpid(child, 0)
    found = contents(out)
    assert own(found) in states
    assert {name: found[name] for name in FOREIGN} == FOREIGN
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_what_a_living_process_has_not_finished_stays(tmp_path):
    place = staging.staging_directory(tmp_path, "out")
    with staging.locked(place):
        write(NEW, tmp_path / "out")
        assert place.exists()
    write(OLD, tmp_path / "out")
    assert not place.exists()


def test_sigterm_cleans_up_at_once(tmp_path):
    """In the middle of generating: at once, without files or staging folders, with the exit code of the signal."""
    program = (
        "import sys, time\n"
        "from rrrgen.base import files as writer\n"
        "def slow(folder, files, fill=writer._fill):\n"
        "    fill(folder, files)\n"
        "    print('filled', flush=True)\n"
        "    time.sleep(30)\n"
        "writer._fill = slow\n"
        "from rrrgen.cli.main import main\n"
        "main(['generate', 'pendulum', '-o', sys.argv[1], '--no-casadi-files', '-j', '1'])\n"
    )
    running = subprocess.Popen([sys.executable, "-c", program, tmp_path / "out"], stdout=subprocess.PIPE)
    assert running.stdout.readline() == b"filled\n"
    assert list(tmp_path.iterdir())
    start = time.monotonic()
    running.terminate()
    assert running.wait() == 128 + signal.SIGTERM
    assert time.monotonic() - start < 5.0
    assert not list(tmp_path.iterdir())


def test_a_single_file_leaves_nothing_behind_either(tmp_path):
    step = 0
    while True:
        step += 1
        file = tmp_path / str(step) / "report.html"
        write_file(file, "old")
        killed = killed_at(step, False, lambda file=file: write_file(file, "new"))
        assert file.read_text() in ("old", "new")
        write_file(file, "newer")
        assert contents(file.parent) == {"report.html": "newer"}
        if not killed:
            break
    assert step > 1


def test_a_disk_that_takes_no_more_is_named_and_nothing_changes(tmp_path):
    """By the system's own error: no file may become larger than some bytes."""
    out, _ = prepare(tmp_path)
    before = contents(out)

    def attempt():
        resource.setrlimit(resource.RLIMIT_FSIZE, (3, resource.RLIM_INFINITY))
        for action in (lambda: write(NEW, out), lambda: write_file(out / "notes.txt", "long enough")):
            try:
                action()
            except StorageError as error:
                assert str(out) in str(error)  # noqa: PT017
                assert error.exit_code == 5  # noqa: PT017
            else:
                raise AssertionError("written")

    assert in_child(attempt) == 0
    assert contents(out) == before
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_a_commit_names_no_file_outside(tmp_path):
    out, _ = prepare(tmp_path)
    commit = out / journal.COMMIT
    (commit / journal.FILES).mkdir(parents=True)
    (tmp_path / "precious").write_text("mine")
    (commit / journal.STALE).write_text(json.dumps(["../precious", str(tmp_path / "precious"), "gone/c.c"]))
    write(NEW, out)
    assert (tmp_path / "precious").read_text() == "mine"
    assert own(contents(out)) == NEW
    assert writer.listed_files(out)
