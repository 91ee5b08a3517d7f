"""Checks for friction, quantisation and other nonlinear behaviour, which the error band of a response does not show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.response.local_polynomial import (
    LEAST_ROUGHNESS,
    LineEstimates,
    between_harmonics,
    regress_window,
    remove_smooth,
    rough_power,
    spectrum,
    whole_periods,
)
from rrrgen.lab.response.response_file import ResponseRecording
from rrrgen.lab.response.response_model import Complex

NEIGHBOURS = 4  # lines at either side through which a smooth curve is fitted
LARGEST_RATIO = 1.5  # largest ratio of total to noise variance
LARGEST_SCATTER = 1.65  # the same for lines between harmonics, where the smooth curve has an error of its own
COUNTED = 1000.0  # largest ratio to noise that is printed: simulated recordings without noise have round-off below it
LARGEST_PART_RATIO = 5.0  # the same for a sixth of the lines, where the ratio is less certain
MATERIAL = 0.01  # distortion below this share of the response is negligible
PARTS = 6  # number of parts of the band that are checked separately, at most, with
LEAST_PART = 50  # lines each at least: a resonance bends the response over a dozen lines
ORDERS = (2, 4)  # orders of the smooth curves
PART = 50  # lines at either side over which the scatter of a line is estimated
QUANTILE = 0.3  # share of the lines, those nearest to the smooth curve, that are used: near resonances it fits badly


@dataclass(frozen=True)
class Caution:
    """One reason not to trust a response as a whole: its ``kind``, and the ``measure`` that exceeds its ``limit``.

    ``message`` says so in words, for the user.
    """

    kind: str
    measure: float
    limit: float
    message: str


def times(ratio: float) -> str:
    """A ratio to noise in words; beyond :data:`COUNTED` it says how little noise there is, and no number means more."""
    return f"{ratio:.1f} times" if ratio <= COUNTED else f"more than {COUNTED:g} times"


def check_repetition(lines: LineEstimates, P: Complex, variance: Array) -> tuple[Caution | None, float]:
    """Check whether a periodic response scatters from harmonic to harmonic more than noise explains.

    Noise is estimated between the harmonics. A part that repeats with every period, but jumps from harmonic to
    harmonic, is distortion, for example by friction at reversals or by an encoder that rounds every period in the same
    way. Also returns the ratio of the total to the noise variance.
    """
    if len(P) < 8 * NEIGHBOURS:
        return None, np.nan
    # a curve that bends at a resonance fits one of the orders better, scatter none
    overall, worst = np.min([_scatter_of(lines, P, variance, order) for order in ORDERS], axis=0).tolist()
    apart = int(np.median(np.diff(lines.line))) > 1  # the lines are further apart, so the smooth curve fits less well
    limits = (
        (overall, 2.0 * LARGEST_SCATTER if apart else LARGEST_SCATTER),
        (0.0 if apart else worst, LARGEST_PART_RATIO),
    )
    for measure, limit in limits:
        if measure > limit and worst > LARGEST_RATIO:
            message = (
                f"the response scatters from harmonic to harmonic {times(measure)} as much as its noise "
                f"(limit {limit}): friction at changes of direction, quantisation that repeats every period, "
                "or a limit of torque"
            )
            return Caution("distortion", measure, limit, message), overall
    return None, overall


def _scatter_of(lines: LineEstimates, P: Complex, variance: Array, order: int) -> tuple[float, float]:
    """Scatter over noise of all lines, and of the part of the band where it is largest (0 where it is immaterial)."""
    ratio, misfit = _scatter(lines, P, variance, order)
    parts = np.array_split(np.arange(len(ratio)), int(np.clip(len(ratio) // LEAST_PART, 1, PARTS)))
    rough = [
        float(_relative_quantile(ratio[part], QUANTILE, lines.dof[0]))
        for part in parts
        if np.median(misfit[part]) > MATERIAL
    ]
    return float(_relative_quantile(ratio, 0.5, lines.dof[0])), max(rough, default=0.0)


def scatter_ratio(lines: LineEstimates, P: Complex, variance: Array) -> Array:
    """Total over noise variance (L,) of a periodic response, at least 1, from its scatter from harmonic to harmonic.

    A force that repeats with the excitation, for example of a joint that turns round for a few samples, scatters the
    response more than the noise between the harmonics. Below the limits of :func:`check_repetition` the response can be
    used, with a variance that is larger by this ratio. It is the median over :data:`PART` lines at either side.
    """
    if len(P) < 8 * NEIGHBOURS:
        return np.ones(len(P))
    ratio = np.stack([_scatter(lines, P, variance, order)[0] for order in ORDERS])
    size = min(2 * PART + 1, ratio.shape[1])
    windows = np.lib.stride_tricks.sliding_window_view(ratio, size, axis=1)
    medians = _relative_quantile(windows, 0.5, lines.dof[0]).min(
        axis=0
    )  # a curve that bends fits one better, scatter none
    before = (len(P) - len(medians)) // 2
    return np.asarray(np.maximum(np.pad(medians, (before, len(P) - len(medians) - before), mode="edge"), 1.0))


def _relative_quantile(ratio: Array, share: float, dof: float) -> Array:
    """The quantile at ``share`` of ``ratio`` (.., lines), divided by that of F(2, 2 dof); one for each window (..).

    The ratios are squared errors over their variances.

    F(2, 2 dof) is the distribution for noise alone, so that the result is 1 for noise alone.
    """
    from scipy.stats import f as f_distribution

    return np.asarray(np.quantile(ratio, share, axis=-1) / f_distribution.ppf(share, 2, 2 * dof))


def _scatter(lines: LineEstimates, P: Complex, variance: Array, order: int) -> tuple[Array, Array]:
    """Distances of the lines from polynomials of an ``order`` through their neighbours, as two arrays (lines,).

    The first are squared and divided by the variance of the noise, the second relative to the magnitude of P. The
    outermost :data:`NEIGHBOURS` lines at either end are left out.
    """
    shape = P * lines.frequency**2  # without the slope of a double integrator
    spread = variance * lines.frequency**4
    index = np.arange(NEIGHBOURS, len(P) - NEIGHBOURS)
    offsets = np.arange(-NEIGHBOURS, NEIGHBOURS + 1)
    inner = index[:, None] + offsets
    position = (lines.line[inner] - lines.line[index][:, None]) / NEIGHBOURS
    basis = position[:, :, None] ** np.arange(order + 1)
    hat = np.linalg.pinv(basis)[:, 0]
    fitted = np.einsum("lr,lr->l", hat, shape[inner])
    leverage = hat[:, NEIGHBOURS]
    misfit = np.abs(shape[index] - fitted)
    expected = np.einsum("lr,lr->l", hat**2, spread[inner]) + (1.0 - 2.0 * leverage) * spread[index]
    return misfit**2 / expected, misfit / np.abs(shape[index])


def check_detection_lines(
    record: ResponseRecording, lines: LineEstimates, P: Complex, samples: int
) -> tuple[Caution | None, dict[str, float]]:
    """Check for distortion at the harmonics within the band that the excitation leaves out (detection lines).

    At these lines ``Q - P U`` is noise for a linear plant, with P interpolated between neighbouring lines. The figures
    are returned separately for odd and even harmonics; empty where no harmonic is left out.
    """
    rows, M = whole_periods(record, samples)
    F = np.fft.fft(rows - rows.mean(axis=0), axis=0)
    left_out = np.setdiff1d(np.arange(lines.line[0], lines.line[-1] + 1), lines.line)
    if len(left_out) < 8:
        return None, {}
    slope = lines.line.astype(float) ** 2
    between = [np.interp(left_out, lines.line, part) / left_out**2.0 for part in ((P * slope).real, (P * slope).imag)]
    at = between[0] + 1j * between[1]
    T, V, leverage, dof = between_harmonics(F[:, 1:], left_out, M)
    weights = np.stack([-at, np.ones_like(at)], axis=1)
    noise = (1.0 + leverage) * np.einsum("la,lab,lb->l", weights, V, weights.conj()).real
    here = np.abs(np.sum(weights * (F[left_out * M, 1:] - T), axis=1)) ** 2
    # distortion of the same size, relative to the signal at the excited lines around
    signal = np.interp(left_out, lines.line, np.abs(P * F[lines.line * M, 1]))
    ratios: dict[str, float] = {}
    worst: Caution | None = None
    for name, chosen in (("even", left_out % 2 == 0), ("odd", left_out % 2 == 1)):
        if np.count_nonzero(chosen) < 8:
            continue
        ratio = float(_relative_quantile(here[chosen] / noise[chosen], 0.5, dof))
        ratios[name] = ratio
        size = float(np.median(np.sqrt(here[chosen]) / signal[chosen]))
        if ratio > LARGEST_RATIO and size > MATERIAL and (worst is None or ratio > worst.measure):
            message = f"at the {name} harmonics left out there is {times(ratio)} the noise (limit {LARGEST_RATIO})"
            worst = Caution("distortion", ratio, LARGEST_RATIO, message + ": the plant is not linear")
    return worst, ratios


# ------------------------------------------------------------------------------------------------------------------
# Checks of a recording for Coulomb friction at a velocity that changes its sign, and for an input that is limited.
#
# Such friction biases a response, which confidence bands do not show. The model is ``Q = P (U - f S)`` with S the
# spectrum of sgn(velocity). The part of S that is uncorrelated with the excitation n acts as an independent input,
# from which the coefficient f is estimated over all lines. The part correlated with n biases P by ``f G_s/G_u``.
#
# A limit of torque or current acts alike, with the cube of u in the place of the sign.
# ------------------------------------------------------------------------------------------------------------------

MATERIAL_BIAS = 0.002  # bias above this share of the response counts; the scatter by friction is larger than its bias
MATERIAL_FORCE = 0.01  # friction above this share of the input's root mean square counts
SIGNIFICANT = 5.0  # standard deviations from zero at which the friction coefficient is significant
SLOW_SHARE = 0.01  # least share of the samples that must move in the other direction for a reversal to count
NOISE_SHARE = 0.001  # the same where the excitation is noise, since no scatter from harmonic to harmonic shows friction
FRICTION_WINDOW = 6  # lines at either side in a window
SMOOTHING = 11  # samples in the window of the polynomial that differentiates the output
SLOW_PART = 20  # velocities are averaged over the recording's length divided by this, to find slow reversals


@dataclass(frozen=True)
class _Force:
    """An estimate of friction.

    ``force`` is in units of the input, ``certain`` is the force in standard deviations, and ``bias`` the relative bias
    of P that 90 % of the lines do not exceed.
    """

    force: float
    certain: float
    bias: float = 0.0


def check_friction(record: ResponseRecording, samples: int | None, lines: LineEstimates, P: Complex) -> Caution | None:
    """Check whether part of the input overcomes Coulomb friction at a velocity that changes its sign.

    ``samples`` is the period of the excitation (None: noise), ``P`` (L,) the response at ``lines``. Returns a finding
    against the recording where friction biases the response or the joint reverses its motion; otherwise None.
    """
    from scipy.signal import savgol_filter

    if len(record.q) < 40 * FRICTION_WINDOW:
        return None
    velocity = savgol_filter(record.q, SMOOTHING, 2, deriv=1)
    back = _share_back(velocity)
    if back < (NOISE_SHARE if samples is None else SLOW_SHARE):
        return None
    width = samples or len(velocity) // SLOW_PART
    turns = _share_back(np.convolve(velocity, np.ones(width) / width, "valid")) >= SLOW_SHARE
    sign = np.sign(velocity)
    estimates = [_of_noise(record, sign) if samples is None else _of_periods(record, sign, samples)]
    if samples is not None and turns:
        estimates.append(_between_harmonics(record, sign, samples, lines, P))
    large = MATERIAL_FORCE * float(np.std(record.u))
    for estimate in estimates:
        if estimate is None or estimate.certain <= SIGNIFICANT:
            continue
        if estimate.bias <= MATERIAL_BIAS and not (turns and abs(estimate.force) > large):
            continue
        harm = f"friction biases the response by up to {100 * estimate.bias:.1f} % and scatters it"
        if estimate.bias <= MATERIAL_BIAS:
            harm = "the joint turns round in the recording, and friction there is no part of a linear response"
        message = (
            f"the velocity changes sign ({100 * back:.0f} % of the samples go back), and with it "
            f"a force of {abs(estimate.force):.3g} in units of the input "
            f"({estimate.certain:.0f} deviations from none): {harm}; move the joint so fast that it never turns"
        )
        return Caution("friction", estimate.certain, SIGNIFICANT, message)
    return None


def check_limits(record: ResponseRecording) -> Caution | None:
    """Check whether an input of noise acts less than in proportion where it is large, as behind a limit of torque.

    Such a limit lowers the response at all lines alike, within a narrow band. The cube of the input enters without its
    part in proportion to the input. Returns a finding against the recording, or None.
    """
    if len(record.u) < 40 * FRICTION_WINDOW:
        return None
    u = record.u - record.u.mean()
    power = float(np.mean(u**2))
    cube = u**3 / power - float(np.mean(u**4)) / power**2 * u
    estimate = _of_noise(record, cube)
    if (
        estimate is None
        or estimate.certain <= SIGNIFICANT
        or abs(estimate.force) * np.std(cube) <= MATERIAL_FORCE * np.std(u)
    ):
        return None
    message = (
        "the input acts less than in proportion where it is large "
        f"({estimate.certain:.0f} deviations from proportion): a limit of torque or current; record the input after "
        "the limit, or excite less"
    )
    return Caution("limit", estimate.certain, SIGNIFICANT, message)


def _share_back(velocity: Array) -> float:
    """Share of the samples in which the joint moves in its less frequent direction."""
    return float(min(np.mean(velocity > 0.0), np.mean(velocity < 0.0)))


def _of_noise(record: ResponseRecording, sign: Array) -> _Force | None:
    return _beside_excitation(spectrum(np.column_stack([record.n, record.u, record.q, sign])))


def _of_periods(record: ResponseRecording, sign: Array, samples: int) -> _Force | None:
    """Estimate the friction force from the mean period of the recording."""
    rows, signs, M = _with_sign(record, sign, samples)
    both = np.hstack([rows, signs]).reshape(M, samples, 4).mean(axis=0)
    return _beside_excitation(np.fft.fft(both - both.mean(axis=0), axis=0))


def _with_sign(record: ResponseRecording, sign: Array, samples: int) -> tuple[Array, Array, int]:
    rows, M = whole_periods(record, samples)
    signed = ResponseRecording(record.name, record.period, sign, record.u, record.q)
    return rows, whole_periods(signed, samples)[0][:, :1], M


def _beside_excitation(F: Complex) -> _Force | None:
    """Estimate the friction force from the spectra ``F`` (lines, 4) of n, u, q and sgn(velocity).

    Within windows of neighbouring lines the responses to n are smooth and can be removed.
    """
    power = np.abs(F[: len(F) // 2, 0])
    active = np.flatnonzero(power > 0.03 * power[1:].max())
    width = FRICTION_WINDOW
    k = np.arange(max(width, active[0]), min(len(F) // 2 - width, active[-1]), 2 * width + 1)
    if len(k) < 4:
        return None
    around = F[k[:, None] + np.arange(-width, width + 1)]
    n = around[:, :, 0]  # where it is smooth there is leakage alone, beside the band, and no response can be found
    around = around[rough_power(n) > LEAST_ROUGHNESS * np.mean(np.abs(n) ** 2, axis=1)]
    if len(around) < 4:
        return None
    G, residual, _, dof = regress_window(around[:, :, :1], around[:, :, 1:])
    P = (G[:, 1] / G[:, 0])[:, None]
    force, certain = _coefficient(residual[:, :, 1] - P * residual[:, :, 0], -P * residual[:, :, 2], dof)
    return _Force(force, certain, float(np.quantile(np.abs(force * G[:, 2] / G[:, 0]), 0.9)))


def _between_harmonics(
    record: ResponseRecording, sign: Array, samples: int, lines: LineEstimates, P: Complex
) -> _Force | None:
    """Estimate the friction force from the lines between the harmonics.

    At these lines sgn(velocity) has a part only if the joint does not reverse in every period alike.
    """
    rows, signs, M = _with_sign(record, sign, samples)
    both = np.hstack([rows[:, 1:], signs])
    residual, dof = remove_smooth(np.fft.fft(both - both.mean(axis=0), axis=0), lines.line, M)
    at = P[:, None]
    force, certain = _coefficient(residual[:, :, 1] - at * residual[:, :, 0], -at * residual[:, :, 2], dof)
    return _Force(force, certain)


def _coefficient(e: Complex, s: Complex, dof: int) -> tuple[float, float]:
    """Estimate the real factor f in ``e = f s`` over windows (L, lines), weighted by their noise.

    Returns f, and f divided by its standard deviation.
    """
    weight = dof / np.maximum(np.sum(np.abs(e) ** 2, axis=1), 1e-300)
    information = max(float(np.sum(weight * np.sum(np.abs(s) ** 2, axis=1))), 1e-300)
    force = float(np.sum(weight * np.sum(s.conj() * e, axis=1).real)) / information
    return force, abs(force) * float(np.sqrt(2.0 * information))
