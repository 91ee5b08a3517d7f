"""What stands in the place of rounding bounds of code with loops: the checks of the emitted self-test."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
from click.testing import CliRunner

from evidence.certified import content_of, run
from rrrgen.cli.generate import generate
from rrrgen.evidence import coding_rules
from rrrgen.evidence.self_tests import checks_of, installed_compilers, self_test_lines

TEST = """#include <stdio.h>
#include "arm.h"
int main(void)
{
    (void)printf("ok      controller: torques are finite      %.1e\\n", half(2.0) - 1.0);
    return half(2.0) != 1.0;
}
"""
FILES = {"arm.h": "double half(double x);\n", "arm.c": '#include "arm.h"\ndouble half(double x) { return x / 2; }\n'}


def test_checks_of_a_header_are_quoted():
    lines = self_test_lines({**FILES, "arm_selftest.c": TEST, "casadi/arm.c": "no C"})
    assert lines == {"arm_selftest.c": [("controller: torques are finite", "0.0e+00")]}
    assert "torques are finite (0.0e+00)" in checks_of("arm_controller.h", lines)
    assert checks_of("arm_fourier.h", lines) == ""


@pytest.mark.parametrize("compiler", installed_compilers())
def test_a_self_test_that_fails_with_one_compiler_is_no_evidence(compiler):
    """Both define ``__GNUC__``, clang ``__clang__`` too."""
    divisors = (3, 2) if compiler == "clang" else (2, 3)
    divisor = "#ifdef __clang__\n#define D {}\n#else\n#define D {}\n#endif\n".format(*divisors)
    with pytest.raises(RuntimeError, match=f"compiled with {compiler}, does not pass"):
        self_test_lines({**FILES, "arm.c": divisor + FILES["arm.c"].replace("/ 2", "/ D"), "arm_selftest.c": TEST})


@pytest.fixture(scope="module")
def timed():
    """The emitted C of a pendulum with the timing of paths, text by name."""
    with tempfile.TemporaryDirectory() as folder:
        CliRunner().invoke(generate, ["pendulum", "--with", "timing", "--no-casadi-files", "-o", folder])
        yield {path.name: path.read_text() for path in Path(folder).glob("*.[ch]")}


def test_the_timing_has_checks(timed):
    assert "passes 6 checks" in checks_of("pendulum_timing.h", self_test_lines(timed))


@pytest.mark.parametrize(
    ("right", "wrong"),
    [("t[i] *= *stretch;", "t[i] *= 1.01 * *stretch;"), ("(last < 1) || ", "")],
    ids=["slower than it need be", "a path of one point"],
)
def test_checks_of_the_timing_notice_faults(timed, right, wrong):
    faulty = timed["pendulum_timing.c"].replace(right, wrong, 1)
    assert faulty != timed["pendulum_timing.c"]
    with pytest.raises(RuntimeError, match=r"FAILED +timing"):
        self_test_lines({**timed, "pendulum_timing.c": faulty})


@pytest.mark.parametrize("words", ["controller", pytest.param("elastic,hessian", marks=pytest.mark.sweep)])
def test_certificates_of_optional_groups_have_no_open_item_but_the_analysis(tmp_path, monkeypatch, words):
    monkeypatch.setattr(coding_rules, "is_available", lambda: False)  # the other tests check the rules
    run("pendulum", "-o", tmp_path, "--samples", 4, "--no-casadi-files", "--with", words)
    content = content_of(tmp_path)
    rest = [row["what"] for row in content["skipped"]]
    assert not [what for what in rest if what.startswith(("rounding", "verification of"))]
    if words == "controller":
        found = {row["what"]: row["instead"] for row in content["without_bound"]}
        assert "status and phase of every fault" in found["rounding of pendulum_controller.h"]
