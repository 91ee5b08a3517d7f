"""Resonances over several postures: matching of the modes of different postures, ranges of their frequencies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.response.response_model import Resonance, ResponseModel

FARTHEST = 0.4  # largest logarithm of the ratio of two frequencies that may belong to the same mode
DAMPING_SHARE = 0.1  # weight of the logarithm of dampings beside that of frequencies


@dataclass(frozen=True)
class ModeOverPostures:
    """One vibration mode: its resonance in each posture in which it was found, by the name of the posture."""

    found: dict[str, Resonance]

    @property
    def frequencies(self) -> Array:
        """Frequencies of the mode, Hz, (postures,)."""
        return np.array([each.frequency for each in self.found.values()])

    @property
    def dampings(self) -> Array:
        """Damping ratios (postures,)."""
        return np.array([each.damping for each in self.found.values()])

    def to_json(self) -> dict[str, Any]:
        """Plain data: the ranges of frequency and damping over the postures, and the values in every posture."""
        return {
            "frequency": [float(np.min(self.frequencies)), float(np.max(self.frequencies))],
            "damping": [float(np.min(self.dampings)), float(np.max(self.dampings))],
            "postures": {name: each.to_json() for name, each in self.found.items()},
        }


def modes_over_postures(
    models: Sequence[ResponseModel], of: Literal["resonances", "antiresonances"] = "resonances"
) -> list[ModeOverPostures]:
    """Match the modes of all postures, sorted by frequency; ``of`` selects poles (resonances) or zeros.

    A resonance of one posture is matched with that of another whose frequency (and, with less weight, damping) is
    nearest by ratio, each at most once. Resonances further apart than ``FARTHEST`` are different modes.
    """
    from scipy.optimize import linear_sum_assignment

    modes: list[dict[str, Resonance]] = []
    lists: list[tuple[str, tuple[Resonance, ...]]] = [(each.name, getattr(each, of)) for each in models]
    for name, own in sorted(lists, key=lambda each: -len(each[1])):
        cost = np.array([[min(_distance(mode, each) for each in row.values()) for row in modes] for mode in own])
        pairs = zip(*linear_sum_assignment(np.minimum(cost, 2.0 * FARTHEST)), strict=True) if modes and own else ()
        matched = {int(i): int(j) for i, j in pairs if cost[i, j] < FARTHEST}
        for i, mode in enumerate(own):
            row = modes[matched[i]] if i in matched else {}
            if i not in matched:
                modes.append(row)
            row[name] = mode
    order = {model.name: place for place, model in enumerate(models)}
    sorted_rows = [dict(sorted(row.items(), key=lambda item: order[item[0]])) for row in modes]
    return sorted((ModeOverPostures(row) for row in sorted_rows), key=lambda each: float(each.frequencies.mean()))


def _distance(one: Resonance, other: Resonance) -> float:
    damping = abs(float(np.log(max(one.damping, 1e-4) / max(other.damping, 1e-4))))
    return abs(float(np.log(one.frequency / other.frequency))) + DAMPING_SHARE * damping
