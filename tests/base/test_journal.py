"""The journal of an unfinished exchange: the next run completes what was decided, and nothing outside."""

from __future__ import annotations

import errno
import json
import os

import pytest

from base.killed_runs import FOREIGN, NEW, OLD, contents, killed_at, own, prepare, state
from rrrgen.base import exchange
from rrrgen.base import files as writer
from rrrgen.base.files import write

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="the writer is killed in a forked process")


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
