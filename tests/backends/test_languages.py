"""Languages besides C and CasADi: each has a module, its templates and one line in a table; nothing else names it."""

from __future__ import annotations

import ast
from importlib import import_module
from pathlib import Path

import pytest

from backends.c_tools import IDENTITY
from backends.planar import planar_model
from rrrgen import pipeline
from rrrgen.errors import BackendError
from rrrgen.robotfile.keys import EMIT, LANGUAGES

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_language_costs_four_files(language):
    module = ROOT / "rrrgen" / "backends" / f"{language}.py"
    others = [path for path in (ROOT / "rrrgen").rglob("*.py") if path != module and names(path, language)]
    assert [path.name for path in others] == ["keys.py"]
    templates = [path for path in (ROOT / "templates" / language).rglob("*") if path.is_file()]
    assert len([module, *others, *templates]) <= 4
    assert language in EMIT


def names(path: Path, language: str) -> bool:
    """Whether the code of a file imports the module of a language, or has its name as a constant."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Constant) and node.value == language:
            return True
        if isinstance(node, ast.ImportFrom) and node.module == f"rrrgen.backends.{language}":
            return path.parent.name != "targets"  # a package for another tool may contain the language
    return False


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_language_prints_files_of_its_own(language):
    model = planar_model()
    backend = import_module(f"rrrgen.backends.{language}").BACKEND
    files = backend.assemble(model, IDENTITY, [task() for task in backend.tasks(model, IDENTITY, "double")])
    assert files
    assert len({path.split("/")[0] for path in files}) == 1


def test_an_unknown_language():
    with pytest.raises(BackendError, match="unknown language 'fortran': " + ", ".join(LANGUAGES)):
        pipeline.emit(planar_model(), languages=["fortran"])
