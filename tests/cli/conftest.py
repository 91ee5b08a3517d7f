"""Fixtures that several test files of this folder share."""

from __future__ import annotations

import pytest

from cli.stated import FULL
from rrrgen.cli.main import run


@pytest.fixture
def rrrgen(capsys, monkeypatch, tmp_path):
    """Runs a command in an empty directory; returns exit code, stdout, stderr."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")

    def call(*arguments: object):
        code = run([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call


@pytest.fixture
def written(tmp_path, monkeypatch, capsys):
    """The file that ``new`` writes for some joints, as text."""
    monkeypatch.chdir(tmp_path)

    def call(joints: str, convention: str = "standard") -> str:
        assert run(["new", "arm", "--joints", joints, "--convention", convention, "--force"]) == 0, capsys.readouterr()
        return (tmp_path / "arm.yaml").read_text(encoding="utf-8")

    return call


@pytest.fixture
def robot(tmp_path):
    file = tmp_path / "full.yaml"
    file.write_text(FULL, encoding="utf-8")
    return str(file)


@pytest.fixture
def show(capsys, monkeypatch):
    """The text that the command prints on stdout."""

    def call(*words: str, columns: str = "") -> str:
        monkeypatch.setenv("COLUMNS", columns)
        code, found = run(["show", *words]), capsys.readouterr()
        assert code == 0, found.err
        return found.out

    return call
