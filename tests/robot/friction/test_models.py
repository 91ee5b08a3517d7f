"""Friction laws (14.11)-(14.14): formulas retyped, one definition in three arithmetics, LuGre stable and passive."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot.friction.examples import EXAMPLES, SPEEDS, model, retyped
from rrrgen.program import evaluate
from rrrgen.robot.friction.laws import LAWS
from rrrgen.robot.friction.models import FrictionModel
from rrrgen.robot.friction.programs import (
    friction_program,
    friction_step_program,
)


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


@pytest.mark.parametrize("name", list(LAWS))
def test_directed_torques_meet_the_law_and_enclose_rest(name: str) -> None:
    friction = model(name)
    speeds = [[2.0, 1.0], [-2.0, -1.0], [0.0, 0.0]]
    backward, forward = (friction.torque_in_direction(speeds, np.full(2, s)) for s in (-1.0, 1.0))
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


# -- data ----------------------------------------------------------------------------------------------------------


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
