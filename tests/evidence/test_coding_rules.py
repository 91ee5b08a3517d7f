"""MISRA C:2012: emitted C has no finding without a recorded deviation, and the table has a row for every rule."""

from __future__ import annotations

import json
import shutil
import subprocess

import numpy as np
import pytest
from click.testing import CliRunner

from rrrgen.cli.main import cli
from rrrgen.evidence import coding_rules
from rrrgen.evidence.coding_rules import DEVIATIONS, RULES, RuleFinding, category, coding_rules_entry, findings
from rrrgen.lab.design.fourier_series import FourierTrajectory

STRAIGHT_LINE = ("_derivatives.c", "_friction.c")
"""Printed functions that stand for all others: with divisions, comparisons and a status."""

FROM_TEMPLATES = ("_controller.c", "_differential_ik.c", "_fourier.c", "_gradient.c", "_ik.c", "_kalman.c", "_rls.c")


def generate(folder, robot, *options):
    arguments = ("generate", robot, "-o", folder, "--no-casadi-files", *options)
    done = CliRunner().invoke(cli, [str(each) for each in arguments], standalone_mode=False, catch_exceptions=False)
    assert done.return_value == 0, done.output


@pytest.fixture(scope="module")
def everything(tmp_path_factory):
    """Folder with the code of a small arm: one file of each kind that `generate` writes in C."""
    place = tmp_path_factory.mktemp("everything")
    motion = FourierTrajectory(np.zeros(2), np.ones((2, 3)), np.ones((2, 3)), 0.1)
    (place / "trajectory.json").write_text(json.dumps({"trajectory": motion.to_json()}), encoding="utf-8")
    (place / "tuning.json").write_text(json.dumps({"var_eta": [1e-10] * 2, "var_xi": [400.0] * 2}), encoding="utf-8")
    folder = place / "planar2r"
    generate(
        *(folder, "planar2r", "--with", "control,controller,points,timing,trajectory", "--friction", "lugre"),
        *("--friction", "stribeck", "--estimator", "rls", "--estimator", "gradient"),
        *("--trajectory", place / "trajectory.json", "--tuning", place / "tuning.json"),
    )
    return folder


@pytest.mark.skipif(not coding_rules.is_available(), reason="cppcheck is not installed")
def test_no_rule_is_broken_without_a_recorded_deviation(everything):
    folder = everything
    names = sorted(path.name for path in folder.glob("*.c"))
    sources = [name for name in names if name.endswith((*STRAIGHT_LINE, *FROM_TEMPLATES, "_timing.c"))]
    assert len(sources) == 11
    unaccepted = [each for each in findings(folder, sources) if each.rule not in DEVIATIONS]
    assert not unaccepted, "\n".join(map(str, unaccepted))


@pytest.mark.skipif(not coding_rules.is_available(), reason="cppcheck is not installed")
@pytest.mark.parametrize("robot", ["stanford", "xarm6"])  # with a slide; with the general solver of six joints
def test_inverse_kinematics_breaks_no_rule_without_a_recorded_deviation(tmp_path, robot):
    generate(tmp_path, robot)
    unaccepted = [each for each in findings(tmp_path, [f"{robot}_ik.c"]) if each.rule not in DEVIATIONS]
    assert not unaccepted, "\n".join(map(str, unaccepted))


ACCEPTED = {
    "bugprone-easily-swappable-parameters": "states and outputs of one type beside each other are the interface",
    "bugprone-implicit-widening-of-multiplication-result": "indices are bounded by array sizes, which int holds",
}
"""Checks of clang-tidy that the emitted code does not keep, with the reason."""


@pytest.mark.skipif(shutil.which("clang-tidy") is None, reason="clang-tidy is not installed")
def test_clang_tidy_finds_nothing(everything):
    checks = ",".join(["-*", "bugprone-*", "cert-*", "clang-analyzer-*", *(f"-{check}" for check in ACCEPTED)])
    sources = sorted(everything.glob("*.c"))
    command = ["clang-tidy", f"--checks={checks}", *map(str, sources), "--", "-std=c99", f"-I{everything}"]
    said = subprocess.run(command, capture_output=True, text=True, check=False).stdout
    assert len(sources) > 15
    assert "warning:" not in said, said


@pytest.mark.skipif(not coding_rules.is_available(), reason="cppcheck is not installed")
def test_a_broken_rule_is_found(tmp_path):
    text = "int broken(int a, unsigned b)\n{\n    if (a) {\n        return a + b;\n    }\n    return 0;\n}\n"
    (tmp_path / "broken.c").write_text(text, encoding="utf-8")
    rules = {each.rule for each in findings(tmp_path, ["broken.c"])}
    assert {"14.4", "10.4"} <= rules


def test_the_table_has_a_row_for_every_rule():
    entry = coding_rules_entry([RuleFinding("a.c", 3, "15.5"), RuleFinding("a.c", 7, "10.3")], ["a.c"])
    rows = {row[0]: row[1:] for row in entry["rows"]}
    assert tuple(rows) == RULES
    assert len(RULES) == 156
    assert rows["15.5"] == ["advisory", "deviation, 1 places", DEVIATIONS["15.5"]]
    assert rows["10.3"][1] == "1 findings"
    assert entry["unaccepted"] == 1
    assert rows["9.1"] == ["mandatory", "compliant", ""]
    assert all(category(rule) != "mandatory" for rule in DEVIATIONS)
