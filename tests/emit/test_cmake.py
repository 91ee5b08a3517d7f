"""The emitted C as a package: installed where the system says, found by version, by CMake and by pkg-config."""

from __future__ import annotations

import re
import shutil
import subprocess
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
NEEDED = ("cmake", "gcc")
pytestmark = pytest.mark.skipif(
    any(shutil.which(tool) is None for tool in NEEDED), reason="needs cmake and gcc to build and install the emitted C"
)

PROGRAM = """\
#include "rrr.h"
int main(void)
{
    rrr_real q[RRR_N] = {0.1, 0.2, 0.3}, g[RRR_N];
    rrr_gravity_nominal(q, g);
    return g[1] > 0.0 || g[1] < 0.0 ? 0 : 1;
}
"""
PROJECT = """\
cmake_minimum_required(VERSION 3.14)
project(use LANGUAGES C)
find_package(rrr {version} REQUIRED)
add_executable(use use.c)
target_link_libraries(use PRIVATE rrr::rrr)
"""


def cmake(*words: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["cmake", *map(str, words)], capture_output=True, text=True, timeout=300, check=False)


LAYOUTS = ("lib", "lib/some-triplet", "absolute")


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A function of the layout: prefix and folder of libraries of an installation, made when first asked for."""
    return cache(lambda layout: installation(layout, tmp_path_factory.mktemp("cmake")))


def installation(layout: str, folder: Path) -> tuple[Path, Path]:
    """Build and install the committed code; the prefix and the folder of libraries."""
    prefix = folder / "prefix"
    libraries = folder / "elsewhere" / "lib" if layout == "absolute" else Path(layout)
    shared = "ON" if layout == "absolute" else "OFF"
    options = [
        f"-DBUILD_SHARED_LIBS={shared}",
        f"-DCMAKE_INSTALL_PREFIX={prefix}",
        f"-DCMAKE_INSTALL_LIBDIR={libraries}",
        "-DRRR_SELFTEST=OFF",
    ]
    done = cmake("-S", ROOT / "generated" / "rrr", "-B", folder / "build", "-DCMAKE_C_FLAGS=-O0", *options)
    assert done.returncode == 0, done.stdout + done.stderr
    for step in (["--build", folder / "build"], ["--install", folder / "build"]):
        done = cmake(*step)
        assert done.returncode == 0, done.stdout + done.stderr
    return prefix, prefix / libraries  # an absolute path stays as it is


@pytest.mark.parametrize(
    ("layout", "version", "found"),
    [
        *((layout, "0.2", True) for layout in LAYOUTS),
        *(("lib", version, found) for version, found in (("", True), ("0.1", False), ("0.3", False), ("1", False))),
    ],
)
@pytest.mark.sweep(but=["lib--True", "lib-0.3-False"])
def test_cmake_finds_the_version(installed, layout, version, found, tmp_path):
    prefix, libraries = installed(layout)
    (tmp_path / "CMakeLists.txt").write_text(PROJECT.format(version=version), encoding="utf-8")
    (tmp_path / "use.c").write_text(PROGRAM, encoding="utf-8")
    config = f"-Drrr_DIR={libraries / 'cmake' / 'rrr'}"
    done = cmake("-S", tmp_path, "-B", tmp_path / "build", f"-DCMAKE_PREFIX_PATH={prefix}", config)
    assert (done.returncode == 0) == found, done.stdout + done.stderr
    if found:
        done = cmake("--build", tmp_path / "build")
        assert done.returncode == 0, done.stdout + done.stderr
        assert subprocess.run([tmp_path / "build" / "use"], check=False).returncode == 0


@pytest.mark.skipif(shutil.which("pkg-config") is None, reason="needs pkg-config")
@pytest.mark.parametrize("layout", LAYOUTS)
def test_pkg_config_finds_headers_and_library(installed, layout, tmp_path):
    _, libraries = installed(layout)
    (tmp_path / "use.c").write_text(PROGRAM, encoding="utf-8")
    path = {"PKG_CONFIG_PATH": str(libraries / "pkgconfig"), "PATH": "/usr/bin:/bin:/usr/local/bin"}
    asked = subprocess.run(
        ["pkg-config", "--cflags", "--libs", "rrr"], env=path, capture_output=True, text=True, check=False
    )
    assert asked.returncode == 0, asked.stderr
    built = subprocess.run(
        ["gcc", "use.c", *asked.stdout.split(), "-o", "use"], cwd=tmp_path, capture_output=True, text=True
    )
    assert built.returncode == 0, built.stderr
    environment = {"LD_LIBRARY_PATH": str(libraries)}  # one of the installations is shared
    assert subprocess.run([tmp_path / "use"], env=environment, check=False).returncode == 0


def test_comments_have_no_operators_of_python():
    """``a2**2`` is neither C nor mathematics; powers are written as in units, ``a2^2``."""
    for file in (ROOT / "generated" / "rrr").glob("*.[ch]"):
        comments = re.findall(r"/\*.*?\*/", file.read_text(encoding="utf-8"), re.S)
        assert not [line for text in comments for line in text.splitlines() if re.search(r"\w\*\*\w", line)], file.name
    assert "a2^2*m3" in (ROOT / "generated" / "rrr" / "rrr.h").read_text(encoding="utf-8")
