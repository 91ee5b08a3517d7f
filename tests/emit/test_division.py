"""Long functions as several static ones: the same values, nothing for compilers to complain about, bounded stacks."""

from __future__ import annotations

import subprocess
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given

from emit.c_tools import C99, CXX, SANITIZERS, check_all, compile_all, compiler, frames, run, write
from program.passes.programs import programs
from rrrgen.derive import derive_once
from rrrgen.emit.c import division
from rrrgen.emit.c.division import divide
from rrrgen.emit.c.function_files import function_files
from rrrgen.emit.c.header_comments import explanation
from rrrgen.emit.c.language import Dialect
from rrrgen.emit.c.stack import stack_bound
from rrrgen.program import Op
from rrrgen.program.evaluation import evaluate_floats
from rrrgen.robot.file import load_spec

LONG = "forward_dynamics_hessian"


@pytest.fixture
def short(monkeypatch):
    """Already functions of 50 operations are divided, into parts of 20."""
    monkeypatch.setattr(division, "LONGEST", 50)
    monkeypatch.setattr(division, "PART", 20)


def model():
    return derive_once(load_spec("planar2r"), groups=("model", "hessian"))


def test_every_part_has_what_it_needs():
    """Every operand is an input, a constant, computed in the part, or loaded, and nothing is overwritten too early."""

    @given(programs(size=60))
    def check(program):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(division, "LONGEST", 0)
            patch.setattr(division, "PART", 6)
            found = divide(program)
        if found is None:
            return
        assert (found.starts[0], found.starts[-1]) == (0, len(program.nodes))
        held: dict[int, int] = {}  # what is in the array
        computed: set[int] = set()
        for k, (start, end) in enumerate(pairwise(found.starts)):
            known = set(found.loaded[k])
            assert all(held[found.slots[node]] == node for node in known)
            for index in range(start, end):
                node = program.nodes[index]
                assert all(arg in known or program.nodes[arg].op in (Op.INPUT, Op.CONST) for arg in node.args)
                angle = node.args[0] if node.op in (Op.SIN, Op.COS) else None
                pair = [other for other, each in enumerate(program.nodes)
                        if angle is not None and each.op in (Op.SIN, Op.COS) and each.args[0] == angle]  # fmt: skip
                known |= {index} if angle is None else set()
                known |= {other for other in pair if not computed & set(pair)}
                for new in known - computed:
                    if new in found.slots and new not in found.loaded[k]:
                        held[found.slots[new]] = new
                computed |= known
        assert max(found.slots.values(), default=-1) < found.size

    check()


def hessians():
    return [program for name, program in model().programs.items() if "hessian" in name]


@pytest.mark.parametrize("real", ["double", "float"])
def test_compilers_have_nothing_to_complain_about(short, real, tmp_path):
    folder = write(function_files("planar2r", "Hessians", hessians(), real), tmp_path)
    subprocess.run([compiler("gcc"), *C99, "-O2", "-c", "planar2r.c"], cwd=folder, check=True)
    check_all(folder, [compiler("clang"), *C99])
    check_all(folder, [compiler("g++"), *CXX])


@pytest.mark.parametrize("flags", [["-O2"], SANITIZERS], ids=["optimized", "sanitized"])
def test_divided_functions_compute_what_their_programs_do(short, flags, tmp_path):
    """A program that prints all results at one state, against the reference evaluation."""
    expected, calls, rng = [], [], np.random.default_rng(1)
    for program in hessians():
        inputs = [rng.uniform(0.5, 1, port.size) for port in program.inputs]
        arrays = [
            f"double {port.name}[] = {{{', '.join(map(repr, x.tolist()))}}};"
            for port, x in zip(program.inputs, inputs, strict=True)
        ]
        results = [f"double {port.name}[{port.size}];" for port in program.data_outputs]
        names = ", ".join(port.name for port in (*program.inputs, *program.data_outputs))
        loop = 'for (k = 0; k < {0}; k++) printf("%.17g ", {1}[k]);'
        prints = [loop.format(port.size, port.name) for port in program.data_outputs]
        calls.append("{ int k; " + " ".join([*arrays, *results, f"planar2r_{program.name}({names});", *prints]) + " }")
        values = evaluate_floats(program, *(x.tolist() for x in inputs))
        expected += [x for k, row in enumerate(values) if not program.is_status(k) for x in row]
    files = function_files("planar2r", "Hessians", hessians(), "double")
    assert files["planar2r.c"].count("_part_1(") == 2 * len([p for p in hessians() if divide(p) is not None]) > 6
    head = '#include <stdio.h>\n#include "planar2r.h"\nint main(void) {\n'
    files["main.c"] = head + "\n".join([*calls, "return 0;", "}"])
    done = run(compile_all(write(files, tmp_path), [compiler("gcc"), "-std=c99", *flags], "main"))
    assert done.returncode == 0, done.stderr
    np.testing.assert_allclose([float(x) for x in done.stdout.split()], expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("command", [["gcc"], ["gcc", "-fno-inline"], ["clang"]], ids=" ".join)
def test_frames_of_divided_functions_stay_below_the_stated_bound(short, command, tmp_path):
    folder = write(function_files("planar2r", "Hessians", hessians(), "double"), tmp_path)
    used = frames(folder / "planar2r.c", [compiler(command[0]), *command[1:], "-O2"])
    for program in hessians():
        name = f"planar2r_{program.name}"
        parts = [size for function, size in used.items() if function.startswith(f"{name}_part_")]
        deepest = used[name] + max(parts, default=0)
        assert deepest <= getattr(stack_bound(program, "double"), command[0]), name


def test_the_comment_states_parts_and_array(short):
    program = model().programs[LONG]
    found = divide(program)
    assert found is not None
    text = " ".join(explanation(program, Dialect("planar2r")))
    assert f"It consists of {found.parts} static functions" in text
    assert f"array of {found.size} values" in text


def test_functions_of_usual_length_stay_whole():
    assert all(divide(program) is None for program in model().programs.values())
