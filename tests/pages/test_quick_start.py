"""The quick start as a newcomer follows it, with the core dependencies: file, commands, C and Python."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

from pages.test_pages import blocks, calls
from pages.test_tutorials import ROOT

PAGE = (ROOT / "docs/quick-start.md").read_text(encoding="utf-8")
EXTRAS = ("casadi", "scipy", "matplotlib", "cvxpy", "clarabel", "pinocchio", "mujoco", "roboticstoolbox")


def section(title: str) -> str:
    found = re.search(rf"^## {re.escape(title)}\n(.*?)(?=^## )", PAGE, re.S | re.M)
    assert found
    return found[1]


def commands(title: str) -> list[list[str]]:
    """The words of the calls of rrrgen in a section, without comments."""
    return [words for block in blocks(section(title), "sh") for words in calls(block)]


WITHOUT = f"""
import importlib.abc, sys

class Missing(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {EXTRAS!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Missing())

import json
from pages.reader import follow
from rrrgen.lab.data import figure_style

figure_style.PRINT = 60  # as for all tests, whose conftest.py does not reach this process
follow(json.loads(sys.argv[1]))
"""


def test_a_newcomer_gets_to_a_verified_model(tmp_path: Path) -> None:
    text = section("From a robot file to code")
    (robot,) = blocks(text, "yaml")
    first, *others = blocks(text, "sh")
    (c,) = blocks(text, "c")
    (python,) = blocks(text, "python")
    (tmp_path / "page.yaml").write_text(robot, encoding="utf-8")
    (tmp_path / "use.c").write_text(c.replace("\n\n", "\nint main(void)\n{\n", 1) + "return 0;\n}\n", encoding="utf-8")
    new, *commands = first.splitlines()
    sources = "use.c elbow3_model/elbow3.c elbow3_model/elbow3_nominal.c"
    steps = [
        ("sh", new),
        ("sh", "cp page.yaml elbow3.yaml"),
        *(("sh", line) for line in commands),
        ("sh", f"cc -std=c99 -Wall -Werror -Ielbow3_model {sources} -lm -o use\n./use"),
        ("python", f"q = dq = ddq = [0.1, 0.2, 0.3]\n{python}"),
        *(("sh", each) for each in others),
    ]
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT, json.dumps(steps)],
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests")])},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, f"{done.stdout[-3000:]}\n{done.stderr}"
    assert "elbow3: all comparisons pass" in done.stdout
    assert "MuJoCo: not installed" in done.stdout
    assert done.stdout.count("[step]") == len(steps)


def test_the_commands_of_the_experiment_are_those_of_its_tutorial() -> None:
    """The tutorial is run line by line, by its own test; the case study by its own."""
    *experiment, case_study = commands("From an experiment to a validated model")
    page = (ROOT / "docs/first-identification.md").read_text(encoding="utf-8")
    tutorial = [words for block in blocks(page, "sh") for words in calls(block)]
    steps = [words for words in tutorial if words[0] not in ("new", "check")]  # its arm is a copy with friction
    assert (
        experiment == [["rrr" if word == "arm.yaml" else word for word in words] for words in steps][: len(experiment)]
    )
    assert len(experiment) == 5
    assert case_study[:2] == ["experiment", "case-study"]
