"""Second derivatives on a floating base: differences of Pinocchio's first derivatives, CasADi, invariances."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import rrrgen
from derive.test_floating_base import LINK, TRUNK, draw, floating
from oracles.free_base import FreePinocchio
from rrrgen.derive import prepare, record
from rrrgen.derive.functions.floating_second_derivatives import weighted_gradient
from rrrgen.derive.functions.second_derivatives import upper_triangle_indices
from rrrgen.derive.functions.table import functions_for, get_function, with_sources
from rrrgen.derive.optimizer import Optimizer
from rrrgen.program import count_operations, evaluate
from rrrgen.robot.file import dumps, load_spec, loads_spec
from rrrgen.runtime.floating_base import FloatingState, integrate, rotation, to_pinocchio
from rrrgen.verify.report import STENCIL

HESSIAN, PRODUCT = "floating_inverse_dynamics_hessian", "floating_inverse_dynamics_hessian_product"

ROUND_OFF = 1e-13
"""Hundreds of roundings of 1e-16; measured 4e-16."""

DIFFERENCED = 1e-10
"""Round-off over the step of the differences, 1e-2, relative to the largest entry; measured 2e-13."""

STEP = 1e-2

SMALL = "random8 of 3"
"""A random tree with a branch of two revolute joints and one of a slide: in half the time of five joints."""

ONE_JOINT = f"""
schema: rrrgen/1
name: swing
convention: modified
units: {{angle: rad, length: m}}
gravity: [0.3, -1.2, -9.7]
{TRUNK}joints:
  - {{name: j1, type: revolute, parent: base, gamma: 0.3, b: 0.1, alpha: 0.5, a: 0.2, d: 0.1}}
links:
{LINK.format(1, 2)}"""


def spec_of(name: str):
    return loads_spec(ONE_JOINT) if name == "one joint" else floating(name)


@cache
def functions(name: str):
    """The optimized Hessian and its product, general and with the numbers of the file, and the base parameters."""
    wanted = with_sources([get_function(HESSIAN), get_function(PRODUCT)])
    derived = Optimizer()(record(prepare(spec_of(name)), wanted))
    return derived, np.array([float(v) for v in (*derived.beta_nominal, *(derived.drive_inertia_nominal or ()))])


def state(s: FloatingState) -> tuple[np.ndarray, ...]:
    return s.orientation, s.twist, s.twist_rate


def full(n: int, gradient, pose, velocity, acceleration, squares, status):
    """Gradient, and the symmetric Hessian of its blocks."""
    size = 6 + n
    H = np.zeros((3 * size, 3 * size))
    for first, of in ((upper_triangle_indices(3 + n), pose), (upper_triangle_indices(size), squares)):
        start = 3 if of is pose else size
        for (i, j), value in zip(first, of, strict=True):
            H[start + i, start + j] = H[start + j, start + i] = value
    H[size : 2 * size, 6:size], H[2 * size :, 6:size] = velocity, acceleration
    H[6:size, size:] = H[size:, 6:size].T
    assert status == 0
    return np.array(gradient), H


def hessian(name: str, s: FloatingState, weights: np.ndarray, end: str = ""):
    derived, beta = functions(name)
    last = () if end else (beta,)
    return full(len(s.q), *evaluate(derived.programs[HESSIAN + end], s.q, s.dq, s.ddq, weights, *state(s), *last))


def moved(s: FloatingState, step: np.ndarray) -> FloatingState:
    """The state after a step (3 (6 + n)) of translation and rotation of the base and q, and of what moves them."""
    x, v, a = np.split(step, 3)
    pose = integrate(s.position, s.orientation, x[:6])
    return FloatingState(*pose, s.twist + v[:6], s.twist_rate + a[:6], s.q + x[6:], s.dq + v[6:], s.ddq + a[6:])


def by_pinocchio(free: FreePinocchio, s: FloatingState, weights: np.ndarray) -> np.ndarray:
    """The gradient (3 (6 + n)) of the weighted wrench and torques from Pinocchio's first derivatives."""
    q, v, a = to_pinocchio(s)
    S, data = free.S, free.data
    by_q, by_v, M = free.pin.computeRNEADerivatives(free.model, data, free.rows(q), S @ v, S @ a)
    upper = np.triu(M)
    return np.concatenate([S.T @ D.T @ (S @ weights) for D in (by_q, by_v, upper + np.triu(upper, 1).T)])


