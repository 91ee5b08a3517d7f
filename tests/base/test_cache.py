"""The cache runs nobody else's code, and says what to do when its disk is full."""

from __future__ import annotations

import errno
import os
import stat
import time

import pytest

from rrrgen.base import cache as cache_module
from rrrgen.base.cache import cache_directory, keep, keep_library, prune, recall, recall_library
from rrrgen.base.errors import StorageError
from rrrgen.cli.main import run
from rrrgen.runtime import build as build_module

pytestmark = pytest.mark.skipif(os.name != "posix", reason="Windows guards the user's folders by access lists")


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("RRRGEN_CACHE", str(tmp_path / "cache"))
    cache_directory.cache_clear()
    yield tmp_path / "cache"
    cache_directory.cache_clear()


@pytest.fixture
def shared(cache):
    """Makes the cache one that others may write to, as an administrator would with a folder for all."""

    def share(mode=0o777):
        cache.mkdir(exist_ok=True)
        cache.chmod(mode)
        cache_directory.cache_clear()

    return share


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o702])
def test_a_folder_that_others_may_write_to_is_refused(shared, cache, mode, capsys):
    shared(mode)
    with pytest.raises(StorageError, match=rf"other users may write to the cache .*chmod go-w {cache}.*RRRGEN_CACHE"):
        cache_directory()
    assert run(["verify", "pendulum"]) == 5
    assert "internal fault" not in capsys.readouterr().err


def test_a_folder_of_another_user_is_refused(cache, monkeypatch):
    cache.mkdir(mode=0o700)
    if os.geteuid() == 0:
        os.chown(cache, 12345, 12345)
    else:
        monkeypatch.setattr(cache_module, "TRUSTED_OWNERS", {os.geteuid() + 1})
    with pytest.raises(StorageError, match=r"belongs to another user.*RRRGEN_CACHE"):
        cache_directory()


@pytest.mark.parametrize("kind", ["owner", "mode"])
def test_a_file_that_another_user_may_have_written_is_refused(cache, monkeypatch, kind):
    keep("model", b"data")
    library = keep_library("lib", b"code")
    assert recall("model") == b"data"
    assert recall_library("lib") == library
    for file in (cache / "model", library):
        if kind == "mode":
            file.chmod(0o666)
        elif os.geteuid() == 0:
            os.chown(file, 12345, 12345)
    if kind == "owner" and os.geteuid() != 0:
        monkeypatch.setattr(cache_module, "TRUSTED_OWNERS", {os.geteuid() + 1})
    with pytest.raises(StorageError):
        recall("model")
    with pytest.raises(StorageError):
        recall_library("lib")


def test_what_is_kept_is_private_and_checked(cache):
    keep("model", b"data")
    library = keep_library("lib", b"code")
    for file in (cache, cache / "model", library):
        assert stat.S_IMODE(file.stat().st_mode) & 0o077 == 0
    (cache / "model").write_bytes((cache / "model").read_bytes()[:-1] + b"!")
    library.write_bytes(b"cod")
    assert recall("model") is None
    assert recall_library("lib") is None
    assert not library.exists()


def test_what_killed_builds_have_left_goes_after_a_day(cache):
    for name, age in (("old", 2 * 86400), ("young", 60)):
        (cache_directory() / f".build-{name}").mkdir()
        (cache / f".file-{name}").write_text("")
        for path in (cache / f".build-{name}", cache / f".file-{name}"):
            os.utime(path, (time.time() - age,) * 2)
    prune()
    assert {path.name for path in cache.iterdir()} == {".build-young", ".file-young"}


def full(*_):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_full_disk_is_named_with_what_to_do(cache, tmp_path, monkeypatch, capsys):
    cache_directory()
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(StorageError, match=r"cannot write .*lib.*the disk is full. Free some space"):
        keep_library("lib", b"code")
    assert not list(cache.iterdir()), "nothing half-written stays"
    monkeypatch.setattr(build_module, "_loaded", {})
    assert run(["verify", "pendulum"]) == 5
    message = capsys.readouterr().err
    assert "the disk is full" in message
    assert str(cache) in message
