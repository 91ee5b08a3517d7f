"""Fit of vibration modes to a frequency response, weighted by its variance; their number minimizes description length.

The model is
``P(z) = z^-d [ (e_0 + e_1 z^-1)/(1 - z^-1)^p + sum_i (c_i0 + c_i1 z^-1)/(1 - 2 r_i cos(w_i) z^-1 + r_i^2 z^-2) ]`` with
the pole pairs of modes of frequency f and damping zeta, p = 2 for a joint that moves freely and 0 for one that is held.
The numerators follow from the modes by linear least squares, so that the search is over frequencies and dampings only.
Several responses of one arm, the elements of a matrix, have numerators of their own and the modes in common.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError
from rrrgen.lab.estimate.linear import solve
from rrrgen.lab.estimate.statistics import rms
from rrrgen.lab.response.frequency_response import FrequencyResponse
from rrrgen.lab.response.local_polynomial import unknown_variances
from rrrgen.lab.response.response_model import (
    HIGHEST_DAMPING,
    Complex,
    Resonance,
    ResponseModel,
    polynomial_sum,
    resonance,
)

MOST_MODES = 6
RANK = 1e-13  # singular values of the scaled columns below this share of the largest are zero
DELAYS = (0, 1, 2, 3)
NEEDED = 10.0  # a part is needed if it lowers the cost by this multiple of the logarithm of the number of values
SCAN = 80  # number of frequencies at which a further mode is tried
FIRST_DAMPING = (0.005, 0.03, 0.15)  # damping ratios at which a further mode is tried
LEAST_LINES = 12
FAR_BELOW = 0.25  # times the lowest resonance: lines below do not count in the modes that several responses share
GROWING_STEPS, LAST_STEPS = 10, 60
MOST_OF_A_LINE = 9.0  # bound on a line's share of the cost, so that no single line decides on a mode
LEAST_BAND = 1e-3  # least relative standard deviation of a line: error of the local polynomials where noise is small


@dataclass(frozen=True)
class _Lines:
    """The lines used: ``z`` = z^-1 (L,), R responses ``P`` (R, L) with ``weight`` 1/sigma; ``period`` (s)."""

    z: Complex
    P: Complex
    weight: Array
    period: float


@dataclass(frozen=True)
class _Candidate:
    """Candidate modal model during the search, with its fit to the measured response P.

    ``modes`` (2 m,) holds [ln f, ln zeta] of each mode; the ``numerators`` (R, k) follow by linear least squares.
    ``costs`` (R L,) are the weighted squared errors ``|P - model|^2/sigma^2`` of the L spectral lines of R responses.
    ``delay`` is in samples, ``integrators`` the number of poles at z = 1.
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

    def capped_cost(self, scale: float) -> float:
        """Sum of the costs of the lines in units of ``scale``; a line counts for at most :data:`MOST_OF_A_LINE`."""
        return float(np.sum(np.minimum(self.costs / scale, MOST_OF_A_LINE)))


def fit_modes(response: FrequencyResponse) -> ResponseModel:
    """Fit modes to the trusted lines of a response; raises :class:`DerivationError` where there are too few."""
    use = response.trusted
    if np.count_nonzero(use) < LEAST_LINES:
        reason = response.findings[0].message if response.findings else f"{LEAST_LINES} are the least"
        raise DerivationError(f"{response.name}: {np.count_nonzero(use)} lines can be trusted: {reason}")
    raw = response.unsmoothed or response  # smoothed lines are not independent
    P = raw.P[use]
    # neighbouring lines that share data count for as much as independent ones in their place would
    share = np.broadcast_to(response.independent, len(use))[use]
    lines = _lines(response.frequency[use], P[None], raw.variance[use][None] / share, share, response.period)
    chosen, table = _choose_candidate(lines, response.frequency[use], share)
    return _model(response, lines, chosen, table)


def common_modes(
    frequency: Array, P: Complex, variance: Array, period: float
) -> tuple[tuple[Resonance, ...], tuple[dict[str, Any], ...]]:
    """The modes that R responses ``P`` (R, L) at ``frequency`` (L,) in Hz share, and the table of what was compared.

    ``variance`` (R, L) is that of the complex P, infinite for an element that is not to be used, ``period`` the
    sampling period (s). Raises :class:`DerivationError` where there are too few lines.
    """
    if len(frequency) < LEAST_LINES:
        raise DerivationError(f"{len(frequency)} lines can be used: {LEAST_LINES} are the least")
    lines = _lines(frequency, P, variance, 1.0, period)
    chosen, table = _choose_candidate(lines, frequency, 1.0)
    resonances = _resonances(lines, chosen, frequency)
    # gravity and viscous friction bend the response at low frequencies, where the model has a double integrator
    above = frequency > FAR_BELOW * resonances[0].frequency if resonances else np.zeros(len(frequency), bool)
    if np.count_nonzero(above) < LEAST_LINES or above.all():
        return resonances, table
    lines = _lines(frequency[above], P[:, above], variance[:, above], 1.0, period)
    modes = np.log([[mode.frequency, mode.damping] for mode in resonances]).ravel()
    refined = _refine(lines, _solve(lines, modes, chosen.delay, chosen.integrators), LAST_STEPS)
    return _resonances(lines, _drop_needless_modes(lines, refined), frequency), table


