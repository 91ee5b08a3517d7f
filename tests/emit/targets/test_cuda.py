"""The CUDA header: NVRTC compiles it without a GPU, and its kernels compute, on the host, what the emitted C does."""

from __future__ import annotations

import ctypes
import subprocess

import numpy as np
import pytest

import rrrgen
from bench.measurements.cuda_registers import compiled, nvrtc
from rrrgen.emit.targets.interface import ExportOptions
from rrrgen.exporting import export_robot
from rrrgen.robot.file import load_spec

ON_THE_HOST = """
#include <cmath>
#include <cstddef>
#define __device__
#define __global__
struct index3 { unsigned x; };
static const index3 gridDim = {2}, blockDim = {4};
static index3 blockIdx, threadIdx;
#include "%s.cuh"
extern "C" void run(void (*kernel)(size_t, const %s *, %s *), size_t count, const %s *x, %s *y)
{
    for (blockIdx.x = 0; blockIdx.x < gridDim.x; ++blockIdx.x)
        for (threadIdx.x = 0; threadIdx.x < blockDim.x; ++threadIdx.x)
            kernel(count, x, y);
}
static void inverse_dynamics(size_t count, const %s *x, %s *tau)
{
    NAME_batch_inverse_dynamics_nominal(count, x, x + N*count, x + 2*N*count, tau);
}
extern "C" void tau(size_t count, const %s *x, %s *y) { run(inverse_dynamics, count, x, y); }
extern "C" void mass(size_t count, const %s *x, %s *y) { run(NAME_batch_mass_matrix_nominal, count, x, y); }
"""


def header(robot, real, further=()):
    return export_robot(load_spec(robot), "cuda", options=ExportOptions(real=real, further=further)).files


@pytest.mark.parametrize(("robot", "real", "limit"), [("rrr", "double", 1e-14), ("scara", "float", 2e-6)])
@pytest.mark.sweep(but=["scara-float-2e-06"])
def test_kernels_on_the_host_equal_the_emitted_c(tmp_path, robot, real, limit):
    """A grid of 8 threads over 21 states, so that threads take several states or fewer than others."""
    model, count = rrrgen.compile(robot), 21
    for name, text in header(robot, real).items():
        (tmp_path / name).write_text(text)
    source = ON_THE_HOST.replace("%s.cuh", f"{robot}.cuh").replace("%s", real)
    (tmp_path / "host.cpp").write_text(source.replace("NAME", robot).replace("N*", f"{model.n}*"))
    library = tmp_path / "host.so"
    command = ["g++", "-O1", "-Wall", "-Wextra", "-Wno-unused-function", "-Werror", "-shared", "-fPIC"]
    subprocess.run([*command, str(tmp_path / "host.cpp"), "-o", str(library)], check=True)
    host = ctypes.CDLL(str(library))
    kind = np.float64 if real == "double" else np.float32
    x = np.random.default_rng(1).uniform(-1, 1, (3, model.n, count)).astype(kind)
    q, dq, ddq = (rows.T.astype(float) for rows in x)
    for name, expected in (("tau", model.inverse_dynamics(q, dq, ddq)), ("mass", model.mass_matrix(q))):
        y = np.empty((expected[0].size, count), kind)
        getattr(host, name)(ctypes.c_size_t(count), x.ctypes, y.ctypes)
        deviation = y.T.reshape(expected.shape) - expected
        assert np.max(np.abs(deviation)) < limit * np.max(np.abs(expected))


@pytest.fixture
def compiler():
    try:
        return nvrtc()
    except ImportError as error:
        pytest.skip(str(error))


@pytest.mark.sweep
def test_it_compiles_without_spills_in_single_precision(compiler):
    """Every word of --with as well, on fewer joints; registers of a real device are not needed for that."""
    kernels = compiled(header("rrr", "float")["rrr.cuh"])
    assert kernels["rrr_batch_inverse_dynamics_nominal"].registers <= 40
    groups = ("control", "elastic", "gravity", "observer", "points", "timing", "trajectory")
    files = header("planar2r", "float", groups)
    assert sorted(files) == ["planar2r.cuh", "planar2r_any_gravity.cuh"]
    kernels |= compiled(files["planar2r.cuh"])
    assert [name for name, kernel in kernels.items() if kernel.spills] == []


def test_the_compiler_speaks_where_it_fails(compiler):
    with pytest.raises(ValueError, match="error: identifier"):
        compiled("__global__ void f(float *x) { *x = y; }")
