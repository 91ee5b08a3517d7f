"""Pages complete by themselves: the keys of the files that accompany an experiment, the equations of the theory."""

from __future__ import annotations

import ast
import inspect
import re
from pathlib import Path

from click.testing import CliRunner

from rrrgen.cli.main import cli
from rrrgen.lab.experiment import experiment_file
from rrrgen.lab.experiment.experiment_file import KEYS

PAGE = Path(__file__).resolve().parents[2] / "docs/files.md"


def test_the_page_of_keys_is_current() -> None:
    printed = CliRunner().invoke(cli, ["schema", "--other-files"]).output
    assert PAGE.read_text(encoding="utf-8") == printed, "rrrgen schema --other-files > docs/files.md"


def test_every_section_of_an_experiment_is_on_the_page() -> None:
    page = PAGE.read_text(encoding="utf-8")
    for section, table in KEYS.items():
        names = "\n".join(rf"\| (?:\*\*)?`{key}`(?:\*\*)? \|.*" for key in table)
        assert re.search(names, page), section


def test_every_key_of_an_experiment_is_read() -> None:
    """The code assigns a reader to every key of a table; ``friction`` and mappings made from a table read all."""
    tree = ast.parse(inspect.getsource(experiment_file))
    read = [
        {key.value for key in node.keys if isinstance(key, ast.Constant)}
        for node in ast.walk(tree)
        if isinstance(node, ast.Dict)
    ]
    for section in KEYS.keys() - {"box", "friction", "flexible_joints"}:
        assert set(KEYS[section]) in read, section


def test_every_equation_that_the_package_cites_is_on_the_page_of_theory() -> None:
    root = Path(__file__).resolve().parents[2]
    cited = {
        number
        for file in (root / "rrrgen").rglob("*.py")
        for number in re.findall(r"\(14\.(\d+)\)", file.read_text(encoding="utf-8"))
    }
    page = (root / "docs/theory.md").read_text(encoding="utf-8")
    explained = set(re.findall(r"\(14\.(\d+)\)", page))
    for first, last in re.findall(r"\(14\.(\d+)\) to \(14\.(\d+)\)", page):
        explained |= {str(number) for number in range(int(first), int(last))}
    assert len(cited) > 30
    assert cited <= explained