def _drop_needless_modes(lines: _Lines, best: _Candidate) -> _Candidate:
    """The candidate without the modes that only took up what a double integrator leaves at low frequencies."""
    penalty = (1.0 + len(lines.P)) * np.log(2.0 * lines.P.size)
    while len(best.modes):
        pairs = best.modes.reshape(-1, 2)
        fewer = [
            _solve(lines, np.delete(pairs, k, axis=0).ravel(), best.delay, best.integrators) for k in range(len(pairs))
        ]
        least = min(fewer, key=lambda candidate: candidate.capped_cost(best.scale))
        if least.capped_cost(best.scale) > best.capped_cost(best.scale) + penalty:
            break
        best = _refine(lines, least, LAST_STEPS) if len(least.modes) else least
    return best


def _lines(frequency: Array, P: Complex, variance: Array, share: Array | float, period: float) -> _Lines:
    """Lines weighted by their ``variance`` (R, L), that of independent ones; ``share`` of the lines are."""
    sigma = np.sqrt(variance + (LEAST_BAND * np.abs(P)) ** 2 / share)
    return _Lines(np.exp(-2j * np.pi * frequency * period), P, 1.0 / sigma, period)


def _choose_candidate(
    lines: _Lines, frequency: Array, share: Array | float
) -> tuple[_Candidate, tuple[dict[str, Any], ...]]:
    """The candidate of least description length, refined, and the table of all of them."""
    candidates = [candidate for delay in DELAYS for candidate in _growing(lines, frequency, delay, 2)]
    if not _integrates(lines, min(candidates, key=lambda candidate: candidate.cost)):
        candidates += [candidate for delay in DELAYS for candidate in _growing(lines, frequency, delay, 0)]
    scale = min(candidates, key=lambda candidate: candidate.cost).scale
    sizes = [len(candidate.modes) + candidate.numerators.size for candidate in candidates]
    values = 2.0 * lines.P.size
    lengths = [
        candidate.capped_cost(scale) + 0.5 * m * np.log(values) for candidate, m in zip(candidates, sizes, strict=True)
    ]
    table = tuple(
        {
            "integrators": candidate.integrators,
            "delay": candidate.delay,
            "modes": len(candidate.modes) // 2,
            "misfit": float(np.mean(candidate.costs.reshape(lines.P.shape) / share)),
            "description_length": float(length),
        }
        for candidate, length in zip(candidates, lengths, strict=True)
    )
    best = candidates[int(np.argmin(lengths))]
    return (best if not len(best.modes) else _refine(lines, best, LAST_STEPS)), table


def _integrates(lines: _Lines, best: _Candidate) -> bool:
    """Whether ``best`` needs the part with poles at z = 1 (a joint that moves freely) in addition to its modes.

    If it does, no model of a joint that is held is tried.
    """
    held = _solve(lines, best.modes, best.delay, 0)
    return bool(held.capped_cost(best.scale) > best.capped_cost(best.scale) + NEEDED * np.log(2.0 * lines.P.size))


def _growing(lines: _Lines, frequency: Array, delay: int, integrators: int) -> list[_Candidate]:
    """Candidates with 0, 1, .. modes; each adds the mode that lowers the cost most, and refines all modes."""
    candidates = [_solve(lines, np.empty(0), delay, integrators)]
    grid = np.geomspace(frequency[0] * 1.05, frequency[-1] * 0.98, SCAN)
    penalty = (1.0 + len(lines.P)) * np.log(2.0 * lines.P.size)
    while len(candidates) <= MOST_MODES:
        last = candidates[-1]
        mode = _best_further_mode(lines, last, grid)
        started = _solve(lines, np.concatenate([last.modes, np.log(mode)]), delay, integrators)
        refined = _refine(lines, started, GROWING_STEPS)
        if refined.capped_cost(last.scale) > last.capped_cost(last.scale) - penalty:
            break
        candidates.append(refined)
    return candidates


