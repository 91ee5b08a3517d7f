"""Building and loading C: caching, parallel builds, missing toolchains, damaged caches."""

from __future__ import annotations

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import rrrgen
from rrrgen.base.cache import cache_directory, digest, keep_library, prune, store, touch
from rrrgen.base.errors import BuildError
from rrrgen.emit.c import compilers as compiler
from rrrgen.runtime import build as build_module
from rrrgen.runtime.build import build_extension

SOURCES = {
    "twice.h": "double twice(double x);\n",
    "twice.c": '#include "twice.h"\ndouble twice(double x) { return 2.0 * x; }\n',
}
CDEF = "double twice(double x);"


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """A cache directory of this test's own."""
    monkeypatch.setenv("RRRGEN_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(build_module, "_loaded", {})
    cache_directory.cache_clear()
    yield tmp_path / "cache"
    cache_directory.cache_clear()


def libraries(cache: Path) -> list[Path]:
    return sorted(cache.glob("*.so"))


def test_sources_become_callable_and_are_built_once(cache, monkeypatch):
    _, lib = build_extension(SOURCES, CDEF, "twice")
    assert lib.twice(21.0) == 42.0
    (built,) = libraries(cache)
    assert built.name.startswith("twice-")
    assert [p for p in cache.iterdir() if p.name.startswith(".")] == [], "no leftovers"
    monkeypatch.setattr(build_module, "_loaded", {})
    monkeypatch.setattr(build_module, "_build", lambda *_: pytest.fail("built again"))
    _, again = build_extension(SOURCES, CDEF, "twice")
    assert again.twice(1.0) == 2.0


def test_threads_that_want_the_same_library_build_it_once(cache, monkeypatch):
    builds, build = [], build_module._build
    monkeypatch.setattr(build_module, "_build", lambda *given: builds.append(given) or build(*given))
    with ThreadPoolExecutor(4) as pool:
        results = list(pool.map(lambda x: build_extension(SOURCES, CDEF, "twice")[1].twice(x), [1.0, 2.0, 3.0, 4.0]))
    assert results == [2.0, 4.0, 6.0, 8.0]
    assert len(builds) == 1


def test_a_batch_builds_the_loop_of_its_function_alone(cache):
    model = rrrgen.compile("pendulum")
    q = np.linspace(-1.0, 1.0, 11)[:, None]
    assert libraries(cache) == []
    alone = model.gravity(q)
    assert len(libraries(cache)) == 1
    np.testing.assert_array_equal(model.gravity(q[:5]), alone[:5])
    assert len(libraries(cache)) == 1
    model.engine.prepare()
    assert len(libraries(cache)) == 3, "all other loops together, and all functions of one state"
    model.mass_matrix(q)
    model.engine.prepare()
    assert len(libraries(cache)) == 3
    again = rrrgen.compile("pendulum")
    again.engine.prepare()
    np.testing.assert_array_equal(again.gravity(q), alone)


def test_one_state_builds_the_functions_of_its_source_file(cache):
    model = rrrgen.compile("pendulum")
    model.mass_matrix(np.zeros(1)), model.gravity(np.zeros(1))
    assert len(libraries(cache)) == 1
    model.gravity(np.zeros(1), beta=model.beta)
    assert len(libraries(cache)) == 2, "those without the numbers of the robot file are in another"
    model.bind("mass_matrix")
    assert len(libraries(cache)) == 2


def test_a_missing_compiler_is_told_before_any_function_is_called(cache, monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(BuildError, match="'no-such-compiler' named by CC"):
        rrrgen.compile("pendulum")


def test_derivatives_are_built_when_they_are_called(cache):
    model = rrrgen.compile("pendulum")
    model.mass_matrix(np.zeros(1))
    assert len(libraries(cache)) == 1
    alone = model.inverse_dynamics_derivatives(*np.ones((3, 1)))
    assert len(libraries(cache)) == 2
    model.forward_dynamics_derivatives(*np.ones((3, 1)))
    assert len(libraries(cache)) == 2
    bound = rrrgen.compile("pendulum").bind("inverse_dynamics_derivatives")
    np.testing.assert_array_equal(np.asarray(bound(*np.ones((3, 1)))[0]), np.asarray(alone[0]))


def test_any_change_builds_anew(cache):
    build_extension(SOURCES, CDEF, "twice")
    other = {**SOURCES, "twice.c": SOURCES["twice.c"].replace("2.0", "3.0")}
    _, lib = build_extension(other, CDEF, "twice")
    assert lib.twice(1.0) == 3.0, "two builds of one name live in one process"
    build_extension(SOURCES, CDEF, "twice", ["-DX"])
    assert len(libraries(cache)) == 3


def test_the_cache_is_private(cache):
    build_extension(SOURCES, CDEF, "twice")
    assert cache.stat().st_mode & 0o077 == 0


def built_but_not_loaded(cache, monkeypatch) -> Path:
    """The library on disk; Python never reads a library again that it has loaded once."""
    with monkeypatch.context() as patch:
        patch.setattr(build_module, "_load", lambda *_: (None, None))
        build_extension(SOURCES, CDEF, "twice")
    build_module._loaded.clear()
    (built,) = libraries(cache)
    return built


@pytest.mark.parametrize("part", [0.0, 0.5, 0.99, 1.0])
def test_a_library_that_is_cut_off_or_changed_is_built_anew(cache, monkeypatch, part):
    built = built_but_not_loaded(cache, monkeypatch)
    sound = built.read_bytes()
    cut = sound[: int(part * len(sound))] if part < 1.0 else sound[:4000] + b"x" + sound[4001:]
    built.write_bytes(cut)
    _, lib = build_extension(SOURCES, CDEF, "twice")
    assert lib.twice(1.0) == 2.0
    (again,) = libraries(cache)
    assert again.read_bytes() != cut


def test_a_library_that_does_not_load_is_removed_and_named(cache, monkeypatch):
    with pytest.raises(BuildError, match=r"cannot be loaded.*please try again"):
        build_module._load(keep_library("twice-0", b"not a library"), "twice")
    assert libraries(cache) == []


def test_what_the_compiler_refuses_is_shown(cache):
    with pytest.raises(BuildError, match=r"(?s)refused emitted code.*undeclared|unknown"):
        build_extension({**SOURCES, "twice.c": "int f(void) { return nothing; }\n"}, CDEF, "twice")
    assert libraries(cache) == []


def test_without_a_compiler_the_message_says_what_to_install(cache, monkeypatch):
    monkeypatch.setenv("PATH", "/nonexistent")
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr(compiler, "is_installed", lambda _: False)
    with pytest.raises(BuildError, match=r"(?s)C compiler.*was not found.*apt install gcc.*backend='numpy'") as caught:
        build_extension(SOURCES, CDEF, "twice")
    assert caught.value.exit_code == 5


def test_without_a_compiler_of_the_system_the_one_from_pypi_is_used(cache, monkeypatch):
    pytest.importorskip("ziglang", reason="the optional compiler from PyPI is not installed")
    monkeypatch.setenv("PATH", "/nonexistent")
    monkeypatch.delenv("CC", raising=False)
    assert compiler.find_compiler().command[:3] == (sys.executable, "-m", "ziglang")
    _, lib = build_extension(SOURCES, CDEF, "twice")
    assert lib.twice(1.5) == 3.0


def test_a_compiler_named_by_cc_is_used_or_missed(cache, monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler -pipe")
    with pytest.raises(BuildError, match="'no-such-compiler' named by CC"):
        build_extension(SOURCES, CDEF, "twice")
    monkeypatch.setenv("CC", "gcc -DUNUSED=1")
    _, lib = build_extension(SOURCES, CDEF, "twice")
    assert lib.twice(1.0) == 2.0


def test_without_python_headers_the_message_says_what_to_install(cache, monkeypatch):
    monkeypatch.setattr(compiler.sysconfig, "get_path", lambda _: "/nonexistent")
    with pytest.raises(BuildError, match="apt install python3-dev"):
        build_extension(SOURCES, CDEF, "twice")


def test_processes_that_build_the_same_do_not_disturb_each_other(cache):
    script = (
        "from rrrgen.runtime.build import build_extension\n"
        f"_, lib = build_extension({SOURCES!r}, {CDEF!r}, 'twice')\n"
        "print(lib.twice(4.0))\n"
    )
    root = Path(__file__).resolve().parents[2]
    environment = {**os.environ, "PYTHONPATH": str(root), "RRRGEN_CACHE": str(cache)}
    running = [
        subprocess.Popen([sys.executable, "-c", script], env=environment, stdout=subprocess.PIPE, text=True)
        for _ in range(4)
    ]
    assert [process.communicate()[0] for process in running] == ["8.0\n"] * 4
    assert len(libraries(cache)) == 1
    assert [p for p in cache.iterdir() if p.name.startswith(".")] == []


def test_a_cache_that_cannot_be_written_is_replaced(tmp_path, monkeypatch):
    blocked = tmp_path / "file"
    blocked.write_text("")
    monkeypatch.setenv("RRRGEN_CACHE", str(blocked / "cache"))
    cache_directory.cache_clear()
    try:
        assert cache_directory().is_dir()
        assert cache_directory() != blocked / "cache"
    finally:
        cache_directory.cache_clear()


def test_the_cache_forgets_what_was_not_used_for_longest(cache):
    cache_directory()
    for k in range(12):
        (cache / f"{k}").write_text("")
        os.utime(cache / f"{k}", (1000 + k, 1000 + k))
    touch(cache / "0")
    prune(most=12)
    assert len(list(cache.iterdir())) == 12
    (cache / "12").write_text("")
    prune(most=12)
    assert {path.name for path in cache.iterdir()} == {"0", "5", "6", "7", "8", "9", "10", "11", "12"}


def test_digests_keep_their_parts_apart_and_files_appear_whole(tmp_path):
    assert digest("ab", "c") != digest("a", "bc")
    store(tmp_path / "x", b"1")
    store(tmp_path / "x", b"2")
    assert (tmp_path / "x").read_bytes() == b"2"
    assert len(list(tmp_path.iterdir())) == 1


def test_a_cache_where_nothing_may_be_run(cache, monkeypatch):
    """On a disk mounted noexec the loader fails however often one tries: the message says what helps."""
    create = build_module.ExtensionFileLoader.create_module

    def refuse(loader, spec):
        if str(cache) not in loader.path:
            return create(loader, spec)
        raise ImportError("failed to map segment from shared object")

    flags = os.ST_NOEXEC | os.ST_NOSUID
    monkeypatch.setattr(build_module.ExtensionFileLoader, "create_module", refuse)
    monkeypatch.setattr(build_module.os, "statvfs", lambda _: os.statvfs_result((0,) * 8 + (flags, 255)))
    with pytest.raises(BuildError, match=r"mounted noexec.*RRRGEN_CACHE.*backend='numpy'") as caught:
        build_extension(SOURCES, CDEF, "twice")
    assert "try again" not in str(caught.value)
    assert len(libraries(cache)) == 1
