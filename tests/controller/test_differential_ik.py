"""Differential inverse kinematics: the best joint speeds in their box, through singular configurations."""

from __future__ import annotations

import subprocess

import numpy as np
import pytest
from scipy.optimize import lsq_linear

import rrrgen
from rrrgen.derive import prepare
from rrrgen.derive.functions.kinematics import jacobian
from rrrgen.emit.controller.differential_ik import differential_ik_files
from rrrgen.program import evaluate
from rrrgen.robot.file import load_spec
from rrrgen.runtime.functions.differential import INVALID, LIMITS, OK, compiled_solver, numpy_solver

STRICT = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Wshadow", "-Werror"]
Ts = 1e-3


def arguments(J, V, **changes):
    """The arguments of the function, by default without limits at rest."""
    n = J.shape[1]
    given = {"q": np.zeros(n), "dq_last": np.zeros(n), "J": J, "V": V, "weight": np.ones(6), "dq_ref": np.zeros(n)}
    given |= {"damping": 0.02, "q_min": np.full(n, -np.inf), "q_max": np.full(n, np.inf)}
    given |= {"dq_max": np.full(n, np.inf), "ddq_max": np.full(n, np.inf), "Ts": Ts} | changes
    return [np.array(value, dtype=float) for value in given.values()]


def solved(solve, values, dtype=float):
    dq = np.empty(len(values[0]), dtype)
    status = solve([np.asarray(value, dtype) for value in values], dq)
    return dq, status


def box(dq_last, dq_max, ddq_max):
    return np.maximum(-dq_max, dq_last - ddq_max * Ts), np.minimum(dq_max, dq_last + ddq_max * Ts)


@pytest.fixture(scope="module")
def problems():
    """Random Jacobians, some nearly singular, with speeds and accelerations of which many are at their limits."""
    rng = np.random.default_rng(0)
    found = []
    for k in range(150):
        J = rng.uniform(-1, 1, (6, 7))
        if k % 3 == 0:
            J[5] = J[4] * (1 + 1e-3 * rng.normal(size=7))
        more = {"weight": rng.uniform(0, 2, 6), "dq_ref": rng.normal(size=7) / 3, "damping": rng.choice([0.01, 0.05])}
        more |= {
            "dq_last": rng.uniform(-1, 1, 7),
            "dq_max": np.full(7, 1.5),
            "ddq_max": np.full(7, 10.0 ** rng.uniform(1, 4)),
        }
        found.append((J, rng.normal(size=6) * rng.choice([0.1, 1.0, 3.0]), more))
    return found


def test_the_speeds_are_the_best_in_their_box(problems):
    compiled, at_limit = compiled_solver("arm", 7, "double"), 0
    for J, V, more in problems:
        values = arguments(J, V, **more)
        dq, status = solved(compiled, values)
        assert status == OK
        low, high = box(more["dq_last"], more["dq_max"], more["ddq_max"])
        root = np.sqrt(more["weight"])
        A = np.vstack([root[:, None] * J, more["damping"] * np.eye(7)])
        b = np.concatenate([root * V, more["damping"] * more["dq_ref"]])
        best = lsq_linear(A, b, (low, high), method="bvls", tol=1e-14).x
        np.testing.assert_allclose(dq, best, rtol=0, atol=1e-9)
        slope = A.T @ (A @ dq - b)  # the conditions of Karush, Kuhn and Tucker
        wrong = np.where(dq <= low, np.minimum(slope, 0), np.where(dq >= high, np.maximum(slope, 0), slope))
        assert np.abs(wrong).max() < 1e-12 * (1 + np.abs(b).max())
        at_limit += np.count_nonzero((dq <= low) | (dq >= high))
        np.testing.assert_allclose(solved(numpy_solver, values)[0], dq, rtol=0, atol=1e-10)
    assert at_limit > 150  # the limits decide


def test_float(problems):
    compiled, double = compiled_solver("arm", 7, "float"), compiled_solver("arm", 7, "double")
    for J, V, more in problems:
        dq, status = solved(compiled, arguments(J, V, **more), np.float32)
        best, _ = solved(double, arguments(J, V, **more))
        assert status == OK
        cost = [np.sum(more["weight"] * (J @ x - V) ** 2) for x in (dq, best)]
        assert cost[0] <= cost[1] + 1e-3 * (1 + cost[1])


