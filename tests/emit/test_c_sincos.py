"""The inline sine and cosine: within its bound over its range against 40-digit arithmetic, the C library beyond."""

import ctypes
import platform
import re
import shutil
import subprocess
from pathlib import Path

import mpmath
import numpy as np
import pytest

from rrrgen.emit.c.language import ERROR_BOUND, HALF_PI, RANGE, Dialect, InlineSinCos

WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Werror"]


def kernel(real, folder):
    dialect = Dialect("k", real)
    source = f"""typedef {real} k_real;
#include <math.h>
{InlineSinCos().preamble(dialect)}
void run(int n, const k_real *x, k_real *s, k_real *c);
void run(int n, const k_real *x, k_real *s, k_real *c) {{ for (int i = 0; i < n; i++) k_sincos(x[i], s + i, c + i); }}
"""
    path = folder / f"{real}.c"
    path.write_text(source)
    library = folder / f"{real}.so"
    flags = ["-std=c99", "-O2", "-ffp-contract=off", *WARNINGS, "-fPIC", "-shared"]
    subprocess.run(["cc", *flags, str(path), "-o", str(library), "-lm"], check=True)
    run = ctypes.CDLL(str(library)).run
    kind = np.float64 if real == "double" else np.float32

    def evaluate(x):
        x = np.ascontiguousarray(x, kind)
        s, c = np.empty_like(x), np.empty_like(x)
        run(len(x), *(ctypes.c_void_p(a.ctypes.data) for a in (x, s, c)))
        return s, c

    return evaluate, kind


def hard_angles(kind, limit, count):
    """Over the whole range, near zero, and as close to quarter and eighth turns as numbers get."""
    rng = np.random.default_rng(14)
    turns = rng.integers(-int(limit / np.pi * 2), int(limit / np.pi * 2), count)
    near = turns * (np.pi / 2) + rng.normal(size=count) * 10.0 ** rng.uniform(-17, 0, count)
    x = np.concatenate(
        [rng.uniform(-limit, limit, count), rng.uniform(-7, 7, count), near, turns * (np.pi / 4), [0.0, limit, -limit]]
    ).astype(kind)
    return x[np.abs(x) <= limit]


@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc")
@pytest.mark.parametrize(("flags", "inlined"), [(["-O2"], True), (["-O3"], True), (["-Os"], False)])
def test_every_function_of_a_large_file_has_its_own_copy_of_the_kernel(flags, inlined, tmp_path):
    """gcc stops inlining where a file grows too much; here it may not grow at all. For size the kernel stays one."""
    limit = ["--param", "large-unit-insns=0", "--param", "inline-unit-growth=0"]
    source = Path(__file__).resolve().parents[2] / "generated" / "rrr" / "rrr.c"
    command = ["gcc", "-std=c99", *flags, *limit, "-c", str(source), "-o", str(tmp_path / "rrr.o")]
    subprocess.run(command, check=True)
    symbols = subprocess.run(["nm", str(tmp_path / "rrr.o")], check=True, capture_output=True, text=True).stdout
    assert ("rrr_sincos" in symbols) is not inlined


@pytest.mark.parametrize(("real", "count"), [("double", 4000), ("float", 400_000)])
def test_error_bound_over_the_range(real, count, tmp_path):
    evaluate, kind = kernel(real, tmp_path)
    x = hard_angles(kind, float(RANGE[real]), count)
    s, c = evaluate(x)
    if real == "float":
        error = max(np.max(np.abs(np.sin(x.astype(float)) - s)), np.max(np.abs(np.cos(x.astype(float)) - c)))
    else:
        with mpmath.workdps(40):
            pairs = zip(x, s, c, strict=True)
            error = max(
                max(abs(mpmath.sin(mpmath.mpf(float(a))) - float(b)), abs(mpmath.cos(mpmath.mpf(float(a))) - float(d)))
                for a, b, d in pairs
            )
    assert 0.1 * ERROR_BOUND[real] < error <= ERROR_BOUND[real], "the bound holds and is not idle"


def test_the_parts_of_half_pi_add_up_and_the_first_two_are_short():
    with mpmath.workdps(60):
        rest = sum(mpmath.mpf(float(part)) for part in HALF_PI["double"]) - mpmath.pi / 2
        assert abs(rest) < 1e-35
    for part in HALF_PI["double"][:2]:
        assert int(np.float64(part).view(np.uint64)) & ((1 << 20) - 1) == 0, "20 bits are left for the quarter turns"


def test_beyond_the_range_the_c_library_answers(tmp_path):
    evaluate, _ = kernel("double", tmp_path)
    far = np.array([1.1e6, -3e8, 1e22])
    s, c = evaluate(far)
    np.testing.assert_allclose(s, np.sin(far), rtol=0, atol=2.3e-16)
    np.testing.assert_allclose(c, np.cos(far), rtol=0, atol=2.3e-16)
    assert np.isnan(evaluate(np.array([np.nan, np.inf, -np.inf]))).all()


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="reads the assembler of x86-64")
@pytest.mark.parametrize("command", [["gcc", "-O2"], ["gcc", "-O3", "-mavx2"], ["clang", "-O2"]])
@pytest.mark.parametrize("real", ["double", "float"])
def test_compiled_it_branches_for_the_range_only(real, command, tmp_path):
    if shutil.which(command[0]) is None:
        pytest.skip(f"{command[0]} is not installed")
    source = f"""typedef {real} k_real;
#include <math.h>
{InlineSinCos().preamble(Dialect("k", real))}
void one(k_real x, k_real *s, k_real *c);
void one(k_real x, k_real *s, k_real *c) {{ k_sincos(x, s, c); }}
"""
    (tmp_path / "one.c").write_text(source)
    subprocess.run([*command, "-std=c99", "-S", "one.c"], cwd=tmp_path, check=True)
    jumps = re.findall(r"^\s+(j(?!mp)\w+)\s", (tmp_path / "one.s").read_text(), re.MULTILINE)
    assert len(jumps) == 1, jumps
