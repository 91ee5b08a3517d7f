"""The Fourier series with its coefficients at run time: its values, and what it refuses."""

from __future__ import annotations

import subprocess

import numpy as np
import pytest

from rrrgen.emit.c.language import sincos_strategy
from rrrgen.emit.controller.fourier_series import fourier_series_files
from rrrgen.lab.design.fourier_series import FourierTrajectory
from rrrgen.runtime.build import build_extension

STRICT = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Wshadow", "-Werror"]
DECLARED = """
typedef struct { int harmonics; REAL base_frequency; const REAL *q0, *a, *b; } arm_fourier_series;
int arm_fourier(const arm_fourier_series *series, REAL t, REAL *q_d, REAL *dq_d, REAL *ddq_d);
"""


@pytest.mark.parametrize(("real", "close"), [("double", 1e-13), ("float", 2e-5)])
def test_it_is_the_series_whatever_its_coefficients(real, close):
    files = fourier_series_files("arm", 3, real, sincos_strategy("inline"))
    ffi, lib = build_extension(files, DECLARED.replace("REAL", real), f"arm_fourier_{real}")
    kind, rng = {"double": np.float64, "float": np.float32}[real], np.random.default_rng(4)
    results = np.empty((3, 3), kind)
    place = [ffi.from_buffer(f"{real}[]", row) for row in results]
    for harmonics in (0, 1, 5, 20):
        parts = [rng.normal(size=3), *rng.normal(size=(2, 3, harmonics))]
        path = FourierTrajectory(*parts, 0.1)
        kept = [np.ascontiguousarray(part, kind) for part in parts]
        series = ffi.new("arm_fourier_series *", [harmonics, 0.1, *(ffi.from_buffer(f"{real}[]", x) for x in kept)])
        for t in (0.0, 0.75, 9.5, -3.25, 1000.5):
            assert lib.arm_fourier(series, t, *place) == 1
            for found, expected in zip(results, path.evaluate(np.array([t])), strict=True):
                np.testing.assert_allclose(found, expected[0], atol=(1 + harmonics**2) * close * (1 + abs(t) / 10))
        for field, value in (("harmonics", -1), ("base_frequency", 0.0), ("base_frequency", np.nan)):
            before = getattr(series, field)
            setattr(series, field, value)
            assert lib.arm_fourier(series, 1.0, *place) == 0
            np.testing.assert_array_equal(results, [kept[0], np.zeros(3), np.zeros(3)])
            setattr(series, field, before)
        for t in (np.nan, np.inf):
            assert lib.arm_fourier(series, t, *place) == 0
            np.testing.assert_array_equal(results, [kept[0], np.zeros(3), np.zeros(3)])


@pytest.mark.parametrize(("real", "trig"), [("double", "libm"), ("float", "inline")])
def test_the_code_is_strict(tmp_path, real, trig):
    for name, text in fourier_series_files("arm", 7, real, sincos_strategy(trig)).items():
        (tmp_path / name).write_text(text)
    for command in (["gcc", "-std=c99"], ["clang", "-std=c99"], ["g++", "-x", "c++", "-std=c++11"]):
        line = [*command, "-O1", *STRICT, "-c", "arm_fourier.c", "-o", "arm.o"]
        try:
            done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, check=False)
        except FileNotFoundError:
            continue
        assert done.returncode == 0, done.stderr
