"""The regressor columns of drive terms as NumPy arrays, shared by runtime, identification and validation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

STANDSTILL = 1e-7
"""Speed (rad/s, m/s) up to which a drive counts as standing still, so that its Coulomb column is zero.

Reconstructed speeds of a drive at rest are round-off, whose sign is meaningless. The emitted friction function receives
true speeds and needs no such threshold; there only sgn(0) = 0.
"""


class ColumnTerm(Protocol):
    """The parts of a drive term that determine its column: its ``kind`` and its direction ``w`` (n,)."""

    @property
    def kind(self) -> str: ...  # noqa: D102
    @property
    def direction(self) -> tuple[Any, ...]: ...  # noqa: D102


def drive_columns(terms: Sequence[ColumnTerm], dq: Array, ddq: Array) -> Array:
    """The columns ``w f(w dq, w ddq)`` (..., n, len(terms)) of ``terms`` at ``dq`` and ``ddq``, (..., n) each.

    ``f`` is the acceleration, the speed, its sign (zero up to :data:`STANDSTILL`) or 1, by the kind of the term.
    """
    shape = np.broadcast_shapes(dq.shape, ddq.shape)
    W = np.zeros((*shape, len(terms)))
    for k, term in enumerate(terms):
        moved = [(i, float(w)) for i, w in enumerate(term.direction) if w]
        force = _force(term.kind, sum(w * dq[..., i] for i, w in moved), sum(w * ddq[..., i] for i, w in moved))
        for i, w in moved:
            W[..., i, k] = w * force
    return W


def _force(kind: str, speed: Any, acceleration: Any) -> Any:
    match kind:
        case "inertia":
            return acceleration
        case "viscous":
            return speed
        case "coulomb":
            return np.sign(speed) * (np.abs(speed) > STANDSTILL)
        case _:
            return 1.0
