"""Estimates inertia, gravity and friction of one joint from one recording: fits every friction law and chooses one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError
from rrrgen.lab.estimate.statistics import rms
from rrrgen.lab.friction.candidate_laws import DELAY, Candidate, candidates
from rrrgen.lab.friction.drift import Drift, friction_drift
from rrrgen.lab.friction.initial_values import LEAST_INERTIA, best_delay, growth_rate, sliding_samples, start_values
from rrrgen.lab.friction.joint_recording import JointData
from rrrgen.lab.friction.joint_simulation import Windows
from rrrgen.lab.friction.kalman_filter import kalman_estimates
from rrrgen.lab.friction.multiple_shooting import (
    Noise,
    ShootingFit,
    best_start,
    bootstrap,
    fit,
    likely_noise,
    make_noise,
    rigid_limit,
    window_losses,
)
from rrrgen.lab.friction.ripple import Ripple, find_ripples, without_ripples

# ------------------------------------------------------------------------------------------------------------------
# Warnings to the user: what a recording hardly tells about the friction of a joint, and what two models share.
# ------------------------------------------------------------------------------------------------------------------

EXTRAPOLATED = 1.0  # s: with less time of sliding below the Stribeck speed, stiction is an extrapolation
HARDLY = 0.02  # relative standard deviation of the inertia above which a note warns the user
UNEXPLAINED = 0.1  # torque error in sliding above which a note warns that no law fits
MISFIT = 1.6  # held-out error above which a note warns that the law is doubtful
LEFT = 1.35  # held-out error above which something is left to explain; true laws have 0.8 to 1.35
UNCERTAIN = 0.2  # relative standard deviation of another parameter above which a note warns the user
SMALL = 0.02  # times break-away: torque below which viscous friction does not matter
CERTAIN = 3.0  # standard deviations from zero from which on a difference counts
RESOLVED = 1.0  # encoder steps: bristles that bend by less are seen only through the motion that follows
CLOSE = 1.05  # times the held-out error of the chosen law: one up to this is as good

DETERMINED_BY = {
    **dict.fromkeys(("coulomb", "coulomb_p", "coulomb_n"), "steady motion in both directions determines it"),
    **dict.fromkeys(("viscous", "viscous_p", "viscous_n"), "fast motion determines it"),
    **dict.fromkeys(("stiction_excess", "stribeck_speed"), "slow reversals determine it"),
    **dict.fromkeys(("sigma0", "sigma1"), "slow reversals determine it, a recording below break-away does so better"),
}
"""The kind of motion that determines a parameter."""


def notes(chosen: LawEstimate, data: JointData) -> tuple[str, ...]:
    """Sentences on what the recording ``data`` of a joint determines poorly about the ``chosen`` law, or not at all."""
    sentences = []
    if chosen.torque_error > UNEXPLAINED:
        sentences.append(
            f"no law fits well: {100 * chosen.torque_error:.0f} % of the torque in sliding remain unexplained; check "
            "that the other joints stand still, and look for torque ripple, backlash or a limit cycle in the recording"
        )
    elif chosen.score.held_out > MISFIT:
        sentences.append(
            f"errors on windows that were not fitted are {chosen.score.held_out:.2g} times the noise: {chosen.name} is "
            "the best law tried, but does not describe rest and reversals; add slow reversals, which determine the law"
        )
    elif chosen.score.held_out > LEFT:
        sentences.append(
            f"errors on windows that were not fitted are {chosen.score.held_out:.3g} times the noise: something is "
            f"left that {chosen.name} does not describe, such as torque ripple or a flexible joint (`rrrgen experiment "
            "elastic-joints` estimates it); it can hide a part of the friction, which the deviations do not count"
        )
    if chosen.std["inertia"] > HARDLY * chosen.values["inertia"]:
        sentences.append("inertia is hardly determined: the joint accelerates too little; add a fast multisine")
    if "stribeck_speed" in chosen.values:
        slow = data.sliding & (np.abs(data.motion[1]) < chosen.values["stribeck_speed"])
        seconds = float(np.count_nonzero(slow)) * data.period
        if seconds < EXTRAPOLATED:
            sentences.append(
                f"the joint slides below the Stribeck speed for {seconds:.2g} s only: stiction_excess is extrapolated, "
                "and its deviation a lower bound; add slow reversals"
            )
    for name, advice in DETERMINED_BY.items():
        value, std = chosen.values.get(name), chosen.std.get(name, 0.0)
        # viscous friction may be next to none: then its torque has to be uncertain, too
        matters = "viscous" not in name or std * data.speed > SMALL * chosen.break_away
        if value is not None and std > UNCERTAIN * abs(value) and matters:
            sentences.append(f"{name} is hardly determined ({value:.3g} +- {std:.2g}): {advice}")
    return (*sentences, *_bristles(chosen, data), *_ambiguities(chosen))


def _bristles(chosen: LawEstimate, data: JointData) -> tuple[str, ...]:
    """Sentences on LuGre bristles that bend by less than an encoder step of ``data``, or carry nothing."""
    if "sigma0" not in chosen.values:
        return ()
    level = chosen.values["coulomb"] + chosen.values["stiction_excess"]
    if level <= 0.0:
        return (
            f"friction at rest, coulomb + stiction_excess, is estimated as {level:.2g}, which no bristles can have: "
            "the law does not hold near rest; the robot file gets the least positive value",
        )
    bend = level / chosen.values["sigma0"] / data.resolution
    if bend >= RESOLVED:
        return ()
    return (
        f"the bristles bend by {bend:.2g} encoder steps before the joint slides: the deviations of sigma0, sigma1 and "
        "stiction_excess are lower bounds; a finer encoder determines them, or a recording below break-away",
    )


def stiff_bristles(chosen: LawEstimate, laws: Sequence[LawEstimate], largest: float) -> tuple[str, ...]:
    """A sentence with a lower bound of the bristles' stiffness where the Stribeck law, of rigid contact, is chosen.

    The bound is the stiffness of the LuGre law among the estimated ``laws`` less three standard deviations, and at most
    ``largest``, N m/rad (N/m), which the sampling rate resolves. There is none if that law is clearly worse.
    """
    bent = next((law for law in laws if law.name == "lugre"), None)
    if chosen.name != "stribeck" or bent is None or bent.score.held_out > CLOSE * chosen.score.held_out:
        return ()
    value, std = bent.values["sigma0"], bent.std["sigma0"]
    bound = min(value * float(np.exp(-CERTAIN * std / value)), largest)
    return (
        f"LuGre friction with stiff bristles explains the recording as well (held-out error {bent.score.held_out:.3g}, "
        f"Stribeck {chosen.score.held_out:.3g}): it gives only a lower bound of sigma0, about {bound:.2g}",
    )


def _ambiguities(chosen: LawEstimate) -> tuple[str, ...]:
    """Sentences on another model that describes the recording equally well.

    An offset of the torque acts like a difference between the Coulomb torques of the two directions.
    """
    values, std = chosen.values, chosen.std
    if chosen.name == "coulomb_viscous" and abs(values.get("offset", 0.0)) > CERTAIN * std.get("offset", 0.0):
        up, down = (values["coulomb"] + s * values["offset"] for s in (1.0, -1.0))
        return (
            f"the offset can be one of the measured torque, or Coulomb friction of {up:.4g} forward and {down:.4g} "
            "backward (law asymmetric): the recording cannot tell these apart",
        )
    if chosen.name != "asymmetric":
        return ()
    if chosen.candidate.gravity == 1:
        return (
            "a constant force and a difference between coulomb_p and coulomb_n cannot be separated: gravity is the "
            "force for which the two are equal",
        )
    slopes = abs(values["viscous_p"] - values["viscous_n"])
    if slopes < CERTAIN * float(np.hypot(std["viscous_p"], std["viscous_n"])):
        offset = 0.5 * (values["coulomb_p"] - values["coulomb_n"])
        return (
            f"the directions differ in Coulomb friction alone: an offset of the measured torque of {offset:.4g} with "
            f"equal Coulomb friction (law coulomb_viscous) cannot be distinguished from that",
        )
    return ()


# ------------------------------------------------------------------------------------------------------------------
# Estimates inertia, gravity and friction of one joint from one recording
# ------------------------------------------------------------------------------------------------------------------

SCHEMA = "rrrgen-friction/1"
FIRST_RATIO = 100.0  # assumed ratio of torque noise to encoder noise, until it is estimated
FIRST_ITERATIONS = 6
REFITTED = 3  # iterations of a fit that leaves out one fold of the cross-validation
BRISTLES = 15  # iterations of the fit of the bristles' stiffness and damping
JOINT = 10  # iterations of the fit of all parameters of the LuGre law, which follows it
STIFFNESS_FACTORS = (0.1, 0.3, 1.0, 3.0, 10.0)  # the bristles' stiffness is tried at these multiples of its first guess
DAMPING_RATIOS = (0.05, 0.3)  # and their damping at these ratios to the critical one
LEAST_WINDOWS = 40
DISCRETE = 2e-4  # relative error of a simulation with steps of one sampling period; resampling does not reveal it
UNRELATED = 0.5  # relative error of the best least-squares fit above which torque and motion count as unrelated
FASTEST = 0.4  # frequency of an oscillation on bristles, in sampling rates, above which they count as rigid
WIDE = 1.0  # rad: range of motion that tells an offset of the torque from gravity, which is cos q and sin q
MIDDLE = (15.87, 84.13)  # percentiles of a normal distribution at one standard deviation from its mean
LARGEST_INERTIA_STD = 0.1  # relative: above it the recording is refused

Progress = Callable[[int, int, str], None]


@dataclass(frozen=True, eq=False)
class LawEstimate:
    """Estimate of the parameters of one friction law, with the inertia and gravity of the joint.

    ``theta`` (k,) are the parameters in the order of ``candidate``. ``values`` and their standard deviations ``std``
    are the reported ones, name -> value in SI. ``score`` is the error on windows that were not fitted, ``kalman`` the
    reported values of the Kalman filter, from which the output-error fit started. ``torque_error`` is
    ``|tau - model| / |tau|`` by inverse dynamics over the samples at which the joint slides.
    """

    candidate: Candidate
    theta: Array
    values: dict[str, float]
    std: dict[str, float]
    score: LawScore
    kalman: dict[str, float]
    torque_error: float

    @property
    def name(self) -> str:
        """Name of the law."""
        return self.candidate.name

    @property
    def break_away(self) -> float:
        """Break-away torque, N m (N): friction at rest, for the direction in which it is smaller.

        The neural law vanishes at rest; for it this is the largest torque at speeds at which its neurons saturate.
        """
        zero, columns = np.zeros(1), self.theta.tolist()
        if self.candidate.jumps or self.name == "lugre":
            return float(min(abs(self.candidate.torque(zero, columns, s)[0]) for s in (1.0, -1.0)))
        speeds = np.linspace(0.0, 1.0, 500) / max(self.values["w1"], self.values["w2"], self.values["w3"])
        return float(np.max(self.candidate.torque(3.0 * speeds, columns)))


@dataclass(frozen=True, eq=False)
class FrictionEstimate:
    """Friction estimates of one joint: all ``laws`` fitted to ``data``, and the ``chosen`` one.

    ``noise_ratio`` is the estimated ratio of torque noise to encoder noise, ``windows`` the number of windows into
    which the recording was cut, and ``notes`` are warnings to the user. ``data`` are without the ``drift`` of the
    friction, if there is one; the estimates are then those in the middle of the recording. They are also without the
    ``ripples`` of the torque over position.
    """

    data: JointData
    laws: tuple[LawEstimate, ...]
    chosen: LawEstimate
    noise_ratio: float
    windows: int
    notes: tuple[str, ...] = ()
    drift: Drift | None = None
    ripples: tuple[Ripple, ...] = ()

    def lines(self) -> list[str]:
        """The table of laws and the parameters of the chosen one as text."""
        lines = [
            f"joint {self.data.name}: {self.windows} windows, encoder steps of {self.data.resolution:.3g}",
            f"  {'law':<16} {'parameters':>10} {'held-out error':>15} {'BIC':>10} {'torque error':>13}",
        ]
        for law in self.laws:
            lines.append(
                f"{'*' if law is self.chosen else ' '} {law.name:<16} {len(law.theta):>10} "
                f"{law.score.held_out:>15.3f} {law.score.bic:>10.0f} {100 * law.torque_error:>11.2f} %"
            )
        lines.append("  held-out error in standard deviations of the noise; * chosen")
        values = self.chosen.values.items()
        lines += (f"  {name:<16} {value:>12.5g} +- {self.chosen.std[name]:.2g}" for name, value in values)
        return [*lines, *(f"  {'ripple':<16} {ripple.line}" for ripple in self.ripples)]

    def to_json(self) -> dict[str, Any]:
        """The estimate as plain data for ``results/friction.json``."""
        return {
            "schema": SCHEMA,
            "joint": self.data.name,
            "chosen": self.chosen.name,
            "models": {
                law.name: {
                    "parameters": law.values,
                    "std": law.std,
                    "held_out": law.score.held_out,
                    "bic": law.score.bic,
                    "torque_error": law.torque_error,
                    "kalman_filter": law.kalman,
                    "equation": law.candidate.equation,
                }
                for law in self.laws
            },
            "delay": self.chosen.values["delay"],
            "encoder_resolution": self.data.resolution,
            "sampling_period": self.data.period,
            "windows": self.windows,
            "noise_ratio": self.noise_ratio,
            "drift": None if self.drift is None else self.drift.to_json(),
            "ripples": [ripple.to_json() for ripple in self.ripples],
            "notes": list(self.notes),
        }


def estimate_friction(
    data: JointData,
    gravity: int,
    names: Sequence[str] = (),
    seed: int = 0,
    progress: Progress | None = None,
    revolute: bool = True,
) -> FrictionEstimate:
    """Estimate inertia, gravity and friction of one joint with every law, and choose one law.

    ``data`` is the recording. ``gravity`` is the number of gravity coefficients: 2 for a revolute joint, 1 for a
    prismatic one, 0 where gravity does not act; the torque may have an offset. ``revolute`` says which the joint is.
    ``names`` are the laws to try, all if empty. ``seed`` is that of the resampling for standard deviations;
    ``progress(done, total, message)`` is called between steps. Least squares on sliding samples give initial values for
    an extended Kalman filter (14.15), whose result is the initial value of the output-error fit over short windows.
    Raises :class:`DerivationError` if the motion does not determine inertia or friction.
    """
    tell = progress or (lambda done, total, message: None)
    tell(0, 0, "start values")
    wanted = {*names, "stribeck"} if "lugre" in names else set(names)  # LuGre slides as the Stribeck law does
    wide = float(np.ptp(data.q)) > WIDE
    laws = [law for law in candidates(gravity, wide) if not wanted or law.name in wanted]
    delay = best_delay(data, max(gravity, 1))
    drift = friction_drift(data, max(gravity, 1), delay)
    drift = None if drift is None or not drift.is_certain else drift
    if drift is not None:
        data = drift.remove_from(data)
    tell(0, 0, "torque ripple")
    ripples = find_ripples(data, max(gravity, 1), delay, revolute)
    if ripples:
        data = without_ripples(data, ripples, delay)
    started = {law.name: start_values(law, data, delay) for law in laws}
    _check_start(list(started.values()), data)
    least = {name: theta for name, (theta, _) in started.items()}
    filtered = _refine_by_kalman(laws, least, data, tell)
    work = _OutputError(laws, data, growth_rate(data, max(gravity, 1), delay), tell)
    full = work.fit_laws({law.name: (filtered[law.name], least[law.name]) for law in laws})
    inside = work.without_folds(full)
    sigma = min(shooting.sigma for shooting in full.values())
    estimates, scores = [], []
    for k, law in enumerate(laws):
        tell(k, len(laws), f"held-out error, {law.name}")
        scores.append(score(full[law.name], inside[law.name], work.whole, sigma))
        estimates.append(_estimate(full[law.name], scores[-1], work.windows(law), filtered[law.name], data, seed))
    best = choose(scores, work.whole.block)
    if _has_unresolved_bristles(full[laws[best].name], data):
        rigid = next(k for k, law in enumerate(laws) if law.name == "stribeck")
        limit = [rigid_limit(shooting, laws[rigid]) for shooting in (full[laws[best].name], *inside[laws[best].name])]
        rating = score(limit[0], limit[1:], work.whole, sigma)
        estimates[rigid] = _without_bristles(estimates[best], estimates[rigid], limit[0], rating)
        scores[rigid] = rating
        # rigid bristles are no law of their own: a simpler law than Stribeck's may describe the sliding as well
        others = [k for k in range(len(laws)) if k != best]
        best = others[choose([scores[k] for k in others], work.whole.block)]
    chosen = estimates[best]
    _check(chosen, data)
    largest = chosen.values["inertia"] * (2.0 * np.pi * FASTEST / data.period) ** 2
    if drift is not None:
        estimates = [replace(estimate, std=drift.widen_std(estimate.std)) for estimate in estimates]
        chosen = estimates[best]
    remarks = (
        *(() if drift is None else (drift.sentence,)),
        *(ripple.sentence for ripple in ripples),
        *notes(chosen, data),
        *stiff_bristles(chosen, estimates, largest),
    )
    return FrictionEstimate(data, tuple(estimates), chosen, work.noise.ratio, len(work.whole), remarks, drift, ripples)


class _OutputError:
    """Fits all laws by output error: the error of positions simulated over short windows of the recording.

    Inertia, gravity and friction are fitted to windows in which the joint slides. For the LuGre law, stiffness and
    damping of the bristles, then all parameters are fitted to all windows, with rest and reversals.
    """

    def __init__(self, laws: Sequence[Candidate], data: JointData, growth: Array, tell: Progress) -> None:
        self.laws, self.tell = laws, tell
        self.sliding, self.whole = data.sliding_windows(growth), data.windows(growth)
        if len(self.sliding) < LEAST_WINDOWS:
            raise DerivationError(
                f"joint '{data.name}' slides steadily in {len(self.sliding)} short stretches only: too little data to "
                "tell inertia and friction apart; record longer"
            )
        self.noise = self._noise(FIRST_RATIO)

    def _noise(self, ratio: float) -> Noise:
        return make_noise(len(self.sliding.measured), self.sliding.period * self.sliding.stride, ratio)

    def fit_laws(self, starts: dict[str, tuple[Array, ...]]) -> dict[str, ShootingFit]:
        """Fit all laws to the windows; returns the fits by the name of the law.

        ``starts`` holds for each law several initial parameter vectors (k,), of which the best is used. A few
        iterations with an assumed noise ratio come first; then the ratio is estimated from the errors.
        """
        first: dict[str, ShootingFit] = {}
        for k, law in enumerate(self._static):
            self.tell(k, 2 * len(self.laws), f"output error, {law.name}")
            better = best_start(law, starts[law.name], self.sliding, self.noise)
            first[law.name] = fit(law, better, self.sliding, self.noise, iterations=FIRST_ITERATIONS)
        best = min(first.values(), key=lambda shooting: float(np.sum(shooting.cost)) * shooting.sigma**2)
        self.noise = likely_noise(best, self.sliding)
        full: dict[str, ShootingFit] = {}
        for k, law in enumerate(self.laws):
            self.tell(len(self.laws) + k, 2 * len(self.laws), f"output error, {law.name}")
            if law.name in first:
                before = first[law.name]
                full[law.name] = fit(law, before.theta, self.sliding, self.noise, start=before.start)
            else:
                before = self._bristles(law, full["stribeck"], starts[law.name])
                full[law.name] = fit(law, before.theta, self.whole, self.noise, start=before.start, iterations=JOINT)
        return full

    def without_folds(self, full: dict[str, ShootingFit]) -> dict[str, list[ShootingFit]]:
        """Refit every law once for each fold of the windows, leaving this fold out, for cross-validation.

        ``full`` holds the fits to all windows, from which the refits start; returns the refits by law name.
        """
        refits: dict[str, list[ShootingFit]] = {law.name: [] for law in self.laws}
        for fold in range(FOLDS):
            for law in self.laws:
                before, windows = full[law.name], self.windows(law)
                kept = fold_of(windows) != fold
                again = fit(
                    law, before.theta, windows.of(kept), self.noise, start=before.start[:, kept], iterations=REFITTED
                )
                refits[law.name].append(again)
        return refits

    def windows(self, law: Candidate) -> Windows:
        """The windows to which ``law`` is fitted: all for a law with bristles, otherwise those in sliding."""
        return self.whole if law.has_bristles else self.sliding

    def _bristles(self, law: Candidate, sliding: ShootingFit, starts: Sequence[Array]) -> ShootingFit:
        """Fit stiffness and damping of the LuGre bristles to all windows; all else is taken from the fit ``sliding``.

        ``starts`` are initial parameters (k,) of the LuGre ``law``; of these and of multiples of their stiffness the
        best are used.
        """
        known = dict(zip(sliding.candidate.names, sliding.theta, strict=True))
        tried = []
        for start in starts:
            parameters = dict(zip(law.names, start, strict=True)) | known
            for factor, ratio in product(STIFFNESS_FACTORS, DAMPING_RATIOS):
                stiffness = factor * parameters["sigma0"]
                damping = 2.0 * ratio * float(np.sqrt(stiffness * parameters["inertia"]))
                bristles = {"sigma0": stiffness, "sigma1": damping}
                tried.append(law.clip(np.array([(parameters | bristles)[name] for name in law.names])))
        better = best_start(law, tried, self.whole, self.noise)
        return fit(law, better, self.whole, self.noise, held=tuple(known), iterations=BRISTLES)

    @property
    def _static(self) -> list[Candidate]:
        return [law for law in self.laws if law.name != "lugre"]


def _refine_by_kalman(
    laws: Sequence[Candidate], starts: dict[str, Array], data: JointData, tell: Progress
) -> dict[str, Array]:
    """Refine the parameters ``starts`` (law name -> (k,)) of all ``laws`` by the extended Kalman filter.

    The filter has no bristle state: the LuGre law gets the result of the Stribeck law, which is its friction in
    sliding, and keeps the initial stiffness and damping of its bristles.
    """
    static = [law for law in laws if law.name != "lugre"]
    estimates = kalman_estimates(
        static,
        [starts[law.name] for law in static],
        data,
        lambda done, total: tell(done, total, "Kalman filter"),
    )
    values = {law.name: result for law, result in zip(static, estimates, strict=True)}
    for law in laws:
        if law.name == "lugre":
            parameters = dict(zip(law.names, starts["lugre"], strict=True))
            sliding = next(candidate for candidate in static if candidate.name == "stribeck")
            parameters |= dict(zip(sliding.names, values["stribeck"], strict=True))
            values["lugre"] = law.clip(np.array([parameters[name] for name in law.names]))
    return values


def _estimate(
    shooting: ShootingFit,
    rating: LawScore,
    windows: Windows,
    kalman: Array,
    data: JointData,
    seed: int,
) -> LawEstimate:
    law = shooting.candidate
    spread = bootstrap(shooting, windows.block, seed)
    drawn = [reported_values(law, theta, data.period) for theta in spread.T]
    values = reported_values(law, shooting.theta, data.period)
    std = {name: _deviation(np.array([draw[name] for draw in drawn]), name) for name in values}
    # a relative error of the simulated torque also shifts what may be zero: offset, angle of gravity, delay
    scale = {"offset": float(rms(data.u)), "gravity_angle": 1.0, DELAY: data.period}
    std = {
        name: float(np.hypot(deviation, DISCRETE * scale.get(name, abs(values[name]))))
        for name, deviation in std.items()
    }
    samples = sliding_samples(data, float(shooting.theta[-1]))
    model = shooting.theta[0] * samples.ddq + law.gravity_torque(samples.q, shooting.theta)
    error = samples.tau - model - law.torque(samples.dq, shooting.theta)
    relative = float(np.linalg.norm(error) / np.linalg.norm(samples.tau))
    return LawEstimate(
        law,
        law.balance_coulomb(shooting.theta),
        values,
        std,
        rating,
        reported_values(law, kalman, data.period),
        relative,
    )


def reported_values(law: Candidate, theta: Array, period: float) -> dict[str, float]:
    """Parameters as they are reported, name -> value in SI: gravity as magnitude and angle, the delay in seconds.

    ``theta`` (k,) are those of the model ``law``, ``period`` is the sampling period (s).
    """
    given = dict(zip(law.names, law.balance_coulomb(theta).tolist(), strict=True))
    values = {"inertia": given["inertia"]}
    if law.gravity >= 2:
        cos, sin = given["gravity_cos"], given["gravity_sin"]
        values |= {"gravity": float(np.hypot(cos, sin)), "gravity_angle": float(np.arctan2(sin, cos))}
    if law.constant_coefficient is not None:
        values[law.constant] = given[law.constant_coefficient]
    values |= {name: given[name] for name in law.law_names}
    values["delay"] = given[DELAY] * period
    return values


def _has_unresolved_bristles(shooting: ShootingFit, data: JointData) -> bool:
    """Whether bristles are so stiff that the joint oscillates on them too fast for the sampling rate.

    Then the recording cannot tell them from rigid ones, and the law is that of its sliding friction.
    """
    if not shooting.candidate.has_bristles:
        return False
    given = dict(zip(shooting.candidate.names, shooting.theta.tolist(), strict=True))
    return float(np.sqrt(given["sigma0"] / given["inertia"])) * data.period > 2.0 * np.pi * FASTEST


def _without_bristles(bent: LawEstimate, rigid: LawEstimate, limit: ShootingFit, rating: LawScore) -> LawEstimate:
    """The estimate ``rigid`` of the law of sliding with the values of ``bent``, the same law with bristles.

    ``limit`` is the fit with these values, ``rating`` its score.
    """
    values, std = ({name: part[name] for name in rigid.values} for part in (bent.values, bent.std))
    return replace(rigid, theta=limit.theta, values=values, std=std, score=rating, torque_error=bent.torque_error)


def _deviation(values: Array, name: str) -> float:
    """Half the range of the middle 68 % of resampled ``values`` of the parameter ``name``: a standard deviation.

    An angle counts from its circular mean. Where a few stretches of the recording tell a parameter, some draws miss
    them all: their estimates are far off, and would determine the root mean square.
    """
    if name == "gravity_angle":
        values = np.angle(np.exp(1j * values) / np.mean(np.exp(1j * values)))
    low, high = np.percentile(values, MIDDLE)
    return 0.5 * float(high - low)


def _check_start(started: Sequence[tuple[Array, float]], data: JointData) -> None:
    """Raise :class:`DerivationError` if the torque is unrelated to the motion or has the wrong sign.

    ``started`` holds, for every law, the least-squares parameters and the relative torque error.
    """
    theta, error = min(started, key=lambda start: start[1])
    if error > UNRELATED or theta[0] <= LEAST_INERTIA:
        what = f"inertia, gravity and friction explain {100 * max(0.0, 1.0 - error):.0f} % of the torque"
        what += " with a negative inertia" if theta[0] <= LEAST_INERTIA else ""
        raise DerivationError(
            f"the torque of joint '{data.name}' does not belong to its motion: {what}; check column, sign and unit"
        )


def _check(chosen: LawEstimate, data: JointData) -> None:
    """Raise :class:`DerivationError` if the inertia is too uncertain, because the joint accelerates too little."""
    relative = chosen.std["inertia"] / chosen.values["inertia"]
    if not relative < LARGEST_INERTIA_STD:
        raise DerivationError(
            f"the motion of joint '{data.name}' does not determine its inertia (standard deviation "
            f"{100 * relative:.0f} %): it accelerates too little; add a fast multisine before the slow reversals "
            "(`rrrgen experiment excite --friction`)"
        )


# ------------------------------------------------------------------------------------------------------------------
# Choice of the friction law by errors on windows that were not fitted, and by the Bayesian information criterion.
# ------------------------------------------------------------------------------------------------------------------

FOLDS = 4
SIGNIFICANT = 2.0  # standard errors by which a law must be better on held-out windows
CLEAR = 1.5
MATERIAL = 0.05  # fraction of the other law's held-out loss by which it must be better, too


@dataclass(frozen=True, eq=False)
class LawScore:
    """Score of a friction ``law`` with k = ``parameters`` on the S windows, each left out of the fit that is scored.

    Windows with rest and velocity reversals are included. ``losses`` (S,) are robust squared position errors, whitened,
    in units of the noise variance; ``held_out`` is their root mean square, in standard deviations of the noise. ``bic``
    is the Bayesian information criterion ``N ln(mean loss) + k ln N`` of the fit to all windows.
    """

    law: str
    parameters: int
    held_out: float
    bic: float
    losses: Array


def fold_of(windows: Windows) -> NDArray[np.int64]:
    """Number of the cross-validation fold of each window, (S,).

    Consecutive blocks of windows go to the folds in turn, so that each fold has fast and slow motion.
    """
    return np.asarray(windows.block % FOLDS)


def score(full: ShootingFit, inside: Sequence[ShootingFit], windows: Windows, sigma: float) -> LawScore:
    """Score a friction law by cross-validation on ``windows``, with the noise standard deviation ``sigma``.

    ``full`` is the fit of the law to all windows; ``inside`` holds one fit per fold, which leaves this fold out.
    """
    losses, folds = np.empty(len(windows)), fold_of(windows)
    for fold, refit in enumerate(inside):
        out = folds == fold
        losses[out] = window_losses(refit.candidate, refit.theta, windows.of(out), refit.noise, sigma)
    full_losses = window_losses(full.candidate, full.theta, windows, full.noise, sigma)
    N, k = windows.points, len(full.theta)
    return LawScore(
        law=full.candidate.name,
        parameters=k,
        held_out=float(np.sqrt(np.sum(losses) / N)),
        bic=float(N * np.log(np.sum(full_losses) / N) + k * np.log(N)),
        losses=losses,
    )


def choose(scores: Sequence[LawScore], blocks: NDArray[np.int64]) -> int:
    """Choose a law: the one with the fewest parameters that no other law beats significantly on held-out windows.

    Returns its index in ``scores``; among laws with equally many parameters the BIC decides. ``blocks`` (S,) is the
    number of the block of each window. Law B beats law A if, over blocks, the mean difference of their losses exceeds
    :data:`SIGNIFICANT` standard errors and :data:`MATERIAL` times the loss of A. It also does if the loss of A is
    :data:`CLEAR` times that of B: in a short recording a few blocks can hold most of the loss, so that no difference
    would be significant.
    """
    standing = [i for i, a in enumerate(scores) if not any(_beats(b, a, blocks) for b in scores)]
    return min(standing or range(len(scores)), key=lambda i: (scores[i].parameters, scores[i].bic))


def _beats(b: LawScore, a: LawScore, blocks: NDArray[np.int64]) -> bool:
    groups = np.unique(blocks, return_inverse=True)[1]
    gains = np.bincount(groups, a.losses - b.losses)
    if len(gains) < 2:
        return False
    error = float(np.std(gains, ddof=1)) / np.sqrt(len(gains))
    mean = float(np.mean(gains))
    if float(np.sum(a.losses)) > CLEAR * float(np.sum(b.losses)):
        return True
    return mean > SIGNIFICANT * error and mean > MATERIAL * float(np.sum(a.losses)) / len(gains)
