"""Modes fitted to a frequency response, weighted by its variance; their number chosen by description length.

``P(z) = z^-d [ (e_0 + e_1 z^-1)/(1 - z^-1)^p + sum_i (c_i0 + c_i1 z^-1)/(1 - 2 r_i cos(w_i) z^-1 + r_i^2 z^-2) ]`` with
the pole pairs of modes of frequency f and damping zeta, p = 2 for a joint that moves freely and 0 for one that is held.
The numerators follow from the modes by linear least squares, so that the search is over frequencies and dampings only.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rrrgen.arrays import Array
from rrrgen.errors import DerivationError
from rrrgen.response.controller import Complex
from rrrgen.response.frequency_response import FrequencyResponse
from rrrgen.response.models.response_model import HIGHEST_DAMPING, Resonance, ResponseModel

MOST_MODES = 6
DELAYS = (0, 1, 2, 3)
NEEDED = 10.0  # times the logarithm of the number of values: gain in cost of a part that cannot be left out
SCAN = 80  # frequencies at which a further mode is tried
FIRST_DAMPING = (0.005, 0.03, 0.15)
LEAST_LINES = 12
GROWING_STEPS, LAST_STEPS = 10, 60
MOST_OF_A_LINE = 9.0  # of the cost by which a mode is accepted: no single line may buy one
LEAST_BAND = 1e-3  # relative: what smoothness between lines may be wrong by where there is hardly any noise


@dataclass(frozen=True)
class _Lines:
    """The lines that are used: ``z`` = z^-1 and ``P`` (L,), ``weight`` 1/sigma."""

    z: Complex
    P: Complex
    weight: Array
    period: float


@dataclass(frozen=True)
class _Candidate:
    """Candidate modal model during the search, with its fit to the measured response P.

    ``modes`` (m, 2) holds [ln f, ln zeta] of each mode; the ``numerators`` follow by linear least squares. ``costs``
    (L,) are the weighted squared errors ``|P - model|^2/sigma^2`` of the L spectral lines. ``delay`` is in samples,
    ``integrators`` the number of poles at z = 1.
    """

    modes: Array
    numerators: Array
    costs: Array
    delay: int
    integrators: int

    @property
    def cost(self) -> float:
        """Sum of squared errors over all lines, each divided by its variance."""
        return float(np.sum(self.costs))

    @property
    def scale(self) -> float:
        """Median cost of a spectral line, at least 1; it is about 1 where the model explains all but the noise."""
        return max(1.0, float(np.median(self.costs)))

    def capped(self, scale: float) -> float:
        """The cost in units of ``scale``, with at most :data:`MOST_OF_A_LINE` of every line."""
        return float(np.sum(np.minimum(self.costs / scale, MOST_OF_A_LINE)))


def fit_modes(response: FrequencyResponse) -> ResponseModel:
    """The model of a response by its trusted lines. Raises :class:`DerivationError` where there are too few."""
    use = response.trusted
    if np.count_nonzero(use) < LEAST_LINES:
        reason = response.findings[0].message if response.findings else f"{LEAST_LINES} are the least"
        raise DerivationError(f"{response.name}: {np.count_nonzero(use)} lines can be trusted: {reason}")
    raw = response.unsmoothed or response  # smoothed lines say the same thing several times
    P = raw.P[use]
    # neighbouring lines that share data count for as much as independent ones in their place would
    sigma = np.sqrt((raw.variance[use] + (LEAST_BAND * np.abs(P)) ** 2) / response.independent)
    z = np.exp(-2j * np.pi * response.frequency[use] * response.period)
    lines = _Lines(z, P, 1.0 / sigma, response.period)
    frequency = response.frequency[use]
    found = [candidate for delay in DELAYS for candidate in _growing(lines, frequency, delay, 2)]
    if not _integrates(lines, min(found, key=lambda each: each.cost)):
        found += [candidate for delay in DELAYS for candidate in _growing(lines, frequency, delay, 0)]
    scale = min(found, key=lambda each: each.cost).scale
    sizes = [len(each.modes) + len(each.numerators) for each in found]
    lengths = [each.capped(scale) + 0.5 * m * np.log(2.0 * len(P)) for each, m in zip(found, sizes, strict=True)]
    table = tuple(
        {
            "integrators": each.integrators,
            "delay": each.delay,
            "modes": len(each.modes) // 2,
            "misfit": each.cost / len(P) / response.independent,
            "description_length": float(length),
        }
        for each, length in zip(found, lengths, strict=True)
    )
    best = found[int(np.argmin(lengths))]
    chosen = best if not len(best.modes) else _refine(lines, best, LAST_STEPS)
    return _model(response, lines, chosen, table)


def _integrates(lines: _Lines, best: _Candidate) -> bool:
    """Whether the free motion of ``best`` is needed beside its modes: then no model of a held joint is tried."""
    held = _solve(lines, best.modes, best.delay, 0)
    return bool(held.capped(best.scale) > best.capped(best.scale) + NEEDED * np.log(2.0 * len(lines.P)))


def _growing(lines: _Lines, frequency: Array, delay: int, integrators: int) -> list[_Candidate]:
    """Candidates of 0, 1, .. modes: a mode is added where it explains most, and all are refined."""
    found = [_solve(lines, np.empty(0), delay, integrators)]
    grid = np.geomspace(frequency[0] * 1.05, frequency[-1] * 0.98, SCAN)
    penalty = 2.0 * np.log(2.0 * len(lines.P))
    while len(found) <= MOST_MODES:
        last = found[-1]
        mode = _best_further_mode(lines, last, grid)
        started = _solve(lines, np.concatenate([last.modes, np.log(mode)]), delay, integrators)
        refined = _refine(lines, started, GROWING_STEPS)
        if refined.capped(last.scale) > last.capped(last.scale) - penalty:
            break
        found.append(refined)
    return found


def _best_further_mode(lines: _Lines, last: _Candidate, grid: Array) -> tuple[float, float]:
    """Frequency and damping, on a grid, of the mode that explains most of what ``last`` leaves.

    Both columns of every mode on trial are projected off the columns of ``last``; a 2x2 system tells what they explain.
    """
    trials = np.array([(f, damping) for f in grid for damping in FIRST_DAMPING])
    H = _stacked(_basis(lines, last.modes, last.delay, last.integrators) * lines.weight[:, None])
    Q = np.linalg.qr(H / np.linalg.norm(H, axis=0))[0] if H.shape[1] else np.zeros((len(H), 0))
    target = _stacked((lines.P * lines.weight)[:, None])[:, 0]
    rest = target - Q @ (Q.T @ target)
    X = _stacked(_basis(lines, np.log(trials).ravel(), last.delay, 0) * lines.weight[:, None])
    X = X / np.linalg.norm(X, axis=0)
    X = (X - Q @ (Q.T @ X)).reshape(len(X), len(trials), 2)
    right = np.einsum("ltc,l->tc", X, rest)
    normal = np.einsum("lta,ltb->tab", X, X) + 1e-9 * np.eye(2)
    explained = np.einsum("tc,tc->t", right, np.linalg.solve(normal, right[:, :, None])[:, :, 0])
    f, damping = trials[int(np.argmax(explained))]
    return float(f), float(damping)


def _stacked(values: Complex) -> Array:
    """Complex rows as real ones: real parts above imaginary parts."""
    return np.concatenate([values.real, values.imag])


def _basis(lines: _Lines, modes: Array, delay: int, integrators: int) -> Complex:
    """Columns (L, m) whose coefficients are the numerators."""
    z = lines.z
    columns = []
    if integrators:
        base = z**delay / (1.0 - z) ** integrators
        columns += [base, base * z]
    for a1, a2 in _pole_pairs(modes, lines.period):
        base = z**delay / (1.0 - a1 * z - a2 * z * z)
        columns += [base, base * z]
    return np.stack(columns, axis=1) if columns else np.empty((len(z), 0), complex)


def _pole_pairs(modes: Array, period: float) -> list[tuple[float, float]]:
    """[a1, a2] of ``1 - a1 z^-1 - a2 z^-2`` per mode."""
    pairs = []
    for log_f, log_damping in modes.reshape(-1, 2):
        omega, damping = 2.0 * np.pi * np.exp(log_f) * period, min(float(np.exp(log_damping)), 0.99)
        radius, angle = np.exp(-damping * omega), omega * np.sqrt(1.0 - damping**2)
        pairs.append((float(2.0 * radius * np.cos(angle)), float(-(radius**2))))
    return pairs


def _solve(lines: _Lines, modes: Array, delay: int, integrators: int) -> _Candidate:
    """Fit the numerators of given modes by weighted linear least squares."""
    real = _stacked(_basis(lines, modes, delay, integrators) * lines.weight[:, None])
    right = _stacked((lines.P * lines.weight)[:, None])[:, 0]
    if real.shape[1] == 0:
        return _Candidate(modes, np.empty(0), _costs(right), delay, integrators)
    scale = np.linalg.norm(real, axis=0)
    numerators = np.linalg.lstsq(real / scale, right, rcond=1e-13)[0] / scale
    return _Candidate(modes, numerators, _costs(right - real @ numerators), delay, integrators)


def _costs(rest: Array) -> Array:
    """Squares of the real over imaginary parts (2 L,), by line."""
    return np.asarray(np.sum(rest.reshape(2, -1) ** 2, axis=0))


def _residual(lines: _Lines, modes: Array, delay: int, integrators: int) -> Array:
    found = _solve(lines, modes, delay, integrators)
    return _stacked((lines.P - _basis(lines, modes, delay, integrators) @ found.numerators) * lines.weight)


def _refine(lines: _Lines, start: _Candidate, steps: int) -> _Candidate:
    from scipy.optimize import least_squares

    def residual(modes: Array) -> Array:
        return _residual(lines, modes, start.delay, start.integrators)

    highest = np.tile([np.log(0.5 / lines.period), np.log(0.9)], len(start.modes) // 2)
    begin = np.minimum(start.modes, highest - 1e-3)
    found = least_squares(residual, begin, bounds=(-np.inf, highest), x_scale=0.01, ftol=1e-6, max_nfev=steps)
    return _solve(lines, np.asarray(found.x), start.delay, start.integrators)


def _model(
    response: FrequencyResponse, lines: _Lines, best: _Candidate, table: tuple[dict[str, Any], ...]
) -> ResponseModel:
    """The difference equation of the modes, and the deviations of these."""
    factors = [np.array([1.0, -a1, -a2]) for a1, a2 in _pole_pairs(best.modes, lines.period)]
    if best.integrators:
        factors.insert(0, np.array([1.0, -2.0, 1.0]))
    denominator, numerator = np.ones(1), np.zeros(1)
    for factor, pair in zip(factors, best.numerators.reshape(-1, 2), strict=True):
        left, right = np.convolve(numerator, factor), np.convolve(pair, denominator)
        size = max(len(left), len(right))
        numerator = np.pad(left, (0, size - len(left))) + np.pad(right, (0, size - len(right)))
        denominator = np.convolve(denominator, factor)
    spread = _deviations(lines, best)
    used = response.frequency[response.trusted]
    resonances = []
    for (log_f, log_damping), (std_f, std_damping) in zip(best.modes.reshape(-1, 2), spread, strict=True):
        f, damping = float(np.exp(log_f)), float(np.exp(log_damping))
        if damping < HIGHEST_DAMPING and used[0] <= f <= used[-1]:  # beyond the lines a pole only bends the curve
            resonances.append(Resonance(f, damping, f * float(std_f), damping * float(std_damping)))
    model = ResponseModel(
        method="modes",
        a=-denominator[1:],
        b=np.trim_zeros(numerator, "b"),
        delay=best.delay,
        period=response.period,
        resonances=tuple(sorted(resonances, key=lambda each: each.frequency)),
        table=table,
        name=response.name,
    )
    relative = np.abs(model.response(used) / lines.P - 1.0)
    model.fit.update(
        {
            "value": 100.0 * (1.0 - float(np.sqrt(np.mean(relative**2)))),
            "unit": "100 (1 - RMS |P_model/P - 1|)",
            "protocol": "frequency response at the trusted lines, each as it was fitted with weight 1/variance",
            "held_out": False,
            "lines": len(used),
            "misfit_per_line": best.cost / len(used) / response.independent,
            "largest_relative_error_95": float(np.quantile(relative, 0.95)),
        }
    )
    return model


def _deviations(lines: _Lines, best: _Candidate) -> Array:
    """Relative standard deviations (m, 2) of frequencies and dampings; scaled up where the misfit exceeds the noise.

    The residual after the numerators are solved for has the derivatives of the whole problem less what numerators can
    take over (variable projection), so that their uncertainty is included. Its variance is 1/2 per real part.
    """
    if not len(best.modes):
        return np.empty((0, 2))
    columns = []
    for i in range(len(best.modes)):
        step = np.zeros(len(best.modes))
        step[i] = 1e-5
        ends = [_residual(lines, best.modes + sign * step, best.delay, best.integrators) for sign in (1.0, -1.0)]
        columns.append((ends[0] - ends[1]) / 2e-5)
    J = np.stack(columns, axis=1)
    dof = max(2 * len(lines.P) - len(best.modes) - len(best.numerators), 1)
    variance = max(0.5, best.cost / dof)
    return np.sqrt(np.diag(variance * np.linalg.pinv(J.T @ J, hermitian=True))).reshape(-1, 2)
