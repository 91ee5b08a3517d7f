"""Parallel starts of the search, on the cores of this machine or a Dask cluster, interruptible and resumable.

The result of a start is a pure function of (problem, seed). Every finished start is written to disk at once, so that an
interrupted search loses only unfinished starts, and a repeated search returns the same result.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rrrgen.base.files import write_file
from rrrgen.base.parallel import as_computed
from rrrgen.lab.design.check import ExcitationCheck, LimitUse
from rrrgen.lab.design.fourier_series import FourierTrajectory
from rrrgen.lab.design.problem import ExcitationProblem
from rrrgen.lab.design.search import StartResult, solve_start

Progress = Callable[[int, int, str], None]
"""Called as ``progress(done, total, message)``."""


def run_starts(
    problem: ExcitationProblem,
    seeds: Sequence[int],
    *,
    jobs: int = 1,
    cluster: str | None = None,
    checkpoints: Path | None = None,
    progress: Progress | None = None,
) -> list[StartResult]:
    """Solve ``problem`` from every seed; returns the results in the order of ``seeds``.

    ``jobs`` is the number of processes on this machine (-1: all cores); ``cluster`` ("tcp://host:port") instead names a
    Dask scheduler whose workers can import rrrgen. With ``checkpoints`` (a folder), finished starts of the same problem
    are read back instead of solved again. ``progress(done, total, message)`` is called after each start. Raises
    InputError if the cluster cannot be reached.
    """
    digest = problem.digest()
    done = {} if checkpoints is None else _read_finished(checkpoints, digest, seeds)
    missing = [seed for seed in seeds if seed not in done]
    if progress is not None and done:
        progress(len(done), len(seeds), f"{len(done)} starts read back")
    for _, result in as_computed(solve_start, missing, jobs, cluster=cluster, shared=[problem]):
        done[result.seed] = result
        if checkpoints is not None:
            write_file(_place(checkpoints, digest, result.seed), json.dumps(_to_json(result, digest), indent=1))
        if progress is not None:
            best = min(done.values(), key=lambda r: r.score).check.condition
            progress(len(done), len(seeds), f"start {result.seed}: cond {result.check.condition:.4g}, best {best:.4g}")
    return [done[seed] for seed in seeds]


def _place(folder: Path, digest: str, seed: int) -> Path:
    return folder / f"start-{digest[:12]}-{seed}.json"


def _read_finished(folder: Path, digest: str, seeds: Sequence[int]) -> dict[int, StartResult]:
    """Results stored for exactly this problem; damaged files and those of other problems are ignored."""
    results = {}
    for seed in seeds:
        try:
            data = json.loads(_place(folder, digest, seed).read_text(encoding="utf-8"))
            if data["digest"] == digest and data["seed"] == seed:
                results[seed] = _from_json(data)
        except (OSError, ValueError, KeyError, TypeError):
            continue
    return results


def _to_json(result: StartResult, digest: str) -> dict[str, Any]:
    return {
        "digest": digest,
        "seed": result.seed,
        "start_condition": result.start_condition,
        "trajectory": result.trajectory.to_json(),
        "check": result.check.to_json(),
        "history": [[stage, list(values)] for stage, values in result.history],
    }


def _from_json(data: dict[str, Any]) -> StartResult:
    check = data["check"]
    return StartResult(
        seed=data["seed"],
        trajectory=FourierTrajectory.from_json(data["trajectory"]),
        check=ExcitationCheck(
            samples=check["samples"],
            condition=check["condition"],
            frobenius_condition=check["frobenius_condition"],
            log_determinant=check["log_determinant"],
            singular_values=tuple(check["singular_values"]),
            limits=tuple(LimitUse(**limit) for limit in check["limits"]),
        ),
        history=tuple((stage, tuple(values)) for stage, values in data["history"]),
        start_condition=data["start_condition"],
    )
