"""The stated operations of the inverse kinematics against a run of the emitted code with numbers that count.

The emitted C is valid C++: with its real type replaced by a class whose operators count, one call of the function that
lists the candidates tells how much it computes. Operations between constants are left to the compiler and not counted.
"""

import shutil
import subprocess

import numpy as np
import pytest

from ik.chains import position
from ik.robots import make
from ik.test_mechanisms import TEXTS
from rrrgen.emit.c.ik.costs import coupling_operations
from rrrgen.emit.c.ik.files import emit, manifest
from rrrgen.ik.classify import plan
from rrrgen.ik.families import parameter
from rrrgen.robot.file import load_spec, loads_spec

COMPILER = shutil.which("g++") or shutil.which("clang++")
ARMS = ("rrr", "planar2r", "puma560", "scara", "stanford", "ur10e", "iiwa14", "gantry")
CLOSE = 0.03
"""How far sums and products may be off: the functions of the templates leave out what is a constant of the robot."""

COUNTING = """
#include <cmath>
#include <cstdio>
struct Counted {
    double x;
    bool known;
    Counted(double v = 0) : x(v), known(true) {}
    explicit operator int() const { return (int)x; }
};
static long mul, add, dv, rt, trig;
static Counted made(double v, bool known, long &n) { Counted c(v); c.known = known; n += !known; return c; }
static Counted operator*(const Counted &a, const Counted &b) { return made(a.x * b.x, a.known && b.known, mul); }
static Counted operator+(const Counted &a, const Counted &b) { return made(a.x + b.x, (a.known && b.known), add); }
static Counted operator-(const Counted &a, const Counted &b) { return made(a.x - b.x, (a.known && b.known), add); }
static Counted operator/(const Counted &a, const Counted &b) { return made(a.x / b.x, a.known && b.known, dv); }
static Counted operator-(const Counted &a) { Counted c(-a.x); c.known = a.known; return c; }
static Counted &operator*=(Counted &a, const Counted &b) { return a = a * b; }
static Counted &operator+=(Counted &a, const Counted &b) { return a = a + b; }
static Counted &operator-=(Counted &a, const Counted &b) { return a = a - b; }
static Counted &operator/=(Counted &a, const Counted &b) { return a = a / b; }
#define COMPARE(op) static bool operator op(const Counted &a, const Counted &b) { return a.x op b.x; }
COMPARE(<) COMPARE(>) COMPARE(<=) COMPARE(>=)
static long none;
static Counted sqrt(const Counted &a) { return made(std::sqrt(a.x), a.known, rt); }
static Counted sin(const Counted &a) { return made(std::sin(a.x), a.known, trig); }
static Counted cos(const Counted &a) { return made(std::cos(a.x), a.known, none); }
static Counted fabs(const Counted &a) { return made(std::fabs(a.x), a.known, none); }
static Counted floor(const Counted &a) { return made(std::floor(a.x), a.known, none); }
static Counted ceil(const Counted &a) { return made(std::ceil(a.x), a.known, none); }
static Counted copysign(const Counted &a, const Counted &b)
{
    return made(std::copysign(a.x, b.x), a.known && b.known, none);
}
"""


COUPLED = ("geared", "sliding")


def prepared(spec, folder, body):
    """The program that runs ``body`` behind the emitted code with counting numbers: what it prints."""
    files, M = emit(spec, plan(spec)).files, spec.name.upper()
    (folder / f"{spec.name}_ik.h").write_text(files[f"{spec.name}_ik.h"])
    text = (
        COUNTING + f"#define {M}_IK_REAL_DEFINED\ntypedef Counted {spec.name}_ik_real;\n" + files[f"{spec.name}_ik.c"]
    )
    text = text.replace("typedef double", "typedef Counted")  # of an elimination
    (folder / "count.cpp").write_text(text + f"int main() {{ {body} }}")
    subprocess.run([COMPILER, "-w", "-std=c++11", "-o", "count", "count.cpp"], cwd=folder, check=True)
    done = subprocess.run([folder / "count"], cwd=folder, capture_output=True, text=True, check=True)
    return map(int, done.stdout.split())


