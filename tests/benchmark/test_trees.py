"""The driver that times trees against Pinocchio is C that compilers take; the whole run takes minutes."""

from __future__ import annotations

import shutil
import subprocess

import pytest


@pytest.mark.sweep
@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc")
@pytest.mark.parametrize("name", ["hand", "quadruped"])
def test_the_driver_compiles(name, tmp_path):
    from bench.measurements.trees import EXAMPLES, FUNCTIONS, driver, nominal_programs
    from rrrgen.emit.c.function_files import function_files
    from rrrgen.robot.file import load_spec

    spec = load_spec(EXAMPLES / f"{name}.yaml")
    programs = nominal_programs(spec)
    assert list(programs) == list(FUNCTIONS)
    files = function_files("robot", "functions that are timed", list(programs.values()), "double")
    (tmp_path / "robot.h").write_text(files["robot.h"], encoding="utf-8", newline="\n")
    (tmp_path / "trees.c").write_text(driver(spec, programs), encoding="utf-8", newline="\n")
    command = ["gcc", "-std=gnu99", "-Wall", "-Werror", "-fsyntax-only", "trees.c"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
