"""Whole outputs of bundled robots, everything that is C in them: warnings, both languages, the self-test."""

from __future__ import annotations

from functools import cache
from statistics import median

import pytest

from emit.c_tools import C99, CXX, compile_all, compiler, emitted, frames, run, write
from pipeline.optimized import bundled
from rrrgen.emit.c.stack import stack_bound
from rrrgen.emit.package import emit


@cache
def sources(robot, real):
    """The C files of a bundled robot, made once."""
    files = emit(bundled(robot), real)
    return {name: text for name, text in files.items() if name.endswith((".h", ".c")) and "/" not in name}


@pytest.mark.parametrize(
    ("robot", "real", "command", "flags"),
    [
        ("rrr", "double", "gcc", ["-O1", *C99]),
        ("rrr", "float", "clang", ["-O1", *C99]),
        ("rrr", "double", "clang", ["-O1", "-ffast-math", *CXX]),
        pytest.param(
            "rrr", "float", "gcc", ["-O0", *CXX], marks=pytest.mark.sweep
        ),  # the optimizer gets the same code from C and C++
        ("stanford", "float", "gcc", ["-O1", *C99]),
        pytest.param("panda", "double", "clang", ["-O0", *C99], marks=pytest.mark.sweep),
        ("xarm6", "double", "clang", ["-O0", *C99]),  # general equations, which may not prove their number
        ("gantry", "double", "clang", ["-O0", *C99]),  # no angle: no kernel that nothing uses
        ("rrr", "double", "gcc", ["-Ofast", *C99]),  # the sines must not come from a kernel that is rearranged
    ],
)
@pytest.mark.sweep(but=["rrr-double-gcc-flags8", "rrr-float-clang-flags1", "gantry-double-clang-flags7"])
def test_bundled_robots_compile_cleanly_and_pass_their_self_test(robot, real, command, flags, tmp_path):
    folder = write(sources(robot, real), tmp_path)
    done = run(compile_all(folder, [compiler(command), *flags]))
    assert done.returncode == 0, done.stdout
    assert "FAILED" not in done.stdout


@pytest.mark.parametrize(
    ("robot", "real", "command", "flags"),
    [
        pytest.param("stanford", "double", "gcc", ["-O2"], marks=pytest.mark.sweep),  # loads inputs early
        ("stanford", "float", "clang", ["-O2"]),  # saves vectors
        ("rrr", "double", "clang", ["-O1"]),
        ("rrr", "float", "gcc", ["-O3", "-march=native"]),
        ("rrr", "double", "gcc", ["-O1"]),  # calls the kernel of the sines
        pytest.param("gantry", "float", "clang", ["-O3"], marks=pytest.mark.sweep),
    ],
)
@pytest.mark.sweep(but=["stanford-float-clang-flags1", "rrr-double-gcc-flags4"])
def test_no_function_takes_more_stack_than_its_bound(robot, real, command, flags, tmp_path):
    folder = emitted(bundled(robot), tmp_path, real)
    bounds = {f"{robot}_{name}": stack_bound(program, real) for name, program in bundled(robot).programs.items()}
    used = {}
    for part in ("", "_derivatives"):
        found = frames(folder / f"{robot}{part}.c", [compiler(command), *flags])
        kernel = found.get(f"{robot}_sincos", 0)
        used |= {name: size + kernel for name, size in found.items() if name in bounds}
    assert len(used) > 20
    stated = {name: getattr(bounds[name], command) for name in used}
    assert [name for name in used if used[name] > stated[name]] == []
    large = [stated[name] / used[name] for name in used if used[name] >= 400]
    assert not large or median(large) < 4, "bounds that say too little"


def test_no_function_takes_more_stack_on_arm(tmp_path):
    folder = emitted(bundled("panda"), tmp_path, "float")
    command = [compiler("arm-none-eabi-gcc"), "-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard", "-O2"]
    used = frames(folder / "panda.c", command)
    for name, program in bundled("panda").programs.items():
        assert used.get(f"panda_{name}", 0) <= stack_bound(program, "float").gcc, name
    assert used["panda_standard_regressor"] > 400


UNITY = """#include "rrr.inc"
#include "rrr_nominal.inc"
#include "rrr_derivatives.inc"
#include "rrr_ik.inc"
int main(void)
{
    rrr_real beta[RRR_B];
    rrr_nominal_parameters(beta);
    return !(beta[0] > 0.0);
}
"""


def test_all_sources_fit_into_one_translation_unit(tmp_path):
    files = sources("rrr", "double")
    folder = write({name.replace(".c", ".inc"): text for name, text in files.items()}, tmp_path)
    write({"unity.c": UNITY}, folder)
    assert run(compile_all(folder, [compiler("gcc"), *C99])).returncode == 0


def test_sources_that_are_not_needed_are_left_out(tmp_path):
    folder = write(sources("rrr", "double"), tmp_path)
    for unused in ("rrr_nominal.c", "rrr_derivatives.c", "rrr_ik.c", "rrr_selftest.c"):
        (folder / unused).unlink()
    main = UNITY.replace("rrr.inc", "rrr.h").replace(
        '#include "rrr_nominal.inc"\n#include "rrr_derivatives.inc"\n#include "rrr_ik.inc"\n', ""
    )
    assert run(compile_all(write({"main.c": main}, folder), [compiler("gcc"), *C99])).returncode == 0