def differences(gradient, s: FloatingState) -> np.ndarray:
    """Its derivatives along every coordinate, one column each: repeated derivatives by rotations."""
    columns = [
        sum(w * (gradient(moved(s, k * STEP * e)) - gradient(moved(s, -k * STEP * e))) for k, w in STENCIL) / STEP
        for e in np.eye(3 * (6 + len(s.q)))
    ]
    return np.stack(columns, axis=1)


def error(found, expected) -> float:
    return float(np.max(np.abs(found - expected)) / np.max(np.abs(expected)))


@pytest.mark.parametrize("name", ["one joint", SMALL, "random1", "tree", "quadruped"])
@pytest.mark.sweep(but=["one joint", SMALL])
def test_hessian_is_the_symmetric_part_of_differences_of_pinocchios_gradient(name):
    """Along the exponential map; repeated derivatives by two rotations differ by a third of the gradient's elements."""
    free = FreePinocchio(spec_of(name))
    n = free.chain.n
    for seed, end in ((1, ""), (2, "_nominal")):
        s, weights = draw(n, seed), np.random.default_rng(seed).uniform(-1, 1, 6 + n)
        gradient, H = hessian(name, s, weights, end)
        expected = by_pinocchio(free, s, weights)
        assert error(gradient, expected) < 10 * ROUND_OFF
        D = differences(lambda at, weights=weights: by_pinocchio(free, at, weights), s)
        assert error(H, (D + D.T) / 2) < DIFFERENCED
        apart, turns = (D - D.T) / 2, expected[3:6]
        x, y, z = turns / 2
        assert error(apart[3:6, 3:6], np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])) < 100 * DIFFERENCED
        apart[3:6, 3:6] = 0
        assert np.max(np.abs(apart)) < DIFFERENCED * np.max(np.abs(D))


@pytest.mark.parametrize("name", ["one joint", SMALL, "random1", "quadruped"])
@pytest.mark.sweep(but=["one joint", SMALL])
def test_the_product_is_that_with_the_hessian(name):
    n, (derived, beta) = spec_of(name).n, functions(name)
    rng, s = np.random.default_rng(3), draw(spec_of(name).n, 3)
    weights, direction = rng.uniform(-1, 1, 6 + n), rng.normal(size=3 * (6 + n))
    _, H = hessian(name, s, weights)
    for end, last in (("", (beta,)), ("_nominal", ())):
        inputs = (s.q, s.dq, s.ddq, weights, direction, *state(s), *last)
        product, status = evaluate(derived.programs[PRODUCT + end], *inputs)
        assert status == 0
        assert error(np.array(product), H @ direction) < ROUND_OFF


def test_casadi_finds_the_same_hessian_along_the_exponential_map():
    """In a formula of its own for the quaternion of a small rotation, exact to the second order."""
    ca = pytest.importorskip("casadi")
    model = rrrgen.compile(loads_spec(ONE_JOINT), backend="numpy")
    forces, n = model.casadi_function("floating_inverse_dynamics_nominal"), 1
    s, weights = draw(n, 5), np.random.default_rng(5).uniform(-1, 1, 6 + n)
    z = ca.SX.sym("z", 3 * (6 + n))
    x, v, a = ca.vertsplit(z, 6 + n)
    xi, u, w = x[3:6], ca.DM(s.orientation[:3]), s.orientation[3]
    small, real = xi / 2, 1 - ca.dot(xi, xi) / 8
    turned = ca.vertcat(w * small + real * u + ca.cross(u, small), w * real - ca.dot(u, small))
    moving = {"q": s.q + x[6:], "dq": s.dq + v[6:], "ddq": s.ddq + a[6:], "orientation": turned}
    found = forces(**moving, twist=s.twist + v[:6], twist_rate=s.twist_rate + a[:6])
    L = ca.dot(weights, ca.vertcat(found["wrench"], found["tau"]))
    H, g = (part.full() for part in ca.Function("h", [z], ca.hessian(L, z))(np.zeros(3 * (6 + n))))
    gradient, own = model.floating_inverse_dynamics_hessian(s.q, s.dq, s.ddq, weights, *state(s))
    assert error(gradient, g.ravel()) < ROUND_OFF
    assert error(own, H) < ROUND_OFF
    emitted = model.casadi_function(f"{HESSIAN}_nominal")
    packed_too = emitted(q=s.q, dq=s.dq, ddq=s.ddq, weights=weights, orientation=s.orientation, twist=s.twist,
                         twist_rate=s.twist_rate)  # fmt: skip
    assert error(packed_too["gradient"].full().ravel(), gradient) < ROUND_OFF


