"""Second derivatives of the dynamics against differences of the independent Newton-Euler, CasADi, and each other."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from oracles import newton_euler as oracle
from oracles.lagrange import STEP
from oracles.newton_euler import Robot
from oracles.random_robots import random_robot, random_state, to_yaml
from pipeline.optimized import bundled
from rrrgen.base.errors import DerivationError
from rrrgen.derive import derive, prepare
from rrrgen.derive.functions.second_derivatives import upper_triangle_indices
from rrrgen.derive.functions.table import combine, functions_for
from rrrgen.program import count_operations, evaluate
from rrrgen.robot.file import load_spec, loads_spec
from rrrgen.verify.report import STENCIL

DIFFERENCED = 1e-9
"""Round-off over the step of the differences, 2e-3, relative to the largest entry."""

ROUND_OFF = 1e-13
"""Hundreds of roundings of 1e-16; measured 2e-15."""


def random_arm(joints: int) -> Robot:
    return random_robot(70 + joints, n=joints, convention="modified" if joints % 2 else "standard")


@cache
def programs_of(joints: int):
    """The functions of both groups for a random arm, and its base parameters."""
    derived = derive(loads_spec(to_yaml(random_arm(joints))), groups=("hessian", "tensors"))
    return derived.programs, np.array([float(value) for value in derived.beta_nominal])


def full(n, gradient, first, velocity, third, second):
    """Gradient, and the symmetric Hessian of its blocks."""
    H = np.zeros((3 * n, 3 * n))
    for (i, j), q, v in zip(upper_triangle_indices(n), first, second, strict=True):
        H[i, j] = H[j, i] = q
        H[n + i, n + j] = H[n + j, n + i] = v
    H[n : 2 * n, :n], H[2 * n :, :n] = velocity, third
    H[:n, n:] = H[n:, :n].T
    return gradient, H


def differences(function, x, step=2e-3):
    """Gradient of a scalar ``function`` by the complex step, and its Hessian by differences of that."""

    def gradient(at):
        return np.array([function(at + 1j * STEP * e).imag / STEP for e in np.eye(len(x))])

    rows = [sum(w * (gradient(x + k * step * e) - gradient(x - k * step * e)) for k, w in STENCIL) / step
            for e in np.eye(len(x))]  # fmt: skip
    return gradient(x), np.array(rows)


def accelerations(robot, q, dq, tau):
    """The solution of M ddq = tau - h, by the columns of M, which may be complex."""
    bias = oracle.bias(robot, q, dq)
    return np.linalg.solve(oracle.mass_matrix(robot, q), tau - bias)


def errors(found, expected) -> list[float]:
    return [float(np.max(np.abs(a - b)) / np.max(np.abs(b))) for a, b in zip(found, expected, strict=True)]


@pytest.mark.parametrize("joints", [1, 2, 3])
@pytest.mark.sweep(but=["1", "2"])
def test_random_arms_against_differences(joints):
    """Prismatic joints, both conventions; general programs and those with the numbers of the file."""
    robot, (programs, beta) = random_arm(joints), programs_of(joints)
    rng = np.random.default_rng(joints)
    q, dq, ddq = random_state(robot, rng)
    weights, direction = rng.uniform(-1, 1, joints), rng.uniform(-1, 1, 3 * joints)
    tau = oracle.inverse_dynamics(robot, q, dq, ddq)
    inverse = differences(
        lambda x: weights @ oracle.inverse_dynamics(robot, *np.split(x, 3)), np.concatenate([q, dq, ddq])
    )
    forward = differences(lambda x: weights @ accelerations(robot, *np.split(x, 3)), np.concatenate([q, dq, tau]))
    for end, last in (("", (beta,)), ("_nominal", ())):
        found = full(joints, *evaluate(programs[f"inverse_dynamics_hessian{end}"], q, dq, ddq, weights, *last))
        assert max(errors(found, inverse)) < DIFFERENCED
        product = evaluate(programs[f"inverse_dynamics_hessian_product{end}"], q, dq, ddq, weights, direction, *last)
        assert max(errors(product, [found[1] @ direction])) < ROUND_OFF
        *blocks, status = evaluate(programs[f"forward_dynamics_hessian{end}"], q, dq, tau, weights, *last)
        assert status == 0
        assert max(errors(full(joints, *blocks), forward)) < 100 * DIFFERENCED  # inv(M) has large entries


@pytest.mark.parametrize("joints", [2, 3])
def test_weighted_tensors_are_the_hessian(joints):
    robot, (programs, beta) = random_arm(joints), programs_of(joints)
    rng = np.random.default_rng(joints)
    q, dq, ddq = random_state(robot, rng)
    weights, n = rng.uniform(-1, 1, joints), joints
    _, H = full(n, *evaluate(programs["inverse_dynamics_hessian"], q, dq, ddq, weights, beta))
    tensors = evaluate(programs["inverse_dynamics_second_derivatives"], q, dq, ddq, beta)
    blocks = [H[:n, :n], H[n : 2 * n, :n], H[n : 2 * n, n : 2 * n], H[2 * n :, :n]]
    scale = np.max(np.abs(H))
    for tensor, block in zip(tensors, blocks, strict=True):
        assert np.max(np.abs(np.einsum("i,ijk->jk", weights, tensor) - block)) < ROUND_OFF * scale
    (slopes,) = evaluate(programs["mass_matrix_derivatives"], q, beta)
    assert max(errors([tensors[3]], [slopes])) < ROUND_OFF


@cache
def hessian_of(name: str, end: str = ""):
    """The Hessian of a bundled robot, from its optimized inverse dynamics."""
    torques = bundled(name).programs[f"inverse_dynamics{end}"]
    return combine("inverse_dynamics_hessian", prepare(load_spec(name)).recording(), [torques])


@pytest.mark.parametrize("name", ["rrr", "puma560"])
def test_hessian_is_that_which_casadi_finds_for_another_newton_euler(name):
    """A hand-written recursion in frames of its own, differentiated twice by CasADi."""
    ca = pytest.importorskip("casadi")
    from bench.contenders.cases import dense_bodies
    from bench.contenders.hand_casadi import HandArm
    from bench.contenders.joint_frames import joint_frames, regrouped
    from rrrgen.verify.references.numeric_robot import chain_of

    chain, n, model = chain_of(load_spec(name)), load_spec(name).n, bundled(name)
    phi = dense_bodies(np.random.default_rng(0), n)
    beta = np.zeros(model.beta_size)  # no drive inertias
    beta[: model.b] = np.array(model.base_projection, dtype=float) @ phi.ravel()
    frames = joint_frames(chain, phi)
    arm = HandArm(frames, regrouped(frames))
    x, w = ca.SX.sym("x", 3 * n), ca.SX.sym("w", n)
    tau = ca.vertcat(*arm.inverse_dynamics(*ca.vertsplit(x, n)))
    H, g = ca.hessian(ca.dot(w, tau), x)
    rng = np.random.default_rng(1)
    at, weights = rng.uniform(-1, 1, 3 * n), rng.uniform(-1, 1, n)
    expected = [part.full() for part in ca.Function("h", [x, w], [g, H])(at, weights)]
    q, dq, ddq = np.split(at, 3)
    found = full(n, *evaluate(hessian_of(name), q, dq, ddq, weights, beta))
    assert max(errors(found, [expected[0].ravel(), expected[1]])) < ROUND_OFF


@pytest.mark.parametrize(("name", "general", "nominal"), [("rrr", 292, 310), ("puma560", 3485, 2099)])
def test_operation_counts(name, general, nominal):
    """Prototypes took 284 and 310 operations for the RRR, 3384 and 2038 for the Puma; three per cent more at most."""
    assert count_operations(hessian_of(name)).total <= general
    assert count_operations(hessian_of(name, "_nominal")).total <= nominal


def test_an_indefinite_mass_matrix_is_reported():
    programs, beta = programs_of(2)
    q, dq, tau, weights = np.random.default_rng(3).uniform(-1, 1, (4, 2))
    *values, status = evaluate(programs["forward_dynamics_hessian"], q, dq, tau, weights, -beta)
    assert status == 1
    assert all(np.all(value == 0) for value in values)


def test_tensors_of_long_arms_are_refused_with_the_reason():
    spec = load_spec("panda")
    assert len(functions_for(spec, ("tensors",))) == 1
    joint = "  - {type: revolute, alpha: 0, a: 1, d: 0, theta: 0}\n"
    head = (
        "schema: rrrgen/1\nname: nine\nconvention: standard\nunits: {angle: deg, length: m}\ngravity: [0, 0, -9.81]\n"
    )
    text = f"{head}joints:\n{joint * 9}"
    with pytest.raises(DerivationError, match=r"tensors of nine, 9 joints: .*at most eight.*inverse_dynamics_hessian"):
        functions_for(loads_spec(text), ("tensors",))
