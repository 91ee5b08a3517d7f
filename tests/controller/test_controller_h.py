"""The header of the controller: compilers agree with the sizes that it states, and refuse others."""

from __future__ import annotations

import re
import subprocess

import pytest

from rrrgen.controller.files import standalone_files
from rrrgen.controller.table import GROUPS, unit_of
from rrrgen.emit.targets.c_package import derived_model
from rrrgen.robot.file import read

STRUCTS = ("params", "state", "input", "output")


@pytest.fixture(scope="module", params=["double", "float"])
def files(request):
    unit = unit_of(derived_model(read("pendulum"), GROUPS)[0], ["gravity"], [])
    return {name: text for name, text in standalone_files(unit, request.param).items() if name.endswith(".h")}


def accepted(files, folder, compiler=("gcc", "-std=c99", "-x", "c")):
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8", newline="\n")
    command = [*compiler, "-fsyntax-only", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-I.", "-"]
    text = '#include "pendulum_controller.h"\n'
    return subprocess.run(command, cwd=folder, input=text, text=True, capture_output=True, check=False).returncode == 0


def test_the_sizes_of_all_structs_are_those_that_the_header_states(files, tmp_path):
    assert accepted(files, tmp_path)
    assert accepted(files, tmp_path, ("g++", "-x", "c++"))


@pytest.mark.parametrize("struct", STRUCTS)
def test_a_struct_of_another_size_is_refused(files, struct, tmp_path):
    header = files["pendulum_controller.h"]
    line = re.search(rf"^typedef char \w+_{struct}_has_(\d+)_bytes.*$", header, re.MULTILINE)
    other = line[0].replace(f"{line[1]}u", f"{int(line[1]) + 4}u")
    assert not accepted(files | {"pendulum_controller.h": header.replace(line[0], other)}, tmp_path)
