"""Contact detection: thresholds for the residuals of the momentum observer, from recordings without contact."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.lab.data.kalman import KalmanMatrices, KalmanSmoother, tune_stretches
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.estimate.statistics import rms
from rrrgen.lab.identify.scores import UNEXPLAINED, not_explained

if TYPE_CHECKING:
    from rrrgen.runtime.model import Model


# ------------------------------------------------------------------------------------------------------------------
# Covariance of the residuals of contact-free motion, with which forces and their covariances are estimated.
#
# The errors of external torques are mostly those of the model: they have a mean, several joints share them, and they
# depend on the motion. Their covariance is therefore the second moment about zero, with all its entries, of residuals
# without contact, enlarged if the forces that these are taken for are larger than it predicts.
# ------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ResidualCovariance:
    """Covariance of external torques: ``matrix`` (n, n), (N m)^2 or N^2, with the factor ``enlarged`` in it."""

    matrix: Array
    enlarged: float

    @property
    def deviations(self) -> Array:
        """Root mean squares (n,) of the residuals, before the matrix was enlarged, N m or N."""
        return np.asarray(np.sqrt(np.diag(self.matrix) / self.enlarged))


def residual_covariance(residuals: Array, jacobians: Array) -> ResidualCovariance:
    """Covariance of the errors of external torques, from ``residuals`` (N, n) without contact, N m or N.

    ``jacobians`` (N, 6, n) are those of the tip. With the moment of one half of the recording, loads are estimated from
    the residuals of the other half: all torques as they are, forces from three joints on and wrenches from six. If
    their covariances P are right, the normalised squares e' inv(P) e are as large on average as e has entries; the
    largest ratio to that is the factor, or one. Raises InputError if the residuals of several joints depend on each
    other linearly.
    """
    n, half = residuals.shape[1], len(residuals) // 2
    halves = [(residuals[:half], jacobians[:half]), (residuals[half:], jacobians[half:])]
    moments = [_moment(r) for r, _ in halves]
    ratios = [
        np.mean([_mean_normalised_square(S, r, J[:, :rows]) for S, (r, J) in zip(moments[::-1], halves, strict=True)])
        for rows in (0, 3, 6)
        if rows <= n
    ]
    enlarged = max(1.0, *map(float, ratios))
    return ResidualCovariance(enlarged * _moment(residuals), enlarged)


def _moment(residuals: Array) -> Array:
    S = residuals.T @ residuals / len(residuals)
    if np.linalg.matrix_rank(S, hermitian=True) < len(S):
        raise InputError("the residuals of the joints are zero or depend on each other: no covariance can be found")
    return np.asarray(S)


def _mean_normalised_square(S: Array, residuals: Array, jacobians: Array) -> float:
    """Mean of e' inv(P) e over its expectation, for the loads e of ``jacobians`` (N, k, n) that the residuals give.

    With white residuals, e' inv(P) e is the square of their projection on the torques J'F of all loads; without rows,
    the loads are the torques themselves.
    """
    L = np.linalg.cholesky(S)
    white = np.linalg.solve(L, residuals.T).T
    rows = jacobians.shape[1]
    if not rows:
        return float(np.mean(white**2))
    directions = np.linalg.qr(np.linalg.solve(L, np.swapaxes(jacobians, 1, 2))).Q
    return float(np.mean(np.einsum("kji,kj->ki", directions, white) ** 2))


# ------------------------------------------------------------------------------------------------------------------
# Extreme-value statistics: the level that the block maxima of a signal exceed with a given small probability.
#
# The maxima of long blocks follow a Gumbel distribution, P(max <= x) = exp(-exp(-(x - mu)/beta)), if the tails of the
# signal are like those of a normal or an exponential distribution. The samples need not be independent, and their own
# distribution need not be known. The fitted distribution extrapolates to levels that the recording hardly reached. A
# multiple of the standard deviation would not do: the residuals of a moving arm are neither white nor normal. For
# exponential tails the exceedance probability is as stated; for normal tails, which fall faster, it is smaller.
# ------------------------------------------------------------------------------------------------------------------

EULER = 0.5772156649015329


@dataclass(frozen=True)
class Gumbel:
    """Gumbel distribution of the maximum of a residual over a block of samples.

    ``mu`` is its location and ``beta`` its scale, both in the unit of the residual.
    """

    mu: float
    beta: float

    def level(self, probability: float) -> float:
        """Level that the maximum of one block exceeds with the given ``probability``, in the unit of the residual."""
        return self.mu - self.beta * math.log(-math.log1p(-probability))


def fit_gumbel(maxima: Array) -> Gumbel:
    """Fit a Gumbel distribution to ``maxima`` (N,) by probability-weighted moments.

    With the sorted maxima x_(j), j = 1..N, b0 is their mean and b1 the mean of (j - 1)/(N - 1) x_(j); then
    beta = (2 b1 - b0)/ln 2 and mu = b0 - 0.5772 beta. The estimate needs no iteration and is less sensitive to a
    single outlier than maximum likelihood. Source: Landwehr, Matalas and Wallis (1979).
    """
    x = np.sort(np.asarray(maxima, float))
    b0, b1 = float(np.mean(x)), float(np.mean(np.arange(len(x)) / (len(x) - 1) * x))
    beta = (2.0 * b1 - b0) / math.log(2.0)
    return Gumbel(b0 - EULER * beta, beta)


def block_maxima(residuals: Array, samples: int) -> Array:
    """Largest magnitude of ``residuals`` (N, n) in each complete block of ``samples`` samples, (N // samples, n)."""
    blocks = len(residuals) // samples
    whole = np.abs(residuals[: blocks * samples]).reshape(blocks, samples, residuals.shape[1])
    return np.asarray(whole.max(axis=1))


# ------------------------------------------------------------------------------------------------------------------
# The C header ``<name>_contact.h``: what recordings without contact tell, as initializers of arrays.
# ------------------------------------------------------------------------------------------------------------------


def contact_header(name: str, findings: ContactFindings) -> str:
    """Text of the header of the robot ``name``.

    The emitted function ``<name>_contact`` takes the thresholds, ``<name>_external_force`` and
    ``<name>_external_wrench`` take the covariance.
    """
    macro = name.upper()
    limits, covariance = findings.thresholds, np.ravel(findings.covariance.matrix)
    return (
        f"/* {name}_contact.h: thresholds of contact detection, by rrrgen experiment contact-thresholds.\n *\n"
        f" *     static const {name}_real threshold[{macro}_N] = {macro}_CONTACT_THRESHOLDS;\n"
        f" *     static const {name}_real change_threshold[{macro}_N] = {macro}_CONTACT_CHANGE_THRESHOLDS;\n"
        f" *     static const {name}_real covariance[{macro}_N * {macro}_N] = {macro}_CONTACT_COVARIANCE;\n *\n"
        " * They hold for the observer pole, the period and the speed filter that they were found with.\n */\n"
        f"#ifndef {macro}_CONTACT_H\n#define {macro}_CONTACT_H\n\n"
        f"#define {macro}_CONTACT_THRESHOLDS {_c_array(limits.levels)} /* of the residuals, N m | N */\n"
        f"#define {macro}_CONTACT_CHANGE_THRESHOLDS {_c_array(limits.change_levels)} /* of their changes, N m | N */\n"
        f"#define {macro}_CONTACT_COVARIANCE {_c_array(covariance)} /* of the residuals, by rows */\n"
        f"#define {macro}_CONTACT_GAIN {findings.gain:.9g} /* pole of the momentum observer, 1/s */\n"
        f"#define {macro}_CONTACT_PERIOD {findings.period:.9g} /* s */\n\n#endif\n"
    )


def _c_array(values: Iterable[float]) -> str:
    return "{ " + ", ".join(f"{value:.9g}" for value in values) + " }"


# ------------------------------------------------------------------------------------------------------------------
# Residuals of the momentum observer along a recording, by the same discrete-time steps as on the controller.
#
# The residual r (n,) estimates the external torques at the joints; without contact it is noise and model error.
# ------------------------------------------------------------------------------------------------------------------

SETTLED = 1e-3
"""Residuals are used once the transients of the filters have decayed to this share of their initial size."""


def observer_residuals(
    model: Model, q: Array, tau: Array, period: float, filter: KalmanSmoother, gain: float, width: float
) -> Array:
    """External joint torques r (m, n), N m or N, estimated by the momentum observer from a recording.

    ``q`` (N, n) are the positions, rad or m, sampled with ``period`` (s); ``tau`` (N, n) the torques, N m or N, each
    held until the next sample. The causal Kalman ``filter`` computes the speeds. ``gain`` is the pole of the observer
    (1/s), ``width`` the speed below which friction is smoothed (rad/s or m/s). The initial samples, in which the
    filters settle, are left out, so m < N.
    """
    motion = filter(period * np.arange(len(q)), q)
    p, ct, g = model.momentum_terms(motion.q, motion.dq)
    u = ct - g - model.smooth_friction(motion.dq, model.friction_parameters, width)
    y = np.diff(p, axis=0) / period - tau[:-1] - 0.5 * (u[1:] + u[:-1])
    start = filter.memory(period) + math.ceil(-math.log(SETTLED) / (gain * period))
    return first_order_lag(y, math.exp(-gain * period))[start:]


def first_order_lag(y: Array, alpha: float) -> Array:
    """First-order low-pass filter ``r_k = alpha r_(k-1) + (1 - alpha) y_k`` along the first axis, starting at r = 0."""
    from scipy.signal import lfilter

    return np.asarray(lfilter([1.0 - alpha], [1.0, -alpha], y, axis=0))


def changes(r: Array, period: float, gain: float) -> Array:
    """Changes h (N, n) of residuals ``r`` (N, n) for contact detection, starting at zero; N m or N.

    ``h_k = alpha^2 h_(k-1) + alpha (r_k - r_(k-1))`` with alpha = exp(-gain period), as in the emitted function
    ``contact``: the residual of an observer with twice the pole ``gain`` (1/s), minus r.
    """
    from scipy.signal import lfilter

    alpha = math.exp(-gain * period)
    return np.asarray(lfilter([alpha], [1.0, -alpha * alpha], np.diff(r, axis=0, prepend=r[:1]), axis=0))


def step_responses(matrices: Sequence[KalmanMatrices], gain: float, seconds: float) -> Array:
    """Step responses (N, n) of the residuals to a unit external torque at each joint, from the next sample on.

    ``matrices`` are those of the Kalman filter of each joint, ``gain`` is the pole of the observer (1/s), ``seconds``
    the length of the responses. A constant torque gives a constant acceleration: the Kalman filter measures a
    parabola, and the observer low-pass filters the change of the estimated speed.
    """
    responses: list[Any] = []
    for kalman in matrices:
        count = max(2, round(seconds / kalman.period))
        x, speed, speeds = np.zeros(3), 0.0, np.empty(count)
        for k in range(count):
            measured = 0.5 * ((k + 1) * kalman.period) ** 2
            x = x + kalman.k * (measured - x[0])
            speeds[k], speed = (x[1] - speed) / kalman.period, x[1]
            x = kalman.E @ x
        responses.append(first_order_lag(speeds, math.exp(-gain * kalman.period)))
    return np.stack(responses, axis=1)


# ------------------------------------------------------------------------------------------------------------------
# Thresholds of contact detection for a given rate of false alarms, and the detection delay that results.
# ------------------------------------------------------------------------------------------------------------------

FEWEST_BLOCKS = 30
"""Smallest number of block maxima; with fewer, the scale of their distribution is uncertain by more than 20 %."""


@dataclass(frozen=True)
class ContactThresholds:
    """Thresholds of the observer residuals and of their changes, N m or N, above which a contact is reported.

    ``levels`` (n,) are those of the residuals, ``change_levels`` (n,) those of their changes, ``distributions`` and
    ``change_distributions`` the fitted distributions of the block maxima of each joint. ``block`` is the length of a
    block (s), ``blocks`` their number, ``seconds_per_alarm`` the mean time between false alarms of all joints together.
    """

    levels: tuple[float, ...]
    change_levels: tuple[float, ...]
    distributions: tuple[Gumbel, ...]
    change_distributions: tuple[Gumbel, ...]
    block: float
    blocks: int
    seconds_per_alarm: float

    def to_json(self) -> dict[str, Any]:
        """Plain data about the thresholds, in the form written to contact.json."""
        return asdict(self)


def contact_thresholds(
    residuals: Sequence[Array], period: float, gain: float, seconds_per_alarm: float = 3600.0, block: float = 1.0
) -> ContactThresholds:
    """Compute thresholds that give one false alarm in ``seconds_per_alarm`` (s) on average, from contact-free motion.

    ``residuals`` are those of the momentum observer with the pole ``gain`` (1/s), N m or N, in uninterrupted stretches
    (N_i, n) sampled with ``period`` (s). For each joint Gumbel distributions are fitted to the largest magnitudes of
    the residual and of its change in blocks of ``block`` s; all of them get an equal share of the false alarms. Raises
    InputError for fewer than :data:`FEWEST_BLOCKS` blocks.
    """
    samples = round(block / period)
    if samples < 1 or not seconds_per_alarm > block:
        raise InputError(f"a block of {block:g} s is no longer than a sample, or the time between alarms is no longer")
    stretches = [np.asarray(stretch, float) for stretch in residuals]
    pairs = [np.hstack([r, changes(r, period, gain)]) for r in stretches]
    maxima = np.concatenate([block_maxima(pair, samples) for pair in pairs])
    if len(maxima) < FEWEST_BLOCKS:
        raise InputError(
            f"{len(maxima)} blocks of {block:g} s without contact are too few: record at least "
            f"{FEWEST_BLOCKS * block:g} s of the motion that the controller will do"
        )
    fitted = tuple(fit_gumbel(column) for column in maxima.T)
    probability = -math.expm1(-block / seconds_per_alarm / len(fitted))
    levels, n = tuple(distribution.level(probability) for distribution in fitted), len(fitted) // 2
    return ContactThresholds(levels[:n], levels[n:], fitted[:n], fitted[n:], block, len(maxima), seconds_per_alarm)


@dataclass(frozen=True)
class Detection:
    """Expected detection of a contact force over many poses and directions.

    ``force`` is its size (N), ``median`` and ``ninth`` are the median and the 90 % quantile of the detection delay (s),
    infinite where contacts are missed; ``missed`` is the fraction of contacts that are never detected.
    """

    force: float
    median: float
    ninth: float
    missed: float

    def sentence(self) -> str:
        """Describe the detection delay in one sentence for the user."""
        if not math.isfinite(self.median):
            return f"{self.force:g} N at the tip: most contacts are missed ({100 * self.missed:.0f} %)"
        ninth = f"{1e3 * self.ninth:.1f} ms" if math.isfinite(self.ninth) else "never"
        return (
            f"{self.force:g} N at the tip: detected after {1e3 * self.median:.1f} ms (median), {ninth} (90 %); "
            f"{100 * self.missed:.1f} % missed"
        )


def expected_detection(
    thresholds: ContactThresholds,
    jacobians: Array,
    responses: Array,
    period: float,
    gain: float,
    force: float,
    seed: int = 0,
) -> Detection:
    """Predict how fast a constant force at the tip, in a random direction, exceeds one of the ``thresholds``.

    ``jacobians`` (N, 6, n) are those of the tip at the poses considered; ``responses`` (K, n) the step responses of the
    residuals to a unit external torque, sampled with ``period`` (s); ``gain`` is the pole of the observer (1/s),
    ``force`` the size of the force (N), ``seed`` that of the random directions. Residual noise is neglected.
    """
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(len(jacobians), 3))
    direction *= force / np.linalg.norm(direction, axis=1, keepdims=True)
    torques = np.abs(np.einsum("kij,ki->kj", jacobians[:, :3], direction))
    delays = np.full(len(torques), np.inf)
    fast = changes(np.vstack([0.0 * responses[:1], responses]), period, gain)[1:]
    both = ((responses, thresholds.levels), (fast, thresholds.change_levels))
    for response, levels in both:
        reached = np.maximum.accumulate(response, axis=0)
        for joint, level in enumerate(levels):
            with np.errstate(divide="ignore"):
                first = np.searchsorted(reached[:, joint], level / torques[:, joint], side="right")
            delays = np.minimum(delays, np.where(first < len(reached), (first + 1) * period, np.inf))
    missed = float(np.mean(np.isinf(delays)))
    median, ninth = (float(v) for v in np.quantile(delays, (0.5, 0.9), method="higher"))
    return Detection(force, median, ninth, missed)


