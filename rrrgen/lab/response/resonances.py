"""Check of the resonances of a difference equation on its recording: which ones it needs, and how well it tells them.

Poles that explain nothing but noise are no resonances. The others are compared with the maximum-likelihood estimate of
``y = sum_i (c_i0 + c_i1 z^-1)/(1 - 2 r_i cos(w_i) z^-1 + r_i^2 z^-2) u + e/W``, one term for each pair of poles, with
an autoregressive filter W that makes the error e white. Noise biases the poles of ARX models and not this estimate, so
the distance between the two counts as a part of their deviations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.lab.estimate.linear import project, scale_columns, solve
from rrrgen.lab.estimate.search import search
from rrrgen.lab.estimate.statistics import rms
from rrrgen.lab.estimate.tsqr import triangular
from rrrgen.lab.response.local_polynomial import unknown_variances
from rrrgen.lab.response.response_model import CERTAIN, HIGHEST_DAMPING, Resonance, resonance

# ------------------------------------------------------------------------------------------------------------------
# Resonances over several postures: matching of the modes of different postures, ranges of their frequencies.
# ------------------------------------------------------------------------------------------------------------------

FARTHEST = 0.4  # largest logarithm of the ratio of two frequencies that may belong to the same mode
DAMPING_SHARE = 0.1  # weight of the logarithm of dampings beside that of frequencies


class Resonating(Protocol):
    """What has resonances in one posture: the ``name`` of the posture, and its ``resonances``."""

    @property
    def name(self) -> str:
        """Name of the posture."""

    @property
    def resonances(self) -> tuple[Resonance, ...]:
        """Resonances in it, sorted by frequency."""


@dataclass(frozen=True)
class ModeOverPostures:
    """One vibration mode: its resonance in each posture in which it was found, by the name of the posture."""

    resonances: dict[str, Resonance]

    @property
    def frequencies(self) -> Array:
        """Frequencies of the mode, Hz, (postures,)."""
        return np.array([mode.frequency for mode in self.resonances.values()])

    @property
    def dampings(self) -> Array:
        """Damping ratios (postures,)."""
        return np.array([mode.damping for mode in self.resonances.values()])

    def to_json(self) -> dict[str, Any]:
        """Plain data: the ranges of frequency and damping over the postures, and the values in every posture."""
        return {
            "frequency": [float(np.min(self.frequencies)), float(np.max(self.frequencies))],
            "damping": [float(np.min(self.dampings)), float(np.max(self.dampings))],
            "postures": {name: mode.to_json() for name, mode in self.resonances.items()},
        }


def modes_over_postures(
    models: Sequence[Resonating], of: Literal["resonances", "antiresonances"] = "resonances"
) -> list[ModeOverPostures]:
    """Match the modes of all postures, sorted by frequency; ``of`` selects poles (resonances) or zeros.

    A resonance of one posture is matched with that of another whose frequency (and, with less weight, damping) is
    nearest by ratio, each at most once. Resonances further apart than ``FARTHEST`` are different modes.
    """
    from scipy.optimize import linear_sum_assignment

    modes: list[dict[str, Resonance]] = []
    lists: list[tuple[str, tuple[Resonance, ...]]] = [(model.name, getattr(model, of)) for model in models]
    for name, resonances in sorted(lists, key=lambda posture: -len(posture[1])):
        cost = np.array(
            [
                [min(_distance(mode, counterpart) for counterpart in row.values()) for row in modes]
                for mode in resonances
            ]
        )
        pairs = (
            zip(*linear_sum_assignment(np.minimum(cost, 2.0 * FARTHEST)), strict=True) if modes and resonances else ()
        )
        matched = {int(i): int(j) for i, j in pairs if cost[i, j] < FARTHEST}
        for i, mode in enumerate(resonances):
            row = modes[matched[i]] if i in matched else {}
            if i not in matched:
                modes.append(row)
            row[name] = mode
    order = {model.name: place for place, model in enumerate(models)}
    sorted_rows = [dict(sorted(row.items(), key=lambda item: order[item[0]])) for row in modes]
    return sorted(
        (ModeOverPostures(row) for row in sorted_rows), key=lambda matched_mode: float(matched_mode.frequencies.mean())
    )


def _distance(one: Resonance, other: Resonance) -> float:
    damping = abs(float(np.log(max(one.damping, 1e-4) / max(other.damping, 1e-4))))
    return abs(float(np.log(one.frequency / other.frequency))) + DAMPING_SHARE * damping


# ------------------------------------------------------------------------------------------------------------------
# Check of the resonances of a difference equation on its recording
# ------------------------------------------------------------------------------------------------------------------

WHITENING_ORDER = 30
NEEDED = 5.0  # a pair of poles is needed if it lowers the cost by this multiple of the logarithm of the rows
DIRECT = 5  # inputs that act directly: with them a true delay of up to three samples more than the model's has no bias
ROWS_PER_UNKNOWN = 4  # below that many rows nothing is compared
WHITENINGS = 3  # alternating estimates of the whitening filter and of the numerators
STEPS = 6  # of the search for the maximum-likelihood estimate
LARGEST_STEP = 0.3  # of the logarithms of frequency and damping
SETTLED = 1e-5  # change of the logarithms at which the search ends
RANK = 1e-12  # singular values of the scaled columns below this share of the largest are zero
DIFFERENCE = 1e-5  # of the logarithms of frequency and damping, for derivatives
LEAST_ERROR = 1e-7  # least error relative to the output: a model without noise has that of rounding
LARGEST_GROWTH = 20.0  # logarithm of the growth of free motions over the rows beyond which they are not compared
REAL = 1e-9  # imaginary part below which a pole is real

Poles = NDArray[np.complex128]


@dataclass(frozen=True)
class _Rows:
    """Input ``u`` and output ``y``, (N,) each, and the coefficients of the filter W = 1 + w_1 z^-1 + .."""

    u: Array
    y: Array
    whitening: Array

    def white(self, columns: Array) -> Array:
        """Pass ``columns`` (N, m) through W, without the rows at which the filter starts."""
        from scipy.signal import lfilter

        return np.asarray(lfilter(self.whitening, [1.0], columns, axis=0)[len(self.whitening) - 1 :])


def check_resonances(a: Array, delay: int, u: Array, y: Array, period: float) -> tuple[Resonance, ...]:
    """The weakly damped pairs of poles of ``1 - sum a_i z^-i`` that the input ``u`` and output ``y`` (N,) confirm.

    ``delay`` is that of the model in samples, ``period`` the sampling period (s). A standard deviation is the root of
    the sum of squares of that of the maximum-likelihood estimate and of the distance from it; it is None where the rows
    do not allow the comparison. Unstable pairs are no resonances.
    """
    poles = np.roots(np.concatenate([[1.0], -a])).astype(complex)
    poles = poles[poles.imag > -REAL]
    weak = np.array([_resonates(p) for p in poles], bool)
    rows = _Rows(u[: len(u) - delay], y[delay:], np.ones(1))
    growth = len(rows.u) * np.log(max(1.0, float(np.max(np.abs(poles), initial=0.0))))
    if growth > LARGEST_GROWTH or len(rows.u) < ROWS_PER_UNKNOWN * (4 * len(poles) + WHITENING_ORDER):
        return tuple(_resonance(p, None, None, period) for p in sorted(poles[weak], key=_frequency))
    rows = _estimate_whitening(rows, poles)
    kept = _needed_pairs(rows, poles, weak)
    rest, chosen = poles[~weak], np.array(sorted(poles[kept], key=_frequency))
    if not len(chosen):
        return ()
    logs = np.array([_logs(p) for p in chosen])
    best, variance = _refine_logs(rows, logs, rest)
    better = np.concatenate([[_pole(*pair) for pair in best], rest])  # whose error has less of the modes in it
    best, variance = _refine_logs(_estimate_whitening(rows, better), best, rest)
    spread = np.sqrt(variance + (best - logs) ** 2)
    elsewhere = np.abs(best - logs)[:, 0] > CERTAIN["frequency"]  # the mode that the rows show is another one
    spread[elsewhere, 1] = np.inf
    return tuple(_resonance(p, float(f), float(d), period) for p, (f, d) in zip(chosen, spread, strict=True))


def _frequency(pole: complex) -> float:
    """Natural frequency |ln p| of a pole, rad per sample."""
    return float(abs(np.log(pole)))


def _resonates(pole: complex) -> bool:
    return pole.imag > REAL and abs(pole) < 1.0 and -np.log(abs(pole)) < HIGHEST_DAMPING * _frequency(pole)


def _resonance(pole: complex, log_f: float | None, log_damping: float | None, period: float) -> Resonance:
    """The resonance of a ``pole``; ``log_f`` and ``log_damping`` are relative standard deviations."""
    s = np.log(pole) / period
    f, damping = float(abs(s) / (2.0 * np.pi)), float(-s.real / abs(s))
    if log_f is None or log_damping is None:
        return Resonance(f, damping)
    return resonance(f, damping, log_f, log_damping)


def _logs(pole: complex) -> tuple[float, float]:
    """Logarithms of the natural frequency (rad per sample) and of the damping ratio of a pole."""
    s = np.log(pole)
    return float(np.log(abs(s))), float(np.log(-s.real / abs(s)))


def _pole(log_frequency: float, log_damping: float) -> complex:
    damping = min(float(np.exp(log_damping)), 0.999)
    return complex(np.exp(np.exp(log_frequency) * (-damping + 1j * np.sqrt(1.0 - damping**2))))


def _columns(rows: _Rows, pole: complex) -> Array:
    """Responses (N, 4 or 2) of the term with a ``pole`` (and its conjugate) to the input and to the initial state."""
    from scipy.signal import lfilter

    pulse = np.zeros(len(rows.u))
    pulse[0] = 1.0
    pair = pole.imag > REAL
    denominator = [1.0, -2.0 * pole.real, abs(pole) ** 2] if pair else [1.0, -pole.real]
    responses = lfilter([1.0], denominator, np.stack([rows.u, pulse], axis=1), axis=0)
    return np.hstack([responses, np.vstack([np.zeros((1, 2)), responses[:-1]])]) if pair else np.asarray(responses)


def _all_columns(rows: _Rows, poles: Poles) -> list[Array]:
    """The columns of every pole, and (N, DIRECT): the input itself, late by none to DIRECT - 1 samples."""
    late = [np.concatenate([np.zeros(k), rows.u[: len(rows.u) - k]]) for k in range(DIRECT)]
    return [*(_columns(rows, p) for p in poles), np.stack(late, axis=1)]


def _estimate_whitening(rows: _Rows, poles: Poles) -> _Rows:
    """Estimate the filter W from the error of the numerators that fit best."""
    rows = replace(rows, whitening=np.ones(1))
    X = np.hstack(_all_columns(rows, poles))
    least = LEAST_ERROR * float(rms(rows.y - rows.y.mean()))
    for _ in range(WHITENINGS):
        error = rows.y - X @ solve(rows.white(X), rows.white(rows.y), RANK).x
        if float(rms(error)) < least:
            return replace(rows, whitening=np.ones(1))
        k = np.arange(WHITENING_ORDER, len(error))
        past = np.stack([error[k - i] for i in range(1, WHITENING_ORDER + 1)], axis=1)
        rows = replace(rows, whitening=np.concatenate([[1.0], -solve(past, error[k], RANK).x]))
    return rows


def _variance(rows: _Rows, cost: float, unknowns: int) -> float:
    """Variance of the white error, at least that of rounding."""
    least = LEAST_ERROR**2 * float(np.mean((rows.y - rows.y.mean()) ** 2))
    return max(cost / max(len(rows.u) - unknowns, 1), least)


def _needed_pairs(rows: _Rows, poles: Poles, weak: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mask of the ``weak`` pairs that the rows need: the least needed one is left out until all that remain are.

    Only the response to the input counts: a free motion of a pair without damping explains a tone in the noise too.
    """
    columns = _all_columns(rows, poles)
    owner = np.concatenate([np.full(block.shape[1], i) for i, block in enumerate(columns)])
    for i in range(len(poles)):
        owner[np.flatnonzero(owner == i)[1::2]] = len(poles)  # the responses to the initial state always stay
    X = rows.white(np.hstack(columns))
    R = triangular(np.column_stack([scale_columns(X)[0], rows.white(rows.y[:, None])]))

    def cost(mask: NDArray[np.bool_]) -> float:
        use = np.append(mask, True)[owner]
        return float(np.sum(solve(R[:, :-1][:, use], R[:, -1], RANK).residual(R[:, -1]) ** 2))

    limit = NEEDED * np.log(2.0 * len(rows.u)) * _variance(rows, cost(np.ones(len(poles), bool)), X.shape[1])
    kept = np.ones(len(poles), bool)
    while (weak & kept).any():
        current_cost, trials = cost(kept), np.flatnonzero(weak & kept)
        gains = [cost(kept & (np.arange(len(poles)) != i)) - current_cost for i in trials]
        least = int(np.argmin(gains))
        if gains[least] > limit:
            break
        kept[trials[least]] = False
    return np.asarray(weak & kept)


