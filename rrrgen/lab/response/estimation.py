"""Estimation of frequency responses from recordings: choice of method, confidence bands, averages over realisations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError, InputError
from rrrgen.lab.estimate.statistics import rms
from rrrgen.lab.response.averaged_spectra import averaged_spectra
from rrrgen.lab.response.frequency_response import FrequencyResponse, smooth
from rrrgen.lab.response.local_polynomial import LineEstimates, noise_lines, periodic_lines, radius
from rrrgen.lab.response.nonlinear_distortion import (
    LARGEST_RATIO,
    MATERIAL,
    Caution,
    check_detection_lines,
    check_friction,
    check_limits,
    check_repetition,
    scatter_ratio,
    times,
)
from rrrgen.lab.response.response_file import ResponseFile, ResponseRecording, read_recordings
from rrrgen.lab.response.response_model import Complex, ControllerTransferFunction

# ------------------------------------------------------------------------------------------------------------------
# Detection of the period of an excitation: whether it repeats, and after how many samples.
# ------------------------------------------------------------------------------------------------------------------

SAME = 1e-3  # largest relative difference of two equal periods: rounding of the numbers in the file
ALIKE = 0.05  # the same where the user states the period
SHORTEST = 16  # shortest period, samples
LEAST_OVERLAP = 0.05  # least share of the recording by which two periods must overlap to be compared
FLAT = 5e-4  # bound on the second differences of the logarithms of a multisine's lines; a sweep has 3e-3, noise 1
LEAST_LINES = 8
STRONG = 0.03  # lines below this share of the largest may be leakage, which is smooth for every excitation


def samples_of(record: ResponseRecording, period: float | None) -> int | None:
    """Number of samples of a period: of the stated ``period`` (s), or found in the excitation; None if none repeats."""
    if period is None:
        return find_period(record.n)
    samples = round(period / record.period)
    if samples < 2 or abs(samples * record.period - period) > 1e-3 * record.period * max(1.0, 1e-3 * samples):
        raise DerivationError(
            f"{record.name}: the period of {period:.9g} s is not a whole number of samples of {record.period:.9g} s"
        )
    last, before = record.n[-samples:], record.n[-2 * samples : -samples]
    if len(before) == samples and np.std(last - before) > ALIKE * np.std(last):
        raise DerivationError(
            f"{record.name}: the excitation does not repeat after {period:.9g} s; leave the key 'period' out and it is "
            "found, where there is one"
        )
    return samples


def find_period(n: Array) -> int | None:
    """Find the period of ``n`` (samples): the shortest shift that maps it to itself; None if there is none.

    The result is longer than half of ``n`` where less than two periods are recorded. It is the length of ``n`` for a
    single period of a multisine, which is recognized by spectral lines whose magnitudes follow a smooth curve.
    """
    period = _shift(n[len(n) // 4 :], len(n) // 2)  # the first quarter apart, since an excitation may fade in
    if period is None:
        period = _shift(n, int((1.0 - LEAST_OVERLAP) * len(n)))
    return len(n) if period is None and _is_one_period(n) else period


def _shift(n: Array, longest: int) -> int | None:
    """The shortest lag up to ``longest`` at which ``n`` repeats."""
    x = n - np.mean(n)
    power = float(x @ x)
    if not power > 0.0:
        return None
    size = 2 * len(x)
    correlation = np.fft.irfft(np.abs(np.fft.rfft(x, size)) ** 2, size)[: len(x)]
    # the correlation of the overlapping parts is divided by the power of each
    cumulated = np.concatenate([[0.0], np.cumsum(x**2)])
    lags = np.arange(len(x))
    both = np.sqrt(cumulated[len(x) - lags] * (cumulated[-1] - cumulated[lags]))
    normal = correlation / np.maximum(both, 1e-12 * power)
    top = (normal[1:-1] >= normal[:-2]) & (normal[1:-1] >= normal[2:]) & (normal[1:-1] > 0.9)
    peaks = np.flatnonzero(top) + 1
    for lag in peaks[(peaks >= SHORTEST) & (peaks <= longest)]:
        part = x[lag:] - x[:-lag]
        if len(part) >= max(LEAST_OVERLAP * len(x), SHORTEST) and rms(part) < SAME * np.std(x):
            return int(lag)
    return None


def _is_one_period(n: Array) -> bool:
    magnitude = np.abs(np.fft.rfft(n - np.mean(n)))
    lines = magnitude[magnitude > STRONG * magnitude.max()] if magnitude.max() > 0.0 else magnitude[:0]
    return len(lines) >= LEAST_LINES and float(np.median(np.abs(np.diff(np.log(lines), 2)))) < FLAT


# ------------------------------------------------------------------------------------------------------------------
# Estimation of frequency responses from recordings
# ------------------------------------------------------------------------------------------------------------------

LEAST_REST = 0.01  # least 1 - g of a line, see instrumental_response
LEAST_SHARE = 0.1  # least share of the lines at which the excitation shows in the input
SURELY = 2.0  # confidence radii of the response of u that it must exceed, so that dividing by it has no bias
WRONG_CONTROLLER = 0.01  # relative error of the stated controller, and
UNLIKELY_CONTROLLER = 10.0  # squared error over its variance, at half of the lines, that are not accepted
METHODS = ("local_polynomial", "instrumental", "direct", "indirect")


def estimate_responses(response: ResponseFile, method: str = "local_polynomial") -> list[FrequencyResponse]:
    """Estimate the responses of a response file: one from all realisations together, or one for every posture."""
    records = read_recordings(response)
    responses = [estimate_one(record, response.period, response.controller, method) for record in records]
    if response.several == "postures" or len(responses) == 1:
        return responses
    return [combine(responses, response.name or "realisations")]


def estimate_one(
    record: ResponseRecording,
    period: float | None = None,
    controller: ControllerTransferFunction | None = None,
    method: str = "local_polynomial",
) -> FrequencyResponse:
    """Estimate the response of one recording; ``period`` (s) is that of the excitation, None to find it.

    Raises :class:`DerivationError` where the recording is too short, has no excitation or only one period of it.
    """
    for name, column in (("excitation", record.n), ("input", record.u), ("output", record.q)):
        if len(column) < 2 or not float(np.ptp(column)) > 0.0:
            raise DerivationError(f"{record.name}: the column of the {name} is constant, so there is no response")
    samples = samples_of(record, period)
    kind = "noise" if samples is None else "periodic"
    details: dict[str, Any] = {"excitation": kind}
    lines = noise_lines(record) if samples is None else periodic_lines(record, samples)
    plain, spread = instrumental_response(lines)
    findings, measures = _findings(record, lines, plain, spread, samples)
    details["distortion"] = measures
    if method in ("instrumental", "direct"):
        spectra = averaged_spectra(record, samples)
        P, variance = spectra.instrumental() if method == "instrumental" else spectra.direct()
        frequency, coherence, kernel = spectra.frequency, spectra.coherence(), spectra.kernel
        dof: Array | float = spectra.dof
        independent: Array | float = spectra.independent
    else:
        dof, frequency, independent, kernel = lines.dof, lines.frequency, lines.independent, lines.kernel
        coherence = lines.signal / (lines.signal + lines.noise)
        P, variance = plain, spread
        if method == "indirect":
            if controller is None:
                raise InputError("the indirect method needs the controller: name it in the response file")
            P, variance = indirect_response(lines, controller, record.period)
            findings += _check_controller(lines, controller, record.period)
    if samples is not None:
        ratio = np.interp(frequency, lines.frequency, scatter_ratio(lines, plain, spread))
        details["scatter_over_noise"], variance = ratio, ratio * variance
    response = FrequencyResponse(
        name=record.name,
        method=f"{method} ({kind})",
        frequency=frequency,
        P=P,
        variance=variance,
        band95=radius(variance, dof) / np.abs(P),
        coherence=coherence,
        period=record.period,
        independent=independent,
        findings=tuple(findings),
        details=details,
        dof=dof,
        kernel=kernel,
    )
    return smooth(response)


def _findings(
    record: ResponseRecording, lines: LineEstimates, P: Complex, variance: Array, samples: int | None
) -> tuple[list[Caution], dict[str, Any]]:
    """Reasons not to trust a recording, and the measured figures by name.

    A periodic excitation is checked at the harmonics that it leaves out (detection lines) and for scatter between
    harmonics, any excitation for friction.
    """
    measures: dict[str, Any] = {}
    findings: list[Caution | None] = []
    if samples is not None:
        by_lines, measures["detection_lines"] = check_detection_lines(record, lines, P, samples)
        by_scatter, measures["total_over_noise_variance"] = check_repetition(lines, P, variance)
        findings = [by_lines, by_scatter]
    else:
        findings.append(check_limits(record))
    findings.append(check_friction(record, samples, lines, P))
    return [finding for finding in findings if finding is not None], measures


def instrumental_response(lines: LineEstimates) -> tuple[Complex, Array]:
    """The response ``P = G_q/G_u`` from those of u and q to the excitation, and its variance.

    The variance is ``a V a^H/(1 - g)`` with ``a = [-P, 1]/G_u``, the covariance V of [G_u, G_q] and g the square of
    :data:`SURELY` relative confidence radii of G_u, after Fieller's interval: a line at which the excitation does not
    show in u tells nothing. Raises :class:`DerivationError` if these are nearly all.
    """
    Gu, Gq = lines.G.T
    if not np.all(np.abs(Gu) > 0.0):
        raise DerivationError("the excitation does not reach the input: are the columns the right ones?")
    P = Gq / Gu
    a = np.stack([-P / Gu, 1.0 / Gu], axis=1)
    variance = np.einsum("la,lab,lb->l", a, lines.covariance, a.conj()).real
    rest = 1.0 - (SURELY * radius(lines.covariance[:, 0, 0].real, lines.dof) / np.abs(Gu)) ** 2
    if np.mean(rest > 0.0) < LEAST_SHARE:
        raise DerivationError(
            f"the excitation shows in the input at {100 * np.mean(rest > 0.0):.0f} % of the lines: is its column the "
            "right one, and is it strong enough?"
        )
    return P, np.where(rest > LEAST_REST, np.maximum(variance, 0.0), np.abs(P) ** 2) / np.maximum(rest, LEAST_REST)


def indirect_response(
    lines: LineEstimates, controller: ControllerTransferFunction, period: float
) -> tuple[Complex, Array]:
    """The response ``P = (1/S - 1)/C`` (14.38) of the plant, and its variance.

    S is the response from the excitation n to the input u, C the sampled ``controller``, ``period`` the sampling period
    (s).
    """
    S = lines.G[:, 0]
    C = controller.response(lines.frequency, period)
    if not np.all(np.abs(C) > 0.0):
        raise InputError("the controller is zero at some frequency: the indirect method cannot be used there")
    return (1.0 / S - 1.0) / C, lines.covariance[:, 0, 0].real / np.abs(S) ** 4 / np.abs(C) ** 2


def _check_controller(lines: LineEstimates, controller: ControllerTransferFunction, period: float) -> list[Caution]:
    """Check whether the recorded input is ``n - C (q - q_r)`` with the stated controller C.

    In the responses to n that is ``G_u = 1 - C G_q``, decided by the half of the lines that determines C best.
    """
    a = np.stack([np.ones(len(lines.frequency)), controller.response(lines.frequency, period)], axis=1)
    fed_back = np.abs(a[:, 1] * lines.G[:, 1])
    off = np.abs(np.sum(a * lines.G, axis=1) - 1.0)
    variance = np.einsum("la,lab,lb->l", a, lines.covariance, a.conj()).real
    strength = fed_back**2 / lines.covariance[:, 0, 0].real
    half = strength >= np.median(strength)
    error = float(np.median((off / fed_back)[half]))
    if error < WRONG_CONTROLLER or np.median((off**2 / np.maximum(variance, 1e-300))[half]) < UNLIKELY_CONTROLLER:
        return []
    message = (
        f"the recorded input is not n - C (q - q_r) with the stated controller, which is {100 * error:.3g} % off: the "
        "indirect method needs it as it is implemented, difference of the position and sampling period included"
    )
    return [Caution("controller", error, WRONG_CONTROLLER, message)]


def combine(responses: Sequence[FrequencyResponse], name: str) -> FrequencyResponse:
    """Average the responses of R realisations of one loop, and separate noise from nonlinear distortion.

    The variance within a realisation is noise and its scatter over the lines. The variance between realisations also
    contains distortion, which differs with the random phases of the excitation. Where it exceeds 1.5 times the noise,
    the result is marked as not to be trusted.
    """
    from scipy.stats import chi2

    smoothed = responses[0].unsmoothed is not None
    responses = [response.unsmoothed or response for response in responses]
    first = responses[0]
    if any(
        len(response.P) != len(first.P) or not np.allclose(response.frequency, first.frequency)
        for response in responses
    ):
        raise InputError("realisations must be excited at the same frequencies; are these postures? (recordings: ...)")
    R = len(responses)
    P = np.array([response.P for response in responses])
    mean: Complex = np.mean(P, axis=0, dtype=np.complex128)
    total = np.sum(np.abs(P - mean) ** 2, axis=0) / (R - 1)
    within = np.mean([response.variance for response in responses], axis=0)
    noise = np.mean(
        [response.variance / response.details.get("scatter_over_noise", 1.0) for response in responses], axis=0
    )
    typical = float(chi2.ppf(0.5, 2 * (R - 1))) / (2 * (R - 1))
    ratio = float(np.median(total / np.maximum(noise, 1e-300)) / typical)
    size = float(np.median(np.sqrt(total) / np.abs(mean)))
    findings = [finding for response in responses for finding in response.findings]
    if ratio > LARGEST_RATIO and size > MATERIAL:
        message = (
            f"realisations differ {times(ratio)} as much as their noise (limit {LARGEST_RATIO}): the plant is not "
            "linear, friction at changes of direction in the first place; or these are several postures"
        )
        findings.insert(0, Caution("distortion", ratio, LARGEST_RATIO, message))
    use_total = ratio > LARGEST_RATIO
    variance = (np.maximum(total, within) if use_total else within) / R
    dof = R - 1.0 if use_total else R * np.min(np.array([response.dof for response in responses]), axis=0)
    details = {
        "excitation": first.details["excitation"],
        "realisations": R,
        "noise_variance": noise,
        "distortion_variance": np.maximum(total - noise, 0.0),
        "distortion": {"total_over_noise_variance": ratio},
    }
    mean_response = FrequencyResponse(
        name=name,
        method=f"{first.method}, {R} realisations",
        frequency=first.frequency,
        P=mean,
        variance=variance,
        band95=radius(variance, dof) / np.abs(mean),
        coherence=np.mean([response.coherence for response in responses], axis=0),
        period=first.period,
        independent=np.mean(np.array([response.independent for response in responses]), axis=0),
        findings=tuple(findings),
        details=details,
        dof=dof,
        kernel=first.kernel,
    )
    return smooth(mean_response) if smoothed else mean_response
