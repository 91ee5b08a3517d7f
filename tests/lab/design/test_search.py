"""Ctrl-C while a trajectory is searched: nothing is lost, nothing is swallowed, the same bytes when it goes on."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress

import click
import pytest

pytest.importorskip("casadi", reason="the search for exciting trajectories needs CasADi")


import casadi

from lab.design.problems import HERE, SEARCHED, pendulum_problem, same
from rrrgen.lab.design.design import run_starts, solve_start

SLOW_SEARCH = """
import signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell that runs tests in the background ignores it
sys.path[:0] = {paths!r}
from pathlib import Path
from lab.design.problems import pendulum_problem
from rrrgen.lab.design.design import run_starts
if __name__ == "__main__":
    def say(done, total, message):
        print(done, flush=True)
        if done == 1:
            time.sleep(5)  # the interruption comes here, and not after the end of a fast search
    run_starts(pendulum_problem(), {starts!r}, jobs=2, checkpoints=Path(sys.argv[1]), progress=say)
"""


def test_ctrl_c_loses_nothing_that_was_finished(tmp_path, undisturbed) -> None:
    """Interrupt a parallel search after its first result; the rerun completes it to the same end."""
    paths = [str(HERE), str(HERE.parents[1]), str(HERE.parents[2])]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}  # what the worker processes import
    script = tmp_path / "search.py"
    script.write_text(SLOW_SEARCH.format(paths=paths, starts=SEARCHED))
    process = subprocess.Popen(
        [sys.executable, str(script), str(tmp_path / "checkpoints")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
        start_new_session=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline().strip() == "1"
    for _ in range(20):  # what a terminal sends; again where a library was busy and did not hear it
        os.killpg(process.pid, signal.SIGINT)
        try:
            process.communicate(timeout=6)
            break
        except subprocess.TimeoutExpired:
            continue
    assert process.returncode != 0
    finished = list((tmp_path / "checkpoints").glob("start-*.json"))
    assert 1 <= len(finished) < len(SEARCHED)
    assert not list((tmp_path / "checkpoints").glob("*.part"))
    stamps = {path: path.stat().st_mtime_ns for path in finished}
    resumed = run_starts(pendulum_problem(), SEARCHED, checkpoints=tmp_path / "checkpoints")
    assert all(path.stat().st_mtime_ns == stamp for path, stamp in stamps.items())
    assert all(same(a, b) for a, b in zip(resumed, undisturbed, strict=True))


@pytest.fixture
def ctrl_c():
    """Sends what a terminal sends at Ctrl-C, after so many seconds."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have told us to ignore it
    timers = []

    def send(after: float) -> None:
        timers.append(threading.Timer(after, os.kill, (os.getpid(), signal.SIGINT)))
        timers[-1].start()

    yield send
    for timer in timers:
        timer.cancel()
    signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("call", ["vertcat", "DM", "nlpsol", "inv"])
def test_an_interruption_that_casadi_swallows_is_raised(monkeypatch, ctrl_c, call) -> None:
    """The Python code of CasADi catches every exception in places; the search must not go on behind one."""
    heard: list[int] = []
    original, problem = getattr(casadi, call), pendulum_problem()

    def swallow(*arguments, **options):
        with suppress(BaseException):
            if not heard:
                heard.append(1)
                signal.raise_signal(signal.SIGINT)
        return original(*arguments, **options)

    monkeypatch.setattr(casadi, call, swallow)
    with pytest.raises(KeyboardInterrupt):
        solve_start(problem, 0)
    assert heard
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_no_interruption_is_lost_inside_the_solver(ctrl_c) -> None:
    """Where one hits an evaluation, IPOPT goes on from another point: the result would be that of no search at all."""
    problem = pendulum_problem()
    began = time.monotonic()
    solve_start(problem, 0)
    duration = time.monotonic() - began

    def search_again_and_again(seconds: float) -> None:
        ctrl_c(seconds)
        for _ in range(100):  # a busy machine may take longer to get there
            solve_start(problem, 0)

    for share in (0.2, 0.4, 0.6):
        with pytest.raises(KeyboardInterrupt):  # which may come at once where the machine is busy
            search_again_and_again(share * duration)


SMALL = """
schema: rrrgen-experiment/1
period: 10 ms
excitation: {harmonics: 3, base_frequency: 0.25, limits: {speed: 4, acceleration: 30}}
"""


def test_an_interrupted_and_resumed_excite_gives_the_same_bytes(tmp_path, monkeypatch, ctrl_c) -> None:
    from click.testing import CliRunner

    from rrrgen.cli.main import cli
    from rrrgen.lab.design import starts

    (tmp_path / "experiment.yaml").write_text(SMALL)

    def excite(folder: str) -> None:
        words = ["experiment", "excite", "planar2r", "--experiment", str(tmp_path / "experiment.yaml"), "--starts", "2"]
        CliRunner().invoke(cli, [*words, "-o", str(tmp_path / folder)], standalone_mode=False, catch_exceptions=False)

    def disturbed(problem, seed):
        if seed == 1:
            ctrl_c(0.02)
        return solve_start(problem, seed)

    excite("undisturbed")
    with monkeypatch.context() as patch:
        patch.setattr(starts, "solve_start", disturbed)
        with pytest.raises((KeyboardInterrupt, click.Abort)):
            excite("resumed")
    folder = tmp_path / "resumed"
    assert json.loads((folder / "run.json").read_text())["status"] == "interrupted"
    assert len(list((folder / "checkpoints" / "starts").iterdir())) == 1
    excite("resumed")
    contents = [
        {file.relative_to(place): file.read_bytes() for file in sorted(place.rglob("*")) if file.is_file()}
        for place in (tmp_path / "undisturbed", folder)
    ]
    assert len(contents[0]) > 8
    assert contents[0] == contents[1]
