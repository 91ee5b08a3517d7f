"""Choice of the friction law by errors on windows that were not fitted, and by the Bayesian information criterion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.lab.friction.joint_simulation import Windows
from rrrgen.lab.friction.multiple_shooting import ShootingFit, window_losses

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
    for fold, found in enumerate(inside):
        out = folds == fold
        losses[out] = window_losses(found.candidate, found.theta, windows.of(out), found.noise, sigma)
    own = window_losses(full.candidate, full.theta, windows, full.noise, sigma)
    N, k = windows.points, len(full.theta)
    return LawScore(
        law=full.candidate.name,
        parameters=k,
        held_out=float(np.sqrt(np.sum(losses) / N)),
        bic=float(N * np.log(np.sum(own) / N) + k * np.log(N)),
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
