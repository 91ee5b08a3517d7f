"""Errors that a recording hides are named with value and line to write, or reported as possible; sound ones are not."""

import numpy as np
import pytest
from recordings_study import case, comparison, mistaken, model_of, words_of

from rrrgen.lab.identify.nuisances import Term

SECONDS, NOISE = 30.0, 0.01


@pytest.fixture(scope="module")
def sound():
    return case(model_of("rrr"), 3, SECONDS, 0.1, noise=NOISE)


def findings(given):
    compared = comparison(given)
    return compared, compared.findings()


def test_a_sound_recording_passes_in_silence(sound):
    assert findings(sound)[1] == []


@pytest.mark.parametrize(
    ("mistake", "cause", "term", "value", "tolerance"),
    [
        ("zero 2 90", "the encoder zero of joint q2 is off", Term("zero", 1), np.radians(90), np.radians(3)),
        ("gain 3 2", "the torque constant of joint q3 is wrong", Term("gain", 2), np.log(2), 0.05),
        ("delay 0 30", "the torques are recorded too late", Term("delay", -1), 0.03, 0.002),
    ],
)
def test_one_mistake_is_named_with_its_size_and_the_line_to_write(sound, mistake, cause, term, value, tolerance):
    given = mistaken(sound, mistake)
    compared, found = findings(given)
    assert found[0].named
    assert found[0].outcome.values[term] == pytest.approx(value, abs=tolerance)
    told = compared.cause(found[0], words_of(given))
    assert told.cause == cause
    assert not told.possible
    key = mistake.split()[0]
    assert f"{key}: " in told.remedy or f"{key.replace('delay', 'torque_delay')}: " in told.remedy
    assert "held-out torque error falls from" in told.evidence[1]
    # the repair leaves what the noise leaves
    assert np.all(compared.joint_errors(found[-1].outcome.values) < 1.5 * comparison(sound).joint_errors({}))


def test_two_mistakes_are_found_in_turn(sound):
    _, found = findings(mistaken(mistaken(sound, "gain 3 2"), "zero 2 90"))
    assert {finding.outcome.hypothesis.terms for finding in found} == {(Term("gain", 2),), (Term("zero", 1),)}
