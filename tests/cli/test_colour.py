"""Colour: on a terminal only, chosen by NO_COLOR, FORCE_COLOR and TERM, and never part of the text itself."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys

import pytest

from rrrgen.cli.main import run
from rrrgen.cli.terminal import with_headings

MARK = re.compile(r"\x1b\[[\d;]*m")
FAULTY = "schema: rrrgen/1\nname: 5x\n"
CHOICES = ("NO_COLOR", "FORCE_COLOR", "TERM")


@pytest.fixture
def rrrgen(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.yaml").write_text(FAULTY, encoding="utf-8")

    def call(*arguments: str, **environment: str) -> tuple[str, str]:
        for name in CHOICES:
            monkeypatch.delenv(name, raising=False)
        for name, value in environment.items():
            monkeypatch.setenv(name, value)
        run(arguments)
        captured = capsys.readouterr()
        return captured.out, captured.err

    return call


COMMANDS = (
    ("check", "arm.yaml"),
    ("show", "arm.yaml"),
    ("show", "pendulum"),
    ("check", "pendulum"),
    ("check", "missing.yaml"),
    ("--help",),
    ("chekc",),
    ("ik", "planar2r", "--backend", "numpy", "--pose", "9 9 0"),
)


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_colour_adds_nothing_but_marks(command, rrrgen):
    piped = rrrgen(*command)
    forced = rrrgen(*command, FORCE_COLOR="1")
    assert not MARK.search("".join(piped))
    assert MARK.search("".join(forced))
    assert tuple(MARK.sub("", text) for text in forced) == piped


def test_no_color_wins_and_an_empty_variable_is_none(rrrgen):
    assert not MARK.search(rrrgen("check", "arm.yaml", FORCE_COLOR="1", NO_COLOR="1")[1])
    assert MARK.search(rrrgen("check", "arm.yaml", FORCE_COLOR="1", NO_COLOR="")[1])
    assert not MARK.search(rrrgen("check", "arm.yaml", FORCE_COLOR="")[1])


@pytest.mark.parametrize(
    ("environment", "coloured"),
    [({"TERM": "xterm"}, True), ({"TERM": "dumb"}, False), ({"TERM": "xterm", "NO_COLOR": "1"}, False)],
)
def test_a_terminal_has_colour_and_a_pipe_beside_it_none(environment, coloured, tmp_path):
    """stderr is a terminal, stdout a pipe: the faults are coloured, the verdict on stdout is not."""
    (tmp_path / "arm.yaml").write_text(FAULTY, encoding="utf-8")
    ours, theirs = pty.openpty()
    kept = {name: value for name, value in os.environ.items() if name not in CHOICES}
    done = subprocess.run(
        [sys.executable, "-m", "rrrgen", "check", "arm.yaml"],
        cwd=tmp_path, env=kept | environment, stdout=subprocess.PIPE, stderr=theirs, check=False,
    )  # fmt: skip
    os.close(theirs)
    said = os.read(ours, 65536).decode()
    os.close(ours)
    assert done.returncode == 3
    assert b"\x1b" not in done.stdout
    assert "arm.yaml" in MARK.sub("", said)
    assert bool(MARK.search(said)) is coloured


def test_headings_are_lines_at_the_margin_above_indented_ones():
    marked = with_headings("arm: title\n  fact\n\nTable\n  a  b\nno heading\n")
    assert MARK.sub("", marked.replace("\x1b[1m", "[").replace("\x1b[0m", "]")) == (
        "[arm: title]\n  fact\n\n[Table]\n  a  b\nno heading\n"
    )
