"""The library for microcontrollers: it compiles for a Cortex-M4F, and its manifests name what is there."""

from __future__ import annotations

import json
import shutil
import tarfile
from importlib.util import find_spec
from pathlib import Path

import pytest

from emit.targets.arm import WITH_CONTROL, arm
from emit.targets.rrr_library import STRICT, run
from rrrgen.emit.targets.interface import ExportOptions
from rrrgen.exporting import export_robot

BOARD_STAND_INS = Path(__file__).with_name("board_stand_ins")
"""What the sketches include of Arduino and Zephyr: functions with their types."""

ZEPHYR = """\
set(CONFIG_ARM y)
macro(zephyr_library_named name)
  message(STATUS "library ${name}")
endmacro()
macro(zephyr_library_sources)
  foreach(file ${ARGN})
    if(NOT EXISTS ${file})
      message(FATAL_ERROR "${file} is missing")
    endif()
  endforeach()
endmacro()
macro(zephyr_include_directories folder)
  if(NOT EXISTS ${folder}/arm.h)
    message(FATAL_ERROR "no header in ${folder}")
  endif()
endmacro()
include(zephyr/CMakeLists.txt)
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("embedded")
    options = ExportOptions(real="float", further=(*WITH_CONTROL, "controller", "cpp", "gravity", "timing"))
    for name, text in export_robot(arm(), "embedded", options=options).files.items():
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).write_text(text, encoding="utf-8")
    return place


@pytest.mark.skipif(shutil.which("arm-none-eabi-gcc") is None, reason="needs arm-none-eabi-gcc")
def test_it_compiles_for_a_microcontroller(folder):
    target = ["-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"]
    for source in (folder / "src").glob("*.c"):
        run("arm-none-eabi-gcc", "-std=c99", "-fsyntax-only", *target, *STRICT, source)


def test_it_holds_what_was_asked_for(folder):
    header = (folder / "src" / "arm.h").read_text(encoding="utf-8")
    assert "arm_computed_torque(" in header
    assert "arm_momentum_observer(" in header
    names = {path.name for path in (folder / "src").iterdir()}
    assert {"arm_differential_ik.c", "arm_timing.c", "arm_any_gravity.c", "arm.hpp"} <= names
    assert "arm_timing.c" in (folder / "zephyr" / "CMakeLists.txt").read_text(encoding="utf-8")
    options = ["-std=c++17", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", "-x", "c++"]
    run("g++", *options, folder / "src" / "arm.hpp")


def check_sketch(folder: Path, sketch: str) -> None:
    """Compile a sketch of the library in ``folder``."""
    options = ["-std=c++11", *STRICT[:2], "-Werror", "-fsyntax-only", "-Isrc", "-include", "Arduino.h", "-x", "c++"]
    compiler = shutil.which("arm-none-eabi-g++") or "g++"
    run(compiler, *options, f"-I{BOARD_STAND_INS}", folder / "examples" / sketch / f"{sketch}.ino", cwd=folder)


def check_sample(folder: Path) -> None:
    """Compile the sample for Zephyr of the library in ``folder``."""
    sample = folder / "zephyr" / "samples" / "controller" / "src" / "main.c"
    compiler = shutil.which("arm-none-eabi-gcc") or "gcc"
    run(compiler, "-std=c11", *STRICT, "-fsyntax-only", "-Isrc", "-isystem", BOARD_STAND_INS, sample, cwd=folder)


@pytest.mark.parametrize("sketch", ["tick", "controller"])
def test_the_sketch_compiles(folder, sketch):
    check_sketch(folder, sketch)


def test_the_sample_of_zephyr_compiles(folder):
    check_sample(folder)


def test_the_manifests_name_what_is_there(folder):
    library = json.loads((folder / "library.json").read_text(encoding="utf-8"))
    lines = (folder / "library.properties").read_text(encoding="utf-8").splitlines()
    properties = dict(line.split("=", 1) for line in lines)
    assert library["name"] == properties["name"] == "arm"
    assert library["version"] == properties["version"]
    for header in (library["headers"], properties["includes"]):
        assert (folder / "src" / header).is_file()


@pytest.mark.skipif(shutil.which("cmake") is None, reason="needs cmake")
def test_the_zephyr_module_finds_its_files(folder):
    assert "CONFIG_ARM" in (folder / "zephyr" / "CMakeLists.txt").read_text(encoding="utf-8")
    assert (folder / "zephyr" / "Kconfig").read_text(encoding="utf-8").startswith("config ARM\n")
    (folder / "check.cmake").write_text(ZEPHYR, encoding="utf-8")
    run("cmake", "-P", "check.cmake", cwd=folder)


@pytest.mark.skipif(shutil.which("pio") is None, reason="needs PlatformIO (pip install platformio)")
def test_platformio_packs_the_library(folder, tmp_path, monkeypatch):
    monkeypatch.setenv("PLATFORMIO_CORE_DIR", str(tmp_path / "core"))
    run("pio", "pkg", "pack", "-o", tmp_path / "arm.tar.gz", ".", cwd=folder)
    with tarfile.open(tmp_path / "arm.tar.gz") as packed:
        assert {"library.json", "src/arm.c", "src/arm.h", "zephyr/module.yml"} <= set(packed.getnames())


@pytest.mark.skipif(find_spec("kconfiglib") is None, reason="needs kconfiglib (pip install kconfiglib)")
def test_the_option_of_zephyr_is_read(folder):
    import kconfiglib

    read = kconfiglib.Kconfig(str(folder / "zephyr" / "Kconfig"))
    assert read.syms["ARM"].type == kconfiglib.BOOL
    assert not read.warnings