@pytest.mark.parametrize(("name", "q", "V"), [
    ("puma560", [0.2, -0.6, 2.3, 0.3, 0.25, 0.4], [0.0, 0.0, 0.0, 0.0, 2.0, 0.5]),  # the wrist, at speed
    ("iiwa14", [0.2, 0.5, 0.0, -0.9, 0.3, 0.7, 0.1], [0.25, 0.1, 0.2, 0.0, 0.0, 0.0]),  # out to the stretched arm
])  # fmt: skip
@pytest.mark.sweep(but=["puma560-q0-V0"])
def test_limits_hold_through_singular_configurations(name, q, V):
    spec = load_spec(name)
    program, n = jacobian(prepare(spec).recording()), spec.n
    dq_max, ddq_max = np.full(n, 2.0), np.full(n, 15.0)
    q_max = np.full(n, 2.8)
    solve, q, dq = compiled_solver("arm" if n == 7 else "six", n, "double"), np.array(q), np.zeros(n)
    fastest = hardest = undamped = reached = 0.0
    smallest = np.inf
    for _ in range(2500):
        (J,) = evaluate(program, q)
        values = arguments(J, np.array(V), q=q, dq_last=dq, dq_max=dq_max, ddq_max=ddq_max, q_min=-q_max, q_max=q_max)
        last, (dq, status) = dq, solved(solve, values)
        assert status == OK
        fastest = max(fastest, np.max(np.abs(dq) / dq_max))
        hardest = max(hardest, np.max(np.abs(dq - last) / Ts / ddq_max))
        undamped = max(undamped, np.max(np.abs(np.linalg.pinv(J) @ V) / dq_max))
        smallest = min(smallest, np.linalg.svd(J, compute_uv=False)[-1])
        reached = max(reached, float(np.linalg.norm(J @ dq) / np.linalg.norm(V)))
        q = q + Ts * dq
        assert np.all(np.abs(q) <= q_max + 1e-9)
    assert smallest < 0.02
    assert undamped > 5
    assert reached > 0.9
    assert fastest <= 1 + 1e-12
    assert 0.9 < hardest <= 1 + 1e-9


def test_impossible_limits_and_inputs_slow_the_arm_down():
    rng = np.random.default_rng(1)
    J, V, n = rng.normal(size=(6, 7)), rng.normal(size=6), 7
    solve = compiled_solver("arm", n, "double")
    limits = {"dq_max": np.full(n, 1.0), "ddq_max": np.full(n, 10.0), "dq_last": np.array([1.5, -1.5, 0, 0, 0, 0, 0.5])}
    for each in (solve, numpy_solver):
        dq, status = solved(each, arguments(J, V, **limits))
        assert status == LIMITS
        np.testing.assert_allclose(dq[:2], [1.49, -1.49])
        for fault in ({"damping": 0.0}, {"weight": np.array([1, 1, -1, 1, 1, 1])}, {"dq_ref": np.full(n, np.nan)}):
            dq, status = solved(each, arguments(J, V, **limits | fault))
            assert status == INVALID
            np.testing.assert_allclose(dq, [1.49, -1.49, 0, 0, 0, 0, 0.49])
        for name, odd in (
            *((name, np.nan) for name in ("q", "dq_last", "q_min", "q_max", "dq_max", "ddq_max")),
            *((name, np.inf) for name in ("q", "dq_last", "dq_ref")),
            *((name, -1.0) for name in ("dq_max", "ddq_max")),
            *(("q_max", -np.inf), ("q_min", np.inf), ("q_min", 1e3)),
        ):
            values = {
                "q": np.zeros(n),
                "q_min": np.full(n, -9.0),
                "q_max": np.full(n, 9.0),
                "dq_ref": np.zeros(n),
            } | limits
            values[name] = np.array(values[name])
            values[name][3] = odd
            given = arguments(J, V, **values)
            dq, status = solved(each, given)
            assert status == INVALID, (name, odd)
            np.testing.assert_allclose(dq, [1.49, -1.49, 0, 0, 0, 0, 0.49], err_msg=f"{name} {odd}")
        for period in (np.nan, np.inf, 0.0, -1e-3):
            dq, status = solved(each, arguments(J, V, **limits, Ts=period))
            assert status == INVALID
            assert np.all(dq == 0.0)
        # a joint near its limit comes no nearer than it can stop
        near = limits | {"q_max": np.full(n, 0.02), "dq_last": np.full(n, 0.62)}
        dq, status = solved(each, arguments(J, V, **near, weight=np.zeros(6), dq_ref=np.full(n, 5.0)))
        assert status == OK
        np.testing.assert_allclose(dq, 10 * (np.sqrt(Ts**2 + 2 * 0.02 / 10) - Ts))


