"""The command lines of the compilers, as on other systems too, and builds with every compiler that is here."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import rrrgen
from rrrgen.base.errors import BuildError
from rrrgen.emit.c import compilers as compiler
from rrrgen.emit.c.compilers import NATIVE, Compiler, environment_words, find_compiler

CLANG = shutil.which("clang")
CL = r"C:\Program Files\Microsoft Visual Studio\VC\bin\cl.exe"


@pytest.fixture
def windows(monkeypatch):
    """The names that the code reads of a system, as Python on Windows has them."""
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setattr(sys, "base_prefix", r"C:\Python312")
    for variable in ("CC", "RRRGEN_CFLAGS"):
        monkeypatch.delenv(variable, raising=False)


def there(*programs: str):
    """``shutil.which`` on a machine with these programs."""
    return lambda name, *_: f"/bin/{name}" if name in programs else None


def test_a_unit_and_a_library_by_gcc_on_linux(monkeypatch):
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("RRRGEN_CFLAGS", raising=False)
    gcc = Compiler(("gcc", "-pipe"))
    assert gcc.compile("a.c", ["-O0", *NATIVE], "/include")[2:] == [
        "-std=c99", "-O2", "-ffp-contract=off", "-fno-fast-math", "-O0", "-march=native", "-Wno-psabi",
        "-fPIC", "-I/include", "-c", "a.c", "-o", "a.c.o",
    ]  # fmt: skip
    assert gcc.link(["a.c", "b.c"], "x.so") == ["gcc", "-pipe", "-shared", "a.c.o", "b.c.o", "-lm", "-o", "x.so"]


def test_flags_of_the_user_follow_those_of_every_build(monkeypatch):
    usual = find_compiler().identity()
    monkeypatch.setenv("RRRGEN_CFLAGS", "-O3 '-DTEXT=a b'")
    words = Compiler(("gcc",)).compile("a.c", ["-O0"], "/include")
    assert words[words.index("-fno-fast-math") + 1 :][:3] == ["-O3", "-DTEXT=a b", "-O0"]
    assert find_compiler().identity() != usual  # the cache keeps these builds apart


def test_no_level_of_optimization_changes_a_bit(monkeypatch):
    """Which is why tests may build at -O0 and -O1 (conftest.py), while users get -O2."""
    states = np.random.default_rng(5).uniform(-3, 3, (3, 40, 2))
    found = []
    for level in ("-O0", "-O1", "-O2"):
        monkeypatch.setenv("RRRGEN_CFLAGS", level)
        model = rrrgen.compile("planar2r")
        bound = [model.bind(name) for name in ("inverse_dynamics", "forward_dynamics", "mass_matrix", "regressor")]
        rows = model.ik.solve_batch(model.forward_kinematics(states[0, 0]), limits=False)
        results = [f(*state[: len(f.inputs)]).copy() for f in bound for state in zip(*states, strict=True)]
        found.append([rows.q, rows.flags, *results])
    assert all(np.array_equal(each, found[0][k], equal_nan=True) for one in found for k, each in enumerate(one))


def test_apple_processors_and_libraries(monkeypatch):
    monkeypatch.setattr(sys, "platform", "darwin")
    monkeypatch.setattr(compiler.platform, "machine", lambda: "arm64")
    clang = Compiler(("cc",))
    words = clang.compile("a.c", NATIVE, "/include")
    assert "-mcpu=native" in words
    assert "-march=native" not in words
    assert "-fPIC" in words
    assert clang.link(["a.c"], "x.so") == ["cc", "-shared", "a.c.o", "-undefined", "dynamic_lookup", "-o", "x.so"]


def test_windows_needs_the_library_of_python_and_no_position(windows):
    major, minor = sys.version_info[:2]
    for command in (("gcc",), (sys.executable, *compiler.ZIG)):
        words = Compiler(command).compile("a.c", NATIVE, r"C:\Python312\include")
        assert "-fPIC" not in words
        linked = Compiler(command).link(["a.c"], "x.pyd")
        assert f"-lpython{major}{minor}" in linked
        assert any(word.startswith(r"-LC:\Python312") and word.endswith("libs") for word in linked)
        assert "-lm" not in linked


def test_microsofts_options(windows):
    cl = Compiler((CL,))
    assert cl.microsoft
    assert cl.compile("a.c", ["-O0", "-DTABLE=1", *NATIVE], r"C:\Python312\include")[1:] == [
        "/nologo", "/std:c11", "/O2", "/fp:precise", "/Od", "-DTABLE=1", r"/IC:\Python312\include",
        "/c", "a.c", "/Foa.c.obj",
    ]  # fmt: skip
    *words, folder = cl.link(["a.c", "b.c"], "x.pyd")
    assert words[1:] == ["/nologo", "/LD", "a.c.obj", "b.c.obj", "/Fex.pyd", "/link"]
    assert folder.startswith(r"/LIBPATH:C:\Python312")


@pytest.mark.skipif(CLANG is None, reason="clang is not installed")
def test_a_compiler_that_reads_microsofts_options_understands_all_of_them(windows):
    """``clang`` in the mode of cl says what it would run, and would complain of an option that it does not know."""
    cl = Compiler((CL,))
    for words in (cl.compile("a.c", ["-O0", *NATIVE], "include"), cl.link(["a.c"], "x.pyd")):
        mode = [str(CLANG), "--driver-mode=cl", "--target=x86_64-pc-windows-msvc", "-###", *words[1:]]
        done = subprocess.run(mode, capture_output=True, text=True, check=False)
        assert not [line for line in done.stderr.splitlines() if "unused" in line or "unknown" in line], done.stderr


def test_the_order_of_compilers(windows, monkeypatch):
    monkeypatch.setattr(shutil, "which", there("gcc", "cl"))
    assert find_compiler().command == ("/bin/cl",)
    monkeypatch.setattr(shutil, "which", there("gcc"))
    assert find_compiler().command == ("/bin/gcc",)
    monkeypatch.setattr(shutil, "which", there())
    monkeypatch.setattr(compiler, "is_installed", lambda name: name == "ziglang")
    assert find_compiler().command[1:3] == ("-m", "ziglang")
    monkeypatch.setattr(compiler, "is_installed", lambda _: False)
    with pytest.raises(BuildError, match=r"cl, clang or gcc.*build tools of Visual Studio"):
        find_compiler()


def test_cc_may_be_a_path_with_blanks(windows, monkeypatch, tmp_path):
    place = tmp_path / "Build Tools" / "cl.exe"
    place.parent.mkdir()
    place.write_text("")
    monkeypatch.setattr(shutil, "which", lambda name, *_: name if Path(name).is_file() else None)
    monkeypatch.setenv("CC", str(place))
    assert find_compiler() == Compiler((str(place),))
    monkeypatch.setenv("CC", r"C:\llvm\clang.exe --target=x86_64")
    with pytest.raises(BuildError, match=r"C:\\llvm\\clang.exe"):
        find_compiler()


STAND_IN = """#!{python}
import os, sys

