"""The driver that times trees against Pinocchio is C that compilers take; the whole run takes minutes."""

from __future__ import annotations

import shutil
import subprocess

import pytest


@pytest.mark.sweep
@pytest.mark.skipif(shutil.which("gcc") is None, reason="needs gcc")
@pytest.mark.parametrize("name", ["hand", "quadruped", "linkages/five_bar"])
def test_the_driver_compiles(name, tmp_path):
    from bench.measurements.mechanisms import robot
    from bench.measurements.trees import FUNCTIONS, OF_LOOPS, driver, nominal_programs
    from rrrgen.emit.c.function_files import function_files

    spec = robot(name)
    programs = nominal_programs(spec)
    assert list(programs) == list(OF_LOOPS if spec.loops else FUNCTIONS)
    files = function_files("robot", "functions that are timed", list(programs.values()), "double")
    (tmp_path / "robot.h").write_text(files["robot.h"], encoding="utf-8", newline="\n")
    (tmp_path / "trees.c").write_text(driver(spec, programs), encoding="utf-8", newline="\n")
    command = ["gcc", "-std=gnu99", "-Wall", "-Werror", "-fsyntax-only", "trees.c"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