# ------------------------------------------------------------------------------------------------------------------
# What recordings without contact tell: thresholds, covariance of the residuals, and the delay of detection.
# ------------------------------------------------------------------------------------------------------------------

SAMPLES = 20_000
"""Number of samples, evenly spread over the recordings, from which the covariance is found."""

POSES = 1000
"""Number of poses, evenly spread over the recordings, at which the detection delay is computed."""

LONGEST_DELAY = 0.5
"""A contact that is not detected within this time counts as missed, s."""


@dataclass(frozen=True)
class ContactFindings:
    """What recordings with the sampling ``period`` (s), made without contact, tell about contacts.

    ``detection`` tells how fast a force at the tip exceeds the ``thresholds``; ``covariance`` is that of the residuals,
    ``shares`` (n,) are their RMS over that of the torques.
    """

    thresholds: ContactThresholds
    covariance: ResidualCovariance
    detection: Detection
    gain: float
    period: float
    shares: tuple[float, ...]

    def notes(self, joints: Sequence[str]) -> list[str]:
        """Sentences on ``joints`` whose torques the model of the arm explains badly."""
        bad = {name: share for name, share in zip(joints, self.shares, strict=True) if not share <= UNEXPLAINED}
        return [not_explained(f"the torques of {', '.join(bad)} are not explained", bad.values())] if bad else []

    def to_json(self) -> dict[str, Any]:
        """Plain data, in the form written to contact.json."""
        return self.thresholds.to_json() | {
            "covariance": self.covariance.matrix,
            "covariance_enlarged": self.covariance.enlarged,
            "gain": self.gain,
            "period": self.period,
            "residuals_over_torques": self.shares,
            "detection": self.detection.__dict__,
        }


