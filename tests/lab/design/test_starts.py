"""Many starts of a search: checkpoints, the best one, processes that are lost."""

from __future__ import annotations

import json
import os
import signal
import time
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("casadi", reason="the search for exciting trajectories needs CasADi")


from lab.design.problems import BETA, HERE, SEARCHED, pendulum_problem, same
from rrrgen.base.errors import InputError
from rrrgen.lab.design.design import ExcitationLimits, design_excitation, run_starts, write_trajectory_csv
from rrrgen.lab.design.search import random_start
from samples.casadi_arms import double_pendulum_torque


def test_search_resumes_from_checkpoints_and_ignores_damaged_ones(tmp_path) -> None:
    problem = pendulum_problem()
    seen: list[tuple[int, int]] = []
    first = run_starts(
        problem, range(3), checkpoints=tmp_path, progress=lambda done, total, _: seen.append((done, total))
    )
    assert seen == [(1, 3), (2, 3), (3, 3)]
    files = sorted(tmp_path.iterdir())
    assert len(files) == 3
    files[0].unlink()
    files[1].write_text(files[1].read_text()[:200])
    seen.clear()
    again = run_starts(
        problem, range(3), checkpoints=tmp_path, progress=lambda done, total, _: seen.append((done, total))
    )
    assert seen == [(1, 3), (2, 3), (3, 3)]  # one read back, two solved
    assert all(same(a, b) and a.history == b.history and a.check == b.check for a, b in zip(first, again, strict=True))
    other = replace(problem, max_iterations=61)
    run_starts(other, range(1), checkpoints=tmp_path)
    assert len(list(tmp_path.iterdir())) == 4  # another problem never reads these


def test_best_of_many_starts_is_kept_and_written(tmp_path) -> None:
    design = design_excitation(pendulum_problem(), 3, seed=5)
    conditions = [s.check.condition for s in design.starts]
    assert conditions == sorted(conditions)
    result, samples = design.write(tmp_path)
    data = json.loads(result.read_text())
    assert data["check"]["condition"] == design.best.check.condition
    rows = np.loadtxt(samples, delimiter=",", skiprows=1)
    assert samples.read_text().splitlines()[0] == "t,q1,q2,dq1,dq2,ddq1,ddq2"
    assert rows.shape == (2000, 7)
    assert np.array_equal(rows[:, 1:3], design.trajectory.derivative(rows[:, 0], 0))
    write_trajectory_csv(tmp_path / "two.csv", design.trajectory, 0.01, cycles=2)
    assert len((tmp_path / "two.csv").read_text().splitlines()) == 801


@pytest.mark.sweep  # as test_factoring.py shows for identification
def test_a_dask_cluster_survives_the_loss_of_a_worker(tmp_path, monkeypatch, undisturbed) -> None:
    """The same search on a cluster, whose worker is killed in the middle and replaced, gives the same result."""
    distributed = pytest.importorskip("distributed", reason="clusters need the extra 'cluster'")
    from joblib import parallel_config

    paths = [str(HERE), str(HERE.parents[1]), str(HERE.parents[2])]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(paths))
    problem = pendulum_problem()
    settings = []
    monkeypatch.setattr("joblib.parallel_config", lambda **given: settings.append(given) or parallel_config(**given))
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as cluster:
        killed: list[int] = []

        def progress(done: int, total: int, message: str) -> None:
            if not killed:
                victim = cluster.workers[0].process.pid
                os.kill(victim, signal.SIGKILL)
                killed.append(victim)

        results = run_starts(
            problem, SEARCHED, cluster=cluster.scheduler_address, checkpoints=tmp_path, progress=progress
        )
    assert len(killed) == 1
    assert settings[0]["scatter"] == [problem]  # sent once: Dask warns of a large graph if every start carries it
    assert len(list(tmp_path.iterdir())) == len(SEARCHED)
    assert all(same(a, b) for a, b in zip(results, undisturbed, strict=True))


def test_a_cluster_that_does_not_answer_is_an_input_error(monkeypatch) -> None:
    pytest.importorskip("distributed", reason="clusters need the extra 'cluster'")
    monkeypatch.setattr("rrrgen.base.parallel.CLUSTER_TIMEOUT", "1s")
    began = time.monotonic()
    with pytest.raises(InputError, match="no Dask scheduler answers"):
        run_starts(pendulum_problem(), range(1), cluster="tcp://127.0.0.1:9")
    assert time.monotonic() - began < 60


def test_a_start_that_the_drives_can_hold_stays_inside_the_limits_of_the_joints_that_have_some() -> None:
    limits = ExcitationLimits(
        position_lower=(1.0, None), position_upper=(2.0, None), speed=(6.0, 8.0), torque=(1.0, 0.5)
    )
    problem = pendulum_problem(limits=limits, torque=double_pendulum_torque(BETA))
    for seed in range(3):
        start = random_start(problem, seed)
        q = start.evaluate(np.linspace(0.0, start.period, 500))[0][:, 0]
        assert 1.0 <= q.min() <= q.max() <= 2.0
