"""A frequency response with its uncertainty and a verdict on every line."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.lab.data.run_folder import read_json
from rrrgen.lab.response.local_polynomial import GROWTH, MANY, PARABOLA_AT_ITS_CENTRE, radius, running_mean
from rrrgen.lab.response.nonlinear_distortion import Caution
from rrrgen.lab.response.response_model import Complex

WIDEST_BAND = 0.1  # relative radius of the 95 % confidence circle above which a line is not trusted
LEAST_COHERENCE = 0.1
SCHEMA = "rrrgen-frf/1"


@dataclass(frozen=True)
class FrequencyResponse:
    """The response ``P`` (L,) of the plant, output over input, at ``frequency`` (L,) in Hz.

    ``band95`` (L,) is the radius of the circle around P that contains the true response with probability 95 %, relative
    to the magnitude of P; ``variance`` (L,) that of the complex P; ``coherence`` (L,) the share of the output's power
    that is due to the excitation (14.37); ``period`` the sampling period in s. ``independent`` is the share of the
    lines that do not share data with others, one number or (L,). ``findings`` are reasons not to trust the recording as
    a whole. ``dof`` are the complex degrees of freedom of the variance, one number or (L,), ``kernel`` (lags,) the
    correlation of lines that are 0, 1, .. apart (None: independent); ``unsmoothed`` is the response before it was
    smoothed over lines, None if it was not.
    ``method`` names the estimator; ``details`` holds the kind of excitation and the figures of the checks.
    """

    name: str
    method: str
    frequency: Array
    P: Complex
    variance: Array
    band95: Array
    coherence: Array
    period: float
    independent: Array | float = 1.0
    findings: tuple[Caution, ...] = ()
    details: dict[str, Any] = field(default_factory=dict)
    dof: Array | float = np.inf
    kernel: Array | None = None
    unsmoothed: FrequencyResponse | None = None

    @property
    def reasons(self) -> list[str]:
        """For each line the reason why it is not trusted; empty text for a trusted line."""
        if self.findings:
            return [self.findings[0].kind] * len(self.frequency)
        wide, low = ~(self.band95 <= WIDEST_BAND), ~(self.coherence >= LEAST_COHERENCE)
        return [
            f"band of {100 * band:.0f} %" if is_wide else "coherence" if is_low else ""
            for band, is_wide, is_low in zip(self.band95, wide, low, strict=True)
        ]

    @property
    def trusted(self) -> NDArray[np.bool_]:
        """Mask (L,) of the spectral lines whose estimate may be used."""
        return np.array([not reason for reason in self.reasons])

    def lines(self) -> list[str]:
        """The verdict on the response as text."""
        trusted, f = self.trusted, self.frequency
        lines = [
            f"{self.name}: {len(f)} lines from {f[0]:.4g} to {f[-1]:.4g} Hz, {self.method}; 95 % band "
            f"{100 * np.median(self.band95):.2g} % (median)"
        ]
        if self.findings:
            return lines + [f"  not trusted: {finding.message}" for finding in self.findings]
        share = f"{np.count_nonzero(trusted)} of {len(trusted)} lines ({100 * np.mean(trusted):.0f} %)"
        return [*lines, f"  trusted: {share}"]

    def to_json(self) -> dict[str, Any]:
        """The response as plain data for ``results/frf.json``."""
        raw = self.unsmoothed
        return {
            "schema": SCHEMA,
            "name": self.name,
            "method": self.method,
            "sampling_period": self.period,
            "independent_share": self.independent,
            "verdict": {
                "trusted": not self.findings,
                "trusted_lines": int(np.count_nonzero(self.trusted)),
                "lines": len(self.frequency),
                "findings": [vars(finding) for finding in self.findings],
            },
            "frequency": self.frequency,
            "re": self.P.real,
            "im": self.P.imag,
            "band95": self.band95,
            "coherence": self.coherence,
            "trusted": self.trusted,
            "reason": self.reasons,
            "variance": self.variance,
            **self.details,
        } | ({} if raw is None else {"unsmoothed": {"re": raw.P.real, "im": raw.P.imag, "variance": raw.variance}})


def read_responses(path: Path) -> list[FrequencyResponse]:
    """Read the responses, one for every posture, from a ``frf.json`` of `rrrgen response frf`.

    Raises :class:`InputError` for any other file.
    """

    def read(data: Any) -> list[FrequencyResponse]:
        return [_of_json(posture) for posture in data.get("postures", [data])]

    return read_json(path, "frequency response of `rrrgen response frf`", read)


def _of_json(data: dict[str, Any]) -> FrequencyResponse:
    names = ("frequency", "re", "im", "variance", "band95", "coherence")
    columns = {key: np.array(data[key], float) for key in names}
    raw = (
        {key: np.array(data["unsmoothed"][key], float) for key in ("re", "im", "variance")}
        if "unsmoothed" in data
        else {}
    )
    period = float(data["sampling_period"])
    independent = np.broadcast_to(np.array(data["independent_share"], float), columns["frequency"].shape)
    lengths = {len(column) for column in (*columns.values(), *raw.values())}
    if len(lengths) > 1 or not (period > 0.0 and np.all((independent > 0.0) & (independent <= 1.0))):
        raise ValueError("columns of different length, or no period")
    response = FrequencyResponse(
        name=str(data["name"]),
        method=str(data["method"]),
        frequency=columns["frequency"],
        P=columns["re"] + 1j * columns["im"],
        variance=columns["variance"],
        band95=columns["band95"],
        coherence=columns["coherence"],
        period=period,
        independent=independent,
        findings=tuple(Caution(**finding) for finding in data["verdict"]["findings"]),
    )
    if not raw:
        return response
    unsmoothed = replace(response, P=raw["re"] + 1j * raw["im"], variance=raw["variance"])
    return replace(response, unsmoothed=unsmoothed)


# ------------------------------------------------------------------------------------------------------------------
# Smoothing of a response over neighbouring spectral lines, where a line is uncertain and the response is smooth.
#
# Times frequency squared, the response of a joint is nearly constant away from its modes. The value in the middle of
# a polynomial of order 2, fitted to the lines at either side, is then more accurate than the estimate of the line
# itself. But it shares its error with its neighbours, so that wide windows leave few independent values in a
# recording, and the share of lines within their bands is left to chance. So a line is smoothed only as far as it
# needs: over a few lines where these give a narrow band, over more only until it can be trusted (:data:`GOALS`).
# Where it cannot, it is left.
#
# The bias by smoothing must stay small against the remaining variance. It is estimated as the difference in the
# middle from a polynomial of order 4 fitted to the same lines; its square is averaged over neighbouring lines, and
# its own noise is subtracted. A bias of this size that may have been missed is added to the variance. The bias of a
# window twice as wide is many times larger and known better; scaled back, it decides, and in the window itself only a
# bias beyond its noise counts. Nothing is smoothed at resonances.
# ------------------------------------------------------------------------------------------------------------------

HALF_WIDTHS = (2, 3, 4, 5, 6, 8, 12, 16, 24, 32, 48, 64, 96)  # numbers of lines at either side that are tried
GOALS = ((0.03, 4, 0), (0.04, 8, 4), (0.09, 96, 0), (0.999 * WIDEST_BAND, 96, 0))
"""Relative confidence radii, each with the most independent lines at either side over which it is sought.

