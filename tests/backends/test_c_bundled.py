"""Whole outputs of bundled robots, everything that is C in them: warnings, both languages, the self-test."""

from __future__ import annotations

from statistics import median

import pytest

from backends.c_tools import C99, CXX, compile_all, compiler, emitted, frames, run, write
from pipeline.optimized import bundled
from rrrgen import pipeline
from rrrgen.backends.c.stack import stack_bound


@pytest.fixture(scope="module")
def derived():
    return {name: bundled(name) for name in ("rrr", "stanford", "panda", "gantry")}


def sources(model, real):
    return {
        name: text
        for name, text in pipeline.emit(model, real).items()
        if name.endswith((".h", ".c")) and "/" not in name
    }


@pytest.mark.parametrize(
    ("robot", "real", "command", "flags"),
    [
        ("rrr", "double", "gcc", C99),
        ("rrr", "float", "clang", C99),
        ("rrr", "double", "clang", CXX),
        ("rrr", "float", "gcc", CXX),
        ("stanford", "float", "gcc", C99),
        ("panda", "double", "clang", C99),
        ("gantry", "double", "clang", C99),  # no angle: no kernel that nothing uses
        ("rrr", "double", "gcc", [*C99, "-Ofast"]),  # the sines must not come from a kernel that is rearranged
        ("panda", "double", "clang", [*C99, "-ffast-math"]),
        ("rrr", "float", "gcc", [*C99, "-ffast-math"]),
    ],
)
def test_bundled_robots_compile_cleanly_and_pass_their_self_test(robot, real, command, flags, derived, tmp_path):
    folder = write(sources(derived[robot], real), tmp_path)
    done = run(compile_all(folder, [compiler(command), "-O1", *flags]))
    assert done.returncode == 0, done.stdout
    assert "FAILED" not in done.stdout


@pytest.mark.parametrize(
    ("robot", "real", "command", "flags"),
    [
        ("stanford", "double", "gcc", ["-O2"]),  # loads inputs early
        ("stanford", "float", "clang", ["-O2"]),  # saves vectors
        ("rrr", "double", "clang", ["-O1"]),
        ("rrr", "float", "gcc", ["-O3", "-march=native"]),
        ("rrr", "double", "gcc", ["-O1"]),  # calls the kernel of the sines
        ("gantry", "float", "clang", ["-O3"]),
    ],
)
def test_no_function_takes_more_stack_than_its_bound(robot, real, command, flags, derived, tmp_path):
    folder = emitted(derived[robot], tmp_path, real)
    bounds = {f"{robot}_{name}": stack_bound(program, real) for name, program in derived[robot].programs.items()}
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


def test_no_function_takes_more_stack_on_arm(derived, tmp_path):
    folder = emitted(derived["panda"], tmp_path, "float")
    command = [compiler("arm-none-eabi-gcc"), "-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard", "-O2"]
    used = frames(folder / "panda.c", command)
    for name, program in derived["panda"].programs.items():
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


def test_all_sources_fit_into_one_translation_unit(derived, tmp_path):
    files = sources(derived["rrr"], "double")
    folder = write({name.replace(".c", ".inc"): text for name, text in files.items()}, tmp_path)
    write({"unity.c": UNITY}, folder)
    assert run(compile_all(folder, [compiler("gcc"), *C99])).returncode == 0


def test_sources_that_are_not_needed_are_left_out(derived, tmp_path):
    folder = write(sources(derived["rrr"], "double"), tmp_path)
    for unused in ("rrr_nominal.c", "rrr_derivatives.c", "rrr_ik.c", "rrr_selftest.c"):
        (folder / unused).unlink()
    main = UNITY.replace("rrr.inc", "rrr.h").replace(
        '#include "rrr_nominal.inc"\n#include "rrr_derivatives.inc"\n#include "rrr_ik.inc"\n', ""
    )
    assert run(compile_all(write({"main.c": main}, folder), [compiler("gcc"), *C99])).returncode == 0
