"""The interface of inverse kinematics engines (compiled C, or evaluated in Python): solve one target, or many."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from rrrgen.runtime.results import IKBatch

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True)
class Answer:
    """Result of the inverse kinematics for one target, with k solutions.

    ``code`` is the status, ``q`` (k, n) are the solutions, rad or m, with their ``flags``, ``branch`` numbers and
    ``residual`` errors, (k,) each. Without a solution ``stage`` is the number of the reason and ``distance`` (m) that
    of the target from the workspace.
    """

    code: int
    q: NDArray[np.float64]
    flags: NDArray[np.uint32]
    branch: NDArray[np.uint32]
    residual: NDArray[np.float64]
    stage: int
    distance: float


class Engine(Protocol):
    """Interface of an inverse kinematics engine; targets are positions or poses whose shapes are already checked."""

    def answer(
        self, goal: NDArray[np.float64], reference: NDArray[np.float64] | None, given: float, bits: int, closest: bool
    ) -> Answer:
        """Solve for one target ``goal``, or with ``closest`` find the configuration nearest to it.

        ``reference`` (n,) is the reference configuration or None, ``given`` the redundancy parameter, rad or m,
        ``bits`` the options.
        """
        ...

    def batch(
        self,
        goals: NDArray[np.float64],
        reference: NDArray[np.float64] | None,
        given: NDArray[np.float64] | None,
        bits: int,
    ) -> IKBatch:
        """Solve N targets; the arguments are those for one target, with a leading axis of length N.

        ``goals`` are the checked targets, row-major, (N, 16) or (N, 3); ``reference`` and ``given`` the reference
        configurations and redundancy parameters, None for none; ``bits`` the options.
        """
        ...


def batch_of(answers: Sequence[Answer], rows: int, n: int) -> IKBatch:
    """Pack the answers for several targets into arrays with room for ``rows`` solutions of ``n`` joints each."""
    out = empty_batch(len(answers), rows, n)
    for i, found in enumerate(answers):
        k = out.counts[i] = len(found.q)
        out.q[i, :k], out.flags[i, :k], out.branch[i, :k] = found.q, found.flags, found.branch
        out.statuses[i], out.distances[i] = found.code, found.distance
    return out


def empty_batch(count: int, rows: int, n: int) -> IKBatch:
    """Create an empty batch result for ``count`` targets, with room for ``rows`` solutions of ``n`` joints each."""
    return IKBatch(
        np.full((count, rows, n), np.nan),
        np.zeros(count, np.int32),
        np.zeros((count, rows), np.uint32),
        np.zeros((count, rows), np.uint32),
        np.zeros(count, np.int32),
        np.zeros(count),
    )
