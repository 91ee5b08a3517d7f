"""Long work says how far it is: the steps that the bars of `reconstruct`, `show`, the benchmark are drawn from."""

from __future__ import annotations

import inspect
import io
import sys
from contextlib import contextmanager

import numpy as np
import pytest
from click.testing import CliRunner

from bench import session
from rrrgen.cli import estimates, show
from rrrgen.cli.commands import COMMANDS, load_command
from rrrgen.cli.main import cli
from rrrgen.cli.terminal import working
from rrrgen.lab.data.recordings import Log
from samples.recordings import fourier_motion, write_log


def test_reconstruct_tells_every_step(tmp_path, monkeypatch):
    told = []

    @contextmanager
    def bar():
        yield lambda *step: told.append(step)

    monkeypatch.setattr(estimates, "progress_bar", bar)
    t = 1e-2 * np.arange(400)
    q, _, _ = fourier_motion(t, 1, 0)
    write_log(tmp_path / "log.csv", Log(("a",), t, q, np.zeros_like(q), period=1e-2))
    command = [
        "experiment",
        "reconstruct",
        str(tmp_path / "log.csv"),
        "--method",
        "butterworth",
        "-o",
        str(tmp_path / "run"),
    ]
    result = CliRunner().invoke(cli, command)
    assert result.exit_code == 0, result.output
    messages = ["reading", "bandwidth and noise of the positions", "reconstructing", "writing the motion"]
    assert [message for _, _, message in told] == messages
    assert [done / total for done, total, _ in told if total] == [0.0, 1.0]


def test_closed_forms_tell_every_function(monkeypatch):
    told = []

    @contextmanager
    def bar():
        yield lambda *step: told.append(step)

    monkeypatch.setattr(show, "progress_bar", bar)
    result = CliRunner().invoke(cli, ["show", "planar2r", "-f", "gravity", "-f", "mass_matrix"])
    assert result.exit_code == 0, result.output
    assert told == [(0, 0, "derivation"), (0, 2, "closed form of gravity"), (1, 2, "closed form of mass_matrix")]


def test_the_benchmark_tells_every_step(monkeypatch):
    told = []
    monkeypatch.setattr(session, "_robot", lambda robot, plan, toolchain, results, say: say(robot))
    monkeypatch.setattr(session, "_control", lambda plan, toolchain, results, say: say("control"))
    plan = session.Plan(robots=("rrr", "puma560"), parts=frozenset({"functions", "control"}))
    session.bench(plan, lambda *step: told.append(step))
    assert told == [(0, 3, "rrr"), (1, 3, "puma560"), (2, 3, "control")]


LONG = (
    *(path for path in COMMANDS if " " in path and path != "response vibration"),
    *("calibrate", "export", "generate", "identify", "ik", "show", "verify"),
)
"""Commands that may take seconds."""


@pytest.mark.parametrize("name", LONG)
def test_commands_that_take_seconds_draw_a_bar(name):
    command = load_command(name)
    names = set(vars(inspect.getmodule(inspect.unwrap(command.callback))))
    assert names & {"progress_bar", "run_study", "working"}


def test_a_terminal_sees_what_is_done_and_a_file_gets_what_is_printed(monkeypatch, capsys):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    with working("estimating the geometry"):
        print("a result")
    assert "estimating the geometry" in terminal.getvalue()
    assert "a result" not in terminal.getvalue()
    assert capsys.readouterr().out == "a result\n"