def test_of_a_model():
    model = rrrgen.compile("rrr", backend="numpy")
    q = np.random.default_rng(2).uniform(-1, 1, (4, 3))
    J, V, position = model.jacobian(q), np.array([0.1, -0.05, 0.02, 0, 0, 0]), [1, 1, 1, 0, 0, 0]
    dq = model.differential_ik(q, np.zeros((4, 3)), J, V, weight=position, damping=1e-6, ddq_max=np.full(3, 1e4), Ts=Ts)
    np.testing.assert_allclose(np.einsum("kij,kj->ki", J, dq)[:, :3], np.tile(V[:3], (4, 1)), atol=1e-6)
    far = np.full(3, 50.0)
    with pytest.raises(np.linalg.LinAlgError, match="too fast for its limits; 1 of 4 states"):
        model.differential_ik(q, np.array([far, 0 * far, 0 * far, 0 * far]), J, V, ddq_max=np.ones(3), Ts=Ts)
    _, status = model.differential_ik(q[0], far, J[0], V, ddq_max=np.ones(3), Ts=Ts, with_status=True)
    assert status == LIMITS


DRIVER = """
#include "arm_differential_ik.h"
#include <stdlib.h>
#include <math.h>
typedef arm_differential_ik_real real;
static real any(void)
{
    const int kind = rand() % 12;
    return kind == 0 ? (real)INFINITY : kind == 1 ? (real)NAN : kind == 2 ? (real)0 : (real)rand() / (real)RAND_MAX;
}
int main(void)
{
    real all[120], dq[7];
    int i, k;
    for (k = 0; k < 20000; ++k) {
        for (i = 0; i < 120; ++i) all[i] = (real)(k % 2 ? 1 : -1) * any();
        (void)arm_differential_ik(all, all + 7, all + 14, all + 56, all + 62, all + 68, all[75], all + 76, all + 83,
            all + 90, all + 97, (real)1e-3, dq);
    }
    return 0;
}
"""


@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.sweep(but=["float"])
def test_the_code_is_strict_and_defined_for_all_inputs(tmp_path, real):
    for n in (1, 7):
        for name, text in differential_ik_files("arm", n, real).items():
            (tmp_path / name).write_text(text)
        cpp = ["-x", "c++", "-std=c++11"]
        parse = "-fsyntax-only"  # only gcc has warnings that need the optimizer
        for command in (
            ["gcc", "-std=c99", "-O2"],
            ["gcc", "-std=c99", "-Os"],
            ["clang", "-std=c99", parse],
            ["g++", *cpp, parse],
            ["clang++", *cpp, parse],
        ):
            line = [*command, *STRICT, "-c", "arm_differential_ik.c", "-o", "arm.o"]
            try:
                done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True, check=False)
            except FileNotFoundError:
                continue
            assert done.returncode == 0, done.stderr
    (tmp_path / "driver.c").write_text(DRIVER)
    sanitized = ["gcc", "-std=c99", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    built = subprocess.run(
        [*sanitized, "driver.c", "arm_differential_ik.c", "-o", "driver", "-lm"], cwd=tmp_path, check=False
    )
    assert built.returncode == 0
    assert subprocess.run([tmp_path / "driver"], check=False).returncode == 0
