"""``generate --with`` and the key ``emit`` of a robot file: what is written besides the model, and what is not."""

from __future__ import annotations

import json
import shutil
import subprocess

import pytest

from rrrgen.cli.main import run
from rrrgen.robot.file import dumps, load_spec, loads_spec
from rrrgen.robot.file.fields import EMIT
from rrrgen.robot.identity import identify

PENDULUM = """\
schema: rrrgen/1
name: swing
convention: standard
units: {angle: rad, length: m}
gravity: [0, -9.81, 0]
joints:
  - {type: revolute, alpha: 0, a: 0.5, d: 0, theta: 0}
links:
  - {mass: 2, com: [-0.1, 0, 0], inertia: {about: com, xx: 0.01, yy: 0.02, zz: 0.02}}
"""
IN_CPP = """\
#include "swing.hpp"
int main()
{
    const swing::vector<1> q{0.3}, rest{};
    const auto [T, J] = swing::kinematics(q);
    swing::vector<6> V{J(0, 0), J(1, 0), 0, 0, 0, J(5, 0)}; // of one rad/s
    const auto free = swing::differential_ik(q, rest, J, V, 1e-6, 1e-3);
    swing::differential_ik_limits limits;
    limits.ddq_max = {20.0};
    const auto slow = swing::differential_ik(q, rest, J, V, 1e-6, 1e-3, {1, 1, 0, 0, 0, 0}, {}, limits);
    V[0] = NAN;
    return !(free && std::abs(free.dq[0] - 1) < 1e-9 && slow && std::abs(slow.dq[0] - 0.02) < 1e-12)
        || swing::differential_ik(q, rest, J, V, 1e-6, 1e-3);
}
"""
STRICT = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Werror"]


def generate(tmp_path, text, *options):
    file, output = tmp_path / "swing.yaml", tmp_path / "out"
    file.write_text(text)
    assert run(["generate", str(file), "-o", str(output), "--no-casadi-files", *options]) == 0
    return output


def names(output):
    return {path.name for path in output.iterdir()}


def test_nothing_more_is_written_unless_it_is_asked_for(tmp_path):
    output = generate(tmp_path, PENDULUM)
    assert not any("any_gravity" in name for name in names(output))
    assert "momentum_terms" not in (output / "swing.h").read_text()
    assert "any_gravity" not in json.loads((output / "manifest.json").read_text())


@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.sweep(but=["double"])
def test_gravity_and_control(tmp_path, real):
    output = generate(tmp_path, PENDULUM, "--with", "gravity,control,cpp,points,trajectory", "--real", real)
    beside = ["swing_ik.c", "swing_tool_ik.c", "swing_differential_ik.c", "swing_fourier.c"]
    for prefix, others in (("swing", beside), ("swing_any_gravity", [])):
        sources = [f"{prefix}{part}.c" for part in ("", "_nominal", "_derivatives", "_selftest")]
        command = ["gcc", *STRICT, *sources, *others, "-o", prefix, "-lm"]
        subprocess.run(command, cwd=output, check=True)
        report = subprocess.run([output / prefix], capture_output=True, text=True, check=True).stdout
        assert "p = M dq" in report
        assert ("differential IK: no better speeds" in report) == (prefix == "swing")
        assert ("Fourier series: at quarters" in report) == (prefix == "swing")
        assert ("inverse kinematics with a tool: the row of" in report) == (prefix == "swing")
    if real == "double":
        (output / "use.cpp").write_text(IN_CPP)
        sources = ["swing.c", "swing_nominal.c", "swing_derivatives.c", "swing_differential_ik.c", "swing_ik.c"]
        subprocess.run(["gcc", *STRICT, "-c", *sources], cwd=output, check=True)
        objects = [source.replace(".c", ".o") for source in sources]
        strict = ["-std=c++17", *STRICT[1:]]
        subprocess.run(["g++", *strict, "use.cpp", *objects, "-o", "use", "-lm"], cwd=output, check=True)
        subprocess.run([output / "use"], check=True)
    readme = (output / "README.md").read_text()
    assert "`swing_fourier.h`" in readme
    assert "`swing_tool_ik.h`" in readme
    (output / "loop.c").write_text(readme.partition("## A control loop")[2].partition("```c\n")[2].partition("```")[0])
    command = ["gcc", *STRICT, "loop.c", "swing.c", "swing_nominal.c", "-o", "loop", "-lm"]
    subprocess.run(command, cwd=output, check=True)
    said = subprocess.run([output / "loop"], capture_output=True, text=True, check=True).stdout
    assert said == "joint 1: 0.1000, desired 0.1000\n"
    manifest = json.loads((output / "manifest.json").read_text())
    assert "momentum_terms" in manifest["functions"]
    inputs = manifest["any_gravity"]["functions"]["inverse_dynamics"]["inputs"]
    assert [port["name"] for port in inputs] == ["q", "dq", "ddq", "gravity", "beta"]
    assert {"swing_any_gravity.h", "swing_any_gravity_selftest.c"} <= set(manifest["files"])
    cmake = (output / "CMakeLists.txt").read_text()
    assert "swing_differential_ik.c" in cmake
    assert "swing_differential_ik.c" in manifest["files"]
    assert "add_executable(swing_any_gravity_selftest swing_any_gravity_selftest.c)" in cmake
    assert "add_library(swing swing.c swing_any_gravity.c" in cmake


