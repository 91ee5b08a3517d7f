"""Thresholds of contact detection for a given rate of false alarms, and the detection delay that results."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.lab.contact.extremes import Gumbel, block_maxima, fit_gumbel
from rrrgen.lab.contact.residuals import changes

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
    stretches = [np.asarray(each, float) for each in residuals]
    pairs = [np.hstack([r, changes(r, period, gain)]) for r in stretches]
    maxima = np.concatenate([block_maxima(pair, samples) for pair in pairs])
    if len(maxima) < FEWEST_BLOCKS:
        raise InputError(
            f"{len(maxima)} blocks of {block:g} s without contact are too few: record at least "
            f"{FEWEST_BLOCKS * block:g} s of the motion that the controller will do"
        )
    fitted = tuple(fit_gumbel(column) for column in maxima.T)
    probability = -math.expm1(-block / seconds_per_alarm / len(fitted))
    levels, n = tuple(each.level(probability) for each in fitted), len(fitted) // 2
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
