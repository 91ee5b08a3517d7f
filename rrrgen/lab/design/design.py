"""Design of an exciting trajectory: search from several random starts, choice of the best feasible one, output files.

Source: (14.24) and the excitation measures after (14.20) of Kostic, de Jager, Steinbuch, Robotics and Automation
Handbook, CRC Press 2005, chapter 14.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rrrgen.base.errors import DerivationError
from rrrgen.base.files import write_file
from rrrgen.lab.design.check import ExcitationCheck, LimitUse, ProblemFunctions, check_trajectory
from rrrgen.lab.design.fourier_series import FourierTrajectory
from rrrgen.lab.design.problem import ExcitationLimits, ExcitationProblem, excitation_problem
from rrrgen.lab.design.search import StartResult, solve_start
from rrrgen.lab.design.starts import Progress, run_starts

__all__ = [
    "ExcitationCheck",
    "ExcitationDesign",
    "ExcitationLimits",
    "ExcitationProblem",
    "LimitUse",
    "ProblemFunctions",
    "StartResult",
    "check_trajectory",
    "design_excitation",
    "excitation_problem",
    "run_starts",
    "solve_start",
    "write_trajectory_csv",
]


@dataclass(frozen=True, eq=False)
class ExcitationDesign:
    """Result of a search: the problem and the results of all starts, the best first."""

    problem: ExcitationProblem
    starts: tuple[StartResult, ...]

    @property
    def best(self) -> StartResult:
        """The result of the best start."""
        return self.starts[0]

    @property
    def trajectory(self) -> FourierTrajectory:
        """The exciting trajectory."""
        return self.best.trajectory

    def to_json(self) -> dict[str, Any]:
        """The design as plain data for JSON: trajectory, check, and a summary of every start."""
        return {
            "problem": self.problem.digest(),
            "objective": self.problem.objective,
            "seed": self.best.seed,
            "trajectory": self.trajectory.to_json(),
            "check": self.best.check.to_json(),
            "starts": [
                {
                    "seed": s.seed,
                    "feasible": s.check.feasible,
                    "condition": s.check.condition,
                    "start_condition": s.start_condition,
                }
                for s in self.starts
            ],
        }

    def write(self, folder: Path) -> list[Path]:
        """Write ``excitation.json`` (coefficients) and ``excitation.csv`` (controller samples), return both."""
        result, samples = folder / "excitation.json", folder / "excitation.csv"
        write_file(result, json.dumps(self.to_json(), indent=1) + "\n")
        write_trajectory_csv(samples, self.trajectory, self.problem.sample_period)
        return [result, samples]


def design_excitation(
    problem: ExcitationProblem,
    starts: int = 4,
    *,
    seed: int = 0,
    jobs: int = 1,
    cluster: str | None = None,
    checkpoints: Path | None = None,
    progress: Progress | None = None,
) -> ExcitationDesign:
    """Search from ``starts`` seeds (seed, seed+1, ...) and keep the best trajectory that meets every limit.

    ``jobs`` is the number of processes, ``cluster`` ("tcp://host:port") the Dask scheduler used instead. Finished
    starts are stored in the folder ``checkpoints`` and read back by a repeated call. ``progress(done, total, message)``
    is called after each start. The result depends on (problem, starts, seed) only. Raises DerivationError, with the
    violations, if no start meets all limits.
    """
    results = run_starts(
        problem, range(seed, seed + starts), jobs=jobs, cluster=cluster, checkpoints=checkpoints, progress=progress
    )
    ordered = sorted(results, key=lambda r: (*r.objective(problem.objective), r.seed))
    if not ordered[0].check.feasible:
        raise DerivationError(f"no start met every limit: {_violations(ordered[0].check.limits, problem)}")
    return ExcitationDesign(problem, tuple(ordered))


def _violations(limits: Sequence[LimitUse], problem: ExcitationProblem) -> str:
    worst = sorted((u for u in limits if u.use > 1.0), key=lambda u: -u.use)

    def name_of(use: LimitUse) -> str:
        followers = problem.limits.followers
        return (
            f"position of {followers[use.index].name}"
            if use.quantity == "follower"
            else f"{use.quantity} {use.index + 1}"
        )

    return ", ".join(f"{name_of(u)} at {100 * u.use:.1f} % of its limit" for u in worst)


def write_trajectory_csv(path: Path, trajectory: FourierTrajectory, sample_period: float, cycles: float = 1.0) -> None:
    """Write a trajectory as a CSV table with the columns ``t, q1.., dq1.., ddq1..`` in SI.

    It covers ``cycles`` periods in steps of ``sample_period`` (s); every float reads back exactly.
    """
    t = trajectory.times(sample_period, cycles)
    q, dq, ddq = trajectory.evaluate(t)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["t", *(f"{name}{i + 1}" for name in ("q", "dq", "ddq") for i in range(trajectory.n))])
    writer.writerows(np.column_stack([t, q, dq, ddq]).tolist())
    write_file(path, text.getvalue())
