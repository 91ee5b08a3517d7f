"""Text on a terminal is folded to its width: lines of any length in files and pipes, and numbers never cut."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

import rrrgen
from rrrgen.cli.main import run
from rrrgen.cli.show import robot_file_lines
from rrrgen.cli.terminal import say
from rrrgen.robot.file import bundled_names, load_spec

PACKAGE = Path(rrrgen.__file__).parent
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[-+]\d+)?")

COMMANDS = (
    ("show", "planar2r"),
    ("robots",),
    ("ik", "planar2r", "--backend", "numpy", "--pose", "0.3 0.4 0"),
    ("verify", "pendulum", "--backend", "numpy", "--samples", "1", "--no-libraries"),
    ("generate", "pendulum", "--no-casadi-files", "-o", "pendulum_model"),
    ("doctor",),
)


def longest(lines: list[str]) -> str:
    return max(lines, key=len)


@pytest.mark.parametrize("width", [80, 60])
@pytest.mark.parametrize("name", bundled_names())
def test_no_line_about_a_bundled_robot_is_longer_than_the_terminal(name: str, width: int) -> None:
    spec = load_spec(name)
    free, folded = robot_file_lines(spec), robot_file_lines(spec, width)
    tables = [line for line in folded if line.startswith(" ")]  # the command folds the titles
    assert len(longest(tables)) <= width, longest(tables)
    assert {*NUMBER.findall("\n".join(free))} == {*NUMBER.findall("\n".join(folded))}


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_no_command_prints_a_line_longer_than_the_terminal(command, capsys, monkeypatch, tmp_path) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "60")
    assert run([*command]) in (0, 1)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) > 1
    assert len(longest(lines)) <= 60, longest(lines)


def test_a_pipe_gets_lines_of_any_length(capsys, monkeypatch) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    say("word " * 40)
    monkeypatch.setenv("COLUMNS", "50")
    say("word " * 40)
    first, *folded = capsys.readouterr().out.splitlines()
    assert len(first) > 190
    assert len(longest(folded)) <= 50


def test_commands_print_text_through_say() -> None:
    """``click.echo`` is for what programs read (JSON, files) and for messages on stderr."""
    found = []
    for file in (PACKAGE / "cli").rglob("*.py"):
        if file.name in ("terminal.py", "main.py"):
            continue
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "click.echo" and not node.keywords:
                found.append(f"{file.name}:{node.lineno}: {ast.unparse(node)}")
    assert not [each for each in found if "json.dumps" not in each]