A line takes the first goal that it reaches, over as few lines as possible. The last is the radius at which a line is
trusted. Between the second and the third there is none: near 5 % a line would be neither independent nor sure to be
within 4 %. The third number is the least of independent values in a response for which a goal is sought: of lines with
a radius of 4 % one in fifty is off by more than 4 % or 2.5 degrees, with all lines that share its data, and of a few
values it would be a large part.
"""
LARGEST_BIAS = 0.15  # largest squared bias, as a share of the remaining variance
MISSED_BIAS = 0.05  # squared bias that may have been missed, alike
UNLIKELY = 1e-3  # probability that noise alone looks like a bias
ORDER, FINE_ORDER = 2, 4
EVENLY = 1e-6  # relative difference below which the spacings of lines are equal


def smooth(response: FrequencyResponse) -> FrequencyResponse:
    """Smooth every line of a response as far as its goal needs (:data:`GOALS`), and where no bias forbids it.

    A line that reaches no goal stays as it is. The given response is kept as ``unsmoothed``.
    """
    f, kernel, line = response.frequency, response.kernel, np.arange(len(response.frequency))
    value, variance, freedom = _windows(response)
    band = radius(variance, freedom) / np.abs(value)
    alike = 1.0 if kernel is None else _length(kernel, len(kernel))
    half = np.array([0, *HALF_WIDTHS])
    chosen = np.zeros(len(f), dtype=np.int64)
    for goal, most, values in reversed(GOALS):
        reached = (band < goal) & (half[:, None] <= most * alike)
        mask, least = reached.any(axis=0), reached.argmax(axis=0)
        if np.sum(_independent(half[least[mask]], alike)) >= values:
            chosen = np.where(mask, least, chosen)
    P, var = value[chosen, line] / f**2, variance[chosen, line] / f**4
    return replace(
        response,
        P=P,
        variance=var,
        band95=band[chosen, line],
        details=response.details | {"smoothed_over": 2 * half[chosen] + 1},
        unsmoothed=response,
    )


def _independent(half: Array, alike: float) -> Array:
    """Number of independent values for which lines count that are smoothed over ``half`` lines at either side."""
    return np.asarray(np.minimum(1.0 / alike, PARABOLA_AT_ITS_CENTRE / (2.0 * half + 1.0)))


def _windows(response: FrequencyResponse) -> tuple[Complex, Array, Array]:
    """The response times frequency squared, smoothed over no lines and each of :data:`HALF_WIDTHS` (first axis).

    Returns values, variances with the bias that may have been missed, and degrees of freedom, (widths, L) each. The
    variance is infinite where smoothing is not allowed.
    """
    from scipy.stats import chi2

    f, dof, kernel = response.frequency, response.dof, response.kernel
    shape, spread = response.P * f**2, response.variance * f**4
    estimates = {
        m: _smooth_lines(f, shape, spread, m, kernel) for m in sorted({*HALF_WIDTHS, *(2 * m for m in HALF_WIDTHS)})
    }
    values, variances, freedoms = [shape], [spread], [np.broadcast_to(dof, len(f))]
    allowed = np.ones(len(f), dtype=bool)
    for m in HALF_WIDTHS:
        value, left, excess, uncertain = estimates[m]
        alike = 1.0 if kernel is None else _length(kernel, m)
        number = (2 * m + 1) / alike  # of independent lines in the window
        explained = chi2.isf(UNLIKELY, number) / number - 1.0
        wider = estimates[2 * m][2] / GROWTH
        bias = np.where(np.isfinite(wider), np.maximum(wider, excess - explained * uncertain), excess)
        allowed &= np.isfinite(left) & (bias < LARGEST_BIAS * left)
        values.append(value)
        variances.append(np.where(allowed, (1.0 + MISSED_BIAS) * left + np.maximum(bias, 0.0), np.inf))
        freedoms.append(np.minimum(freedoms[0] * number, MANY))
    return np.array(values), np.array(variances), np.array(freedoms)


def _smooth_lines(
    f: Array, shape: Complex, spread: Array, m: int, kernel: Array | None
) -> tuple[Complex, Array, Array, Array]:
    """Smooth over m lines at either side; returns four arrays (L,), one entry per line.

    They are the smoothed value, its variance, an estimate of its squared bias from which the part due to noise is
    subtracted, and that part. Where there are fewer than m lines at a side, the variance is infinite and the estimate
    of the bias NaN.
    """
    lines = len(f)
    value, left, excess, noise = shape.copy(), np.full(lines, np.inf), np.full(lines, np.nan), np.zeros(lines)
    if lines <= 4 * m:
        return value, left, excess, noise
    inner = np.arange(m, lines - m)
    around = inner[:, None] + np.arange(-m, m + 1)
    value[inner], left[inner], bias, uncertain = _window(f[around], shape[around], spread[around], m, kernel)
    noise[inner] = running_mean(uncertain, m)
    excess[inner] = running_mean(bias, m) - noise[inner]
    return value, left, excess, noise


def _window(
    f: Array, shape: Complex, spread: Array, m: int, kernel: Array | None
) -> tuple[Complex, Array, Array, Array]:
    """Fit polynomials in windows of 2m+1 lines; returns four arrays, one entry per window.

    They are the value of the polynomial of order 2 in the middle of the window, its variance, the squared difference
    from the polynomial of order 4 there (the bias), and the variance of that difference.
    """
    position = (f - f[:, m : m + 1]) / (f[:, -1:] - f[:, :1]) * 2.0
    if float(np.max(np.ptp(position, axis=0))) < EVENLY:
        position = position[:1]  # one set of weights for all windows
    low, high = (np.linalg.pinv(position[:, :, None] ** np.arange(order + 1))[:, 0] for order in (ORDER, FINE_ORDER))
    common = spread.mean(axis=1)  # the mean variance of a window is more certain than that of a single line
    C = np.eye(2 * m + 1) if kernel is None else _toeplitz(kernel, 2 * m + 1)
    value = np.sum(low * shape, axis=1)
    difference = high - low
    bias = np.abs(np.sum(difference * shape, axis=1)) ** 2
    left, uncertain = (np.sum((hat @ C) * hat, axis=1) * common for hat in (low, difference))
    return value, left, bias, uncertain


def _toeplitz(kernel: Array, size: int) -> Array:
    padded = np.concatenate([kernel, np.zeros(max(size - len(kernel), 0))])
    return np.asarray(padded[np.abs(np.arange(size)[:, None] - np.arange(size))])


def _length(kernel: Array, m: int) -> float:
    """Number of correlated lines in a window of 2m+1 lines that carry as much information as one independent line.

    ``kernel`` (lags,) is the correlation of lines that are 0, 1, .. apart.
    """
    inside = kernel[1 : 2 * m + 1]
    return float(1.0 + 2.0 * np.sum(inside**2))
