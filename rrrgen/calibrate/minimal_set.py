"""The minimal set of geometric parameters that a kind of measurement can determine, and what it cannot tell apart.

The derivative of the measurement by every parameter is stacked over random joint positions. A column that is a
combination of those before it adds nothing: what it does, they do as well. The rank is that of generic positions, hence
the best that any choice of poses can reach. Between columns that count and those that do not lie six decades, or the
set is refused.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rrrgen.arrays import Array
from rrrgen.calibrate.geometry import Entry, Geometry
from rrrgen.calibrate.measurements import Kind, observed
from rrrgen.errors import DerivationError

POSES = 120
SEED = 1
DEPENDENT = 1e-9  # of the length of a column: what round-off leaves of a dependent one
INDEPENDENT = 1e-5  # of the length of a column: the least that an independent one adds, angles in rad, lengths of 1 m
SHOWN = 1e-6


@dataclass(frozen=True)
class MinimalSet:
    """The parameters ``kept``, and for each one left out a sentence that says with which it acts."""

    kept: tuple[Entry, ...]
    left_out: dict[str, str]


def minimal_set(geometry: Geometry, kind: Kind) -> MinimalSet:
    """Parameters that measurements of ``kind`` determine.

    Raises :class:`DerivationError` if it cannot be decided: axes that are parallel only nearly.
    """
    entries = geometry.entries()
    random = np.random.default_rng(SEED)
    q = random.uniform(-np.pi, np.pi, (POSES, geometry.n))
    J = observed(kind, geometry, q, geometry.jacobian(q, entries)).reshape(-1, len(entries))
    kept: list[int] = []
    left_out: dict[str, str] = {}
    basis = np.zeros((len(J), 0))
    for k, entry in enumerate(entries):
        column = J[:, k]
        rest = column
        for _ in range(2):  # twice is enough for orthogonality to round-off
            rest = rest - basis @ (basis.T @ rest)
        size = float(np.linalg.norm(column)) or 1.0
        share = float(np.linalg.norm(rest)) / size
        if share > INDEPENDENT:
            basis = np.column_stack([basis, rest / np.linalg.norm(rest)])
            kept.append(k)
        elif share < DEPENDENT or size < DEPENDENT:
            left_out[entry.name] = _reason(column, J[:, kept], [entries[i] for i in kept])
        else:
            message = f"{entry.name} is told apart from other parameters only to {share:.0e}"
            raise DerivationError(f"{message}: axes nearly parallel, and not quite; calibrate from the nominal table")
    return MinimalSet(tuple(entries[k] for k in kept), left_out)


def _reason(column: Array, kept: Array, entries: list[Entry]) -> str:
    if float(np.linalg.norm(column)) < SHOWN:
        return "no effect"
    factors = np.linalg.lstsq(kept, column, rcond=None)[0]
    parts = [
        f"{factor:+.4g} {entry.name}" for factor, entry in zip(factors, entries, strict=True) if abs(factor) > SHOWN
    ]
    return "acts like " + " ".join(parts)
