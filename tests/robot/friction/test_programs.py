"""Friction as programs: equal to NumPy and CasADi, differentiable at rest."""

from __future__ import annotations

import numpy as np
import pytest

from robot.friction.examples import SPEEDS, model
from rrrgen.base.errors import InputError
from rrrgen.program import evaluate
from rrrgen.robot.friction.laws import LAWS
from rrrgen.robot.friction.programs import friction_program, friction_rate_program, friction_step_program

# The same operations in another order: a few units in the last place.
ROUND_OFF = 1e-14


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
    from rrrgen.emit.casadi.function import function

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
