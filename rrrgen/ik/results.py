"""Results of the inverse kinematics, and the interface of its engines: compiled C, or evaluated in Python."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import DTypeLike, NDArray


@dataclass(frozen=True)
class IKResult:
    """All solutions found for one target.

    ``q`` (k, n) are the configurations in rad or m; ``flags`` (k,) sums of MULTIPLE, FREE, OUTSIDE, INEXACT; ``branch``
    (k,) numbers that stay constant along a path without singularities (:meth:`InverseKinematics.branch_names` decodes
    them); ``residual`` (k,) the remaining errors of the task: the root of the sum of squares of the orientation error
    (rad) and of the position error divided by a length, which the header of the emitted C states. Without a solution,
    ``status`` and ``reason`` say why, and ``distance`` (m) is the distance of the target from the workspace (negative
    if unknown). With the status "incomplete" there may be further solutions, even if none was found.
    """

    q: NDArray[np.float64]
    flags: NDArray[np.uint32]
    branch: NDArray[np.uint32]
    residual: NDArray[np.float64]
    status: str
    reason: str
    distance: float

    def __len__(self) -> int:
        return len(self.q)


@dataclass(frozen=True)
class IKBatch:
    """Solutions for a batch of targets of shape (...), at most k_max for each.

    Of the configurations ``q`` (..., k_max, n), rad or m, the first ``counts`` (...) of each target are solutions; the
    rest of ``q`` is NaN. ``flags`` and ``branch``, (..., k_max), are those of :class:`IKResult`; ``statuses`` (...) are
    indices of :data:`~rrrgen.ik.result_layout.STATUS`; ``distances`` (...), m, are the distances of the targets from
    the workspace.
    """

    q: NDArray[np.float64]
    counts: NDArray[np.int32]
    flags: NDArray[np.uint32]
    branch: NDArray[np.uint32]
    statuses: NDArray[np.int32]
    distances: NDArray[np.float64]


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


class SolverEngine(Protocol):
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
    for i, answer in enumerate(answers):
        k = out.counts[i] = len(answer.q)
        out.q[i, :k], out.flags[i, :k], out.branch[i, :k] = answer.q, answer.flags, answer.branch
        out.statuses[i], out.distances[i] = answer.code, answer.distance
    return out


def empty_batch(count: int, rows: int, n: int, scalar: DTypeLike = np.float64) -> IKBatch:
    """Create an empty batch result for ``count`` targets, with room for ``rows`` solutions of ``n`` joints each.

    ``scalar`` is the type of its real numbers.
    """
    return IKBatch(
        np.full((count, rows, n), np.nan, scalar),
        np.zeros(count, np.int32),
        np.zeros((count, rows), np.uint32),
        np.zeros((count, rows), np.uint32),
        np.zeros(count, np.int32),
        np.zeros(count, scalar),
    )
