"""The C behind CasADi's external interface: values, derivatives, IPOPT, cffi, and what compilers say."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emit.casadi_cases import arguments, as_matrices, build, call, every_shape, pendulum, random_program
from rrrgen.emit.casadi.derivatives import jacobian, routine
from rrrgen.emit.casadi.external import external_sources
from rrrgen.emit.casadi.function import function, smooth_sign
from rrrgen.program import Program, evaluate

ca = pytest.importorskip("casadi")
pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc to build the emitted C")

ROUND_OFF = 1e-13  # the same formulas up to grouping, values of size one
DERIVATIVE = 1e-12  # CasADi's differentiation groups products differently; derivatives reach size 10
FLOAT = 2e-5  # single precision has 6e-8; up to 40 operations and cancellation
DIFFERENCE = 1e-7  # central differences with h = 1e-6: h^2 and 1e-16/h
KINDS = ("jac", "fwd1", "adj1", "fwd1_adj1")


def cases() -> dict[str, Program]:
    rng = np.random.default_rng(20)
    programs = {"shapes": every_shape(), "fd": pendulum(), "fd_smooth": smooth_sign(pendulum())}
    return programs | {f"random{k}": random_program(rng) for k in range(8)}


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    files = external_sources("robot", [(name, program, KINDS) for name, program in cases().items()])
    return build(tmp_path_factory.mktemp("external"), files)


def pair(name: str, library: Path) -> tuple[Any, Any]:
    """The SX function and the external one."""
    symbol = f"robot_casadi_{name}"
    return function(cases()[name], symbol), ca.external(symbol, str(library))


def agree(one: Any, other: Any, values: list[np.ndarray]) -> None:
    for x, y in zip(call(one, values), call(other, values), strict=True):
        np.testing.assert_allclose(y, x, rtol=DERIVATIVE, atol=DERIVATIVE)


@pytest.mark.parametrize("name", cases())
def test_values_names_and_patterns(name: str, library: Path) -> None:
    rng = np.random.default_rng(5)
    program = cases()[name]
    symbolic, external = pair(name, library)
    for side in ("in", "out"):
        for i in range(getattr(symbolic, f"n_{side}")()):
            assert getattr(external, f"name_{side}")(i) == getattr(symbolic, f"name_{side}")(i)
            assert getattr(external, f"sparsity_{side}")(i) == getattr(symbolic, f"sparsity_{side}")(i)
    for _ in range(5):
        values = arguments(program, rng)
        for got, expected in zip(call(external, values), as_matrices(list(evaluate(program, *values))), strict=True):
            np.testing.assert_allclose(got, expected, rtol=ROUND_OFF, atol=ROUND_OFF)


@pytest.mark.parametrize("name", cases())
def test_derivatives_equal_those_of_casadi(name: str, library: Path) -> None:
    """Jacobian, one and several directions forward and reverse, and forward over reverse."""
    rng = np.random.default_rng(6)
    symbolic, external = pair(name, library)
    for derive in (
        lambda f: f.jacobian(),
        lambda f: f.forward(1),
        lambda f: f.reverse(1),
        lambda f: f.forward(3),
        lambda f: f.reverse(2),
        lambda f: f.reverse(1).forward(1),
    ):
        one, other = derive(symbolic), derive(external)
        values = [np.asarray(rng.uniform(-2, 2, one.size_in(i))) for i in range(one.n_in())]
        agree(one, other, values)


def test_jacobian_is_not_denser_than_that_of_casadi(library: Path) -> None:
    for name in ("shapes", "fd", "fd_smooth"):  # no function of a constant, which CasADi folds
        symbolic, external = pair(name, library)
        one, other = symbolic.jacobian(), external.jacobian()
        for i in range(one.n_out()):
            assert other.nnz_out(i) <= one.nnz_out(i)


@pytest.mark.parametrize("seed", range(5))
def test_jacobian_against_differences(seed: int) -> None:
    rng = np.random.default_rng(seed)
    program = random_program(rng, smooth=True)
    base = routine(program, "f")
    derivative = jacobian(base)
    values = [m.T.ravel() for m in as_matrices(arguments(program, rng))]
    blocks = iter(zip(derivative.outputs, evaluate(derivative.program, *values, *_empty(base)), strict=True))
    step = 1e-6
    for k in range(len(base.outputs)):
        for i, value in enumerate(values):
            matrix, nonzeros = next(blocks)
            dense = np.zeros((matrix.rows, matrix.cols))
            for (r, c), entry in zip(matrix.entries, nonzeros, strict=True):
                dense[r, c] = entry
            for c in range(value.size):
                ends = []
                for sign in (1.0, -1.0):
                    moved = [v.copy() for v in values]
                    moved[i][c] += sign * step
                    ends.append(evaluate(base.program, *moved)[k])
                difference = (ends[0] - ends[1]) / (2 * step)
                np.testing.assert_allclose(dense[:, c], difference, rtol=DIFFERENCE, atol=DIFFERENCE)


def _empty(base: Any) -> list[np.ndarray]:
    return [np.zeros(0) for _ in base.outputs]


def swing_up(step: Any) -> dict[str, Any]:
    """Swing a pendulum up in 20 steps of the smooth model with the least torque, and report what IPOPT did."""
    N, h = 20, 0.1
    X, U = ca.MX.sym("X", 2, N + 1), ca.MX.sym("U", 1, N)
    gaps = [X[:, 0], X[:, N] - ca.vertcat(np.pi, 0)]
    for k in range(N):
        half = X[:, k] + h / 2 * ca.vertcat(X[1, k], step(X[0, k], X[1, k], U[k], 0.1))
        gaps.append(X[:, k + 1] - X[:, k] - h * ca.vertcat(half[1], step(half[0], half[1], U[k], 0.1)))
    problem = {"x": ca.vertcat(ca.vec(X), ca.vec(U)), "f": ca.sumsqr(U), "g": ca.vertcat(*gaps)}
    options = {"ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes", "ipopt.tol": 1e-9}
    solver = ca.nlpsol("solver", "ipopt", problem, options)
    solution = solver(x0=0.1, lbg=0, ubg=0)
    return {"x": solution["x"].full().ravel(), "f": float(solution["f"]), **solver.stats()}


def test_ipopt_takes_the_same_iterations_with_the_external_function(library: Path) -> None:
    symbolic, external = (swing_up(step) for step in pair("fd_smooth", library))
    assert symbolic["success"]
    assert external["success"]
    assert external["iter_count"] == symbolic["iter_count"]
    assert external["f"] == pytest.approx(symbolic["f"], rel=1e-9)
    np.testing.assert_allclose(external["x"], symbolic["x"], atol=1e-7)


_CDEF = """
const char *robot_casadi_shapes_name_in(long long i);
long long robot_casadi_shapes_n_in(void);
const long long *robot_casadi_shapes_sparsity_out(long long i);
int robot_casadi_shapes_work(long long *sz_arg, long long *sz_res, long long *sz_iw, long long *sz_w);
int robot_casadi_shapes(const double **arg, double **res, long long *iw, double *w, int mem);
"""


def test_cffi_loads_it(library: Path) -> None:
    """The calling convention from outside CasADi: null outputs are skipped, null inputs are zeros."""
    cffi = pytest.importorskip("cffi")
    ffi = cffi.FFI()
    ffi.cdef(_CDEF)
    C = ffi.dlopen(str(library))
    assert C.robot_casadi_shapes_n_in() == 3
    assert ffi.string(C.robot_casadi_shapes_name_in(1)) == b"B"
    assert C.robot_casadi_shapes_name_in(9) == ffi.NULL
    assert list(C.robot_casadi_shapes_sparsity_out(2)[0:3]) == [4, 2, 1]
    sizes = [ffi.new("long long *") for _ in range(4)]
    assert C.robot_casadi_shapes_work(*sizes) == 0
    assert [size[0] for size in sizes] == [3, 3, 0, 0]
    program = every_shape()
    q, B, k = arguments(program, np.random.default_rng(1))
    q_c, k_c = ffi.new("double[]", q.tolist()), ffi.new("double[]", [float(k)])
    T = ffi.new("double[8]")
    arg, res = ffi.new("double *[]", [q_c, ffi.NULL, k_c]), ffi.new("double *[]", [ffi.NULL, ffi.NULL, T])
    assert C.robot_casadi_shapes(ffi.cast("const double **", arg), res, ffi.NULL, ffi.NULL, 0) == 0
    expected = as_matrices([evaluate(program, q, 0 * B, k)[2]])[0]
    np.testing.assert_allclose(np.array(list(T)).reshape(2, 4).T, expected, rtol=ROUND_OFF)


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
@pytest.mark.parametrize("extra", [(), ("-Dcasadi_real=float",), ("-x", "c++", "-std=c++17")])
def test_compilers_are_content(compiler: str, extra: tuple[str, ...], tmp_path: Path) -> None:
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is not installed")
    names = ("shapes", "fd_smooth", "random1")
    files = external_sources("robot", [(name, cases()[name], KINDS) for name in names])
    build(tmp_path, files, compiler, extra)


def test_single_precision(tmp_path: Path) -> None:
    cffi = pytest.importorskip("cffi")
    program = every_shape()
    library = build(tmp_path, external_sources("robot", [("shapes", program, ())]), extra=("-Dcasadi_real=float",))
    ffi = cffi.FFI()
    ffi.cdef("int robot_casadi_shapes(const float **arg, float **res, long long *iw, float *w, int mem);")
    values = arguments(program, np.random.default_rng(2))
    buffers = [ffi.new("float[]", m.T.ravel().tolist()) for m in as_matrices(values)]
    T = ffi.new("float[8]")
    arg, res = ffi.new("float *[]", buffers), ffi.new("float *[]", [ffi.NULL, ffi.NULL, T])
    assert (
        ffi.dlopen(str(library)).robot_casadi_shapes(ffi.cast("const float **", arg), res, ffi.NULL, ffi.NULL, 0) == 0
    )
    expected = as_matrices([evaluate(program, *values)[2]])[0]
    np.testing.assert_allclose(np.array(list(T)).reshape(2, 4).T, expected, rtol=FLOAT, atol=FLOAT)


def test_two_robots_in_one_program(tmp_path: Path) -> None:
    """Every symbol carries the robot's name, so two robots link into one library."""
    defined = []
    for robot in ("left", "right"):
        folder = tmp_path / robot
        folder.mkdir()
        library = build(folder, external_sources(robot, [("shapes", every_shape(), KINDS)]))
        listed = subprocess.run(["nm", "-D", "--defined-only", library], check=True, capture_output=True, text=True)
        symbols = {line.split()[-1] for line in listed.stdout.splitlines()}
        defined.append({symbol for symbol in symbols if not symbol.startswith("_")})
    assert len(defined[0]) == len(defined[1]) == 5 * 8
    assert all("left_casadi_shapes" in symbol for symbol in defined[0])
    assert not defined[0] & defined[1]
