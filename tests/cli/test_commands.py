"""The table of commands: help of each, old names, and where they point."""

from __future__ import annotations

import re

import pytest

from cli.golden_files import golden
from rrrgen.cli.commands import COMMANDS, RENAMED
from rrrgen.cli.main import LazyGroup, cli


def test_the_whole_help_names_every_command(rrrgen):
    code, out, err = rrrgen("--help-all")
    assert (code, err) == (0, "")
    for path, (_, text) in COMMANDS.items():
        assert re.search(rf"^  {path} +{re.escape(text[:20])}", out, re.M)
    golden("help-all.txt", out.split("\n\n", 2)[2])


@pytest.mark.parametrize("old", RENAMED)
def test_old_names_of_grouped_commands_still_work_and_name_the_new_words(old, rrrgen):
    code, out, err = rrrgen(old, "--help")
    assert code == 0
    assert err == f"rrrgen {old} is now called: rrrgen {RENAMED[old]}\n"
    assert rrrgen(*RENAMED[old].split(), "--help")[1].partition("\n")[2] == out.partition("\n")[2]


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help_with_an_example(name, rrrgen):
    code, out, _ = rrrgen(*name.split(), "--help")
    assert code == 0
    assert re.search(r"Examples?:\n +rrrgen", out) or "Commands:" in out
    assert COMMANDS[name][1].endswith(".")
    assert "=None" not in out  # the range of a number without bounds


def test_the_table_of_commands_points_at_commands():
    assert isinstance(cli, LazyGroup)
    for path in COMMANDS:
        *groups, name = path.split()
        group = cli
        for word in groups:
            group = group.get_command(None, word)
        assert group.get_command(None, name) is not None
