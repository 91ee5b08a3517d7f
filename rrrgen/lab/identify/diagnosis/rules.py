"""Rules by which a fit that explains too little is diagnosed: limits, dissipation, motion, recorded speeds."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.lab.data.clock import THOUSANDS, clock_factor
from rrrgen.lab.data.uniform_stream import Part
from rrrgen.lab.estimate.statistics import Whiteness, rms
from rrrgen.lab.identify.bandwidth import TUNING_SAMPLES, motion_bandwidth
from rrrgen.lab.identify.diagnosis.causes import Cause, Wording
from rrrgen.lab.identify.diagnosis.trial_fits import AllTerms, Fit, Sample
from rrrgen.lab.identify.diagnosis.units_and_wiring import gravity_and_inertia
from rrrgen.lab.identify.observations import Recording

# ------------------------------------------------------------------------------------------------------------------
# Rule: negative friction or inertia means that the torque or the position of the joint has the wrong sign.
#
# Reversing both signals of a joint, or one signal of a joint that is decoupled from the others, leaves the error of
# the fit unchanged; only the signs of friction and inertia reveal it.
# ------------------------------------------------------------------------------------------------------------------

CLEAR = 6.0
"""Standard deviations, of white residuals: twice that for residuals correlated over four samples."""
SHARE = 0.01  # of the joint's RMS torque: smaller friction or inertia torques are not judged


def dissipation(regressor: AllTerms, sample: Sample, fit: Fit, words: Wording) -> Iterator[Cause]:
    """Report joints whose friction or inertia is significantly negative in ``fit``."""
    names = list(regressor.names)
    _, M = gravity_and_inertia(regressor, sample, fit.theta)
    tau = rms(sample.tau, axis=0)
    for i, joint in enumerate(words.joints):
        speed, push = (float(rms(x[:, i])) for x in (sample.dq, sample.ddq))
        at = [names.index(f"{key}{i + 1}") for key in ("fv", "fc")]
        # mean friction torque against the motion, at the joint's RMS speed
        weights = np.zeros(len(names))
        weights[at] = speed, 1.0
        friction = float(weights @ fit.theta)
        doubt = float(np.sqrt(np.maximum(0.0, weights @ fit.covariance @ weights)))
        drives = friction < -max(CLEAR * doubt, SHARE * tau[i])
        slows = friction > max(CLEAR * doubt, SHARE * tau[i])
        inertia = float(np.mean(M[:, i]))
        backwards = inertia * push < -max(SHARE * tau[i], fit.error[i] * tau[i])
        forwards = inertia * push > max(SHARE * tau[i], fit.error[i] * tau[i])
        if (drives and not forwards) or (backwards and not slows):
            unit = ("N m", "kg m^2") if words.revolute[i] else ("N", "kg")
            yield words.wrong_sign(["torque", "position"], i).because(
                f"friction of {joint} at its RMS speed {friction:.3g} {unit[0]} (deviation {doubt:.1g}), inertia "
                f"{inertia:.3g} {unit[1]}: both must be positive"
            )


# ------------------------------------------------------------------------------------------------------------------
# Diagnosis rule: a clock wrong by a power of 1000; and the motion data used by all rules that need no model.
# ------------------------------------------------------------------------------------------------------------------

LAG = 10  # samples over which positions are differenced: a tenth of the encoder noise of single differences


@dataclass(frozen=True)
class RecordedStretch:
    """The first uninterrupted stretch of a recording (``part``), as the rules that need no model use it.

    ``spec`` is the robot file, ``words`` formulates the faults found, ``period`` is that of the sampling, s.
    """

    spec: Any
    words: Wording
    part: Part
    period: float

    @classmethod
    def of(cls, spec: Any, words: Wording, recording: Recording) -> RecordedStretch:
        """The first stretch of ``recording``, cut to at most TUNING_SAMPLES samples."""
        part = next(iter(recording.parts()))
        return cls(spec, words, part.slice_samples(0, min(len(part), TUNING_SAMPLES)), recording.period)

    @cached_property
    def bandwidth(self) -> float:
        """Bandwidth of the motion, Hz; NaN if no joint moves."""
        try:
            return motion_bandwidth(self.part.q, self.period)
        except InputError:
            return math.nan

    @property
    def clock_factor(self) -> float:
        """Correction factor of time, 1 if sampling rate and motion are plausible."""
        return clock_factor(self.period, self.bandwidth)

    def speeds(self) -> Array:
        """Mean speeds over LAG samples, (N - LAG, n)."""
        return np.asarray((self.part.q[LAG:] - self.part.q[:-LAG]) / (LAG * self.period))


def clock(motion: RecordedStretch) -> Iterator[Cause]:
    """Report a clock that makes both sampling and motion implausible by a power of 1000."""
    factor = motion.clock_factor
    if factor != 1.0:
        yield motion.words.clock(factor).because(
            f"a period of {motion.period:.4g} s and a motion of {motion.bandwidth:.3g} Hz bandwidth; "
            f"with the other unit {factor * motion.period:.4g} s and {motion.bandwidth / factor:.3g} Hz"
        )


# ------------------------------------------------------------------------------------------------------------------
# Rule: positions, speeds and torques far beyond the limits of the robot file.
# ------------------------------------------------------------------------------------------------------------------

DEGREE = math.pi / 180.0
SLACK = 0.05  # of the allowed range: tolerated overshoot, since limits are nominal
FAR = 3.0  # times the allowed range: above it the cause is a wrong unit, below it a wrong sign or zero
TOO_FAST = 3.0  # times the limit: drives do not run so far beyond their rated speed
TOO_STRONG = 10.0  # times the limit: peak torques are usually three times the nominal torque
THOUSAND = 1000.0**0.5  # times the limit: above it a wrong factor of 1000 is more likely than none


def limits(motion: RecordedStretch) -> Iterator[Cause]:
    """Report positions, speeds and torques far beyond the limits of the robot file."""
    yield from _positions(motion)
    if len(motion.part) > 2 * LAG:
        yield from _speeds(motion)
        yield from _torques(motion)


def _positions(motion: RecordedStretch) -> Iterator[Cause]:
    q, words = motion.part.q, motion.words
    low, high = np.min(q, axis=0), np.max(q, axis=0)
    bounds = [_range(joint) for joint in motion.spec.joints]
    outside = [i for i, bound in enumerate(bounds) if not _within(low[i], high[i], bound)]
    if not outside:
        return
    ranges = ", ".join(
        f"{words.joints[i]} from {low[i]:.4g} to {high[i]:.4g}, allowed {bounds[i][0]:.4g} to {bounds[i][1]:.4g}"
        for i in outside
    )
    evidence = f"positions beyond the limits of the robot file (rad, m): {ranges}"
    turning = [i for i, turns in enumerate(words.revolute) if turns]
    far = [i for i in outside if words.revolute[i] and high[i] - low[i] > FAR * (bounds[i][1] - bounds[i][0])]
    if far:
        limited = [i for i in turning if bounds[i][1] < math.inf]
        everywhere = 2 * len(far) > len(limited)
        yield words.wrong_unit("position", turning if everywhere else far, DEGREE).because(evidence)
        return
    for i in outside:
        name = words.joints[i]
        if _within(-high[i], -low[i], bounds[i]):
            yield words.wrong_sign(["position"], i).because(evidence)
        else:
            yield Cause(
                f"the zero, the unit or the range of joint {name} is another one than the robot file's",
                f"`zero` or `unit` of joint {name} in the mapping, or its `limits` in {words.robot}",
                (evidence,),
                general=True,
            )


def _range(joint: Any) -> tuple[float, float]:
    """Lowest and highest allowed position of a joint, rad (m); infinite unless the robot file states both."""
    lower, upper = joint.limits.lower, joint.limits.upper
    return (-math.inf, math.inf) if lower is None or upper is None else (float(lower), float(upper))


def _within(low: float, high: float, bound: tuple[float, float]) -> bool:
    room = SLACK * (bound[1] - bound[0]) if bound[1] < math.inf else 0.0
    return low >= bound[0] - room and high <= bound[1] + room


def _speeds(motion: RecordedStretch) -> Iterator[Cause]:
    words = motion.words
    fastest = np.max(np.abs(motion.speeds()), axis=0)
    for i, joint in enumerate(motion.spec.joints):
        limit = joint.limits.velocity
        if limit is not None and fastest[i] > TOO_FAST * float(limit):
            name, unit = words.joints[i], "rad/s" if words.revolute[i] else "m/s"
            yield Cause(
                f"the unit of the positions of joint {name} or of the clock is another one",
                f"the unit of `position` of joint {name} or of `time` in the mapping",
                (f"speeds of {name} up to {fastest[i]:.4g} {unit}, limit {float(limit):.4g} {unit}",),
                general=True,
            )


def _torques(motion: RecordedStretch) -> Iterator[Cause]:
    words, tau = motion.words, motion.part.tau
    if tau is None:
        return
    peaks = np.max(np.abs(np.where(np.isfinite(tau), tau, 0.0)), axis=0)
    over = {
        i: peaks[i] / float(joint.limits.torque)
        for i, joint in enumerate(motion.spec.joints)
        if joint.limits.torque is not None
    }

    def overload(joints: list[int]) -> str:
        units = ["N m" if turns else "N" for turns in words.revolute]
        phrases = (f"{words.joints[i]} up to {peaks[i]:.4g} {units[i]}, {over[i]:.3g} times its limit" for i in joints)
        return f"torques of {', '.join(phrases)}"

    thousand = [i for i, ratio in over.items() if ratio > THOUSAND]
    if thousand:
        joints = range(len(words.joints)) if 2 * len(thousand) > len(over) else thousand
        yield words.wrong_unit("torque", list(joints), 1e-3).because(overload(thousand))
    strong = [i for i, ratio in over.items() if TOO_STRONG < ratio <= THOUSAND]
    if strong:
        yield Cause(
            f"the torques of {words.name_joints(strong)} are on another side or scale than the limits of the robot "
            "file",
            f"`side`, `gear_ratio` or `constant` of {words.name_joints(strong)} in the mapping, or `limits` in "
            f"{words.robot}",
            (overload(strong),),
            general=True,
        )


# ------------------------------------------------------------------------------------------------------------------
# Rule: recorded speeds that are not the derivatives of the positions: units, signs, exchanged columns, the clock.
# ------------------------------------------------------------------------------------------------------------------

AGREES = 0.2  # relative difference below which two speeds agree, since drives delay and filter them
SHAPE = 0.8  # squared correlation above which two curves differ by a factor only
TURN = 180.0 / math.pi
CLOCKS = (*THOUSANDS, *(1.0 / large for large in THOUSANDS))
FACTORS = (TURN, 1.0 / TURN, 30.0 / math.pi, math.pi / 30.0, *CLOCKS)


def recorded_speed(motion: RecordedStretch) -> Iterator[Cause]:
    """Report recorded speeds that are not the derivatives of the recorded positions."""
    if motion.part.dq is None or len(motion.part) <= 2 * LAG:
        return
    derivatives = motion.speeds()
    sums = np.cumsum(np.vstack([np.zeros(derivatives.shape[1]), motion.part.dq]), axis=0)
    # the same mean over LAG steps, by trapezoids
    recorded = (sums[LAG + 1 :] - sums[: -LAG - 1] - 0.5 * (motion.part.dq[:-LAG] + motion.part.dq[LAG:])) / LAG
    ratio, shape = _slopes(derivatives, recorded)
    wrong = [i for i in range(len(ratio)) if shape[i] >= SHAPE and abs(ratio[i] - 1.0) > AGREES]
    near = {i: _nearest(ratio[i]) for i in wrong}
    everywhere = {near[i] for i in wrong} if len(wrong) == len(ratio) else set()
    if len(everywhere) == 1 and everywhere <= set(CLOCKS):
        factor = 1.0 / everywhere.pop()
        yield motion.words.clock(factor).because(_ratios(motion.words, wrong, ratio))
        return
    for i in wrong:
        if ratio[i] < 0.0 and abs(ratio[i] + 1.0) <= AGREES:
            cause = motion.words.wrong_sign(["position", "velocity"], i)
        else:
            cause = motion.words.wrong_unit("velocity", [i], 1.0 / (near[i] or ratio[i]))
        yield cause.because(_ratios(motion.words, [i], ratio))
    yield from _exchanged_speeds(motion, derivatives, recorded, shape)


def _slopes(x: Array, y: Array) -> tuple[Array, Array]:
    """Least-squares slope of ``y = slope x`` and squared correlation, for each column."""
    xy, xx, yy = np.sum(x * y, axis=0), np.sum(x * x, axis=0), np.sum(y * y, axis=0)
    some = (xx > 0.0) & (yy > 0.0)
    slope = np.divide(xy, xx, out=np.ones(len(xx)), where=some)
    return slope, np.divide(xy**2, xx * yy, out=np.zeros(len(xx)), where=some)


def _nearest(ratio: float) -> float:
    """The conversion factor between two known units that is nearest to ``ratio``; 0 if none agrees within AGREES."""
    return next((factor for factor in FACTORS if abs(ratio / factor - 1.0) <= AGREES), 0.0)


def _ratios(words: Wording, joints: list[int], ratio: Array) -> str:
    ratios = ", ".join(f"{words.joints[i]} {ratio[i]:.4g}" for i in joints)
    return f"recorded speed over the derivative of the position: {ratios} (should be 1)"


def _exchanged_speeds(motion: RecordedStretch, derivatives: Array, recorded: Array, shape: Array) -> Iterator[Cause]:
    """Report pairs of joints whose recorded speeds are exchanged.

    ``derivatives`` (N, n) are those of the positions, ``recorded`` (N, n) the recorded speeds, ``shape`` (n,) the
    squared correlation of the two at each joint.
    """
    for i in range(len(shape)):
        for k in range(i + 1, len(shape)):
            if shape[i] < 1.0 - SHAPE and shape[k] < 1.0 - SHAPE:
                _, cross = _slopes(derivatives[:, [i, k]], recorded[:, [k, i]])
                if np.all(cross >= SHAPE):
                    pair = f"{motion.words.joints[i]} and {motion.words.joints[k]}"
                    yield motion.words.exchanged_columns("velocity", i, k).because(
                        f"the recorded speeds of {pair} follow the position of the other one "
                        f"(squared correlations {cross[0]:.2f} and {cross[1]:.2f}; of their own "
                        f"{shape[i]:.2f} and {shape[k]:.2f})"
                    )


# ------------------------------------------------------------------------------------------------------------------
# Rule: a large torque error that is not noise and that no other rule explains.
# ------------------------------------------------------------------------------------------------------------------

LARGE = 0.3  # relative torque error; sound recordings have some percent, joints of light wrists up to 20 percent
COLOURED = 1.0
"""Durbin-Watson: 2 for noise, below 1 where neighbouring residuals correlate by more than a half."""


def unexplained_joints(joint_errors: Any, whiteness: tuple[Whiteness, ...], words: Wording) -> Iterator[Cause]:
    """Report joints with a large relative error (``joint_errors``, (n,)) and correlated residuals (``whiteness``)."""
    for i, (error, white) in enumerate(zip(np.asarray(joint_errors), whiteness, strict=False)):
        if error > LARGE and white.durbin_watson < COLOURED:
            name = words.joints[i]
            yield Cause(
                f"the model does not describe joint {name}",
                f"check column, unit, sign and zero of {name} in the mapping, and its row of the Denavit-Hartenberg "
                f"table, limits and friction in {words.robot}",
                (
                    f"{100 * error:.3g} % of its torque is left, and that is no noise: Durbin-Watson "
                    f"{white.durbin_watson:.2f}, 2 for noise",
                ),
            )
