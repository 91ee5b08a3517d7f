"""Resonances of difference equations: what noise alone explains is not reported, and what noise biases says so."""

import numpy as np
import pytest

from rrrgen.base.errors import DerivationError
from rrrgen.lab.response.difference_models import arx, fit_difference_model
from rrrgen.lab.response.frequency_response import FrequencyResponse
from rrrgen.lab.response.local_polynomial import unknown_variances
from rrrgen.lab.response.modal_fit import fit_modes
from rrrgen.lab.response.resonances import check_resonances
from rrrgen.lab.response.response_file import ResponseRecording
from rrrgen.lab.response.response_model import Resonance, resonance
from samples.flexible_joint import flexible_joint

PERIOD = 2e-3
MODES = ((31.0, 0.02, 1.0), (70.0, 0.008, 0.7))  # Hz, damping ratio, share


def held_arm(u, modes=MODES):
    """Response of a sum of sampled modes to the input ``u``, each by the recursion of its pair of poles."""
    total = np.zeros(len(u))
    for frequency, damping, share in modes:
        w = 2 * np.pi * frequency * PERIOD
        radius, angle = np.exp(-damping * w), w * np.sqrt(1 - damping**2)
        y = np.zeros(len(u))
        for k in range(2, len(u)):
            y[k] = 2 * radius * np.cos(angle) * y[k - 1] - radius**2 * y[k - 2] + share * w * np.sin(w) * u[k - 1]
        total += y
    return total


@pytest.fixture(scope="module")
def recorded():
    """Input, and output with 5 % of white noise."""
    rng = np.random.default_rng(41)
    u = rng.standard_normal(2000)
    y = held_arm(u)
    return u, y + 0.05 * y.std() * rng.standard_normal(len(y))


def assert_right(found):
    """What is reported as certain is a mode of the arm, with its frequency to .5 % and its damping to 10 %."""
    for mode in found:
        frequency, damping, _ = min(MODES, key=lambda each: abs(each[0] - mode.frequency))
        if "frequency" not in mode.uncertain:
            assert mode.frequency == pytest.approx(frequency, rel=5e-3)
        if "damping" not in mode.uncertain:
            assert mode.damping == pytest.approx(damping, rel=0.1)


@pytest.mark.parametrize("order", [6, 12, 20])
def test_least_squares_of_noisy_rows_are_told_apart(recorded, order):
    """The poles that model the noise are left out; those that it biases are uncertain, or right at a high order."""
    u, y = recorded
    equation = arx(u, y, 0, len(u), order, 1)
    pairs = np.roots(np.concatenate([[1.0], -equation.a]))
    assert np.count_nonzero(pairs.imag > 0) >= order // 2 - 1  # far more than the two modes
    found = check_resonances(equation.a, 1, u, y, PERIOD)
    assert_right(found)
    assert len(found) <= 3
    assert [round(mode.frequency) for mode in found if not mode.uncertain] in ([], [31], [70], [31, 70])


def test_the_poles_of_the_arm_itself_are_certain(recorded):
    u, y = recorded
    denominator = np.ones(1)
    for frequency, damping, _ in MODES:
        p = np.exp(2 * np.pi * frequency * PERIOD * (-damping + 1j * np.sqrt(1 - damping**2)))
        denominator = np.convolve(denominator, [1.0, -2.0 * p.real, abs(p) ** 2])
    noise_pair = np.convolve(denominator, [1.0, -2 * 0.99 * np.cos(2.0), 0.99**2])
    for a in (-denominator[1:], -noise_pair[1:]):
        found = check_resonances(a, 1, u, y, PERIOD)
        assert [mode.frequency for mode in found] == pytest.approx([31.0, 70.0], rel=1e-6)
        assert [mode.uncertain for mode in found] == [(), ()]
        assert all(mode.damping_std < 0.03 * mode.damping for mode in found)


@pytest.mark.parametrize("late", [0, 2, 3])
def test_an_input_later_than_in_the_model_biases_nothing(late):
    """In disturbances that go through the modes, where every share of the response counts."""
    rng = np.random.default_rng(46)
    u, disturbance = rng.standard_normal((2, 2000)) * [[1.0], [0.07]]
    y = held_arm(np.concatenate([np.zeros(late), u[: len(u) - late]]) + disturbance)
    poles = [np.exp(2 * np.pi * f * PERIOD * (-d + 1j * np.sqrt(1 - d**2))) for f, d, _ in MODES]
    found = check_resonances(-np.poly([*poles, *np.conj(poles), 0.4]).real[1:], 1, u, y, PERIOD)
    assert [mode.uncertain for mode in found] == [(), ()]
    wrong = [np.exp(2 * np.pi * f * PERIOD * (-0.8 * d + 1j * np.sqrt(1 - d**2))) for f, d, _ in MODES]
    found = check_resonances(-np.poly([*wrong, *np.conj(wrong), 0.4]).real[1:], 1, u, y, PERIOD)
    assert [mode.uncertain for mode in found] == [("damping",), ("damping",)]


