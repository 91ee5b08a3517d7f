"""The stated bytes of stack of the emitted inverse kinematics against what compilers report along chains of calls."""

from __future__ import annotations

import re
import subprocess
from functools import cache

import pytest

from emit.c_tools import compiler, frames, write
from ik.robots import make
from ik.test_emitted_c import LIMITS, VARIANTS
from rrrgen.base.errors import InternalError
from rrrgen.emit.c.ik.costs import stack_bounds
from rrrgen.emit.c.ik.files import emit
from rrrgen.ik.classify import plan


def calls(source):
    """Who calls whom, from gcc before it compiles callees into callers: an opinion of its own on the text."""
    command = [compiler("gcc"), "-std=c99", "-O0", "-fcallgraph-info", "-c", source.name]
    done = subprocess.run(command, cwd=source.parent, capture_output=True, text=True)
    if "-fcallgraph-info" in done.stderr:
        pytest.skip("gcc before version 10 tells no graph of calls")
    assert done.returncode == 0, done.stderr
    graph = {}
    edges = re.findall(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"', source.with_suffix(".ci").read_text())
    for caller, callee in edges:
        graph.setdefault(caller.split(":")[-1], set()).add(callee.split(":")[-1])
    return graph


@pytest.mark.parametrize(
    ("name", "limited", "real", "command", "flags"),
    [
        ("puma", True, "double", "gcc", ["-O2"]),
        ("puma", True, "float", "clang", ["-O2"]),
        ("general", False, "double", "clang", ["-O2"]),  # callees compiled into one caller do not share their space
        ("general", False, "float", "gcc", ["-O2"]),  # the elimination is in double
        ("gantry", False, "float", "clang", ["-O3", "-march=native"]),  # short loops become long straight lines
        ("rrr", False, "double", "gcc", ["-O1"]),
    ],
)
@pytest.mark.sweep(
    but=["puma-True-double-gcc-flags0", "general-False-float-gcc-flags3", "gantry-False-float-clang-flags4"]
)
def test_no_chain_of_calls_takes_more_stack_than_is_stated(name, limited, real, command, flags, tmp_path):
    rows = VARIANTS[name]
    spec = make(name, rows, limits=LIMITS[: len(rows)] if limited else None)
    emitted = emit(spec, plan(spec), real)
    source = write(emitted.files, tmp_path) / f"{name}_ik.c"
    used, graph = frames(source, [compiler(command), *flags]), calls(source)

    @cache
    def deepest(function):
        """A function without a frame of its own was compiled into its callers."""
        return used.get(function, 0) + max(map(deepest, graph.get(function, ())), default=0)

    header = (tmp_path / f"{name}_ik.h").read_text()
    assert [int(text) for text in re.findall(r"Stack: at most (\d+) bytes\.", header)] == [
        emitted.stack[f"{name}_{function}"]
        for function in ("inverse_kinematics", "inverse_kinematics_batch", "closest")
    ]
    for function, stated in emitted.stack.items():
        assert deepest(function) <= stated, function
        assert stated <= 2 * deepest(function) or deepest(function) < 4000, f"{function}: a bound that says too little"


SOURCE = """
#define R_IK_SIZE 3 /* a comment with REAL x[7]; */
static const r_ik_real r_table[2] = { (r_ik_real)1, (r_ik_real)2};
static void r_inner(const r_ik_real a[4])
{
    static const int order[5] = {1, 2, 3, 4, 5};
    r_ik_real scale = a[0] * (a[1] + a[2]), x[2][R_IK_SIZE + 1] = { {(r_ik_real)0} }, *const y = x[1];
    unsigned flags[R_IK_SIZE];
    for (int i = 0; i < 2; ++i) {
        const int k[1] = {order[i]};
    }
}

void r_outer(r_ik_solutions *out)
{
    r_ik_solutions found, *const best = &found;
    r_inner(out->q[0]);
}
"""


def test_the_figure_counts_arrays_structures_and_the_deepest_chain():
    bounds = stack_bounds(SOURCE, "r", "double", {"ik": (3, 2)})
    arrays = 8 * 2 * 4 + 4 * 3 + 4 * 1  # x, flags, k
    solutions = 4 + 4 + 8 + 2 * (3 * 8 + 4 + 4 + 8)
    assert set(bounds) == {"r_inner", "r_outer"}
    assert 0 <= bounds["r_inner"] - (2048 + 192 + 1.5 * arrays) < 16
    assert 0 <= bounds["r_outer"] - (2048 + 2 * 192 + 1.5 * (arrays + solutions)) < 16


def test_an_array_of_unknown_size_is_a_fault():
    with pytest.raises(InternalError, match=r"\[R_SIZE\]"):
        stack_bounds("void r_f(void)\n{\n    r_ik_real x[R_SIZE];\n}\n", "r", "float", {"ik": (3, 2)})