def test_tables_of_two_numbers_are_not_shadowed(tmp_path):
    """The table of a vector has its size in its name: ``tau_2`` of an arm of two joints, here in any gravity."""
    output = tmp_path / "out"
    assert run(["generate", "planar2r", "-o", str(output), "--no-casadi-files", "--with", "gravity,observer"]) == 0
    strict = [*STRICT, "-Wshadow", "-fsyntax-only"]
    subprocess.run(["gcc", *strict, *(path.name for path in output.glob("*.c"))], cwd=output, check=True)


def test_gravity_in_rust_is_a_crate_of_its_own(tmp_path):
    output = generate(tmp_path, PENDULUM, "--with", "control,gravity,rust")
    source = output / "rust_any_gravity" / "src" / "lib.rs"
    assert "gravity: &[Real; 3]" in source.read_text()
    assert 'name = "swing_any_gravity_model"' in (output / "rust_any_gravity" / "Cargo.toml").read_text()
    assert "gravity: &[" not in (output / "rust" / "src" / "lib.rs").read_text()
    assert "pub mod differential_ik" not in source.read_text()
    for crate in ("rust", "rust_any_gravity") if shutil.which("rustc") else ():
        flags = ["--edition", "2018", "--crate-type", "lib", "-D", "warnings", "--cfg", 'feature="std"']
        subprocess.run(
            ["rustc", *flags, "--emit", "metadata", "--out-dir", tmp_path, output / crate / "src/lib.rs"], check=True
        )
    assert "pub mod differential_ik {" in (output / "rust/src/lib.rs").read_text()


def test_the_robot_file_asks_like_the_option(tmp_path):
    asked = generate(tmp_path, PENDULUM + "emit: [gravity, control]\n")
    before = {name: (asked / name).read_bytes() for name in names(asked) if (asked / name).is_file()}
    option = generate(tmp_path, PENDULUM, "--with", "gravity", "--with", "control")
    assert {name: (option / name).read_bytes() for name in before} == before


def test_what_is_emitted_is_no_property_of_the_robot():
    plain, asked = loads_spec(PENDULUM), loads_spec(PENDULUM + "emit: [gravity]\n")
    assert identify(plain) == identify(asked)
    assert loads_spec(dumps(asked)).emit == ("gravity",)
    assert identify(plain.in_any_gravity()) != identify(plain)
    assert identify(load_spec("rrr")).model_hash.startswith("f76b01304d96f30a")


def test_unknown_words_are_refused(tmp_path, capsys):
    assert run(["generate", "rrr", "-o", str(tmp_path), "--with", "gravty"]) == 2
    assert f"did you mean 'gravity'? allowed are {', '.join(sorted(EMIT))}" in capsys.readouterr().err
    file = tmp_path / "swing.yaml"
    file.write_text(PENDULUM + "emit: [gravity, momentum]\n")
    assert run(["check", str(file)]) == 3
    error = capsys.readouterr().err
    assert "swing.yaml:10:17" in error
    assert "emit: 'momentum' is not allowed" in error


def test_packages_that_are_no_longer_asked_for_are_removed(tmp_path):
    output = generate(tmp_path, PENDULUM, "--with", "urdf,embedded,controller,rust")
    assert {"urdf", "embedded", "rust", "rust_controller"} <= names(output)
    listed = json.loads((output / "manifest.json").read_text())["files"]
    assert {"urdf/swing.urdf", "rust_controller/Cargo.toml"} <= listed.keys()
    assert not {"urdf", "embedded", "rust", "rust_controller"} & names(generate(tmp_path, PENDULUM))


def test_serialized_functions_do_not_stay_beside_other_code(tmp_path, capsys):
    """Those of the robot are removed, also where nothing else changes; files with other names are the user's."""
    pytest.importorskip("casadi")
    file, output = tmp_path / "swing.yaml", tmp_path / "out"
    file.write_text(PENDULUM)
    words = ["generate", str(file), "-o", str(output)]
    assert run([*words, "--with", "control"]) == 0
    own = {path.name for path in (output / "casadi").glob("*.casadi")}
    assert {"swing_casadi_gravity.casadi", "swing_casadi_computed_torque.casadi"} <= own
    (output / "casadi" / "swing_casadi_mine.casadi").write_text("mine")
    assert run(words) == 0
    assert not (output / "casadi" / "swing_casadi_computed_torque.casadi").exists()
    file.write_text(PENDULUM.replace("-9.81", "-1.62"))
    assert run([*words, "--check"]) == 1
    assert "swing_casadi_gravity.casadi" not in capsys.readouterr().out
    assert run([*words, "--no-casadi-files", "--check"]) == 1
    assert "--- a/casadi/swing_casadi_gravity.casadi\n+++ /dev/null" in capsys.readouterr().out
    assert run([*words, "--no-casadi-files"]) == 0
    assert [path.name for path in (output / "casadi").glob("*.casadi")] == ["swing_casadi_mine.casadi"]
    assert run([*words, "--no-casadi-files", "--check"]) == 0


def test_files_that_no_run_has_written_are_not_replaced(tmp_path, capsys):
    output = tmp_path / "out"
    output.mkdir()
    for name in ("README.md", "CMakeLists.txt", "notes.txt"):
        (output / name).write_text("mine\n")
    (tmp_path / "swing.yaml").write_text(PENDULUM)
    words = ["generate", str(tmp_path / "swing.yaml"), "-o", str(output), "--no-casadi-files"]
    assert run(words) == 3
    said = capsys.readouterr().err
    assert f"{output / 'README.md'}: error: the file exists already, and no earlier run has written it" in said
    assert str(output / "CMakeLists.txt") in said
    assert {path.name: path.read_text() for path in output.iterdir()} == dict.fromkeys(
        ("README.md", "CMakeLists.txt", "notes.txt"), "mine\n"
    )