def test_a_damping_that_the_rows_contradict_is_uncertain(recorded):
    """By a fifth too large; the deviation then is the distance from the damping that explains the rows best."""
    u, y = recorded
    poles = [np.exp(2 * np.pi * f * PERIOD * (-d + 1j * np.sqrt(1 - d**2))) for f, d in ((31.0, 0.024), (70.0, 0.008))]
    first, second = check_resonances(-np.poly([*poles, *np.conj(poles)]).real[1:], 1, u, y, PERIOD)
    assert first.uncertain == ("damping",)
    assert first.damping_std == pytest.approx(0.004, rel=0.2)
    assert second.uncertain == ()


def test_unstable_pairs_are_no_resonances_and_unknown_deviations_are_uncertain(recorded):
    u, y = recorded
    a = -np.poly([1.001 * np.exp(0.4j), 1.001 * np.exp(-0.4j), 0.99 * np.exp(0.3j), 0.99 * np.exp(-0.3j)]).real[1:]
    assert all(mode.damping > 0 for mode in check_resonances(a, 0, u, y, PERIOD))
    (short,) = check_resonances(a, 0, u[:50], y[:50], PERIOD)
    assert short.uncertain == ("frequency", "damping")
    assert Resonance(10.0, 0.1, np.nan, 0.001).uncertain == ("frequency",)


def test_a_model_that_predicts_nothing_is_refused(recorded):
    """An output that does not follow the input: each order fits noise, and none does so on the rows left out."""
    u, _ = recorded
    record = ResponseRecording("noise", PERIOD, u, u, np.random.default_rng(43).standard_normal(len(u)))
    with pytest.raises(DerivationError, match=r"noise: .* predicts the rows 1001:1333 better than their mean"):
        fit_difference_model(record, None, "arx")


def test_what_the_errors_do_not_depend_on_is_not_known():
    """A pseudo-inverse gave it the variance 0: a damping of 1e-9 was certain to a billionth."""
    J = np.random.default_rng(44).standard_normal((50, 3))
    assert np.allclose(unknown_variances(J, 2.0), np.diag(2.0 * np.linalg.inv(J.T @ J)))
    assert unknown_variances(J * [1.0, 1e-15, 1.0], 1.0)[1] > 1e6
    twins = np.column_stack([J, J[:, 0]])
    assert np.all(unknown_variances(twins, 1.0)[[0, 3]] > 1e6)
    assert resonance(30.0, 0.01, 1e-3, np.sqrt(1e6)).uncertain == ("damping",)


def test_a_resonance_narrower_than_the_lines_has_an_unknown_damping():
    """Between two lines 4/3 Hz apart: whatever damping is found, it is not certain."""
    frequency = 4.0 / 3.0 * np.arange(3, 75)
    rng, joint = np.random.default_rng(45), flexible_joint(((32.67, 1e-6, 0.3), (70.0, 0.02, 0.5)))
    P = joint.response(frequency)
    noise = 0.01 * np.abs(P) * (rng.standard_normal((4, 72, 2)) @ [1.0, 1j]) / np.sqrt(2.0)
    for each in noise:
        response = FrequencyResponse(
            "lines", "", frequency, P + each, (0.01 * np.abs(P)) ** 2, np.full(72, 0.02), np.ones(72), 1e-3
        )
        near = [mode for mode in fit_modes(response).resonances if abs(mode.frequency - 32.67) < 1.0]
        assert len(near) == 1
        assert near[0].uncertain[-1:] == ("damping",)


def test_a_tone_in_the_noise_is_no_resonance():
    """Such as that of a fan, next to an arm: a pair of poles without damping explains it by its free motion."""
    rng = np.random.default_rng(47)
    u = rng.standard_normal(1500)
    y = held_arm(u, MODES[:1])
    y = y + y.std() * (0.02 * rng.standard_normal(1500) + 0.1 * np.sin(2 * np.pi * 113.0 * PERIOD * np.arange(1500)))
    p = [np.exp(2 * np.pi * f * PERIOD * (-d + 1j * np.sqrt(1 - d**2))) for f, d in ((31.0, 0.02), (113.0, 1e-6))]
    (found,) = check_resonances(-np.poly([*p, *np.conj(p)]).real[1:], 1, u, y, PERIOD)
    assert found.frequency == pytest.approx(31.0)
    assert found.uncertain == ()


def test_a_model_with_one_mode_in_place_of_two_tells_nothing():
    """Its damping is that of both together, which no small deviation may make certain."""
    rng = np.random.default_rng(48)
    u = rng.standard_normal(1500)
    y = held_arm(u, ((28.4, 0.065, 1.0), (31.2, 0.0085, 0.5)))
    y = y + 0.001 * y.std() * rng.standard_normal(len(y))
    p = np.exp(2 * np.pi * 30.4 * PERIOD * (-0.045 + 1j))
    for mode in check_resonances(-np.poly([p, np.conj(p)]).real[1:], 1, u, y, PERIOD):
        assert mode.uncertain == ("frequency", "damping")
        assert mode.unknown
