"""Killed anywhere, the output folder is one whole state; the user's own files in it survive; nothing stays behind."""

from __future__ import annotations

import os
import resource

import pytest

from base.killed_runs import NEW, contents, in_child, killed_at, prepare
from rrrgen.base.errors import StorageError
from rrrgen.base.files import write, write_file

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="the writer is killed in a forked process")


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
