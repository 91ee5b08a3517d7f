"""Every emitted C file on a microcontroller's compiler (short enumerations, single precision), and under cppcheck."""

import shutil
import subprocess

import pytest

from pipeline.optimized import bundled
from rrrgen.emit.package import emit
from rrrgen.robot.file import read

ARM = "arm-none-eabi-gcc"
FLAGS = ["-std=c99", "-O1", "-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"]
WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Werror"]


def sources(name, folder, real):
    files = emit(bundled(name), real)
    for file, text in files.items():
        if file.endswith((".c", ".h")) and "/" not in file:
            (folder / file).write_text(text)
    return sorted(folder.glob("*.c"))


@pytest.mark.skipif(shutil.which(ARM) is None, reason=f"{ARM} is not installed")
@pytest.mark.parametrize("name", ["rrr", "scara"])
def test_bare_metal_arm(name, tmp_path):
    for source in sources(name, tmp_path, "float"):
        done = subprocess.run(
            [ARM, *FLAGS, *WARNINGS, "-c", source.name, "-o", "x.o"], cwd=tmp_path, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr[:2000]


@pytest.mark.sweep
@pytest.mark.skipif(shutil.which("cppcheck") is None, reason="cppcheck is not installed")
def test_static_analysis_finds_nothing_in_the_inverse_kinematics(tmp_path):
    from rrrgen.emit.c.ik.files import sources as ik_sources

    for file, text in ik_sources(read("stanford")).items():  # a joint that slides, and a wrist
        (tmp_path / file).write_text(text)
    done = subprocess.run(
        ["cppcheck", "-q", "--enable=warning,portability", "--error-exitcode=1", *map(str, tmp_path.glob("*.c"))],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr[:2000]
