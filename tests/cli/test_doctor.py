"""``rrrgen doctor``: what it finds, what is missing, and the exit code that says whether models can be compiled."""

from __future__ import annotations

import json
import re

import pytest
from click.testing import CliRunner

from rrrgen.base import errors
from rrrgen.cli.doctor import doctor
from rrrgen.cli.main import main
from rrrgen.emit.c import compilers as compiler


def findings(capsys) -> tuple[int, dict[str, dict]]:
    with pytest.raises(SystemExit) as ended:
        main(["doctor", "--json"])
    return ended.value.code or 0, {each["name"]: each for each in json.loads(capsys.readouterr().out)["findings"]}


def test_a_working_compiler_is_tried_out(capsys):
    code, found = findings(capsys)
    assert code == 0
    assert found["C compiler"]["ok"]
    assert found["rrrgen"]["found"]
    assert found["cache"]["ok"]


def test_without_a_compiler_it_says_how_to_get_one(monkeypatch, capsys):
    monkeypatch.setenv("PATH", "/nonexistent")
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr(compiler, "is_installed", lambda _: False)
    code, found = findings(capsys)
    assert code == 5
    assert not found["C compiler"]["ok"]
    assert "apt install gcc" in found["C compiler"]["found"]
    assert not found["cmake"]["ok"]


def test_a_compiler_that_fails_is_not_ok(monkeypatch, capsys):
    monkeypatch.setenv("CC", "false")
    code, found = findings(capsys)
    assert code == 5
    assert "refused" in found["C compiler"]["found"]


@pytest.mark.parametrize(
    ("variable", "text", "reason"),
    [
        ("RRRGEN_CFLAGS", "-DX='a", "RRRGEN_CFLAGS"),
        ("CC", "gcc '", "CC"),
        ("CC", "true", "wrote no library.*CC"),
        ("CC", "{folder}/empty", "does not run.*CC"),
    ],
)
def test_variables_that_name_no_compiler_are_named(monkeypatch, capsys, tmp_path, variable, text, reason):
    monkeypatch.setenv("RRRGEN_CACHE", str(tmp_path / "cache"))
    (tmp_path / "empty").write_bytes(b"\0")
    (tmp_path / "empty").chmod(0o755)
    monkeypatch.setenv(variable, text.format(folder=tmp_path))
    code, found = findings(capsys)
    assert code == 5
    assert re.search(reason, found["C compiler"]["found"])


def test_a_missing_extra_is_named_with_the_line_to_type(monkeypatch, capsys):
    monkeypatch.setattr(errors, "is_installed", lambda module: module != "h5py")
    _, found = findings(capsys)
    assert not found["extra logs"]["ok"]
    assert "without h5py; pip install 'rrrgen[logs]'" in found["extra logs"]["found"]
    assert found["extra identify"]["ok"]


@pytest.mark.parametrize("columns", ["60", "120"])
def test_lines_keep_to_the_terminal(monkeypatch, columns):
    monkeypatch.setenv("COLUMNS", columns)
    text = CliRunner().invoke(doctor, []).output
    assert max(len(line) for line in text.splitlines() if "/" not in line) <= int(columns)
