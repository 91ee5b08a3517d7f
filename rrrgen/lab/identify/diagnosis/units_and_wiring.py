"""Rule: a wrong sign, wrong unit, exchanged columns or wrong clock whose correction improves the fit considerably.

Each hypothesis is corrected in the motion or the torques, and the model is fitted again, with friction, offset and
drive inertia at every joint, so that a term missing in the robot file is not mistaken for such a fault. Corrections are
accepted one after the other, if they at least halve the error of some joint and divide the product of all squared
errors by four or more. Noise does not reach this likelihood ratio: it changes the product by a few percent.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.derive.parameters.physical_links import SMALLEST_LENGTH
from rrrgen.lab.data.mapping import Signal
from rrrgen.lab.estimate.statistics import rms
from rrrgen.lab.identify.diagnosis.causes import Cause, Wording
from rrrgen.lab.identify.diagnosis.trial_fits import AllTerms, Fit, Regressor, Sample, Trial

# ------------------------------------------------------------------------------------------------------------------
# Rule: an implausible mass of the arm reveals a wrong unit of all torques, or of time.
#
# A common factor on all torques changes no relative error: it multiplies every parameter. It shows in the mass that
# the torques imply, once by gravity and once by inertia. A wrong clock leaves the mass by gravity unchanged and
# multiplies that by inertia by the square of its factor.
#
# If the robot file has links, the mass is compared with theirs; a ratio above 31.6, the geometric mean of 1 and 1000,
# counts as a factor of 1000. Without links the mass over the cube of the reach is judged: it is 5 to 60 kg/m^3 for
# arms from the Puma 560 to the Staubli TX40, and 0.01 to 1000 is accepted.
# ------------------------------------------------------------------------------------------------------------------

BETWEEN = 1000.0**0.5
DENSITY = (0.01, 1000.0)  # kg/m^3, accepted range: toy models are lighter than industrial arms, nothing is heavier
SQUARED = 1000.0  # ratio of the masses by inertia and by gravity, between 1 and 1000^2, above which the clock is wrong
POSES = 60  # poses of the recording at which gravity and inertia are compared
LEVEL = 1e-6  # gravity torque over inertia torque of the same mass, below which gravity acts on no joint


def gravity_and_inertia(regressor: AllTerms, sample: Sample, theta: Array) -> tuple[Array, Array]:
    """Gravity torques and diagonal of the mass matrix at K <= POSES poses of the recording, (K, n) each.

    They follow from the parameters ``theta`` (p,); drive inertia is included.
    """
    q = sample.q[np.linspace(0, len(sample.q) - 1, min(POSES, len(sample.q))).astype(int)]
    beta, zero = theta[: len(regressor.model.base_parameter_names)], np.zeros_like(q)
    g = np.asarray(regressor.model.regressor(q, zero, zero)) @ beta
    M = np.empty_like(g)
    for i in range(sample.n):
        unit = zero.copy()
        unit[:, i] = 1.0
        M[:, i] = (np.asarray(regressor.model.regressor(q, zero, unit)) @ beta - g)[:, i]
    return g, M + regressor.inertia(theta)


def magnitude(spec: Any, regressor: AllTerms, sample: Sample, theta: Array, words: Wording) -> Iterator[Cause]:
    """Report a wrong unit of all torques, or a wrong clock, if the masses implied by ``theta`` are implausible."""
    g, M = gravity_and_inertia(regressor, sample, theta)
    nominal = getattr(regressor.model, "beta", None)
    if nominal is not None:
        inertia = [0.0 if j.drive is None or j.drive.inertia is None else float(j.drive.inertia) for j in spec.joints]
        known = np.zeros(len(theta))
        known[: len(nominal)] = nominal
        g0, M0 = gravity_and_inertia(regressor, sample, known)
        yield from _against_links(g, M, g0, M0 + np.asarray(inertia), words)
    else:
        yield from _against_reach(spec, g, M, sample, words)


def _against_links(g: Array, M: Array, g0: Array, M0: Array, words: Wording) -> Iterator[Cause]:
    pull = float(np.sqrt(np.sum(g0**2)))
    by_gravity = float(np.sqrt(np.sum(g**2))) / pull if pull > 0.0 else np.nan
    # sums over joints, dominated by the heavy ones: in a wrist, unstated drive inertia may exceed that of the links
    like = np.array(words.revolute) if any(words.revolute) else np.ones(len(words.joints), bool)
    total, link_inertia = float(np.sum(np.abs(np.mean(M, axis=0))[like])), float(np.sum(np.mean(M0, axis=0)[like]))
    if not (total > 0.0 and link_inertia > 0.0):
        return
    by_inertia = total / link_inertia
    evidence = f"inertia {by_inertia:.3g} times that of the robot file's links"
    evidence += "" if np.isnan(by_gravity) else f", gravity torques {by_gravity:.3g} times theirs"
    ratios = np.abs(np.mean(M, axis=0)) / np.maximum(np.mean(M0, axis=0), np.finfo(float).tiny)
    off = [i for i, ratio in enumerate(ratios) if not 1.0 / BETWEEN <= ratio <= BETWEEN]
    joints = off or list(range(len(ratios)))
    yield from _judge_masses(by_gravity, by_inertia, (1.0 / BETWEEN, BETWEEN), evidence, joints, words)


def _against_reach(spec: Any, g: Array, M: Array, sample: Sample, words: Wording) -> Iterator[Cause]:
    """Judge the mass of an arm whose file has no links: mass at full reach divided by the cube of the reach, kg/m^3.

    ``g`` and ``M`` (K, n) are the gravity torques and the diagonal of the mass matrix.
    """
    if spec.mechanism is not None:
        return  # in a tree, the links that a joint carries do not follow from the order of the DH rows
    # an offset d along the first axis does not add to the distance from it
    sizes = [abs(a) if i == 0 else max(abs(a), abs(d)) for i, (_, _, a, d, _) in enumerate(spec.dh_table())]
    travel = np.ptp(sample.q, axis=0)
    lengths = np.array([size if words.revolute[i] else max(size, travel[i]) for i, size in enumerate(sizes)])
    reach = np.maximum(np.cumsum(lengths[::-1])[::-1], SMALLEST_LENGTH)
    turning = np.array(words.revolute)
    if not turning.any() or float(np.sum(lengths)) <= SMALLEST_LENGTH:
        return
    arm = np.where(turning, reach, 1.0)
    pull = float(np.linalg.norm([float(v) for v in spec.gravity]))
    by_gravity = float(np.max(rms(g, axis=0) / arm)) / pull if pull > 0.0 else 0.0
    by_inertia = float(np.max(np.abs(np.mean(M, axis=0)) / arm**2))
    volume = float(reach[0]) ** 3
    evidence = f"the inertia is that of {by_inertia:.3g} kg at a reach of {reach[0]:.3g} m"
    upright = by_gravity > LEVEL / SQUARED * by_inertia
    evidence += f", the gravity torques that of {by_gravity:.3g} kg" if upright else ""
    gravity = by_gravity / volume if upright else np.nan
    yield from _judge_masses(gravity, by_inertia / volume, DENSITY, evidence, range(len(words.joints)), words)


def _judge_masses(
    gravity: float, inertia: float, allowed: tuple[float, float], evidence: str, joints: Sequence[int], words: Wording
) -> Iterator[Cause]:
    """Report a wrong torque unit of ``joints``, or a wrong clock, from the masses implied by gravity and inertia.

    ``gravity`` and ``inertia`` are these masses, divided by the expected mass or by the cube of the reach (kg/m^3);
    ``gravity`` is NaN if gravity acts on no joint. The clock is wrong if they differ by more than SQUARED, the torques
    if they lie outside the range ``allowed``. ``evidence`` is the evidence in words.
    """
    low, high = allowed
    if np.isnan(gravity):
        clock = inertia > SQUARED * high or inertia < low / SQUARED
    else:
        clock = inertia > SQUARED * gravity or inertia < gravity / SQUARED
    if clock:
        faster = inertia > (high if np.isnan(gravity) else gravity)
        yield words.clock(1e-3 if faster else 1e3).because(evidence)
        return
    size = inertia if np.isnan(gravity) else gravity
    if size > high or size < low:
        yield words.wrong_unit("torque", joints, 1e-3 if size > high else 1e3).because(evidence)


# ------------------------------------------------------------------------------------------------------------------
# Rule
# ------------------------------------------------------------------------------------------------------------------

SMALL = 0.03
"""Relative error of every joint below which nothing is tried: the faults sought leave tens of percent."""
HALVED = 0.5
SCORE = math.log(4.0)
EXPLAINED = 0.35  # largest relative error that may remain at the joints that a correction improves
TIE = 0.3  # difference of scores below which the data cannot distinguish two hypotheses
SIGNALS: tuple[Signal, ...] = ("position", "torque")
CHOICES = 3  # number of equally good corrections tried in turn, while impossible signs or masses remain
MOST = 8  # largest number of corrections in one recording
ANGLES = (math.pi / 180.0, 180.0 / math.pi)
THOUSANDS = (1e-3, 1e3)


@dataclass(frozen=True)
class Change:
    """A hypothesis about a fault of a recording, and its correction.

    The true ``signal`` is the recorded one times ``matrix`` (n, n); if ``signal`` is None, time is wrong, and the true
    time is ``slower`` times the recorded one. ``cause`` describes the fault; ``turned`` is the joint (from 0) whose
    sign is reversed, if any.
    """

    cause: Cause
    signal: Signal | None
    matrix: Array
    slower: float = 1.0
    turned: int | None = None

    @property
    def is_scale(self) -> bool:
        """Whether the fault is a wrong unit: ``matrix`` has entries other than 0, 1 and -1."""
        return bool(np.any(~np.isin(self.matrix, (-1.0, 0.0, 1.0))))


Doubts = Callable[["CorrectedSample"], int]


@dataclass(frozen=True)
class CorrectedSample:
    """A sample after the accepted corrections, and its fit.

    The motion in ``trial`` is corrected; corrected torques are ``tau @ mix`` with ``mix`` (n, n). ``causes`` are the
    faults found, ``scaled`` says whether a unit is among them.
    """

    trial: Trial
    mix: Array
    fit: Fit
    causes: tuple[Cause, ...] = ()
    scaled: bool = False

    @property
    def sample(self) -> Sample:
        """The sample with corrected motion and torques."""
        return self.trial.sample.mix_torques(self.mix)


def fit_uncorrected(sample: Sample, regressor: Regressor) -> CorrectedSample:
    """The sample as it is, with its fit."""
    start = Trial(regressor, sample)
    return CorrectedSample(start, np.eye(sample.n), start.fit())


def correct_sample(
    sample: Sample, regressor: Regressor, words: Wording, doubts: Doubts = lambda state: 0
) -> CorrectedSample:
    """Apply the best correction repeatedly until none improves the fit enough.

    Among corrections with equal errors, those that leave the fewest ``doubts`` (impossible signs and masses) are
    preferred: a wrong sign at one joint, for instance, is explained equally well by reversing all the others.
    """
    first = fit_uncorrected(sample, regressor)
    runs = []
    for choice in range(CHOICES):
        state, choices = _descent(first, regressor, words, doubts, choice)
        runs.append((doubts(state), choice, state))
        if runs[-1][0] == 0 or choice + 1 >= choices:
            break
    now = min(runs, key=lambda run: run[:2])[2]
    helped = now.fit.error <= HALVED * first.fit.error
    return now if helped.any() and np.max(now.fit.error[helped]) <= EXPLAINED else first


def _descent(
    now: CorrectedSample, regressor: Regressor, words: Wording, doubts: Doubts, choice: int
) -> tuple[CorrectedSample, int]:
    """Greedy descent: accept the best correction until none improves the fit enough.

    At the first step with several equally good corrections, that with index ``choice`` is taken. Returns the result and
    the number of such corrections.
    """
    choices = 1
    while len(now.causes) < MOST and np.max(now.fit.error) > SMALL:
        tried = [(change, _corrected_fit(change, now, regressor, words)) for change in changes(now.trial.sample, words)]
        best = min(after.fit.score for _, after in tried)
        if now.fit.score - best < SCORE:
            break
        alike = [(change, after, doubts(after)) for change, after in tried if after.fit.score - best < TIE]
        fewest = min(doubt for *_, doubt in alike)
        alike = sorted(
            (correction for correction in alike if correction[2] == fewest),
            key=lambda correction: correction[1].fit.score,
        )
        at = choice if choices == 1 and choice < len(alike) else 0
        choices = max(choices, len(alike))
        alike.insert(0, alike.pop(at))
        change, chosen = alike[0][:2]
        if not np.any(chosen.fit.error <= HALVED * now.fit.error):
            break
        cause = _cause_of([change for change, *_ in alike], now.fit, chosen.fit, words)
        scaled = now.scaled or change.is_scale
        now = replace(chosen, causes=(*now.causes, cause), scaled=scaled)
    return now, choices


def changes(sample: Sample, words: Wording) -> Iterator[Change]:
    """Iterate over all hypotheses: units, signs, exchanged columns, clock."""
    n = sample.n
    unit = np.eye(n)
    turning = [i for i in range(n) if words.revolute[i]]
    if len(turning) > 1:
        for factor in ANGLES:
            D = np.diag([factor if i in turning else 1.0 for i in range(n)])
            yield Change(words.wrong_unit("position", turning, factor), "position", D)
    for i in range(n):
        for signal in SIGNALS:
            D = unit.copy()
            D[i, i] = -1.0
            yield Change(words.wrong_sign([signal], i), signal, D, turned=i)
        for factor in ANGLES if words.revolute[i] else THOUSANDS:
            D = unit.copy()
            D[i, i] = factor
            yield Change(words.wrong_unit("position", [i], factor), "position", D)
        for factor in THOUSANDS if n > 1 else ():
            D = unit.copy()
            D[i, i] = factor
            yield Change(words.wrong_unit("torque", [i], factor), "torque", D)
        for k in range(i + 1, n):
            P = unit.copy()
            P[[i, k]] = P[[k, i]]
            if words.revolute[i] == words.revolute[k]:
                yield Change(words.exchanged_columns("position", i, k), "position", P)
            yield Change(words.exchanged_columns("torque", i, k), "torque", P)
    for factor in THOUSANDS:
        yield Change(words.clock(factor), None, unit, slower=factor)


def _corrected_fit(change: Change, now: CorrectedSample, regressor: Regressor, words: Wording) -> CorrectedSample:
    """Apply the correction ``change`` to the sample ``now`` and fit the model again."""
    trial, mix, n = now.trial, now.mix, now.trial.sample.n
    if change.signal == "torque":
        N = _transmission(words, "torque", n)
        # rows: tau = tau_m N, so a change D of the motors' torques is inv(N) D' N on the right
        new = np.asarray(mix @ np.linalg.solve(N, change.matrix.T @ N))
        return CorrectedSample(trial, new, trial.fit(new))
    if change.signal == "position":
        N = _transmission(words, "position", n)
        zero = np.zeros(n) if words.mapping is None else np.array([joint.zero for joint in words.mapping.joints])
        moved = trial.sample.transform_motion(np.asarray(np.linalg.solve(N, change.matrix @ N)), zero)
    else:
        moved = trial.sample.stretch_time(change.slower)
    other = Trial(regressor, moved)
    return CorrectedSample(other, mix, other.fit(mix))


def _transmission(words: Wording, signal: Signal, n: int) -> Array:
    """Matrix (n, n) from joint to motor angles for a signal recorded at the motors; the identity for the joint side."""
    mapping = words.mapping
    if mapping is None or mapping.transmission is None:
        return np.eye(n)
    side = [c is not None and c.side == "motor" for c in (joint.channel(signal) for joint in mapping.joints)]
    if all(side):
        return np.asarray(mapping.transmission)
    return np.diag(np.where(side, np.diag(mapping.transmission), 1.0))


def _cause_of(alike: list[Change], before: Fit, after: Fit, words: Wording) -> Cause:
    """The cause behind the equally good corrections ``alike``; the decrease of the torque error is its evidence."""
    joints = [i for i in range(len(words.joints)) if after.error[i] <= HALVED * before.error[i]]
    fall = ", ".join(
        f"{words.joints[i]} from {100 * before.error[i]:.3g} % to {100 * after.error[i]:.2g} %" for i in joints
    )
    turned = {change.turned for change in alike}
    first = alike[0].turned
    if len(alike) == 2 and len(turned) == 1 and first is not None:
        cause = words.wrong_sign(["torque", "position"], first)
        return cause.because(f"with either of them turned the torque error of the fit falls: {fall}")
    cause = alike[0].cause.because(f"with it put right the torque error of the fit falls: {fall}")
    others = "; ".join(change.cause.cause for change in alike[1:])
    return cause.because(f"as well explained by: {others}") if others else cause