@pytest.mark.parametrize("name", [SMALL])
def test_translation_yaw_and_constant_velocity_change_nothing(name):
    n = spec_of(name).n
    s, weights = draw(n, 6), np.random.default_rng(6).uniform(-1, 1, 6 + n)
    gradient, H = hessian(name, s, weights)
    size, scale = 6 + n, np.max(np.abs(H))
    assert not gradient[:3].any()
    assert not H[:3].any()
    down = rotation(s.orientation).T @ [0.3, -1.2, -9.7]
    yaw, faster = np.zeros((2, 3 * size))
    yaw[3:6] = down / np.linalg.norm(down)
    faster[size : size + 3] = np.array([0.3, -0.5, 0.8])  # and the rates of its components in turning axes
    faster[2 * size : 2 * size + 3] = -np.cross(s.twist[3:], faster[size : size + 3])
    for direction in (yaw, faster):
        assert abs(gradient @ direction) < ROUND_OFF * scale
        assert abs(direction @ H @ direction) < ROUND_OFF * scale
    again = hessian(name, moved(s, 0.7 * yaw), weights)
    assert max(error(one, other) for one, other in zip(again, (gradient, H), strict=True)) < ROUND_OFF
    angle = rotation(moved(s, 0.7 * yaw).orientation) - rotation(s.orientation)
    assert np.max(np.abs(angle)) > 0.1


def test_operation_counts_of_the_quadruped():
    """A prototype took 8795 operations, 2749 of them for the gradient, with the numbers of the file."""
    derivation = prepare(floating("quadruped"))
    derived = Optimizer()(record(derivation, with_sources([get_function(HESSIAN)])))
    assert count_operations(derived.programs[HESSIAN]).total <= 6347
    assert count_operations(derived.programs[f"{HESSIAN}_nominal"]).total <= 5998
    recording, (forces,) = derivation.recording(), get_function(HESSIAN).of
    recording.function = get_function(HESSIAN)
    gradient = weighted_gradient(recording, derived.programs[f"{forces}_nominal"])
    assert count_operations(gradient).total <= 2593


@pytest.fixture(scope="module")
def model():
    return rrrgen.compile(loads_spec(ONE_JOINT), backend="numpy")


def test_what_is_missing_of_a_moving_base_is_named(model):
    state = [[0.1], [0.0], [0.0]]
    with pytest.raises(TypeError, match="floating_inverse_dynamics: twist, twist_rate must be given"):
        model.inverse_dynamics(*state, orientation=[0, 0, 0, 1])
    with pytest.raises(TypeError, match="floating_inverse_dynamics_hessian: twist must be given"):
        model.inverse_dynamics_hessian(*state, np.ones(7), orientation=[0, 0, 0, 1], twist_rate=np.zeros(6))


