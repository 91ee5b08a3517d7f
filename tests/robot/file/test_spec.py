"""Robots of any legal name, capitals, digits and keywords of other languages among them, from `new` to packages."""

from __future__ import annotations

import random
import re
import string
import subprocess
import sys
from dataclasses import replace

import pytest
from click.testing import CliRunner

from emit.c_tools import check_all, compiler
from rrrgen.base.errors import InputError
from rrrgen.cli.main import cli
from rrrgen.emit.c.ik.files import emit
from rrrgen.exporting import export_robot
from rrrgen.ik.classify import plan
from rrrgen.robot.file import load_spec
from rrrgen.robot.spec import name_fault

WORDS = re.findall(
    r"\S+",
    """A a Q9 R2D2 MyArm UF_ROBOT AL5D Puma560 MYARM x N B Model Self self fn impl crate mod match end function
classdef parfor otherwise var debugger undefined NaN arguments unix linux size_t int8_t FILE all install robot real
solve ik static Static Int float_ Void""",
)
"""Keywords and well-known names of C, C++, Rust, Python, MATLAB, JavaScript and CMake, and names of real robots."""

WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Werror"]
C99, CXX = ["-std=c99", *WARNINGS], ["-x", "c++", "-std=gnu++17", *WARNINGS]  # as users build it: unix is a macro there


def random_names(seed: int, count: int) -> list[str]:
    rng = random.Random(seed)
    letters = string.ascii_letters + string.digits + "_"
    names = [
        rng.choice(string.ascii_letters) + "".join(rng.choices(letters, k=rng.randrange(39))) for _ in range(count)
    ]
    return [name for name in names if name_fault(name, "robot") is None]


def run(*arguments):
    result = CliRunner().invoke(cli, [str(argument) for argument in arguments])
    assert result.exit_code == 0, (arguments, result.output[-2000:])
    return result.output


def test_the_solver_of_any_legal_name():
    """The stack of each function, which is found in the C text by the names in it, depends on no name."""
    spec = load_spec("planar2r")
    expected = {key.removeprefix("planar2r"): size for key, size in emit(spec, plan(spec)).stack.items()}
    names = [name for name in WORDS if name_fault(name, "robot") is None] + random_names(1, 20)
    assert len(names) > 40
    for name in names:
        named = replace(spec, name=name)
        found = emit(named, plan(named)).stack
        assert {key.removeprefix(name): size for key, size in found.items()} == expected, name


@pytest.mark.parametrize(
    ("name", "further"),
    [("MyArm", "control,cpp,javascript,rust"), pytest.param(random_names(2, 9)[-1], "cpp", marks=pytest.mark.sweep)],
)
def test_from_new_to_every_package(name, further, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run("new", name, "--joints", "RR")
    file = f"{name}.yaml"
    run("check", file)
    run("generate", file, "-o", "code", "--no-casadi-files", "--with", further, "-j", 1)
    check_all(tmp_path / "code", [compiler("gcc"), *C99])
    check_all(tmp_path / "code", [compiler("g++"), *CXX])
    subprocess.run([compiler("g++"), *CXX, "-fsyntax-only", f"{name}.hpp"], cwd="code", check=True)
    assert "at most 2 solutions" in run("ik", file, "--pose", "0.3 0.2 0", "--backend", "numpy")
    module = f"import sys; sys.path.insert(0, 'code/casadi'); import {name}_casadi"
    subprocess.run([sys.executable, "-c", module], check=True)
    for target in ("embedded", "matlab", "mjcf", "par", "ros2", "urdf"):
        run("export", file, "--to", target, "-o", target)


@pytest.mark.parametrize("name", ["end", "MyArm"])
def test_a_package_of_matlab_can_be_called(name):
    files = export_robot(replace(load_spec("pendulum"), name=name), "matlab").files
    (package,) = {path.split("/")[0][1:] for path in files if path.startswith("+")}
    assert package.startswith(name)
    assert package not in MATLAB
    assert f"{package}.gravity" in files["README.md"]
    assert f" {package}.nominal_parameters()" in files[f"+{package}/gravity.m"]


@pytest.mark.parametrize("name", ["CON", "com1", "Lpt9", "nul", "Math", "stdio"])
def test_a_name_that_no_file_can_have_is_refused(name, tmp_path, monkeypatch):
    """Windows opens con.h and COM1.yaml as devices; where case does not count, #include <math.h> finds Math.h."""
    assert name_fault(name, "robot") is not None
    assert name_fault(name, "joint") is None
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(cli, ["new", name])
    assert isinstance(result.exception, InputError)
    assert f"the robot name '{name}'" in str(result.exception)
    assert not list(tmp_path.iterdir())


MATLAB = re.findall(
    r"\S+",
    """break case catch classdef continue else elseif end for function global if otherwise parfor persistent return spmd
switch try while""",
)
"""What iskeyword prints: no package can be called so."""