def _best_further_mode(lines: _Lines, last: _Candidate, grid: Array) -> tuple[float, float]:
    """Find on a grid the frequency and damping of the mode that explains most of the residual of ``last``.

    Both columns of each mode are made orthogonal to the columns of ``last``; a 2x2 system gives the reduction of cost.
    """
    trials = np.array([(f, damping) for f in grid for damping in FIRST_DAMPING])
    present = _basis(lines, last.modes, last.delay, last.integrators)
    further = _basis(lines, np.log(trials).ravel(), last.delay, 0)
    explained = np.zeros(len(trials))
    for P, weight in zip(lines.P, lines.weight, strict=True):
        H = _real_rows(present * weight[:, None])
        Q = np.linalg.qr(H / np.linalg.norm(H, axis=0))[0] if H.shape[1] else np.zeros((len(H), 0))
        target = _real_rows((P * weight)[:, None])[:, 0]
        rest = target - Q @ (Q.T @ target)
        X = _real_rows(further * weight[:, None])
        X = X / np.linalg.norm(X, axis=0)
        X = (X - Q @ (Q.T @ X)).reshape(len(X), len(trials), 2)
        right = np.einsum("ltc,l->tc", X, rest)
        normal = np.einsum("lta,ltb->tab", X, X) + 1e-9 * np.eye(2)
        explained += np.einsum("tc,tc->t", right, np.linalg.solve(normal, right[:, :, None])[:, :, 0])
    f, damping = trials[int(np.argmax(explained))]
    return float(f), float(damping)


def _real_rows(values: Complex) -> Array:
    """Convert complex rows to real ones: the real parts, then the imaginary parts below them."""
    return np.concatenate([values.real, values.imag])


def _basis(lines: _Lines, modes: Array, delay: int, integrators: int) -> Complex:
    """The matrix (L, m) whose columns are the terms of the model; their coefficients are the numerators."""
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
    """The coefficients [a1, a2] of the denominator ``1 - a1 z^-1 - a2 z^-2`` of each mode."""
    pairs = []
    for log_f, log_damping in modes.reshape(-1, 2):
        omega, damping = 2.0 * np.pi * np.exp(log_f) * period, min(float(np.exp(log_damping)), 0.99)
        radius, angle = np.exp(-damping * omega), omega * np.sqrt(1.0 - damping**2)
        pairs.append((float(2.0 * radius * np.cos(angle)), float(-(radius**2))))
    return pairs


def _solve(lines: _Lines, modes: Array, delay: int, integrators: int) -> _Candidate:
    """Fit the numerators of given modes by weighted linear least squares."""
    basis = _basis(lines, modes, delay, integrators)
    numerators, costs = np.empty((len(lines.P), basis.shape[1])), np.empty(lines.P.shape)
    for k, (P, weight) in enumerate(zip(lines.P, lines.weight, strict=True)):
        right = _real_rows((P * weight)[:, None])[:, 0]
        if not basis.shape[1]:
            costs[k] = _costs(right)
            continue
        fit = solve(_real_rows(basis * weight[:, None]), right, RANK)
        numerators[k], costs[k] = fit.x, _costs(fit.residual(right))
    return _Candidate(modes, numerators, costs.ravel(), delay, integrators)


def _costs(rest: Array) -> Array:
    """Squared errors (L,) per line from the residual (2 L,), real parts followed by imaginary parts."""
    return np.asarray(np.sum(rest.reshape(2, -1) ** 2, axis=0))


def _residual(lines: _Lines, modes: Array, delay: int, integrators: int) -> Array:
    candidate = _solve(lines, modes, delay, integrators)
    left = (lines.P - candidate.numerators @ _basis(lines, modes, delay, integrators).T) * lines.weight
    return np.concatenate([_real_rows(row) for row in left])


def _slopes(lines: _Lines, modes: Array, delay: int, integrators: int) -> Array:
    """Derivatives (2 L R, 2m) of the residual by ln f and ln zeta of every mode, when the numerators are refitted.

    Refitting removes from each column what the numerators can represent. Of this derivative of variable projection,
    only Kaufman's part is computed, with which the gradient of the squared residual is exact.
    """
    candidate = _solve(lines, modes, delay, integrators)
    basis = _basis(lines, modes, delay, integrators)
    bends = _bends(lines, modes)
    first, found_by_response = 2 * bool(integrators), []
    for weight, numerators in zip(lines.weight, candidate.numerators, strict=True):
        real = _real_rows(basis * weight[:, None])
        Q = np.linalg.qr(real / np.linalg.norm(real, axis=0))[0]
        columns = []
        for i, changes in enumerate(bends):
            pair = basis[:, first + 2 * i : first + 2 * i + 2]
            contribution = pair @ numerators[first + 2 * i : first + 2 * i + 2]
            turned = pair[:, 1] / lines.z**delay  # z^-1/(1 - a1 z^-1 - a2 z^-2)
            columns += [contribution * turned * (a1 + a2 * lines.z) for a1, a2 in changes]
        J = -_real_rows(np.asarray(np.stack(columns, axis=1) * weight[:, None], complex))
        found_by_response.append(J - Q @ (Q.T @ J))
    return np.concatenate(found_by_response)


