"""The writer: all or nothing, LF, what is stale goes, what is the user's stays, diffs."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from rrrgen.base import files as emit
from rrrgen.base.errors import InputError, InternalError, OutputError, StorageError
from rrrgen.base.files import differences, listed_files, write, write_file


def files(**others):
    contents = {"a.h": "1\n", "sub/b.c": "2\n", "data.bin": b"\x00\xff\r\n", **others}
    listed = {name: emit.checksum(data) for name, data in contents.items()}
    return {**contents, "manifest.json": json.dumps({"files": listed})}


def tree(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_new_directory_holds_exactly_the_files(tmp_path):
    target = tmp_path / "deep" / "out"
    write(files(), target)
    assert tree(target) == {name: emit.as_bytes(data) for name, data in files().items()}
    assert list(target.parent.iterdir()) == [target], "nothing temporary is left"
    assert target.stat().st_mode & 0o777 == 0o777 & ~emit._umask()
    assert differences(files(), target) == ""


def test_an_existing_directory_keeps_what_is_not_ours_and_loses_what_is_stale(tmp_path):
    write(files(**{"old.c": "x"}), tmp_path / "out")
    (tmp_path / "out" / "notes.txt").write_text("the user's own")
    write(files(**{"a.h": "new\n"}), tmp_path / "out")
    after = tree(tmp_path / "out")
    assert after["a.h"] == b"new\n"
    assert after["notes.txt"] == b"the user's own"
    assert "old.c" not in after
    assert len(after) == 5


def test_a_directory_is_enough_where_nothing_beside_it_can_be_written(tmp_path, monkeypatch):
    (tmp_path / "out").mkdir()
    original = emit.staging_directory

    def only_inside(place, name):
        if place != tmp_path / "out":
            raise PermissionError(13, "Permission denied")
        return original(place, name)

    monkeypatch.setattr(emit, "staging_directory", only_inside)
    write(files(), tmp_path / "out")
    assert len(tree(tmp_path / "out")) == 4


@pytest.mark.parametrize("as_a_whole", [True, False])
def test_folders_that_hold_nothing_more_are_removed(as_a_whole, tmp_path, monkeypatch):
    if not as_a_whole:
        monkeypatch.setattr("rrrgen.base.exchange._in_use", lambda directory: True)
    target = tmp_path / "out"
    write(files(**{"rust/src/lib.rs": "b", "rust/Cargo.toml": "c", "urdf/arm.urdf": "d"}), target)
    (target / "urdf" / "notes").mkdir()
    (target / "mine").mkdir()
    write(files(), target)
    folders = sorted(str(path.relative_to(target)) for path in target.rglob("*") if path.is_dir())
    assert folders == ["mine", "sub", "urdf", "urdf/notes"]


def test_text_is_written_with_lf(tmp_path):
    write(files(), tmp_path / "out")
    assert b"\r" not in (tmp_path / "out" / "a.h").read_bytes()


def test_when_writing_fails_nothing_changes(tmp_path, monkeypatch):
    write(files(), tmp_path / "out")
    before = tree(tmp_path / "out")
    original = emit.Path.write_bytes

    def full(self, data):
        if self.name == "b.c":
            raise OSError(28, "No space left on device")
        return original(self, data)

    monkeypatch.setattr(emit.Path, "write_bytes", full)
    with pytest.raises(StorageError, match="disk is full"):
        write(files(**{"a.h": "new\n"}), tmp_path / "out")
    with pytest.raises(StorageError, match="disk is full"):
        write(files(), tmp_path / "fresh")
    monkeypatch.undo()
    assert tree(tmp_path / "out") == before
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_places_that_cannot_be_written_are_the_user_s_fault(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="not a directory"):
        write(files(), tmp_path / "file")
    with pytest.raises(OutputError):
        write(files(), tmp_path / "file" / "below")


@pytest.mark.parametrize("name", ["../x", "/etc/x", "a/../../x", ""])
def test_nothing_is_written_outside_the_directory(name, tmp_path):
    with pytest.raises(InternalError):
        write({name: ""}, tmp_path / "out")
    assert not (tmp_path / "x").exists()


def test_differences_are_a_unified_diff(tmp_path):
    write(files(**{"gone.c": "old\n"}), tmp_path)
    (tmp_path / "a.h").write_text("changed by hand\n")
    (tmp_path / "data.bin").write_bytes(b"\xff\x00")
    (tmp_path / "sub" / "b.c").unlink()
    diff = differences(files(**{"more.h": "no newline"}), tmp_path)
    assert "--- a/a.h\n+++ b/a.h\n@@ -1 +1 @@\n-changed by hand\n+1\n" in diff
    assert "--- /dev/null\n+++ b/sub/b.c\n@@ -0,0 +1 @@\n+2\n" in diff
    assert "--- a/gone.c\n+++ /dev/null\n" in diff
    assert "+no newline\n\\ No newline at end of file\n" in diff
    assert "Binary file data.bin differs" in diff
    assert tree(tmp_path)["a.h"] == b"changed by hand\n", "looking changes nothing"


def test_other_line_ends_are_a_difference(tmp_path):
    write(files(), tmp_path)
    (tmp_path / "a.h").write_bytes(b"1\r\n")
    assert differences(files(), tmp_path)


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"files": 3}', '{"files": {"../../x": 1}}', '{"files": ["/etc/passwd"]}']
)
def test_a_manifest_that_is_none_is_not_believed(text, tmp_path):
    (tmp_path / "manifest.json").write_text(text)
    assert listed_files(tmp_path) == ["manifest.json"]


def test_relative_directories_work(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(files(), emit.Path("out"))
    write(files(), emit.Path("."))
    assert os.path.exists("out/a.h")
    assert os.path.exists("a.h")


def test_one_file_appears_whole_with_usual_permissions_or_not_at_all(tmp_path, monkeypatch):
    old = os.umask(0o027)
    try:
        write_file(tmp_path / "deep" / "report.html", "ü\n")
    finally:
        os.umask(old)
    file = tmp_path / "deep" / "report.html"
    assert file.read_bytes() == "ü\n".encode()
    assert file.stat().st_mode & 0o777 == 0o640
    monkeypatch.setattr(os, "replace", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    with pytest.raises(StorageError, match="disk is full"):
        write_file(file, "new")
    assert [path.name for path in file.parent.iterdir()] == ["report.html"]
    assert file.read_bytes() == "ü\n".encode()
    with pytest.raises(OutputError, match="is a directory"):
        write_file(tmp_path / "deep", "")


def test_a_device_is_written_to_and_stays_a_device(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reading = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    write_file(pipe, "text")
    assert os.read(reading, 100) == b"text"
    os.close(reading)
    assert pipe.is_fifo()
    assert list(tmp_path.iterdir()) == [pipe]


@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="no device that is always full")
def test_a_full_device_is_a_full_disk(tmp_path):
    full = tmp_path / "full"
    full.symlink_to("/dev/full")
    with pytest.raises(StorageError, match="the disk is full"):
        write_file(full, "text")
    assert Path("/dev/full").is_char_device()


def test_a_symbolic_link_stays_one(tmp_path):
    (tmp_path / "link").symlink_to("file")
    for text in ("first", "second"):
        write_file(tmp_path / "link", text)
        assert (tmp_path / "file").read_text(encoding="utf-8") == text
    assert (tmp_path / "link").is_symlink()


def test_files_of_the_user_are_not_replaced(tmp_path):
    """They are named, and nothing changes; equal ones, those beside and those of an earlier run are no hindrance."""
    for name, text in {"a.h": "mine\n", "manifest.json": '{"name": "app"}', "notes.txt": "mine\n"}.items():
        (tmp_path / name).write_text(text)
    before = tree(tmp_path)
    with pytest.raises(InputError) as caught:
        write(files(), tmp_path)
    assert [fault.file for fault in caught.value.faults] == [str(tmp_path / "a.h"), str(tmp_path / "manifest.json")]
    assert tree(tmp_path) == before
    (tmp_path / "manifest.json").unlink()
    (tmp_path / "a.h").write_text("1\n")
    write(files(), tmp_path)
    write(files(**{"a.h": "new\n"}), tmp_path)
    (tmp_path / "more.h").write_text("mine\n")
    with pytest.raises(InputError, match=r"more\.h"):
        write(files(**{"more.h": "emitted\n"}), tmp_path)
    (tmp_path / "manifest.json").write_text('<<<<<<< {"schema": "rrrgen-manifest/1"')
    write(files(**{"more.h": "emitted\n"}), tmp_path)
    assert tree(tmp_path)["notes.txt"] == b"mine\n"
