"""CasADi functions with derivatives of their own, in Python, in emitted modules and in external C."""

from __future__ import annotations

import importlib.util
import shutil
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rrrgen
from emit.casadi_cases import build
from rrrgen.derive import derive_once
from rrrgen.derive.derived_model import DerivedModel
from rrrgen.emit.casadi.external import external_sources
from rrrgen.emit.casadi.files import derivative_functions, external_functions, module_file
from rrrgen.emit.casadi.function import function
from rrrgen.emit.casadi.own_derivatives import with_own_derivatives
from rrrgen.robot.file import load_spec

ca = pytest.importorskip("casadi")

ROUND_OFF = 1e-12  # relative to the largest entry; the mass matrix has a condition of some hundreds
NAMES = ("inverse_dynamics_nominal", "forward_dynamics_nominal")


@cache
def derived() -> DerivedModel:
    return derive_once(load_spec("rrr"), groups=("model", "hessian"))


@cache
def own(name: str) -> Any:
    programs = derived().programs
    names = derivative_functions(programs[name], programs)
    assert names is not None
    return with_own_derivatives(function(programs[name], name), *(function(programs[each], each) for each in names))


def plain(name: str) -> Any:
    return function(derived().programs[name], name)


def close(found: Any, expected: Any) -> None:
    """Two matrices of CasADi are equal up to round-off."""
    one, other = found.full(), expected.full()
    assert np.max(np.abs(one - other)) < ROUND_OFF * np.max(np.abs(other))


def operations(f: Any) -> int:
    """Scalar operations of all SX functions that ``f`` calls."""
    if f.class_name() == "SXFunction":
        free = (ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST)
        return sum(f.instruction_id(k) not in free for k in range(f.n_instructions()))
    if f.class_name() == "Map":
        return int(f.info()["n"]) * operations(f.info()["f"])
    calls = [k for k in range(f.n_instructions()) if f.instruction_id(k) == ca.OP_CALL]
    return sum(operations(f.instruction_MX(k).which_function()) for k in calls)


def hessian(f: Any, count: int, square: bool) -> Any:
    """The Hessian that CasADi makes of a weighted sum of y, or of their squares, over ``count`` mapped states."""
    n = f.numel_in(0)
    x, w = ca.MX.sym("x", 3 * n * count), ca.MX.sym("w", n, count)
    arguments = ca.vertsplit(ca.reshape(x, 3 * n, count), n)
    y = (f if count == 1 else f.map(count)).call(arguments)[0]
    H, _ = ca.hessian(ca.dot(w, y * y if square else y), x)
    return ca.Function("H", [x, w], [H, ca.jacobian(ca.vec(y), x)])


@pytest.mark.parametrize("square", [False, True])
@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize("name", NAMES)
def test_hessians_and_jacobians_are_those_of_casadi(name: str, count: int, square: bool) -> None:
    """Of a linear function and of one whose multipliers depend on the state, called once and mapped."""
    mine, theirs = (hessian(f, count, square) for f in (own(name), plain(name)))
    rng = np.random.default_rng(count)
    x, w = rng.uniform(-1, 1, theirs.size_in(0)), rng.uniform(-1, 1, theirs.size_in(1))
    for found, expected in zip(mine.call([x, w]), theirs.call([x, w]), strict=True):
        close(found, expected)
    assert mine.nnz_out(0) == theirs.nnz_out(0)
    assert operations(mine) < 0.6 * operations(theirs)


@pytest.mark.parametrize("name", NAMES)
def test_the_hessian_is_one_call_of_the_function_of_rrrgen(name: str) -> None:
    n, f = 3, own(name)
    x, w = ca.MX.sym("x", 3 * n), ca.MX.sym("w", n)
    H, _ = ca.hessian(ca.dot(w, f.call(ca.vertsplit(x, n))[0]), x)
    made = ca.Function("H", [x, w], [H])
    second = function(derived().programs[name.replace("_nominal", "_hessian_nominal")])
    assert operations(made) <= operations(second)  # the gradient is left out