def test_methods_take_a_moving_base_by_keyword_parameters_and_gravity(model):
    n = model.n
    s, rng = draw(n, 7), np.random.default_rng(7)
    weights, direction = rng.uniform(-1, 1, 6 + n), rng.normal(size=3 * (6 + n))
    base = {"orientation": s.orientation, "twist": s.twist, "twist_rate": s.twist_rate}
    gradient, H = model.inverse_dynamics_hessian(s.q, s.dq, s.ddq, weights, **base)
    assert error(H, hessian("one joint", s, weights)[1]) < ROUND_OFF
    product = model.inverse_dynamics_hessian_product(s.q, s.dq, s.ddq, weights, direction, **base)
    assert error(product, H @ direction) < ROUND_OFF
    for given in ({"beta": model.beta}, {"gravity": [0.3, -1.2, -9.7]}):
        same = model.inverse_dynamics_hessian(s.q, s.dq, s.ddq, weights, **base, **given)
        assert max(error(one, other) for one, other in zip(same, (gradient, H), strict=True)) < ROUND_OFF
    at_rest = model.inverse_dynamics_hessian(s.q, s.dq, s.ddq, weights[6:])
    assert (at_rest.gradient.shape, at_rest.H.shape) == ((3,), (3, 3))


def test_zero_weights_give_zero_and_batches_what_single_states_give(model):
    states = [draw(model.n, seed) for seed in range(3)]
    arrays = [np.stack(parts) for parts in zip(*((s.q, s.dq, s.ddq, *state(s)) for s in states), strict=True)]
    weights = np.random.default_rng(1).uniform(-1, 1, (3, 6 + model.n))
    weights[1] = 0
    gradient, H = model.floating_inverse_dynamics_hessian(*arrays[:3], weights, *arrays[3:])
    assert H.shape == (3, 21, 21)
    assert not gradient[1].any()
    assert not H[1].any()
    s = states[2]
    one = model.floating_inverse_dynamics_hessian(s.q, s.dq, s.ddq, weights[2], *state(s))
    np.testing.assert_array_equal(H[2], one.H)


@pytest.mark.parametrize(("off", "expected"), [(9e-7, 0), (1.1e-6, 2), (-1.1e-6, 2), (np.nan, 2)])
def test_an_orientation_that_is_no_unit_quaternion_is_refused(model, off, expected):
    s, weights = draw(model.n, 5), np.ones(6 + model.n)
    base = (s.orientation * (1 + off), s.twist, s.twist_rate)
    direction = np.ones(3 * (6 + model.n))
    _, status = model.floating_inverse_dynamics_hessian(s.q, s.dq, s.ddq, weights, *base, with_status=True)
    assert status == expected
    _, status = model.floating_inverse_dynamics_hessian_product(
        s.q, s.dq, s.ddq, weights, direction, *base, with_status=True
    )
    assert status == expected
    if expected:
        with pytest.raises(ValueError, match="no unit quaternion"):
            model.inverse_dynamics_hessian(
                s.q, s.dq, s.ddq, weights, orientation=base[0], twist=s.twist, twist_rate=s.twist_rate
            )


def test_a_state_that_is_no_number_gives_none(model):
    s, weights = draw(model.n, 5), np.ones(6 + model.n)
    gradient, H = model.floating_inverse_dynamics_hessian(s.q * np.nan, s.dq, s.ddq, weights, *state(s))
    assert np.isnan(gradient).any()
    assert np.isnan(H).any()


def test_robots_without_a_floating_base_have_none_and_say_so():
    spec = load_spec("planar2r")
    assert not any("floating" in each.name for each in functions_for(spec, ("hessian",)))
    text = dumps(spec).replace("joints:\n", f"{TRUNK}joints:\n")
    assert {HESSIAN, PRODUCT} <= {each.name for each in functions_for(loads_spec(text), ("hessian",))}
    fixed, s = rrrgen.compile("planar2r", backend="numpy"), draw(2, 1)
    for ask in (
        lambda: fixed.floating_inverse_dynamics_hessian(s.q, s.dq, s.ddq, np.ones(8), *state(s)),
        lambda: fixed.floating_inverse_dynamics_hessian_product(s.q, s.dq, s.ddq, np.ones(8), np.ones(24), *state(s)),
        lambda: fixed.inverse_dynamics_hessian(s.q, s.dq, s.ddq, np.ones(8), twist=s.twist),
    ):
        with pytest.raises(ValueError, match="the robot has no floating base"):
            ask()