def _refine_logs(rows: _Rows, logs: Array, rest: Poles) -> tuple[Array, Array]:
    """Maximum-likelihood estimate of the ``logs`` (m, 2) of frequency and damping ratio, and its variances (m, 2).

    The poles ``rest`` stay as they are. The numerators are projected out (variable projection), so that the variances
    include their uncertainty.
    """
    y = rows.white(rows.y[:, None])[:, 0]
    others = [rows.white(block) for block in _all_columns(rows, rest)]

    def columns(x: Array) -> Array:
        return np.hstack([*(rows.white(_columns(rows, _pole(*pair))) for pair in x.reshape(-1, 2)), *others])

    def linearise(x: Array) -> tuple[Array, Array]:
        return project(columns(x), y, lambda c: _slopes(rows, x.reshape(-1, 2), c), RANK)[:2]

    def cost(x: Array) -> float:
        return float(np.sum(solve(columns(x), y, RANK).residual(y) ** 2))

    optimum = search(logs.ravel(), linearise, cost=cost, largest=LARGEST_STEP, steps=STEPS, small_step=SETTLED)
    unknowns = columns(optimum.state).shape[1] + logs.size
    variances = unknown_variances(optimum.J, _variance(rows, optimum.cost, unknowns))
    return optimum.state.reshape(-1, 2), variances.reshape(-1, 2)


def _slopes(rows: _Rows, logs: Array, coefficients: Array) -> Array:
    """Derivatives (N, 2 m) of the whitened output by ``logs``, for the ``coefficients`` of all columns."""
    derivatives = []
    for i, at in enumerate(logs):
        mode_coefficients = coefficients[4 * i : 4 * i + 4]
        for direction in np.eye(2):
            ends = [
                _columns(rows, _pole(*(at + sign * DIFFERENCE * direction))) @ mode_coefficients for sign in (1.0, -1.0)
            ]
            derivatives.append((ends[0] - ends[1]) / (2.0 * DIFFERENCE))
    return rows.white(np.stack(derivatives, axis=1))
