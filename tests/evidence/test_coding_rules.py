"""MISRA C:2012: emitted C has no finding without a recorded deviation, and the table has a row for every rule."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from functools import cache

import numpy as np
import pytest
from click.testing import CliRunner

from derive.loops import EXAMPLES, FOUR_BAR, links
from derive.test_floating_base import TRUNK
from rrrgen.base.errors import InternalError
from rrrgen.cli.main import cli
from rrrgen.emit.c.ik.files import sources as sources_of
from rrrgen.evidence import coding_rules
from rrrgen.evidence.coding_rules import (
    DEVIATIONS,
    LONGEST_FUNCTION,
    RULES,
    RuleFinding,
    category,
    coding_rules_entry,
    findings,
    pieces,
)
from rrrgen.lab.design.fourier_series import FourierTrajectory
from rrrgen.robot.file import dumps, load_spec

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
@pytest.mark.parametrize("robot", ["stanford", pytest.param("xarm6", marks=pytest.mark.sweep)])  # a slide; general 6R
def test_inverse_kinematics_breaks_no_rule_without_a_recorded_deviation(tmp_path, robot):
    generate(tmp_path, robot)
    unaccepted = [each for each in findings(tmp_path, [f"{robot}_ik.c"]) if each.rule not in DEVIATIONS]
    assert not unaccepted, "\n".join(map(str, unaccepted))


FINGERS = """\
schema: rrrgen/1
name: fingers
convention: modified
units: {angle: deg, length: m}
gravity: [0, 0, -9.81]
joints:
  - {name: roll, type: revolute, alpha: 0, a: 0, d: 0.2}
  - {name: finger, type: revolute, alpha: 90, a: 0.05, d: 0}
  - {name: thumb, type: revolute, parent: roll, gamma: -90, b: 0, alpha: 90, a: 0.07, d: 0}
tip: finger
tips:
  finger: {row: finger, tool: {translation: [0.1, 0, 0]}}
  thumb: {row: thumb, tool: {translation: [0.08, 0, 0]}}
