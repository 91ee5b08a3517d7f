"""State-space forms of a difference equation: equal to it, precise with many slow poles, the same step in C."""

import mpmath
import numpy as np
import pytest
from numpy.polynomial.polynomial import polyadd

from rrrgen.base.errors import InputError
from rrrgen.emit.controller.filters import linear_step_program
from rrrgen.emit.controller.state_space import realize
from rrrgen.lab.response.response_model import ResponseModel
from samples.flexible_joint import PERIOD


def test_state_space_is_the_difference_equation():
    rng = np.random.default_rng(5)
    u = rng.standard_normal(300)
    for order in (1, 2, 5, 9):
        pairs = 0.97 * np.exp(1j * rng.uniform(0.05, 3.0, order // 2))
        poles = np.concatenate([pairs, pairs.conj(), [0.4] * (order % 2)])
        model = ResponseModel("", -np.poly(poles).real[1:], rng.standard_normal(order), 1, PERIOD)
        y = np.zeros(len(u))
        for k in range(len(u)):
            y[k] = sum(c * y[k - i] for i, c in enumerate(model.a, 1) if k >= i)
            y[k] += sum(c * u[k - 1 - j] for j, c in enumerate(model.b) if k >= 1 + j)
        found = model.state_space()
        assert np.abs(found.run(u) - y).max() < 1e-9 * np.abs(y).max()
        assert np.count_nonzero(found.A) <= 2 * len(found.B)
    double = realize(np.array([0.0, 0.5, 0.5]), np.array([1.0, -2.0, 1.0])).run(np.ones(1000))
    assert double[-1] == pytest.approx(0.5 * 999**2, rel=1e-9)
    with pytest.raises(InputError, match="needs a state"):
        linear_step_program([], PERIOD, "step", "nothing")


def test_many_slow_poles_keep_their_precision_in_state_space():
    """A free joint with a slow mode: a and b in double precision cannot hold its poles at 1 kHz, the fractions do."""
    modes = [(0.7, 0.4), (28.0, 0.1), (73.0, 0.015), (89.0, 0.03), (98.0, 0.2)]
    factors, numerators = [np.array([1.0, -2.0, 1.0])], [np.array([5e-7, 5e-7])]
    for f, damping in modes:
        omega = 2.0 * np.pi * f * 1e-3
        radius, angle = np.exp(-damping * omega), omega * np.sqrt(1.0 - damping**2)
        factors.append(np.array([1.0, -2.0 * radius * np.cos(angle), radius**2]))
        numerators.append(np.array([3e-7, 1e-7]))
    for delay in (0, 1, 3):
        whole = [np.zeros(1), np.ones(1)]
        for c, d in zip(numerators, factors, strict=True):
            whole = [polyadd(np.convolve(whole[0], d), np.convolve(c, whole[1])), np.convolve(whole[1], d)]
        fractions = tuple(zip(numerators, factors, strict=True))
        model = ResponseModel("modes", -whole[1][1:], whole[0], delay, 1e-3, fractions=fractions)
        states, f = model.state_space(), np.array([0.3, 0.5, 1.0, 30.0, 200.0])
        z = np.exp(2j * np.pi * f * 1e-3)
        found = [states.C @ np.linalg.solve(x * np.eye(len(states.B)) - states.A, states.B) + states.D for x in z]
        assert np.allclose(found, model.response(f), rtol=1e-7, atol=0.0)
        assert len(states.B) == 12 + max(delay - 1, 0)
        with mpmath.workdps(40):  # the error of a and b as they are, which the file tells
            w = mpmath.expjpi(-2 * mpmath.mpf(1) / 1000)
            top, bottom = (mpmath.polyval([mpmath.mpf(float(c)) for c in x[::-1]], w) for x in whole)
            told = abs(complex(top / bottom * w**delay) / model.response(np.array([1.0]))[0] - 1.0)
        assert told < 1.1 * model.rounding
        assert model.rounding < 10 * told
        assert model.to_json()["rounding"] == model.rounding
