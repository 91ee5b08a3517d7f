"""Applies all diagnosis rules to all recordings: rules that need no model before the fit, the others after it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.lab.identify.diagnosis.causes import Cause, Wording, merged
from rrrgen.lab.identify.diagnosis.rules import (
    Motion,
    clock,
    clock_factor,
    dissipation,
    limits,
    missing_terms,
    recorded_speed,
    unexplained,
)
from rrrgen.lab.identify.diagnosis.trial_fits import AllTerms, Sample, linear_stand_ins, sample_of
from rrrgen.lab.identify.diagnosis.units_and_wiring import Corrected, corrected, magnitude
from rrrgen.lab.identify.observations import Recording
from rrrgen.lab.identify.regressor import RigidModel

if TYPE_CHECKING:
    from rrrgen.lab.identify.identification import Identification

BEFORE: tuple[Callable[[Motion], Any], ...] = (clock, recorded_speed, limits)


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
    found = []
    for recording in recordings:
        motion = Motion.of(spec, wording(spec, recording), recording)
        for rule in BEFORE:
            found += list(rule(motion))
    return merged(found)


def diagnose_fit(model: RigidModel, recordings: Sequence[Recording], found: Identification) -> tuple[Cause, ...]:
    """Diagnose recordings by their torques: signs, exchanged columns, units, clock, missing terms, unexplained errors.

    ``found`` is the identification of ``model`` from these recordings.
    """
    regressor = AllTerms(model, linear_stand_ins(found.columns))
    causes: list[Cause] = []
    for recording in recordings:
        sample = sample_of(recording, found.processing)
        if sample is not None and int(np.sum(sample.use)) > len(regressor.names):
            words = wording(model.spec, recording)
            # a clock that is already known to be wrong is corrected, so that it does not hide other faults
            sample = sample.slowed(clock_factor(Motion.of(model.spec, words, recording)))
            causes += _of_sample(regressor, sample, words, found)
    return merged(causes)


def _of_sample(regressor: AllTerms, sample: Sample, words: Wording, found: Identification) -> list[Cause]:
    """Causes found in one sample: wrong signs, units and columns, then implausible parameters, missing terms, errors.

    Wrong signs, units and columns are found first, because the other rules need the corrected sample.
    """
    names = regressor.names
    estimated = [column.name for column in linear_stand_ins(found.columns)]
    inside = [k for k, name in enumerate(names) if name in estimated]
    # friction at every joint; an offset or a drive inertia that is not in the model may stand for gravity or a link
    plain = [k for k, name in enumerate(names) if name in estimated or name.startswith(("fv", "fc"))]

    def impossible(best: Corrected) -> list[Cause]:
        fit, put_right = best.trial.fit(best.mix, plain), best.sample
        return [
            *magnitude(regressor.model.spec, regressor, put_right, fit.theta, words),
            *dissipation(regressor, put_right, fit, words),
        ]

    best = corrected(sample, regressor, words, lambda each: len(impossible(each)))
    causes = [*best.causes, *impossible(best)]
    if len(causes) == len(best.causes):
        causes += missing_terms(regressor, estimated, best.trial, best.mix, words)
    return causes or list(unexplained(best.trial.fit(best.mix, inside).error, found.whiteness, words))