def findings_of_recordings(
    model: Model,
    recordings: Sequence[Log],
    tuning: Sequence[tuple[float, float]] | None,
    gain: float,
    width: float,
    seconds_per_alarm: float,
    block: float,
    force: float,
) -> ContactFindings:
    """Compute contact thresholds from contact-free recordings, and how fast they detect a contact force.

    ``model`` is the compiled robot. ``tuning`` holds, for each joint, the variances of position noise and of jerk for
    the Kalman filter that computes the speeds; None estimates them. ``gain`` is the pole of the momentum observer
    (1/s), ``width`` the speed below which friction is smoothed (rad/s or m/s), ``seconds_per_alarm`` the wanted mean
    time between false alarms (s), ``block`` the length of the blocks whose maxima are taken (s), ``force`` the contact
    force at the tip (N). Samples with unusable torques split a recording.

    Raises InputError for recordings that have no torques, have different periods or are too short.
    """
    periods = {round(recording.period, 12) for recording in recordings}
    if len(periods) > 1:
        raise InputError("the recordings have different sampling periods: thresholds hold for one")
    period = recordings[0].period
    stretches = [piece for recording in recordings for piece in _usable(recording)]
    if not stretches:
        raise InputError("no stretch of the recordings has usable torques of all joints")
    if tuning is None:
        tuned = tune_stretches([q for q, _ in stretches], period)
        kalman = KalmanSmoother(tuned.var_eta, tuned.var_xi, smooth=False)
    else:
        kalman = KalmanSmoother(tuple(eta for eta, _ in tuning), tuple(xi for _, xi in tuning), smooth=False)
    residuals = [observer_residuals(model, q, tau, period, kalman, gain, width) for q, tau in stretches]
    thresholds = contact_thresholds(residuals, period, gain, seconds_per_alarm, block)
    r = np.concatenate(residuals)
    q = np.concatenate([q[len(q) - len(r) :] for (q, _), r in zip(stretches, residuals, strict=True)])
    every = max(1, len(q) // SAMPLES)
    J = model.jacobian(q[::every])
    responses = step_responses(kalman.matrices(period, model.n), gain, LONGEST_DELAY)
    detection = expected_detection(thresholds, J[:: max(1, len(J) // POSES)], responses, period, gain, force)
    size = rms(np.concatenate([tau for _, tau in stretches]), axis=0)
    shares = rms(r, axis=0) / np.maximum(size, np.finfo(float).tiny)
    covariance = residual_covariance(r[::every], J)
    return ContactFindings(thresholds, covariance, detection, gain, period, tuple(shares.tolist()))


def _usable(recording: Log) -> list[tuple[np.ndarray, np.ndarray]]:
    """Positions and torques, (m, n) each, of the uninterrupted stretches where the torques of all joints are valid."""
    pieces = []
    for part in recording.parts():
        if part.tau is None:
            raise InputError("contact detection needs recorded torques")
        good = np.concatenate([[False], np.all(part.valid, axis=1), [False]])
        edges = np.flatnonzero(np.diff(good.astype(int)))
        pieces += [(part.q[a:b], part.tau[a:b]) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a > 2]
    return pieces
