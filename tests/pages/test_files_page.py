"""Pages complete by themselves: every key of every reader on the page of keys, every equation on that of theory."""

from __future__ import annotations

import ast
import inspect
import re
from pathlib import Path

import pytest

from rrrgen.closed_loop import controller_file
from rrrgen.experiments import experiment_file
from rrrgen.recordings import mapping_reader, source_reader
from rrrgen.response import response_file
from rrrgen.signals import processing

PAGE = (Path(__file__).resolve().parents[2] / "docs/files.md").read_text(encoding="utf-8")


def sections_of(module) -> set[str]:
    """The keys of the dictionaries, name -> how it is read, in the code of a reader."""
    tree = ast.parse(inspect.getsource(module))
    return {
        key.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Dict) and len(node.keys) > 2
        for key in node.keys
        if isinstance(key, ast.Constant) and isinstance(key.value, str)
    }


KEYS = {
    "Mapping file": {
        *(key for keys in mapping_reader.KEYS.values() for key in keys),
        *source_reader.FILE_KEYS,
        *source_reader.TIME_KEYS,
        *processing._KEYS,
    },
    "Experiment file": sections_of(experiment_file),
    "Controller file": {
        *controller_file.KEYS,
        *controller_file.JOINT_KEYS,
        *controller_file.SIGNAL_KEYS,
        *(key for keys in controller_file.SIGNAL_KEYS.values() for key in keys),
    },
    "Response file": {
        *response_file.KEYS,
        *response_file.CONTROLLER_KEYS,
        *response_file.CHANNEL_KEYS,
        *source_reader.TIME_KEYS,
    },
}


@pytest.mark.parametrize("title", KEYS)
def test_every_key_has_its_place(title: str) -> None:
    found = re.search(rf"^## {title}.*?(?=^## )", PAGE, re.S | re.M)
    assert found
    assert len(KEYS[title]) > 10
    assert KEYS[title] <= set(re.findall(r"`([a-z_]+)`", found[0]))


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