def swing(f: Any) -> tuple[Any, Any]:
    """The arm moves to another posture in six steps with the least torques: IPOPT's solver, and its problem."""
    n, N, h = 3, 6, 0.1
    X, U = ca.MX.sym("X", 2 * n, N + 1), ca.MX.sym("U", n, N)
    gaps = [X[:, 0] - ca.vertcat(0, -1.2, 0.8, 0, 0, 0), X[:, N] - ca.vertcat(1, -0.5, 0.4, 0, 0, 0)]
    for k in range(N):
        ddq = f(X[:n, k], X[n:, k], U[:, k])[0]
        speed = X[n:, k] + h * ddq
        gaps.append(X[:, k + 1] - ca.vertcat(X[:n, k] + h * speed, speed))
    problem = {"x": ca.vertcat(ca.vec(X), ca.vec(U)), "f": ca.sumsqr(U), "g": ca.vertcat(*gaps)}
    options = {"ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes", "ipopt.tol": 1e-9}
    return ca.nlpsol("solver", "ipopt", problem, options), problem


def test_the_hessian_of_ipopt_is_that_of_casadi() -> None:
    (mine, problem), (theirs, _) = swing(own(NAMES[1])), swing(plain(NAMES[1]))
    rng = np.random.default_rng(3)
    x, multipliers = rng.uniform(-1, 1, problem["x"].numel()), rng.uniform(-1, 1, problem["g"].numel())
    callbacks = [solver.get_function("nlp_hess_l") for solver in (mine, theirs)]
    close(*(f(x, [], 1, multipliers) for f in callbacks))
    assert operations(callbacks[0]) < 0.3 * operations(callbacks[1])
    results = [solver(x0=0.1, lbg=0, ubg=0) for solver in (mine, theirs)]
    assert mine.stats()["success"]
    assert mine.stats()["iter_count"] == theirs.stats()["iter_count"]
    assert float(results[0]["f"]) == pytest.approx(float(results[1]["f"]), rel=1e-9)


def test_the_method_of_a_model() -> None:
    m = rrrgen.compile("rrr", backend="numpy")
    f = m.casadi_function("inverse_dynamics_nominal", hessian=True)
    H = hessian(f, 1, False)
    x, w = np.linspace(-1, 1, 9), np.array([0.3, -0.5, 0.7])
    expected = m.inverse_dynamics_hessian(*np.split(x, 3), w).H
    assert np.max(np.abs(H(x, w)[0].full() - expected)) < ROUND_OFF * np.max(np.abs(expected))
    with pytest.raises(ValueError, match=r"inverse_dynamics: no Hessian; .*inverse_dynamics_nominal, forward"):
        m.casadi_function("inverse_dynamics", hessian=True)


def test_code_that_casadi_generates_has_them(tmp_path: Path) -> None:
    """What acados and other programs do with an expression of CasADi."""
    made = hessian(own(NAMES[0]), 1, False)
    theirs = hessian(plain(NAMES[0]), 1, False)
    lengths = []
    for label, f in (("own", made), ("plain", theirs)):
        generator = ca.CodeGenerator(f"{label}.c")
        generator.add(f)
        lengths.append(Path(generator.generate(f"{tmp_path}/")).stat().st_size)
    assert lengths[0] < 0.6 * lengths[1]


def test_the_emitted_module_has_them(tmp_path: Path) -> None:
    (text,) = module_file(derived(), ("Generated by rrrgen.",)).values()
    path = tmp_path / "rrr_own.py"
    path.write_text(text, encoding="utf-8")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    x, w = np.linspace(-1, 1, 9), np.array([0.3, -0.5, 0.7])
    for name in NAMES:
        f, reference = hessian(getattr(module, name)(), 1, False), hessian(own(name), 1, False)
        assert operations(f) <= operations(reference)  # the printed text shares more
        close(f(x, w)[0], reference(x, w)[0])
    assert "with_own_derivatives" not in next(iter(module_file(derive_once(load_spec("rrr")), ("",)).values()))


@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc to build the emitted C")
def test_external_c_has_them(tmp_path: Path) -> None:
    """CasADi takes ``jac_adj1_`` by its name and needs no directions."""
    chosen = [each for each in external_functions(derived()) if each[0] in NAMES]
    library = build(tmp_path, external_sources("rrr", chosen))
    rng = np.random.default_rng(5)
    x, w = rng.uniform(-1, 1, 9), rng.uniform(-1, 1, 3)
    for name in NAMES:
        f = ca.external(f"rrr_casadi_{name}", str(library))
        for square in (False, True):
            made, reference = hessian(f, 1, square), hessian(plain(name), 1, square)
            for found, expected in zip(made.call([x, w]), reference.call([x, w]), strict=True):
                close(found, expected)
            called = [made.instruction_MX(k) for k in range(made.n_instructions())]
            names = {each.which_function().name() for each in called if each.op() == ca.OP_CALL}
            assert f"jac_adj1_rrr_casadi_{name}" in names
            assert not any(each.startswith("fwd1_adj1") for each in names)
