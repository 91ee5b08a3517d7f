"""Friction laws (14.11)-(14.14): formulas retyped, one definition in three arithmetics, LuGre stable and passive."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rrrgen.base.errors import InputError
from rrrgen.program import evaluate
from rrrgen.robot.friction.laws import LAWS, neural_law
from rrrgen.robot.friction.models import NUMPY, FrictionModel, coulomb_viscous
from rrrgen.robot.friction.programs import (
    friction_columns_program,
    friction_program,
    friction_rate_program,
    friction_step_program,
)

# The same operations in another order: a few units in the last place.
ROUND_OFF = 1e-14

SPEEDS = np.concatenate([[0.0], np.linspace(-6, 6, 41), [1e-9, -1e-9, 300.0]])
EXAMPLES = {
    "coulomb_viscous": [[0.4, 1.5, 0.2], [0.1, 0.5, -0.1]],
    "asymmetric": [[0.4, 0.5, 1.5, 1.2], [0.1, 0.2, 0.5, 0.6]],
    "exponential": [[-0.3, 1.5, 0.4, 0.1], [0.3, 0.5, 0.2, 0.05]],
    "asymmetric_exponential": [[0.4, 0.5, 1.5, 1.2, -0.4, 0.1], [0.1, 0.2, 0.5, 0.6, 0.3, 0.05]],
    "dahl": [[1.5, 0.4, 1e-4], [0.5, 0.2, 3e-5]],
    "dahl_exponential": [[-0.3, 1.5, 0.4, -0.02, 0.1, 1e-4], [0.3, 0.5, 0.2, 0.01, 0.05, 3e-5]],
    "load_dependent": [[1.5, 0.4, 0.06], [0.5, 0.2, 0.02]],
    "dahl_load_dependent": [[-0.3, 1.5, 0.4, -0.02, 0.06, 0.1, 1e-4], [0.3, 0.5, 0.2, 0.01, 0.02, 0.05, 3e-5]],
    "stribeck": [[0.7, 1.5, 0.4, 0.1], [0.3, 0.5, 0.2, 0.05]],
    "lugre": [[1e4, 3.0, 0.7, 1.5, 1.6, 0.1], [3e3, 1.0, 0.3, 0.5, 0.8, 0.05]],
    "logistic": [[1.1, 9.0, 0.02], [0.6, 40.0, -0.03]],
    "neural": [[1.0, 0.5, -0.2, 30.0, 4.0, 200.0, 0.3], [0.3, 0.2, 0.1, 60.0, 8.0, 1.0, 0.1]],
}


def model(name: str) -> FrictionModel:
    return FrictionModel(LAWS[name], np.array(EXAMPLES[name]))


def retyped(name: str, v: float, p: list[float], load: float = 0.0) -> float:
    """The printed formulas, one joint, one speed."""
    sign = 0.0 if v == 0 else (1.0 if v > 0 else -1.0)
    if name == "coulomb_viscous":
        return p[0] * v + p[1] * sign + p[2]
    if name == "asymmetric":
        return 0.0 if v == 0 else (p[0] * v + p[2] if v > 0 else p[1] * v - p[3])
    if name == "asymmetric_exponential":
        return retyped("asymmetric", v, p) + p[4] * np.exp(-abs(v) / p[5]) * sign
    if name == "exponential":
        return (p[0] * np.exp(-abs(v) / p[3]) + p[1]) * sign + p[2] * v
    if name == "dahl":
        return p[0] * sign + p[1] * v
    if name == "dahl_exponential":
        return (p[0] * np.exp(-abs(v) / p[4]) + p[1]) * sign + p[2] * v + p[3] * v * abs(v)
    if name == "load_dependent":
        return (p[0] + p[2] * abs(load)) * sign + p[1] * v
    if name == "dahl_load_dependent":
        level = p[0] * np.exp(-abs(v) / p[5]) + p[1] + p[4] * abs(load)
        return level * sign + p[2] * v + p[3] * v * abs(v)
    if name in ("stribeck", "lugre"):
        a0, a1, a2, vs = p[-4:]
        return (a0 * np.exp(-((v / vs) ** 2)) + a1) * sign + a2 * v
    with np.errstate(over="ignore"):  # the printed forms overflow, which is why the code uses tanh
        if name == "logistic":
            return p[0] / (1 + np.exp(-p[1] * (v + p[2]))) - p[0] / (1 + np.exp(-p[1] * p[2]))
        return sum(f * (1 - 2 / (np.exp(2 * w * v) + 1)) for f, w in zip(p[:3], p[3:6], strict=True)) + p[6] * v


@pytest.mark.parametrize("name", list(LAWS))
def test_laws_equal_the_printed_formulas(name: str) -> None:
    friction = model(name)
    loads = 30.0 * np.cos(np.arange(2 * len(SPEEDS))).reshape(-1, 2)
    speeds = np.column_stack([SPEEDS, SPEEDS[::-1]])
    got = friction.torque(speeds, load=loads)
    expected = np.array(
        [
            [retyped(name, v, p, load) for v, p, load in zip(*row, strict=True)]
            for row in zip(speeds, [EXAMPLES[name]] * len(SPEEDS), loads, strict=True)
        ]
    )
    assert np.abs(got - expected).max() <= 1e-12 * np.abs(expected).max()
    assert np.all(np.isfinite(got))


@pytest.mark.parametrize("name", list(LAWS))
def test_program_numpy_and_casadi_agree(name: str) -> None:
    friction = model(name)
    speeds = np.column_stack([SPEEDS, -0.7 * SPEEDS])
    program = friction_program(friction.law, 2)
    loads = 30.0 * np.cos(np.arange(2 * len(SPEEDS))).reshape(-1, 2) if friction.has_load else np.zeros_like(speeds)
    parameters = np.broadcast_to(friction.parameters, (len(SPEEDS), *friction.parameters.shape))
    (tau,) = evaluate(program, speeds, parameters, *([loads] if friction.has_load else []))
    scale = np.abs(friction.torque(speeds, load=loads)).max()
    assert np.abs(tau - friction.torque(speeds, load=loads)).max() <= ROUND_OFF * scale
    pytest.importorskip("casadi", reason="CasADi is an optional extra")
    from rrrgen.emit.casadi import function

    exact = function(program)
    smooth = function(program, name="smooth", smooth_sign=0.05)
    for dq, load in zip(speeds, loads, strict=True):
        given = (dq, friction.parameters, *([load] if friction.has_load else []))
        assert np.abs(exact(*given).full().ravel() - friction.torque(dq, load=load)).max() <= ROUND_OFF * scale
        expected = friction.torque(dq, width=0.05, load=load)
        assert np.abs(smooth(*given).full().ravel() - expected).max() <= 1e-13 * scale


@pytest.mark.parametrize("name", [n for n, law in LAWS.items() if n != "neural"])
def test_smooth_surrogate_converges_and_is_differentiable_at_rest(name: str) -> None:
    friction = model(name)
    far = np.array([[0.5, -0.5], [-2.0, 3.0]])
    assert np.abs(friction.torque(far, width=0.01) - friction.torque(far)).max() < 1e-9
    h = 1e-7
    slope = (friction.torque([h, h], width=0.01) - friction.torque([-h, -h], width=0.01)) / (2 * h)
    nearer = (friction.torque([h / 8, h / 8], width=0.01) - friction.torque([-h / 8, -h / 8], width=0.01)) / (h / 4)
    assert np.allclose(slope, nearer, rtol=1e-5)


@pytest.mark.parametrize("name", ["coulomb_viscous", "asymmetric"])
def test_linear_laws_are_columns_times_parameters(name: str) -> None:
    friction = model(name)
    speeds = np.column_stack([SPEEDS, 0.3 - SPEEDS])
    Y = friction.columns(speeds)
    assert Y.shape == (len(SPEEDS), 2, 2 * friction.parameters.shape[1])
    assert np.abs(Y @ friction.parameters.ravel() - friction.torque(speeds)).max() <= 1e-13 * 300
    program = friction_columns_program(friction.law, 2)
    (recorded,) = evaluate(program, speeds)
    assert np.array_equal(recorded, Y)
    assert len(friction.names) == Y.shape[-1]
    assert np.all(Y[:, 0, friction.parameters.shape[1] :] == 0.0)


@pytest.mark.parametrize("name", list(LAWS))
def test_separable_laws_are_factors_times_linear_parameters(name: str) -> None:
    law, p = LAWS[name], EXAMPLES[name][0]
    linear, shapes = law.split(p)
    assert law.joined(linear, shapes) == pytest.approx(tuple(p), rel=1e-14)
    factors = law.factors(NUMPY, SPEEDS, np.sign(SPEEDS), shapes)
    if law.has_load:  # the factor of a load is left to the caller
        assert law.linear[-1].name == "load_ratio"
        linear = linear[:-1]
    got = sum(factor * value for factor, value in zip(factors, linear, strict=True)) + 0.0 * SPEEDS
    assert got == pytest.approx([retyped(name, v, p) for v in SPEEDS], rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("name", ["dahl", "dahl_exponential", "dahl_load_dependent"])
def test_presliding_builds_up_over_its_distance(name: str) -> None:
    """After a reversal at constant speed the torque relaxes with exp(-travel / presliding), whatever the period."""
    friction = model(name)
    p = dict(zip((each.name for each in friction.law.parameters), friction.parameters[0], strict=True))
    dq, z = np.array([0.02, 0.02]), -np.array([p["presliding"]] * 2)
    for steps in (1, 7):
        at = z.copy()
        for _ in range(steps):
            at, tau = friction.step(at, dq, 4e-3 / steps)
        share = 1.0 - 2.0 * np.exp(-0.02 * 4e-3 / p["presliding"])
        assert at[0] / p["presliding"] == pytest.approx(share, rel=1e-12)
        sliding = retyped(name, 0.02, EXAMPLES[name][0])
        level = sliding - p["viscous"] * 0.02 - p.get("quadratic", 0.0) * 0.02**2
        assert tau[0] == pytest.approx(level * share + sliding - level, rel=1e-12)
    h = 1e-9
    assert friction.rate(z, dq) == pytest.approx((friction.step(z, dq, h)[0] - z) / h, rel=1e-4)


@pytest.mark.parametrize("name", [name for name, law in LAWS.items() if law.columns is None])
def test_nonlinear_laws_have_no_columns(name: str) -> None:
    with pytest.raises(InputError, match="not linear"):
        model(name).columns([0.0, 0.0])
    with pytest.raises(InputError, match="not linear"):
        friction_columns_program(LAWS[name], 2)


@pytest.mark.parametrize("name", list(LAWS))
def test_directed_torques_meet_the_law_and_enclose_rest(name: str) -> None:
    friction = model(name)
    speeds = [[2.0, 1.0], [-2.0, -1.0], [0.0, 0.0]]
    backward, forward = (friction.directed(speeds, np.full(2, s)) for s in (-1.0, 1.0))
    assert np.allclose(forward[0], friction.torque([2.0, 1.0]), rtol=1e-12)
    assert np.allclose(backward[1], friction.torque([-2.0, -1.0]), rtol=1e-12)
    assert np.all(backward[2] <= friction.torque([0.0, 0.0]))
    assert np.all(friction.torque([0.0, 0.0]) <= forward[2])


# -- LuGre ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shift", [0.0, 0.4, -0.4])
def test_the_logistic_law_brakes_either_way_and_is_odd_only_without_a_shift(shift: float) -> None:
    friction = FrictionModel(LAWS["logistic"], np.array([[1.2, 10.0, shift]]))
    speeds = np.concatenate([-np.geomspace(1e-9, 50, 60), [0.0], np.geomspace(1e-9, 50, 60)])[:, None]
    tau = friction.torque(speeds)
    assert np.all(tau * speeds >= 0.0)
    assert np.all((tau * speeds > 0.0) == (speeds != 0.0))
    odd = np.abs(tau + friction.torque(-speeds)).max()
    assert odd == 0.0 if shift == 0.0 else odd > 0.1
    assert tau.max() - tau.min() == pytest.approx(1.2, rel=1e-12)  # the span
    assert friction.passivity_margin().tolist() == [0.0]


def test_lugre_slides_onto_the_stribeck_curve() -> None:
    lugre, dq = model("lugre"), np.array([0.3, -0.8])
    z = np.zeros(2)
    for _ in range(2000):
        z, tau = lugre.step(z, dq, 1e-3)
    assert np.allclose(tau, lugre.torque(dq), rtol=1e-12)
    assert np.abs(lugre.rate(z, dq)).max() < 1e-12


def test_lugre_step_equals_a_tight_integration() -> None:
    """Constant speed over one period: the exact solution, against small Runge-Kutta steps."""
    lugre, dq, Ts = model("lugre"), np.array([0.05, -0.3]), 1e-3
    z0 = np.array([2e-5, 1e-4])
    got, tau = lugre.step(z0, dq, Ts)
    z, h = z0.copy(), Ts / 2000
    for _ in range(2000):
        k1 = lugre.rate(z, dq)
        k2 = lugre.rate(z + 0.5 * h * k1, dq)
        k3 = lugre.rate(z + 0.5 * h * k2, dq)
        k4 = lugre.rate(z + h * k3, dq)
        z = z + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    assert np.abs(got - z).max() <= 1e-12 * np.abs(z).max()
    p = lugre.parameters.T
    assert np.allclose(tau, p[0] * z + p[1] * (z - z0) / Ts + p[4] * dq, rtol=1e-9)


@given(
    st.floats(-50, 50),
    st.floats(1e-5, 10),
    st.lists(st.floats(-30, 30), min_size=5, max_size=30),
)
def test_lugre_step_is_bounded_for_every_period(z_relative: float, period: float, speeds: list[float]) -> None:
    """|z| never grows beyond the largest of its start and gamma/sigma0, at periods where explicit Euler diverges."""
    friction = FrictionModel(LAWS["lugre"], np.array([[1e4, 3.0, 0.7, 1.5, 1.6, 0.1]]))
    largest = max(abs(z_relative) * 1e-4, (0.7 + 1.5) / 1e4)
    z = np.array([z_relative * 1e-4])
    for v in speeds:
        z, tau = friction.step(z, np.array([v]), period)
        assert abs(z[0]) <= largest * (1 + 1e-12)
        assert np.isfinite(tau[0])


def test_explicit_euler_diverges_where_the_step_does_not() -> None:
    """The trap: at sigma0 = 1e4, 1 rad/s and gamma = 1 Euler needs Ts < 0.2 ms."""
    friction = FrictionModel(LAWS["lugre"], np.array([[1e4, 0.0, 0.0, 1.0, 0.0, 0.1]]))
    euler = exact = np.zeros(1)
    for _ in range(40):
        euler = euler + 1e-3 * friction.rate(euler, np.ones(1))
        exact, tau = friction.step(exact, np.ones(1), 1e-3)
    assert abs(euler[0]) > 1e3
    assert tau[0] == pytest.approx(1.0, rel=1e-12)


def test_small_steps_lose_no_digits() -> None:
    friction = model("lugre")
    z, _ = friction.step(np.zeros(2), np.array([1e-13, -1e-13]), 1e-3)
    assert np.allclose(z, [1e-16, -1e-16], rtol=1e-9)
    z, tau = friction.step(np.array([1e-5, 0.0]), np.zeros(2), 1e-3)
    assert z[0] == 1e-5
    assert tau[0] == pytest.approx(0.1)


def dissipation_can_be_negative(friction: FrictionModel) -> bool:
    """Whether supply minus storage rate gets negative somewhere on a grid of states the bristles can reach."""
    sigma0, _, a0, a1, _, _ = friction.parameters[0]
    dq = np.concatenate([np.geomspace(1e-6, 100, 400), -np.geomspace(1e-6, 100, 400)])[:, None]
    z = np.linspace(-1, 1, 201)[None, :] * (a0 + a1) / sigma0
    rate = friction.rate(z[..., None], dq[..., None])[..., 0]
    tau = friction.state_torque(z[..., None], dq[..., None])[..., 0]
    return bool(np.min(tau * dq - sigma0 * z * rate) < -1e-12)


@pytest.mark.parametrize(("factor", "passive"), [(1.001, True), (0.95, False)])
def test_passivity_margin_tells_the_sign_of_dissipation(factor: float, passive: bool) -> None:
    a0, a1, sigma1 = 0.7, 1.5, 3.0
    friction = FrictionModel(LAWS["lugre"], np.array([[1e4, sigma1, a0, a1, factor * sigma1 * a0 / a1, 0.1]]))
    assert bool(friction.passivity_margin()[0] >= 0) is passive
    assert dissipation_can_be_negative(friction) is not passive


def test_lugre_programs_equal_the_numpy_reference() -> None:
    lugre = model("lugre")
    rng = np.random.default_rng(0)
    dq, z = rng.normal(size=(50, 2)), 1e-4 * rng.normal(size=(50, 2))
    p = np.broadcast_to(lugre.parameters, (50, 2, 6))
    rate, tau = evaluate(friction_rate_program(lugre.law, 2), dq, z, p)
    assert np.allclose(rate, lugre.rate(z, dq), rtol=1e-12, atol=1e-13)
    assert np.allclose(tau, lugre.state_torque(z, dq), rtol=1e-12, atol=1e-12)
    following, tau, _ = evaluate(friction_step_program(lugre.law, 2), dq, z, p, np.full(50, 1e-3))
    expected, expected_tau = lugre.step(z, dq, 1e-3)
    assert np.allclose(following, expected, rtol=1e-12, atol=1e-18)
    assert np.allclose(tau, expected_tau, rtol=1e-12, atol=1e-12)
    for record in (friction_rate_program, friction_step_program):
        with pytest.raises(InputError):
            record(LAWS["stribeck"], 2)


# -- data ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", list(LAWS))
def test_mapping_round_trip(name: str) -> None:
    friction = model(name)
    again = FrictionModel.from_mapping(friction.to_json())
    assert again.law.name == name
    assert np.array_equal(again.parameters, friction.parameters)


def test_more_neural_units() -> None:
    friction = FrictionModel(neural_law(5), np.arange(1.0, 12.0)[None, :])
    assert FrictionModel.from_mapping(friction.to_json()).parameters.shape == (1, 11)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"law": "stribek"}, "not one of"),
        ({"law": "stribeck", "joints": [{"coulomb": 1.0}]}, "stribeck_speed"),
        ({"law": "coulomb_viscous", "joints": [{"coulom": 1.0}]}, "unknown 'coulom'"),
        ({"law": "coulomb_viscous", "joints": []}, "one mapping per joint"),
        ({"law": "stribeck", "joints": [{"coulomb": 1.0, "stribeck_speed": -1.0}]}, "must be positive"),
    ],
)
def test_faults_are_named(data: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        FrictionModel.from_mapping(data)


def test_coulomb_viscous_shorthand() -> None:
    friction = coulomb_viscous([0.1, 0.2], [1.0, 2.0])
    assert np.allclose(friction.torque([2.0, -2.0]), [1.2, -2.4])
    assert friction.passivity_margin().tolist() == [0.0, 0.0]


@pytest.mark.parametrize("name", list(LAWS))
def test_friction_at_joints_and_coupled_motors(name: str) -> None:
    """A surface with the direction w slides at w dq and loads the joints with w' f; power is kept."""
    friction = model(name)
    surfaces = {"joint roll": (0, 1), "right": (Fraction(-32, 3), 32)}
    W = np.array([[0.0, 1.0], [-32 / 3, 32.0]])
    dq = np.column_stack([SPEEDS, -0.7 * SPEEDS]) / 40
    given = np.broadcast_to(friction.parameters, (len(dq), *friction.parameters.shape))
    load = 30.0 * np.cos(np.arange(2 * len(dq))).reshape(-1, 2)
    loads = [load] if friction.has_load else []
    (tau,) = evaluate(friction_program(friction.law, 2, surfaces), dq, given, *loads)
    expected = friction.torque(dq @ W.T, load=load) @ W
    np.testing.assert_allclose(tau, expected, atol=1e-12 * np.abs(expected).max())
    if friction.law.step is not None:
        z, period = np.full((len(dq), 2), 1e-5), np.full(len(dq), 1e-3)
        following, tau, _ = evaluate(friction_step_program(friction.law, 2, surfaces), dq, z, given, *loads, period)
        after, torque = friction.step(z, dq @ W.T, 1e-3, load)
        np.testing.assert_allclose(following, after, rtol=1e-12)
        np.testing.assert_allclose(tau, torque @ W, atol=1e-12 * np.abs(tau).max())