""" + links(3)

KINDS = {
    "second derivatives": ("planar2r", "hessian,tensors"),
    "elastic joints, observer, any gravity": ("planar2r", "elastic,observer,gravity"),
    "closed loop": (FOUR_BAR, "control"),
    "closed loop, Newton's method": (EXAMPLES / "linkages" / "six_bar.yaml", "points"),
    "tree with two tips": (FINGERS, "control,points"),
    "floating base": (dumps(load_spec("planar2r")).replace("joints:\n", f"{TRUNK}joints:\n"), "points"),
}
"""Robots and words of ``generate --with`` for code of further kinds than :func:`everything` has."""


@pytest.fixture(scope="module")
def kinds(tmp_path_factory):
    """The function that returns the folder with the code of one of :data:`KINDS`, generated once."""

    @cache
    def folder_of(kind):
        place = tmp_path_factory.mktemp("kind")
        robot, words = KINDS[kind]
        if isinstance(robot, str) and "\n" in robot:
            (place / "robot.yaml").write_text(robot, encoding="utf-8")
            robot = place / "robot.yaml"
        generate(place / "code", robot, "--with", words)
        return place / "code"

    return folder_of


@pytest.mark.skipif(not coding_rules.is_available(), reason="cppcheck is not installed")
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.sweep  # cppcheck takes a minute and more for each
def test_code_of_further_kinds_breaks_no_rule_without_a_recorded_deviation(kinds, kind):
    folder = kinds(kind)
    sources = [path.name for path in folder.glob("*.c") if "selftest" not in path.name]
    unaccepted = [each for each in findings(folder, sorted(sources)) if each.rule not in DEVIATIONS]
    assert not unaccepted, "\n".join(map(str, unaccepted))


LEFT = {
    "The scope of the variable 'i' can be reduced.": "it serves two loops, of which an arm without limits has one",
    "The scope of the variable 'first' can be reduced.": "later turns of the loop read it",
    "Array 'v[12]' accessed at index 17, which is out of bounds.": "the index is j + 9 where j < 3 alone",
    "Uninitialized variable: d": "turn i reads what the turns before it have set",
}
"""What cppcheck says about C beside the rules of MISRA, with the reason why it stays."""


def said_by_cppcheck(folder, sources, *options):
    """What cppcheck says about the ``sources`` beside the rules of MISRA, one message each."""
    command = ["cppcheck", "--quiet", "--enable=style,warning,performance,portability", *options]
    command += ["--suppress=missingIncludeSystem", "--suppress=unusedStructMember", "--template={message}"]
    done = subprocess.run([*command, *sources], cwd=folder, capture_output=True, text=True, check=False)
    return sorted({line for line in done.stderr.splitlines() if line and line not in LEFT})


@pytest.mark.skipif(not coding_rules.is_available(), reason="cppcheck is not installed")
@pytest.mark.parametrize("robot", ["stanford", "xarm6"])
def test_cppcheck_itself_finds_nothing_in_inverse_kinematics(tmp_path, robot):
    files = sources_of(load_spec(robot))
    for name, text in files.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    assert said_by_cppcheck(tmp_path, sorted(files), "--std=c99", *coding_rules._ONE_CONFIGURATION) == []


@pytest.mark.skipif(not coding_rules.is_available(), reason="cppcheck is not installed")
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.sweep  # 15 s for the smallest
def test_cppcheck_itself_finds_nothing_in_code_of_further_kinds(kinds, kind):
    folder = kinds(kind)
    sources = sorted(path.name for path in folder.glob("*.c") if "selftest" not in path.name)
    assert said_by_cppcheck(folder, sources, "--std=c99", *coding_rules._ONE_CONFIGURATION) == []


def test_the_header_for_cpp_has_no_finding_of_either_tool(tmp_path):
    if not coding_rules.is_available() or shutil.which("clang-tidy") is None:
        pytest.skip("cppcheck or clang-tidy is not installed")
    generate(tmp_path, "planar2r", "--with", "cpp,control,points")
    (tmp_path / "use.cpp").write_text('#include "planar2r.hpp"\nint main() { return 0; }\n', encoding="utf-8")
    assert said_by_cppcheck(tmp_path, ["use.cpp"], "--language=c++", "--std=c++17", "-U__AVX512F__") == []
    command = ["clang-tidy", "--header-filter=.*hpp", f"--checks={CHECKS}", "use.cpp", "--", "-std=c++17", "-I."]
    said = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False).stdout
    assert "warning:" not in said, said


ACCEPTED = {
    "bugprone-easily-swappable-parameters": "states and outputs of one type beside each other are the interface",
    "bugprone-implicit-widening-of-multiplication-result": "indices are bounded by array sizes, which int holds",
}
"""Checks of clang-tidy that the emitted code does not keep, with the reason."""

CHECKS = ",".join(["-*", "bugprone-*", "cert-*", "clang-analyzer-*", *(f"-{check}" for check in ACCEPTED)])


@pytest.mark.skipif(shutil.which("clang-tidy") is None, reason="clang-tidy is not installed")
def test_clang_tidy_finds_nothing(everything):
    sources = sorted(everything.glob("*.c"))
    command = ["clang-tidy", f"--checks={CHECKS}", *map(str, sources), "--", "-std=c99", f"-I{everything}"]
    said = subprocess.run(command, capture_output=True, text=True, check=False).stdout
    assert len(sources) > 15
    assert "warning:" not in said, said


def analysed(folder, sources):
    """What gcc's analyser says about the paths through the ``sources``."""
    command = ["gcc", "-std=c99", "-O1", "-fanalyzer", "-Wall", "-Wextra", "-c", "-o", "/dev/null"]
    return "".join(
        subprocess.run([*command, name], cwd=folder, capture_output=True, text=True, check=False).stderr
        for name in sources
    )


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
@pytest.mark.parametrize("ending", [*STRAIGHT_LINE, *FROM_TEMPLATES, "_timing.c", "_trajectory.c"])
@pytest.mark.sweep(but=["_controller.c", "_differential_ik.c", "_timing.c", "_friction.c"])  # 4 s for the solver alone
def test_the_analyser_of_gcc_finds_nothing(everything, ending):
    sources = sorted(path.name for path in everything.glob(f"*{ending}"))
    assert sources
    assert analysed(everything, sources) == ""


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
def test_the_analyser_of_gcc_finds_a_null_pointer(tmp_path):
    text = "int broken(int a);\nint broken(int a)\n{\n    int *p = 0;\n    return a ? *p : 0;\n}\n"
    (tmp_path / "broken.c").write_text(text, encoding="utf-8")
    assert "-Wanalyzer-null-dereference" in analysed(tmp_path, ["broken.c"])


@pytest.mark.skipif(not coding_rules.is_available(), reason="cppcheck is not installed")
def test_a_broken_rule_is_found(tmp_path):
    text = "int broken(int a, unsigned b)\n{\n    if (a) {\n        return a + b;\n    }\n    return 0;\n}\n"
    (tmp_path / "broken.c").write_text(text, encoding="utf-8")
    rules = {each.rule for each in findings(tmp_path, ["broken.c"])}
    assert {"14.4", "10.4"} <= rules


@pytest.mark.skipif(not coding_rules.is_available(), reason="cppcheck is not installed")
def test_a_product_with_the_number_of_joints_is_no_dead_code_where_that_is_one(tmp_path):
    lines = ["#define ARM_N 1 /* joints */", "#define TWO_N 2", "int broken(int a);", "int broken(int a)", "{"]
    products = ["a * ARM_N", "a * 1", "(a * ARM_N) + (a * 1)", "(a * ARM_N) + 0", "(a * TWO_N) + (1 * a)"]
    lines += [f"    const int at{k} = {product};" for k, product in enumerate(products)]
    lines += ["    return at0 + at1 + at2 + at3 + at4;", "}", ""]
    (tmp_path / "broken.c").write_text("\n".join(lines), encoding="utf-8")
    found = [each.line for each in findings(tmp_path, ["broken.c"]) if each.rule == "2.2"]
    assert found == [7, 8, 9, 10]


