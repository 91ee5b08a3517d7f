"""Nonlinear least squares by damped Gauss-Newton steps (Levenberg 1944, Marquardt 1963), for every study."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.estimate.linear import scale_columns
from rrrgen.lab.estimate.tsqr import triangular

State = TypeVar("State")

Linearisation = tuple[Array, Array]
"""Residuals r (m,) and their derivatives J (m, k) by the k unknowns."""

LEAST_DAMPING = 1e-15  # below the squared round-off of scaled columns damping has no effect
ROUND_OFF = 1e-16  # predicted relative decrease of the cost that cannot be told from rounding


@dataclass(frozen=True, eq=False)
class Search(Generic[State]):
    """Where a search ended: ``state``, with the residuals ``r`` (m,) and their derivatives ``J`` (m, k) there.

    Both include the rows of the prior. ``cost`` is the sum of squares that was minimized. ``steps`` counts accepted
    steps, ``trials`` all that were tried. ``ended_by`` names the reason: "step" or "gain" (below the limit), "optimum"
    (no step promises a decrease), "tries" (no tried step gave one), "steps" or "trials" (limit reached), "not finite".
    """

    state: State
    r: Array
    J: Array
    cost: float
    steps: int
    trials: int
    ended_by: str


def add(state: Any, step: Array) -> Any:
    """The sum of a state (k,) and a step: the motion of unknowns that are plain numbers."""
    return state + step


def search(
    state: State,
    linearise: Callable[[State], Linearisation],
    *,
    moved: Callable[[State, Array], State] = add,
    cost: Callable[[State], float] | None = None,
    prior: Callable[[State], Linearisation] | None = None,
    after: Callable[[State], None] | None = None,
    largest: Array | float = np.inf,
    steps: int = 50,
    tries: int = 12,
    trials: int = 10**9,
    small_step: float = 0.0,
    small_gain: float = 0.0,
    damping: float = 1e-3,
    less: float = 10.0,
    more: float = 10.0,
    progress: Callable[[int], None] | None = None,
) -> Search[State]:
    """Minimize the sum of squared residuals ``|r|^2`` from ``state`` by the Levenberg-Marquardt method.

    Unknowns are scaled by the lengths of their columns in J. A step solves ``(B' B + damping I) step = -B' r`` with the
    scaled columns B through their singular values, so that it exists for columns that depend on each other too.

    ``linearise(state)`` returns r (m,) and J (m, k). ``moved(state, step)`` applies a step (k,): states on manifolds,
    bounds and signs that must stay live there; the sum by default. ``cost(state)`` is ``|r|^2`` where that is cheaper
    than ``linearise``, or a robust loss with the same gradient; infinity and NaN refuse a step. ``prior(state)``
    returns further rows of r and J, such as ``(w x, diag(w))`` for unknowns x known to be about 0 with standard
    deviations 1/w. ``after(state)`` is called after each accepted step, to renew weights that r and J hold fixed.
    ``largest`` (k,) bounds the size of a step in each unknown.

    The search ends after ``steps`` accepted or ``trials`` tried steps, after ``tries`` in a row that do not lower the
    cost, after a step that changes no unknown by ``small_step`` or lowers the cost by less than ``small_gain`` of it,
    or where the linear model promises no decrease beyond round-off. ``damping`` is divided by ``less`` after a step
    that is accepted and multiplied by ``more`` after one that is not. ``progress(number)`` is called before each step.
    """

    def rows(at: State) -> Linearisation:
        r, J = linearise(at)
        if prior is not None:
            more_r, more_J = prior(at)
            r, J = np.concatenate([r, more_r]), np.concatenate([J, more_J])
        return np.asarray(r), np.asarray(J)

    def total(at: State) -> float:
        assert cost is not None
        here = cost(at)
        return here if prior is None else here + float(np.sum(prior(at)[0] ** 2))

    def squares(r: Array) -> float:
        with np.errstate(over="ignore", invalid="ignore"):
            return float(r @ r)

    r, J = rows(state)
    now = squares(r) if cost is None else total(state)
    accepted = tried = 0
    ended_by = "steps"
    while accepted < steps and ended_by == "steps":
        if progress is not None:
            progress(accepted)
        k = J.shape[1]
        with np.errstate(over="ignore", invalid="ignore"):
            B, size = scale_columns(J)
        R = triangular(np.column_stack([B, r]))  # J may have many rows: only its triangular factor is decomposed
        if not (np.isfinite(now) and np.all(np.isfinite(size)) and np.all(np.isfinite(R))):
            ended_by = "not finite"
            break
        U, s, Vt = np.linalg.svd(R[:k, :k])
        gradient = U.T @ R[:k, k]
        if float(gradient[s > 0.0] @ gradient[s > 0.0]) <= ROUND_OFF * squares(r):
            ended_by = "optimum"
            break
        ended_by = "tries"
        for _ in range(tries):
            if tried == trials:
                ended_by = "trials"
                break
            tried += 1
            step = -(Vt.T @ (s / (s * s + damping) * gradient)) / size
            step = np.clip(step, -np.asarray(largest), largest)
            trial = moved(state, step)
            following = rows(trial) if cost is None else None
            reached = total(trial) if following is None else squares(following[0])
            if reached < now:
                gain = 1.0 - reached / now
                state, now, accepted, ended_by = trial, reached, accepted + 1, "steps"
                damping = max(damping / less, LEAST_DAMPING)
                if after is not None:
                    after(state)
                r, J = rows(state) if following is None or after is not None else following
                if after is not None:
                    now = squares(r) if cost is None else total(state)
                if float(np.max(np.abs(step), initial=0.0)) < small_step:
                    ended_by = "step"
                elif gain < small_gain:
                    ended_by = "gain"
                break
            damping *= more
    return Search(state, r, J, now, accepted, tried, ended_by)