@pytest.mark.skipif(COMPILER is None, reason="needs a C++ compiler")
@pytest.mark.parametrize("name", COUPLED)
def test_operations_of_a_coupling(name, tmp_path):
    """One solution of the chain, one way in which the drives can stand."""
    spec = loads_spec(TEXTS[name])
    coupling, types = (found := plan(spec)).coupling, found.chain.types
    stem = f"{name}_ik"
    body = f"""
    Counted y[{len(types)}], q[{coupling.n}];
    for (int i = 0; i < {len(types)}; ++i) {{ y[i] = made(0.1 * i, false, none); }}
    {stem}_lead(y, 0, q);
    (void){stem}_off(y, q);
    std::printf("%ld %ld %ld", mul, add, dv);"""
    stated = coupling_operations(coupling, 1, types)
    mul, add, div = (each // coupling.count for each in (stated.mul, stated.add, stated.div))
    turns = types.count("R")  # angles of less than half a turn are wrapped by 0, a constant
    assert tuple(prepared(spec, tmp_path, body)) == (mul - turns, add - turns, div)
    assert emit(spec, found).operations.mul > coupling_operations(coupling, found.max_solutions, types).mul


GENERAL = {"general": position("RRRRRR", 1), "generalslide": position("RRPRRR", 2)}


@pytest.mark.skipif(COMPILER is None, reason="needs a C++ compiler")
@pytest.mark.parametrize("name", GENERAL)
def test_operations_of_an_elimination_are_a_mean_over_random_targets(name, tmp_path):
    spec = make(name, GENERAL[name])
    found = plan(spec)
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (200, 6))
    np.array([found.chain.forward(x).ravel() for x in q]).tofile(tmp_path / "targets")
    body = f"""
    double t[16];
    std::FILE *file = std::fopen("targets", "rb");
    while (std::fread(t, sizeof(double), 16, file) == 16) {{
        Counted target[16], ref[6]; {name}_ik_solutions found; int stage = 0;
        for (int i = 0; i < 16; ++i) {{ target[i] = made(t[i], false, none); }}
        mul = add = dv = rt = 0;
        const int rows = {name}_ik_branches(target, ref, 0.0, 0.0, &found, &stage);
        std::printf("%d %ld %ld %ld %ld ", rows, mul, add, dv, rt);
    }}
    std::fclose(file);"""
    rows, *counts = np.array([*prepared(spec, tmp_path, body)], float).reshape(len(q), 5).mean(axis=0)
    base, each = emit(spec, found).operations, manifest(spec)["operations_of_a_solution"]
    for kind, counted, close in zip(("mul", "add", "div", "sqrt"), counts, (0.05, 0.05, 0.1, 0.2), strict=True):
        assert counted == pytest.approx(getattr(base, kind) + rows * each[kind], rel=close)


@pytest.mark.skipif(COMPILER is None, reason="needs a C++ compiler")
@pytest.mark.parametrize("name", ARMS)
@pytest.mark.sweep(but=["rrr", "scara", "stanford", "iiwa14"])
def test_operations_are_those_of_the_emitted_code(name, tmp_path):
    spec = load_spec(name)
    found = plan(spec)
    emitted = emit(spec, found)
    stated, files = emitted.operations, emitted.files
    rng = np.random.default_rng(1)
    q = rng.uniform(0.2, 0.6, found.chain.n)
    T, given = found.chain.forward(q), parameter(found, q)
    T = [*T[:3, 3]] if found.task == "position" else [*T.ravel()]
    M = name.upper()
    locked = f", made({float(given)!r}, false, none)" if found.locked is not None else ""
    arc = f"{name}_ik_atan2" in files[f"{name}_ik.c"]
    main = f"""
int main() {{
    const double t[] = {{{", ".join(repr(float(x)) for x in T)}}};
    Counted target[16], ref[16]; {name}_ik_solutions found; int stage = 0;
    for (int i = 0; i < {len(T)}; ++i) {{ target[i] = made(t[i], false, none); }}
    for (int i = 0; i < 16; ++i) {{ ref[i] = made(0.1, false, none); }}
    const int rows = {name}_ik_branches(target, ref{locked}, {M}_IK_TOL_SLACK, {M}_IK_TOL_FREE, &found, &stage);
    std::printf("%d %ld %ld %ld %ld %ld ", rows, mul, add, dv, rt, trig);
    mul = add = dv = 0;
    {f"(void){name}_ik_atan2(made(0.3, false, none), made(0.4, false, none));" if arc else ""}
    std::printf("%ld %ld %ld", mul, add, dv);
}}
"""
    (tmp_path / f"{name}_ik.h").write_text(files[f"{name}_ik.h"])
    text = COUNTING + f"#define {M}_IK_REAL_DEFINED\ntypedef Counted {name}_ik_real;\n" + files[f"{name}_ik.c"] + main
    (tmp_path / "count.cpp").write_text(text)
    subprocess.run([COMPILER, "-w", "-std=c++11", "-o", "count", "count.cpp"], cwd=tmp_path, check=True)
    done = subprocess.run([tmp_path / "count"], capture_output=True, text=True, check=True)
    rows, mul, add, div, sqrt, sincos, *arc_tangent = map(int, done.stdout.split())
    assert rows == found.max_solutions
    assert (stated.sincos, stated.sqrt) == (sincos, sqrt)
    arcs = np.array(arc_tangent) * stated.atan2
    assert stated.div == div - arcs[2]
    assert stated.mul == pytest.approx(mul - arcs[0], rel=CLOSE)
    assert stated.add == pytest.approx(add - arcs[1], rel=CLOSE)
