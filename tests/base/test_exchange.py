"""Folders exchanged in one step: the old state or the new one, wherever a run is killed."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from base.killed_runs import FOREIGN, NEW, OLD, contents, killed_at, own, prepare, state
from rrrgen.base import exchange
from rrrgen.base import files as writer
from rrrgen.base.errors import OutputError
from rrrgen.base.files import write

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="the writer is killed in a forked process")


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


# ------------------------------------------------------------------------------------------------------------------
# The journal of an unfinished exchange: the next run completes what was decided, and nothing outside.
# ------------------------------------------------------------------------------------------------------------------


@pytest.mark.sweep(but=["True"])
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
        whole = {name: text for name, text in found.items() if not name.startswith((exchange.COMMIT, ".new"))}
        decided = (out / exchange.COMMIT).exists()
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


def test_a_commit_names_no_file_outside(tmp_path):
    out, _ = prepare(tmp_path)
    commit = out / exchange.COMMIT
    (commit / exchange.FILES).mkdir(parents=True)
    (tmp_path / "precious").write_text("mine")
    (commit / exchange.STALE).write_text(json.dumps(["../precious", str(tmp_path / "precious"), "gone/c.c"]))
    write(NEW, out)
    assert (tmp_path / "precious").read_text() == "mine"
    assert own(contents(out)) == NEW
    assert writer.listed_files(out)


# ------------------------------------------------------------------------------------------------------------------
# Places of unfinished files: what a living process has not finished stays, the rest is cleaned up.
# ------------------------------------------------------------------------------------------------------------------


def test_what_a_living_process_has_not_finished_stays(tmp_path):
    place = exchange.staging_directory(tmp_path, "out")
    with exchange.hold_lock(place):
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
