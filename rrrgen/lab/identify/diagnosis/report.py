"""Applies all diagnosis rules to all recordings: rules that need no model before the fit, the others after it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.identify.diagnosis.causes import Cause, Wording, merge_causes
from rrrgen.lab.identify.diagnosis.hypotheses import Comparison, Finding
from rrrgen.lab.identify.diagnosis.rules import (
    RecordedStretch,
    clock,
    dissipation,
    limits,
    recorded_speed,
    unexplained_joints,
)
from rrrgen.lab.identify.diagnosis.trial_fits import (
    FLOOR,
    AllTerms,
    Sample,
    beyond_linear,
    linear_stand_ins,
    sample_of,
)
from rrrgen.lab.identify.diagnosis.units_and_wiring import (
    SCORE,
    CorrectedSample,
    correct_sample,
    fit_uncorrected,
    magnitude,
)
from rrrgen.lab.identify.observations import Recording
from rrrgen.lab.identify.regressor import RigidModel
from rrrgen.lab.plant.tracking import band_of, oscillation

if TYPE_CHECKING:
    from rrrgen.lab.identify.identification import Identification


EXPLAINED_BY_UNITS = 0.1
"""Relative torque error that may remain where a unit is called wrong: wrong gear sides look like degrees and kN m."""

BEFORE: tuple[Callable[[RecordedStretch], Any], ...] = (clock, recorded_speed, limits)


def wording(spec: Any, recording: Recording) -> Wording:
    """Build the :class:`Wording` that describes faults in one recording of the robot ``spec``."""
    return Wording(
        joints=tuple(recording.joints),
        revolute=tuple(joint.is_revolute for joint in spec.joints),
        mapping=getattr(recording, "mapping", None),
        robot="the robot file",
    )


def diagnose_recordings(spec: Any, recordings: Sequence[Recording]) -> tuple[Cause, ...]:
    """Diagnose recordings without a fit: clock, recorded speeds, limits of the robot file ``spec``."""
    causes = []
    for recording in recordings:
        motion = RecordedStretch.of(spec, wording(spec, recording), recording)
        for rule in BEFORE:
            causes += list(rule(motion))
    return merge_causes(causes)


def diagnose_fit(
    model: RigidModel, recordings: Sequence[Recording], identification: Identification
) -> tuple[Cause, ...]:
    """Diagnose recordings by their torques: signs, exchanged columns, units, clock, missing terms, unexplained errors.

    ``identification`` is that of ``model`` from these recordings. Friction is linear here, whatever its law, and
    slow motion is left out as for linear friction. What that does not describe looks like other faults, a reversal over
    some distance like torques that are recorded late: faults are only named if they also explain torques from which the
    estimated laws were taken. These torques alone would not do, since a fault bends the laws that are fitted to them.
    """
    regressor = AllTerms(model, linear_stand_ins(identification.columns))
    causes: list[Cause] = []
    for recording in recordings:
        sample = sample_of(recording, identification.linear_processing)
        if sample is not None and identification.nuisances is not None:
            # of tilt and drift; the recordings are corrected
            corrections = identification.nuisances.corrections
            sample = sample.without(corrections.columns.torque(sample, corrections.values))
        if sample is not None and int(np.sum(sample.use)) > len(regressor.names):
            words = wording(model.spec, recording)
            # a clock that is already known to be wrong is corrected, so that it does not hide other faults
            sample = sample.stretch_time(RecordedStretch.of(model.spec, words, recording).clock_factor)
            laws = None
            if identification.regressor is not None and identification.regressor.surfaces:
                laws = sample_of(
                    recording,
                    identification.linear_processing,
                    partial(identification.regressor.law_torque, identification.theta),
                )
            causes += _of_sample(regressor, sample, words, identification, laws, recording.period)
    return merge_causes(causes)


def _of_sample(
    regressor: AllTerms,
    sample: Sample,
    words: Wording,
    identification: Identification,
    laws: Sample | None,
    period: float,
) -> list[Cause]:
    """Causes found in one sample, by what their repair leaves unexplained.

    Signs, units, columns and the clock are corrected first, as far as that explains the torques; then errors that
    change them by little are compared with each other. If these alone explain as much, nothing is corrected. ``laws``
    is the sample with the torques of the estimated friction laws alone, None without any; ``period`` is that of the
    recording, s.
    """
    names = regressor.names
    estimated = [column.name for column in linear_stand_ins(identification.columns)]
    inside = [k for k, name in enumerate(names) if name in estimated]
    # friction at every joint; an offset or a drive inertia that is not in the model may stand for gravity or a link
    plain = [k for k, name in enumerate(names) if name in estimated or name.startswith(("fv", "fc"))]

    def impossible(best: CorrectedSample) -> list[Cause]:
        fit, put_right = best.trial.fit(best.mix, plain), best.sample
        return [
            *magnitude(regressor.model.spec, regressor, put_right, fit.theta, words),
            *dissipation(regressor, put_right, fit, words),
        ]

    best = correct_sample(sample, regressor, words, lambda state: len(impossible(state)))
    plainly = Explained.of(regressor, fit_uncorrected(sample, regressor), inside)
    if best.causes:
        repaired = Explained.of(regressor, best, inside)
        if best.scaled and repaired.error > EXPLAINED_BY_UNITS:
            repaired = plainly
        if not plainly.findings or plainly.score > repaired.score + SCORE:
            plainly = repaired
    if plainly.error > EXPLAINED_BY_UNITS or plainly.state.scaled:  # ratios near 57 look like degrees
        sides = Comparison(regressor, fit_uncorrected(sample, regressor).sample, inside).gear_sides(words)
        if sides is not None and score_of(sides[1]) < plainly.score - SCORE:
            return [sides[0]]
    findings, errors = plainly.findings, plainly.joint_errors
    if laws is not None and findings and not plainly.state.causes:  # else the laws were fitted to other torques
        known = sample.without(beyond_linear(laws, regressor.estimated))
        beside = Comparison(regressor, fit_uncorrected(known, regressor).sample, inside)
        findings = [finding for finding in findings if beside.is_explained_by(finding.outcome.hypothesis)]
        errors = errors if findings else beside.joint_errors({})
    findings = [finding for finding in findings if not is_held(finding, period)]
    causes = [*plainly.state.causes, *impossible(plainly.state)]
    if len(causes) == len(plainly.state.causes):
        causes += [plainly.comparison.cause(finding, words) for finding in by_joint(findings)]
    return causes or list(unexplained_joints(errors, identification.whiteness, words))


def is_held(finding: Finding, period: float) -> bool:
    """Whether torques are early by less than a sample: those of a command that is held until the next one."""
    hypothesis, values = finding.outcome.hypothesis, finding.outcome.values
    return hypothesis.subject == "delay" and -period < values[hypothesis.terms[0]] < 0.0


def by_joint(findings: Sequence[Finding]) -> list[Finding]:
    """Findings in the order of their joints, those about all joints first."""
    return sorted(findings, key=lambda finding: finding.outcome.hypothesis.joint)


@dataclass(frozen=True, eq=False)
class Explained:
    """A sample after corrections, ``state``, and the ``findings`` of the ``comparison`` of what else may be wrong.

    ``joint_errors`` (n,) are the relative torque errors that remain, ``error`` that of all joints together.
    """

    state: CorrectedSample
    comparison: Comparison
    findings: list[Finding]
    joint_errors: Array
    error: float

    @classmethod
    def of(cls, regressor: AllTerms, state: CorrectedSample, inside: Sequence[int]) -> Explained:
        """Compare what may be wrong with the sample of ``state``; ``inside`` are the columns in the model."""
        comparison = Comparison(regressor, state.sample, inside)
        findings = comparison.findings()
        errors = comparison.joint_errors(findings[-1].outcome.values if findings else {})
        weights = comparison.counts * comparison.size**2
        return cls(state, comparison, findings, errors, float(np.sqrt(weights @ errors**2 / np.sum(weights))))

    @property
    def score(self) -> float:
        """Minus twice the logarithm of the likelihood per sample, up to a constant."""
        return score_of(self.joint_errors)


def score_of(joint_errors: Array) -> float:
    """Minus twice the logarithm of the likelihood per sample for relative torque errors (n,), up to a constant."""
    return float(np.sum(np.log(joint_errors**2 + FLOOR**2)))


# ------------------------------------------------------------------------------------------------------------------
# Note on recordings whose control loop oscillates: torques swing at a frequency that the motion does not have.
# ------------------------------------------------------------------------------------------------------------------

FASTEST_MOTION = 20.0
"""Frequency (Hz) above which no motion for identification goes, where the recording holds no reference to tell."""


def swinging_notes(recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Sentences on the joints whose torques oscillate, one per recording, with frequency and amplitude."""
    return tuple(note for recording in recordings for note in _notes(recording))


def _notes(recording: Recording) -> Iterator[str]:
    part, period = next(iter(recording.parts())), recording.period
    if part.tau is None:
        return
    swings = []
    for i, torque in enumerate(part.tau.T):
        lowest = FASTEST_MOTION
        if part.reference is not None:
            lowest = 3.0 * band_of(np.diff(part.reference[:, i], n=2), period)
        joint_swing = oscillation(torque, np.zeros_like(torque), float(np.abs(torque).max()), i, period, lowest / 3.0)
        if joint_swing is not None:
            swings.append(joint_swing)
    if swings:
        worst = max(swings, key=lambda swing: swing.stop - swing.start)
        names = ", ".join(recording.joints[swing.joint] for swing in swings)
        yield (
            f"the control loop oscillates: the torque of {names} swings, of {recording.joints[worst.joint]} at "
            f"{worst.frequency:.3g} Hz with {worst.amplitude:.3g} from t = {part.t[0] + worst.start:.3g} s to "
            f"{part.t[0] + worst.stop:.3g} s, which the motion does not ask for; do not trust estimates, deviations "
            "and diagnoses, but record anew with lower gains or a higher rate"
        )