def _bends(lines: _Lines, modes: Array) -> list[list[tuple[float, float]]]:
    """Derivatives of the coefficients (a1, a2) of every mode's denominator by its ln f and by its ln zeta."""
    derivatives = []
    for log_f, log_damping in modes.reshape(-1, 2):
        omega, damping = 2.0 * np.pi * np.exp(log_f) * lines.period, float(np.exp(log_damping))
        root = np.sqrt(1.0 - damping**2)
        radius, angle = np.exp(-damping * omega), omega * root
        change = -damping * omega * radius
        mode_derivatives = []
        for bend in (angle, -omega * damping**2 / root):  # of the angle; the radius changes alike with both
            a1 = 2.0 * (change * np.cos(angle) - radius * np.sin(angle) * bend)
            mode_derivatives.append((float(a1), float(-2.0 * radius * change)))
        derivatives.append(mode_derivatives)
    return derivatives


def _refine(lines: _Lines, start: _Candidate, steps: int) -> _Candidate:
    from scipy.optimize import least_squares

    def residual(modes: Array) -> Array:
        return _residual(lines, modes, start.delay, start.integrators)

    def slopes(modes: Array) -> Array:
        return _slopes(lines, modes, start.delay, start.integrators)

    highest = np.tile([np.log(0.5 / lines.period), np.log(0.9)], len(start.modes) // 2)
    begin = np.minimum(start.modes, highest - 1e-3)
    with np.errstate(divide="ignore", invalid="ignore"):  # of a damping on which no line depends
        optimum = least_squares(
            residual, begin, slopes, bounds=(-np.inf, highest), x_scale=0.01, ftol=1e-6, max_nfev=steps
        )
    return _solve(lines, np.asarray(optimum.x), start.delay, start.integrators)


def _model(
    response: FrequencyResponse, lines: _Lines, best: _Candidate, table: tuple[dict[str, Any], ...]
) -> ResponseModel:
    """Make the model: the difference equation of the modes, and the modes with their standard deviations."""
    factors = [np.array([1.0, -a1, -a2]) for a1, a2 in _pole_pairs(best.modes, lines.period)]
    if best.integrators:
        factors.insert(0, np.array([1.0, -2.0, 1.0]))
    denominator: Array = np.ones(1)
    numerator: Array = np.zeros(1)
    pairs = best.numerators[0].reshape(-1, 2)
    for factor, pair in zip(factors, pairs, strict=True):
        numerator = polynomial_sum(np.convolve(numerator, factor), np.convolve(pair, denominator))
        denominator = np.convolve(denominator, factor)
    use = response.trusted
    used = response.frequency[use]
    model = ResponseModel(
        method="modes",
        a=-denominator[1:],
        b=np.trim_zeros(numerator, "b"),
        delay=best.delay,
        period=response.period,
        resonances=_resonances(lines, best, used),
        table=table,
        name=response.name,
        fractions=tuple(zip(pairs, factors, strict=True)),
    )
    relative = np.abs(model.response(used) / lines.P[0] - 1.0)
    model.fit.update(
        {
            "value": 100.0 * (1.0 - float(rms(relative))),
            "unit": "100 (1 - RMS |P_model/P - 1|)",
            "protocol": "frequency response at the trusted lines, each as it was fitted with weight 1/variance",
            "held_out": False,
            "lines": len(used),
            "misfit_per_line": float(np.mean(best.costs / np.broadcast_to(response.independent, len(use))[use])),
            "largest_relative_error_95": float(np.quantile(relative, 0.95)),
        }
    )
    return model


def _resonances(lines: _Lines, best: _Candidate, used: Array) -> tuple[Resonance, ...]:
    """The modes within the ``used`` frequencies (L,) with their deviations, sorted by frequency."""
    resonances = []
    for (log_f, log_damping), (std_f, std_damping) in zip(
        best.modes.reshape(-1, 2), _deviations(lines, best), strict=True
    ):
        f, damping = float(np.exp(log_f)), float(np.exp(log_damping))
        if damping < HIGHEST_DAMPING and used[0] <= f <= used[-1]:  # a pole outside the band is no measured resonance
            resonances.append(resonance(f, damping, float(std_f), float(std_damping)))
    return tuple(sorted(resonances, key=lambda mode: mode.frequency))


def _deviations(lines: _Lines, best: _Candidate) -> Array:
    """Relative standard deviations (m, 2) of frequencies and dampings; scaled up where the misfit exceeds the noise.

    The derivatives are those of the residual after the numerators are solved for (variable projection), so that the
    uncertainty of the numerators is included. The variance of each real or imaginary part is 1/2.
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
    dof = max(2 * lines.P.size - len(best.modes) - best.numerators.size, 1)
    variance = max(0.5, best.cost / dof)
    return np.sqrt(unknown_variances(J, variance)).reshape(-1, 2)
