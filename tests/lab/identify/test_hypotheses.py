"""Errors that a recording hides are named with value and line to write, or reported as possible; sound ones are not."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lab.identify.recordings_study import case, comparison, identified, mistaken, model_of, words_of
from rrrgen.lab.data.mapping import plain_mapping
from rrrgen.lab.identify.diagnosis.report import diagnose_fit
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


def test_a_delay_is_read_without_bias_at_any_time_between_the_rows(sound):
    """The noise is as large between the decimated rows, its rate is taken there, and rows at the ends stay out."""
    at, late = comparison(sound).sample, comparison(mistaken(sound, "delay 0 30")).sample
    used = at.use & late.use
    assert used.mean() > 0.8
    moved = late.later(np.full(at.n, 0.03)) - at.tau
    assert np.all(np.max(np.abs(np.where(used, moved, 0.0)), axis=0) < 5e-3 * np.sqrt(np.mean(at.tau**2, axis=0)))
    given = mistaken(case(model_of("puma560"), 8700, SECONDS, 0.1, noise=NOISE), "delay 0 30")
    delay = Term("delay", -1)
    assert comparison(given).fit_terms([delay], {})[delay] == pytest.approx(0.03, abs=0.001)


def test_a_parameter_that_may_as_well_be_zero_is_not_named():
    """The derivative by the delay of joint 2 explains 15 % of what is left, but the delay itself is 1.4 +- 1.2 ms."""
    _, found = findings(
        mistaken(mistaken(case(model_of("rrr"), 8701, SECONDS, 0.1, noise=NOISE), "tilt 0 3"), "gain 2 0.7")
    )
    assert [finding.outcome.hypothesis.subject for finding in found] == ["tilt", "gain"]


RATIOS = np.array([101.0, 101.0, 54.0])


def behind_gears(given, ratios):
    """The set with motions times ``ratios`` (n,), and torques divided by them."""
    return replace(given, log=replace(given.log, q=given.log.q * ratios, tau=given.log.tau / ratios))


def test_data_from_the_motors_are_called_so_with_the_ratios(sound):
    given = behind_gears(sound, RATIOS)
    (cause,) = diagnose_fit(given.model, [given.log], identified(given))
    assert cause.cause == "positions and torques are recorded at the motors"
    found = [float(r) for r in re.findall(r"gear_ratio: ([\d.]+)", cause.remedy)]
    np.testing.assert_allclose(found, RATIOS, rtol=0.03)
    assert cause.remedy.startswith("side: motor; ")


def test_data_from_the_joints_in_a_mapping_that_says_motors_are_called_so(sound):
    given = behind_gears(sound, 1.0 / RATIOS)  # what is read where each column is divided by a ratio that it lacks
    mapping = replace(plain_mapping(Path("log.csv"), given.log.joints, False, True), transmission=np.diag(RATIOS))
    cause, errors = comparison(given).gear_sides(replace(words_of(given), mapping=mapping))
    assert "recorded at the joints" in cause.cause
    assert cause.remedy.startswith("side: joint")
    assert np.all(errors < 0.05)


def test_data_from_the_right_side_of_the_gears_pass(sound):
    assert comparison(sound).gear_sides(words_of(sound)) is None
    coupled = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, 1.0]])
    mapping = replace(plain_mapping(Path("log.csv"), sound.log.joints, False, True), transmission=coupled)
    given = behind_gears(sound, RATIOS)
    assert comparison(given).gear_sides(replace(words_of(given), mapping=mapping)) is None
