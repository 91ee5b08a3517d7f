"""The self-test that runs on the target sees what is wrong with the emitted inverse kinematics."""

import re
import shutil
import subprocess

import pytest

from ik.robots import ROWS, make
from pipeline.optimized import bundled
from rrrgen.derive import derive
from rrrgen.emit.c.ik.self_test import selftest
from rrrgen.emit.package import emit
from rrrgen.robot.file import loads_spec


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    place = tmp_path_factory.mktemp("selftest")
    files = emit(bundled("rrr"))
    for name, text in files.items():
        if name.endswith((".c", ".h")) and "/" not in name:
            (place / name).write_text(text)
    others = [name for name in files if re.fullmatch(r"rrr(_nominal|_derivatives|_selftest)?\.c", name)]
    subprocess.run(["gcc", "-std=c99", "-c", *others], cwd=place, check=True)
    return place


def run(folder, source):
    (folder / "rrr_ik.c").write_text(source)
    subprocess.run(["gcc", "-std=c99", "-O1", "-c", "rrr_ik.c"], cwd=folder, check=True)
    objects = [path.name for path in folder.glob("*.o")]
    subprocess.run(["gcc", *objects, "-o", "selftest", "-lm"], cwd=folder, check=True)
    return subprocess.run(["./selftest"], cwd=folder, capture_output=True, text=True)


SPOILED = [
    ("found->q[i][1] = angle[", "found->q[i][1] = (rrr_ik_real)1e-6 + angle[", "every row meets its target"),
    ("out->count = rows;", "out->count = rows > 0 ? rows - 1 : 0;", "rows of golden targets"),
    ("return (outside != 0) ? RRR_IK_OUTSIDE_LIMITS : RRR_IK_UNREACHABLE;", "return RRR_IK_OK;", "out of reach"),
]


def test_right_code_passes_and_wrong_code_does_not(folder):
    source = (folder / "rrr_ik.c").read_text()
    done = run(folder, source)
    assert done.returncode == 0, done.stdout
    assert done.stdout.count("inverse kinematics:") == 4
    for before, after, words in SPOILED:
        assert before in source
        wrong = run(folder, source.replace(before, after))
        assert wrong.returncode == 1, before
        assert any("FAILED" in line and words in line for line in wrong.stdout.splitlines()), (before, wrong.stdout)


UNCOUNTED = """\
schema: rrrgen/1
name: arm
convention: standard
units: {angle: deg, length: m}
gravity: [0, 0, -9.81]
tool: {translation: [0, 0.05, 0.12], rpy: [40, 0, 90]}
joints:
  - {type: revolute, alpha: 90, a: 0, d: 0.377, theta: 0}
  - {type: revolute, alpha: 0, a: 0.47, d: 0.47, theta: 0, sign: -1}
  - {type: revolute, alpha: 90, a: 0, d: 0.457, theta: 0}
"""


def test_an_arm_without_golden_targets_has_no_unused_function(tmp_path):
    """Three joints that lack a point to be placed at: no solver counts the rows of a target."""
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    for name, text in emit(derive(loads_spec(UNCOUNTED))).items():
        if name.endswith((".c", ".h")) and "/" not in name:
            (tmp_path / name).write_text(text)
    source = (tmp_path / "arm_selftest.c").read_text()
    assert "golden_rows" not in source
    warnings = ["-Wall", "-Wextra", "-Werror"]  # unused functions are found where code is made
    subprocess.run(["gcc", "-std=c99", *warnings, "-c", "arm_selftest.c"], cwd=tmp_path, check=True)


def test_every_family_has_targets():
    """Closed forms with all their rows; general arms with the configuration itself."""
    counts = {}
    for name in ("rrr", "puma", "ur5", "scara", "panda", "jaco2"):
        text = selftest(make(name, ROWS[name]), "float")
        counts[name] = re.search(r"golden_counts\[3\] = \{(.*?)\}", text)[1]
    assert counts["rrr"] == "4, 4, 4"
    assert counts["puma"] == "8, 8, 8"
    assert counts["jaco2"] == "1, 1, 1"
    assert all(name in counts for name in ("ur5", "scara", "panda"))
