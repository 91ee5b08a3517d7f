"""The response of a whole arm from as many experiments as joints, against the differentiated equations of motion."""

from dataclasses import replace

import numpy as np
import pytest

from lab.response.shaken_arm import PERIOD, experiment, truth
from rrrgen.base.errors import DerivationError, InputError
from rrrgen.lab.response.matrix_response import matrix_responses

POSTURE = (0.3, 0.8)


@pytest.fixture(scope="module")
def logs():
    return [experiment(POSTURE, joint) for joint in (0, 1)]


@pytest.fixture(scope="module")
def found(logs):
    (response,) = matrix_responses(logs, PERIOD)
    return response


def test_all_elements_are_those_of_the_arm(found):
    G, _, _ = truth(found.posture, found.frequency)
    assert len(found.frequency) == 61
    assert not found.findings
    off = np.abs(found.G - G)
    assert np.median(off / np.abs(G), axis=0).max() < 0.03
    assert np.mean(off < found.band95 * np.abs(found.G)) > 0.9
    assert found.asymmetry < 1.5


def test_resonances_are_the_modes_of_the_arm(found):
    _, frequency, damping = truth(found.posture, found.frequency)
    assert [mode.frequency for mode in found.resonances] == pytest.approx(frequency, rel=2e-3)
    assert [mode.damping for mode in found.resonances] == pytest.approx(damping, rel=0.05)
    for mode, f in zip(found.resonances, frequency, strict=True):
        assert abs(mode.frequency - f) < 4.0 * mode.frequency_std
    assert found.lines()[-1].startswith("  resonance 4")


def test_torques_that_are_not_held_differ_by_the_hold(logs, found):
    (smooth,) = matrix_responses(logs, PERIOD, held=False)
    x = np.pi * found.frequency * found.period
    np.testing.assert_allclose(found.G, smooth.G / (np.tan(x) / x)[:, None, None], rtol=1e-9)


def test_a_wrong_torque_constant_is_told_by_the_asymmetry(logs):
    wrong = [replace(log, tau=log.tau * [1.0, 1.3]) for log in logs]
    (response,) = matrix_responses(wrong, PERIOD)
    assert [finding.kind for finding in response.findings] == ["asymmetry"]
    assert "is the torque constant of a joint wrong" in response.lines()[1]


def test_friction_of_joints_that_turn_round_is_no_linear_response(logs):
    rough = [experiment(POSTURE, joint, (0.6, 0.2)) for joint in (0, 1)]
    (response,) = matrix_responses(rough, PERIOD)
    assert "distortion" in [finding.kind for finding in response.findings]
    (mixed,) = matrix_responses([*logs, *rough], PERIOD)
    assert any("from one linear response" in finding.message for finding in mixed.findings)


def test_more_experiments_than_joints_are_used_together(logs, found):
    """The same experiments with other noise in the torques: the deviations fall by the square root of two."""
    rng = np.random.default_rng(5)
    noise = np.array([0.02, 0.006])
    more = [replace(log, tau=log.tau + noise * rng.normal(size=log.tau.shape)) for log in logs]
    (response,) = matrix_responses([*logs, *more], PERIOD)
    G, _, _ = truth(response.posture, response.frequency)
    assert response.experiments == 4
    assert not response.findings
    assert np.mean(np.abs(response.G - G) < response.band95 * np.abs(response.G)) > 0.9


def test_what_tells_no_response_is_refused(logs):
    log = logs[0]
    half = replace(log, t=log.t[:1500], q=log.q[:1500], tau=log.tau[:1500])
    for given, period, kind, words in (
        ([log], PERIOD, InputError, r"as many experiments as the arm has joints, 2, .* 1 at \[0"),
        ([log, log], PERIOD, DerivationError, "does it differ from experiment to experiment"),
        (logs, 0.3333, InputError, "not a whole number of samples"),
        ([half, half], PERIOD, DerivationError, "holds 1.5 periods"),
        ([replace(log, tau=None), log], PERIOD, InputError, "no torques"),
        ([replace(log, joints=("a", "b")), log], PERIOD, InputError, "different joints"),
        ([replace(each, valid=each.tau < 1e9) for each in logs[:1]] * 2, PERIOD, DerivationError, "differ from"),
        ([replace(each, valid=each.t[:, None] < [3.0, 3.0]) for each in logs], PERIOD, DerivationError, "missing"),
    ):
        with pytest.raises(kind, match=words):
            matrix_responses(given, period)