@pytest.mark.skipif(not coding_rules.is_available(), reason="cppcheck is not installed")
def test_a_file_that_cppcheck_cannot_read_is_not_a_clean_one(tmp_path):
    (tmp_path / "broken.c").write_text("int broken(int a)\n{\n    return (a;\n}\n", encoding="utf-8")
    with pytest.raises(InternalError, match=r"broken.c\|3\|12\|syntaxError"):
        findings(tmp_path, ["broken.c"])


HEAD = """#include "long.h"

static double twice(double x)
{
    return x + x;
}
"""


def straight(name, lines, last):
    """A function of so many lines as the printer writes them, and the line before its brace."""
    body = "\n".join(f"    const double t{k} = twice({f't{k - 1}' if k else 'x'});" for k in range(lines))
    return f"\ndouble {name}(double x)\n{{\n{body}\n    {last}\n}}\n"


@pytest.mark.skipif(not coding_rules.is_available(), reason="cppcheck is not installed")
def test_a_long_file_is_checked_a_few_functions_at_a_time(tmp_path):
    functions = [straight(f"f{k}", 90, "return t89;") for k in range(7)]
    functions.append(straight("broken", 90, "if (x) { return t0; } return t89;"))
    functions.append(straight("endless", LONGEST_FUNCTION, "return t0;"))
    text = HEAD + "".join(functions)
    parts, too_long = pieces(text)
    assert [each.name for each in too_long] == ["endless"]
    assert len(parts) == 3
    assert all("twice(double x)" in part for part in parts)
    whole = text.splitlines()
    for part in parts:
        lines = part.splitlines()
        assert len(lines) == len(whole)
        assert all(line in ("", given) for line, given in zip(lines, whole, strict=True))
    for name in [f"f{k}" for k in range(7)] + ["broken"]:
        assert sum(f"double {name}(" in part for part in parts) == 1
    (tmp_path / "long.c").write_text(text, encoding="utf-8")
    prototypes = [f"double {name}(double x);" for name in (*(f"f{k}" for k in range(7)), "broken", "endless")]
    (tmp_path / "long.h").write_text("\n".join([*prototypes, ""]), encoding="utf-8")
    found = findings(tmp_path, ["long.c"])
    at = next(number for number, line in enumerate(whole, 1) if "if (x)" in line)
    assert RuleFinding("long.c", at, "14.4") in found
    assert {(each.file, each.line) for each in found} == {("long.c", at)}


def test_a_file_with_loops_is_checked_as_a_whole():
    text = HEAD + straight("f", 900, "for (;;) { }")
    assert pieces(text) == ([text], [])


@pytest.mark.skipif(not coding_rules.is_available(), reason="cppcheck is not installed")
def test_enumerations_without_a_tag_break_no_rule_about_tags(tmp_path):
    for name in ("one", "two"):
        text = f'#include "{name}.h"\n\nint {name}(void)\n{{\n    return (int){name.upper()};\n}}\n'
        (tmp_path / f"{name}.c").write_text(text, encoding="utf-8")
        above = "\n" if name == "two" else ""  # another line of another file
        lines = f"{above}enum {{ {name.upper()} = 1 }};\nint {name}(void);\n"
        (tmp_path / f"{name}.h").write_text(lines, encoding="utf-8")
    found = findings(tmp_path, ["one.c", "two.c"])
    assert not {"2.4", "5.7"} & {each.rule for each in found}, found


def test_no_two_headers_define_one_type(everything):
    headers = [header.read_text(encoding="utf-8") for header in everything.glob("*.h")]
    defined = [name for text in headers for name in re.findall(r"^(?:typedef \w+|}) (\w+);", text, re.MULTILINE)]
    assert len(defined) > 20
    assert len(defined) == len(set(defined))


def test_the_table_has_a_row_for_every_rule():
    entry = coding_rules_entry([RuleFinding("a.c", 3, "15.5"), RuleFinding("a.c", 7, "10.3")], ["a.c"])
    rows = {row[0]: row[1:] for row in entry["rows"]}
    assert tuple(rows) == RULES
    assert len(RULES) == 156
    assert rows["15.5"] == ["advisory", "deviation, 1 places", DEVIATIONS["15.5"]]
    assert rows["10.3"][1] == "1 findings"
    assert entry["unaccepted"] == 1
    assert rows["9.1"] == ["mandatory", "compliant", ""]
    assert all(category(rule) == "advisory" for rule in DEVIATIONS)
