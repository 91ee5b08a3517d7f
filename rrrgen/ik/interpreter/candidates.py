"""Candidate solutions of the inverse kinematics: the recorded solver, evaluated in floats on every path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sin
from typing import TYPE_CHECKING

from rrrgen.ik.geometry.rigid_transforms import Vector
from rrrgen.ik.plan import ARM_ANGLE
from rrrgen.ik.recording.float_builder import FloatBuilder, RootTolerances, paths

if TYPE_CHECKING:
    from rrrgen.ik.geometry.chain import Matrix
    from rrrgen.ik.plan import SolverPlan


@dataclass(eq=False)
class CandidateRow:
    """A candidate solution of the inverse kinematics.

    ``q`` are the joint positions, rad or m, ``flags`` a sum of flag bits, ``branch`` the number of the branch, and
    ``residual`` the squared task error, negative while it is unknown. ``free`` are the indices of joints that the
    target does not determine, ``doubtful`` those that it may not determine. ``settled`` tells that the candidate is
    known to meet the target.
    """

    q: list[float]
    flags: int
    branch: int
    residual: float
    free: frozenset[int] = frozenset()
    doubtful: frozenset[int] = frozenset()
    settled: bool = False


@dataclass(frozen=True)
class Query:
    """Input of the solver: checked target pose ``T`` (3, 4), reference configuration, redundancy parameter ``given``.

    Only the position of ``T`` counts where the task is a position; ``tool`` is that of the tool in the frame of the
    last link, where it is an input.
    """

    T: Matrix
    reference: Sequence[float]
    given: float = 0.0
    tool: Vector = (0.0, 0.0, 0.0)


def candidates(plan: SolverPlan, query: Query, settings: RootTolerances) -> tuple[list[CandidateRow], int]:
    """All candidate solutions in the order of the branches, and the latest choice (from 1) that had no real root.

    The latter tells which equation makes a target unreachable; 0 if every choice had a root.
    """
    rows: list[CandidateRow] = []
    stage = 0
    for path in paths(
        plan.equations.play,
        lambda script: FloatBuilder(
            query.T,
            query.reference,
            script,
            redundancy=query.given,
            tool=query.tool,
            settings=settings,
            fixed=plan.equations.fixed_pairs,
        ),
    ):
        stage = max(stage, path.failed)
        if not path.failed:
            rows.append(_row(plan, path))
    return rows, stage


def _row(plan: SolverPlan, path: FloatBuilder) -> CandidateRow:
    """The candidate to which a ``path`` leads.

    Its residual is unknown where the path checks nothing, or solves a similar arm. Virtual joints must be zero.
    """
    n = plan.chain.n
    branch = sum(number << bit for number, (_, bit, _) in zip(path.numbers, plan.equations.leaf.labels, strict=True))
    virtual = [x for j, x in path.values.items() if n <= j < ARM_ANGLE]
    checks = [*(x / plan.chain.reach for x in path.lengths), *path.ratios, *(2.0 * sin(0.5 * x) for x in virtual)]
    known = checks and not plan.snapped
    return CandidateRow(
        [path.values[j] for j in range(n)],
        path.flags,
        branch,
        sum(x * x for x in checks) if known else -1.0,
        frozenset(j for j in path.free if j < n),
        frozenset(j for j in path.doubtful if j < n),
    )
