"""Counted instructions: the longest path against what callgrind counts in a run, and what has no figure."""

from __future__ import annotations

import re
import shutil
import subprocess

import pytest

from pipeline.optimized import bundled
from rrrgen.emit.c.function_files import function_files
from rrrgen.emit.c.language import InlineSinCos
from rrrgen.evidence.counts import FLAGS, PROCESSORS, count_instructions, counts_entry, not_applicable

X86, CORTEX = PROCESSORS
installed = pytest.mark.skipif(bool(X86.missing), reason=f"not installed: {X86.missing}")

SOURCE = """#include <math.h>
double straight(double x) { return x * x + 1.0; }
double either(double x) { return x > 0.0 ? x / (x + 1.0) : straight(x) * 7.0 + 1.0 / x; }
double summed(const double *x, int n) { double s = 0.0; for (int k = 0; k < n; ++k) { s += x[k] * x[k]; } return s; }
double library(double x) { return tan(x) + 1.0; }
double guarded(double x) { return x < 1e6 ? x * 2.0 : tan(x) + 1.0; }
int deep(int n) { return n < 2 ? 1 : deep(n - 1) * n + deep(n - 2); }
"""


@installed
@pytest.mark.parametrize("processor", PROCESSORS, ids=lambda processor: processor.name)
def test_loops_recursion_and_the_c_library_have_no_figure(processor, tmp_path):
    if processor.missing:
        pytest.skip(f"not installed: {processor.missing}")
    text = SOURCE
    if processor.single_only:
        text = re.sub(r"(\d\.\d|1e6)", r"(float)\1", text.replace("double", "float").replace("tan(", "tanf("))
    count = count_instructions(processor, {"functions.c": text}, tmp_path)
    reasons = {name: value.instructions for name, value in count.items() if isinstance(value.instructions, str)}
    assert reasons == {
        "summed": "a loop",
        "library": "every path calls the C library",
        "deep": reasons.get("deep"),
    }
    assert reasons["deep"] in ("a loop", "recursion")
    assert 2 <= count["straight"].instructions < count["either"].instructions < 30
    assert 2 <= count["guarded"].instructions < 10


@installed
@pytest.mark.skipif(shutil.which("valgrind") is None, reason="not installed: valgrind")
@pytest.mark.parametrize("robot", ["pendulum", "rrr"])
def test_no_run_executes_more_instructions_than_the_longest_path(robot, tmp_path):
    programs = bundled(robot).programs
    names = ["inverse_dynamics", "mass_matrix", "forward_kinematics"]
    files = function_files("counted", "three functions", [programs[name] for name in names], "double", InlineSinCos())
    count = count_instructions(X86, files, tmp_path)
    calls = []
    for name in names:
        program = programs[name]
        sizes = {port.name: port.size for port in (*program.inputs, *program.data_outputs)}
        declared = "".join(f"static double {port}[{size}];" for port, size in sizes.items())
        given = ", ".join(sizes)
        filled = "".join(f"for (k = 0; k < {p.size}; ++k) {p.name}[k] = 0.3 * k - 0.2;" for p in program.inputs)
        calls.append(f"{{ {declared} {filled} (void)counted_{name}({given}); }}")
    main = f'#include "counted.h"\nint main(void) {{ int k; {" ".join(calls)} return 0; }}\n'
    (tmp_path / "main.c").write_text(main, encoding="utf-8")
    sources = [name for name in files if name.endswith(".c")]
    subprocess.run([*X86.compiler, *FLAGS, *sources, "main.c", "-lm", "-o", "run"], cwd=tmp_path, check=True)
    for name in names:
        tool = ["valgrind", "--tool=callgrind", f"--toggle-collect=counted_{name}", "--callgrind-out-file=/dev/null"]
        done = subprocess.run([*tool, "./run"], cwd=tmp_path, capture_output=True, text=True, check=True)
        executed = int(re.search(r"Collected : (\d+)", done.stderr)[1])
        assert 0.9 * count[f"counted_{name}"].instructions <= executed <= count[f"counted_{name}"].instructions, name


@installed
def test_the_entry_states_a_target_that_has_no_figures():
    model = bundled("pendulum")
    files = function_files("pendulum", "all functions", list(model.programs.values()), "double", InlineSinCos())
    entry, skipped = counts_entry("pendulum", model.programs, files, "double")
    assert not skipped
    assert [what for what, _ in not_applicable("double")] == ["instructions on Cortex-M4F"]
    assert not not_applicable("float")
    rows = {row[0]: row[1:] for row in entry["instructions"]["rows"]}
    assert {*rows} == {*model.programs}
    assert 0 < rows["inverse_dynamics"][0] < 200
    assert rows["smooth_friction"][0] == "none: every path calls the C library"
