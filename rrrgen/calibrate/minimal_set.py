"""The minimal set of geometric parameters that a kind of measurement can determine.

The derivative of the measurement by every parameter is stacked over random joint positions. A parameter whose column is
a linear combination of those before it has the same effect as these together, and is left out. Since the positions are
generic, no choice of poses can determine more parameters. The set is refused unless dependent and independent columns
are clearly apart: their remainders must be below ``DEPENDENT`` or above ``INDEPENDENT``.
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
DEPENDENT = 1e-9  # largest remainder of a dependent column, as a share of its length: rounding errors are smaller
INDEPENDENT = 1e-5  # least remainder of an independent column, as a share of its length; angles in rad, lengths in m
SHOWN = 1e-6


@dataclass(frozen=True)
class MinimalSet:
    """The parameters ``kept`` for the calibration, and those that are ``left_out``.

    ``left_out`` maps the name of a parameter to a sentence that says which kept parameters have the same effect.
    """

    kept: tuple[Entry, ...]
    left_out: dict[str, str]


def minimal_set(geometry: Geometry, kind: Kind) -> MinimalSet:
    """Find the parameters of ``geometry`` that measurements of ``kind`` determine.

    Raises :class:`DerivationError` where that cannot be decided, because some axes are nearly but not quite parallel.
    """
    entries = geometry.entries()
    random = np.random.default_rng(SEED)
    q = random.uniform(-np.pi, np.pi, (POSES, geometry.joints))
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