NAMES = {{"/c": "-c", "/O2": "-O1", "/Od": "-O0", "/fp:precise": "-ffp-contract=off", "/nologo": "-fPIC"}}

def translated(word):
    for theirs, ours in (("/Fo", "-o"), ("/Fe", "-o"), ("/I", "-I"), ("/LD", "-shared"), ("/std:c11", "-std=c11")):
        if word.startswith(theirs):
            return ours + word[len(theirs):]
    return NAMES.get(word, word)

words = sys.argv[1:]
if "/link" in words:
    words = words[:words.index("/link")]
words = [translated(word) for word in words]
assert not [word for word in words if word.startswith("/") and not os.path.exists(word)], words
os.execvp("gcc", ["gcc", "-Dvector_size=none", "-Werror=attributes", *words])
"""
"""A program that understands the options of cl as far as they are used, calls gcc, and refuses vector types."""


@pytest.mark.skipif(sys.platform == "win32" or shutil.which("gcc") is None, reason="the stand-in calls gcc")
def test_a_model_is_built_with_the_options_of_cl(monkeypatch, tmp_path):
    """From the file to calls in batches: loops call the function of one state, since cl has no vector types."""
    states = np.random.default_rng(4).uniform(-1, 1, (3, 7, 1))
    usual = rrrgen.compile("pendulum")
    expected = usual.inverse_dynamics(*states), usual.forward_dynamics(*states)
    stand_in = tmp_path / "cl"
    stand_in.write_text(STAND_IN.format(python=sys.executable), encoding="utf-8")
    stand_in.chmod(0o755)
    monkeypatch.setenv("CC", str(stand_in))
    model = rrrgen.compile("pendulum")
    for found, wanted in zip((model.inverse_dynamics(*states), model.forward_dynamics(*states)), expected, strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize(
    ("variable", "text"), [("RRRGEN_CFLAGS", "-DX='a"), ("CC", "gcc '"), ("CC", '"gcc'), ("LDFLAGS", "-L'x")]
)
def test_a_variable_with_an_open_quotation_is_named(monkeypatch, variable, text):
    monkeypatch.setenv(variable, text)
    with pytest.raises(BuildError, match=f"^{variable}.*: no closing quotation") as caught:
        environment_words(variable)
    assert text in str(caught.value)
    assert caught.value.exit_code == 5
