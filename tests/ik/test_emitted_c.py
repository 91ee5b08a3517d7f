"""The emitted C: clean under every warning in C and C++, self-contained, the same bytes every time, safe."""

import re
import shutil
import subprocess
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ik.chains import position
from ik.checks import configurations
from ik.robots import ROWS, make, reference, robot
from rrrgen.emit.c.ik.files import FUNCTIONS, emit, manifest, sources
from rrrgen.ik.classify import plan
from rrrgen.ik.families import parameter

WARNINGS = [
    "-Wall",
    "-Wextra",
    "-Wconversion",
    "-Wsign-conversion",
    "-Wfloat-conversion",
    "-Wdouble-promotion",
    "-Wshadow",
    "-Wpedantic",
    "-Werror",
]

LIMITS = [(-2.0, 2.0), (None, 1.5), (None, None), (None, None), (-1.0, None), (None, None), (None, None)]

LIMITED = ("puma", "stanford")

VARIANTS = {
    "rrr": ROWS["rrr"],
    "ortho3r": ROWS["ortho3r"],
    "puma": ROWS["puma"],
    "ur5": ROWS["ur5"],
    "stanford": ROWS["stanford"],
    "scara": ROWS["scara"],
    "iiwa14": ROWS["iiwa14"],
    "panda": ROWS["panda"],
    "general": [
        ("R", 1.3, 0.3, 0.4, 0.2),
        ("R", -0.7, 0.5, 0.1, 0.0),
        ("R", 0.9, 0.2, -0.2, 0.5),
        ("R", 1.1, 0.1, 0.3, 0.0),
        ("R", -1.4, 0.25, 0.15, 0.0),
        ("R", 0.4, 0.1, 0.2, -1.0),
    ],
    "sliding": [  # with the last joint prescribed: five revolute joints and a prismatic one
        ("R", 1.3, 0.3, 0.4, 0.2),
        ("R", -0.7, 0.5, 0.1, 0.0),
        ("R", 0.9, 0.2, -0.2, 0.5),
        ("P", 1.1, 0.1, 0.3, 0.7),
        ("R", -1.4, 0.25, 0.15, 0.0),
        ("R", 0.4, 0.1, 0.2, -1.0),
        ("R", 0.8, 0.1, 0.1, 0.0),
    ],
    "incomplete": [  # two joints slide, and the wrist's axes meet but for a calibration
        ("R", 1.3, 0.3, 0.4, 0.2),
        ("P", -0.7, 0.5, 0.1, 0.4),
        ("P", 0.9, 0.2, -0.2, 0.5),
        ("R", -1.1, 0.001, 0.3, 0.0),
        ("R", 1.2, -0.001, 0.001, 0.0),
        ("R", 0.4, 0.1, 0.2, 0.0),
    ],
    "gantry": [("P", 1.5707963267948966, 0.1, 0.0, 0.0), ("P", 1.2, 0.0, 0.0, 0.3), ("R", 0.4, 0.2, 0.1, 0.0)],
    "quadratic": [("P", 0.7, 0.1, 0.0, 0.0), ("R", 0.8, 0.2, 0.1, 0.3), ("P", 0.4, 0.2, 0.1, 0.2)],
    "nominal": [  # a calibrated Puma, whose nominal arm is solved first
        ("R", 1.571, 1e-4, 0.0, 0.0),
        ("R", 1e-4, 0.4318, 0.0, 0.0),
        ("R", -1.5707963267948966, 0.0203, 0.15005, 0.0),
        ("R", 1.5708, 2e-4, 0.4318, 0.0),
        ("R", -1.5709, -1e-4, 1e-4, 0.0),
        ("R", 0.0, 0.0, 0.05, 0.0),
    ],
    "four": [  # of the wrist of two more joints that complete it only one angle is read
        ("R", 1.57079632679, 0.25, 0.0, 0.0),
        ("R", 3.14159265359, 0.195, 0.0, -0.4),
        ("R", -1.57079632679, 0.0, 0.275, -0.4),
        ("R", 0.0, 0.0, 0.124, 1.57079632679),
    ],
    "orientation": position("PRPRRP", 4),
    "point": position("RP", 1),
    "nearly": [("R", 1.5707963267948966, 1e-5, 0.56, 0.0), ("R", 1e-5, 0.2, 0.169, 0.0), ("R", 0.0, 0.415, 0.09, 0.0)],
}

COMPILERS = [
    (["gcc", "-std=c99", "-Wstrict-prototypes"]),
    (["clang", "-std=c99", "-Wstrict-prototypes"]),
    (["g++", "-x", "c++", "-std=c++17"]),
    (["clang++", "-x", "c++", "-std=c++11"]),
]

GCC = "gcc" if shutil.which("gcc") else "cc"

TEXT_LIMIT = 32_200
"""Bytes of machine code at -O2 of a solver with its checks, refinement and nearest configuration."""

GENERAL_LIMIT = 44_000
"""The same with an elimination for six joints. A quarter of it proves that no solution is missing: it counts the roots,
finds all solutions that share one, and follows continua."""

SEVEN_LIMIT = 46_500
"""The same where an elimination solves seven joints: refinement and elimination grow with the joint that slides."""


NOMINAL_LIMIT = 80_000
"""The same with the closed form of a special arm, its Newton step and the elimination."""


def variant(name, limits=None):
    spec = make(name, VARIANTS[name], limits=limits)
    return replace(spec, ik="nominal_first") if name == "nominal" else spec


@cache
def emitted(name, real, limits):
    spec = variant(name, limits)
    return emit(spec, plan(spec), real).files


def written(directory, name, real="double", limits=None):
    for file, text in emitted(name, real, tuple(limits) if limits else None).items():
        (directory / file).write_text(text)
    return directory / f"{name}_ik.c"


def run(command, **options):
    done = subprocess.run(command, capture_output=True, text=True, check=False, **options)
    assert done.returncode == 0, done.stderr[:3000] + done.stdout[:1000]
    return done.stdout


@pytest.mark.parametrize(
    ("command", "real"),
    [(command, real) for command in COMPILERS[:2] for real in ("double", "float")]
    + [(COMPILERS[2], "double"), (COMPILERS[3], "float")],  # what is C++ and what is float are told apart above
    ids=lambda value: value if isinstance(value, str) else value[0],
)
@pytest.mark.sweep(but=["gcc-double", "clang-float"])
def test_no_warning_in_c_and_c_plus_plus(command, real, tmp_path):
    if shutil.which(command[0]) is None:
        pytest.skip(f"{command[0]} is not installed")
    found = [written(tmp_path, name, real) for name in VARIANTS]
    (folder := tmp_path / "limited").mkdir()
    found += [written(folder, name, real, LIMITS[: len(VARIANTS[name])]) for name in LIMITED]
    run([*command, "-fsyntax-only", *WARNINGS, *map(str, found)])


def optimized(source, out):
    """Compile at -O2 under every warning: uninitialised variables show only where the optimiser looks."""
    run(
        [
            GCC,
            "-std=c99",
            "-Wstrict-prototypes",
            *WARNINGS,
            "-O2",
            "-fno-stack-protector",
            "-fno-pie",
            "-c",
            "-o",
            str(out),
            str(source),
        ]
    )


@pytest.mark.parametrize("name", LIMITED)
def test_no_warning_from_the_optimizer_where_joints_have_limits(name, tmp_path):
    optimized(written(tmp_path, name, limits=LIMITS[: len(VARIANTS[name])]), tmp_path / "x.o")


def test_text_rules():
    for name in VARIANTS:
        files = emitted(name, "double", None)
        assert set(files) == {f"{name}_ik.h", f"{name}_ik.c"}
        for text in files.values():
            assert text.isascii()
            assert "\r" not in text
            assert not re.search(r"\b(REAL|SQRT|COS|SIN|FABS|WRAP|ROOT0)\b", text)
            assert not re.search(
                r"\b(malloc|calloc|free|alloca|goto|while|printf|errno)\b", re.sub(r"/\*.*?\*/", "", text, flags=re.S)
            )


def test_same_bytes_in_a_fresh_process(tmp_path):
    script = (
        "import sys; sys.path[:0] = sys.argv[1:]\n"
        "from ik.robots import robot\nfrom rrrgen.emit.c.ik.files import sources\n"
        "for n in ('rrr', 'puma', 'ur5', 'iiwa14'):\n    print(*sources(robot(n)).values())"
    )
    import os
    import sys
    from pathlib import Path

    import rrrgen

    paths = [str(Path(__file__).parents[1]), str(Path(rrrgen.__file__).parents[1])]
    here = "\n".join(" ".join(sources(robot(n)).values()) for n in ("rrr", "puma", "ur5", "iiwa14"))
    seed = "2" if os.environ.get("PYTHONHASHSEED") == "1" else "1"  # another one than here
    fresh = run([sys.executable, "-c", script, *paths], env={**os.environ, "PYTHONHASHSEED": seed})
    assert fresh.strip() == here.strip()


DRIVER = """
#include <stdio.h>
#include <string.h>
#include "{name}_ik.h"
int main(int argc, char **argv)
{{
    double line[{size} + {n}{extra}];
    FILE *file = fopen(argv[argc - 1], "rb");
    long rows = 0, bad = 0;
    if (!file) return 2;
    while (fread(line, sizeof line, 1, file) == 1) {{
        {name}_ik_solutions out;
        int i, j, option;
        for (option = 0; option < 8; ++option) {{
            memset(&out, 0xff, sizeof out); /* every byte of an unwritten number is a NaN */
            {name}_inverse_kinematics(line, option & 1 ? line + {size} : NULL{redundancy}, (unsigned)option, &out);
            for (i = 0; i < out.count; ++i) for (j = 0; j < {n}; ++j) bad += !(out.q[i][j] == out.q[i][j]);
            rows += out.count;
            bad += !({name}_ik_reason(out.stage)[0]);
            {name}_closest(line, option & 1 ? line + {size} : NULL{redundancy}, (unsigned)option, &out);
            for (i = 0; i < out.count; ++i) for (j = 0; j < {n}; ++j) bad += !(out.q[i][j] == out.q[i][j]);
        }}
    }}
    fclose(file);
    printf("%ld %ld\\n", rows, bad);
    return bad != 0;
}}
"""


@pytest.mark.parametrize("name", ["rrr", "puma", "ur5", "stanford", "iiwa14", "nearly", "general", "sliding"])
@pytest.mark.sweep(but=["general", "rrr"])
def test_sanitizers(name, tmp_path):
    """Address and undefined-behaviour sanitizers over ordinary, singular, unreachable and absurd targets."""
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    rows = VARIANTS[name]
    n = len(rows)
    spec = make(name, rows)
    found = plan(spec)
    source = written(tmp_path, name)
    q = np.vstack([configurations(rows, 40, 0), np.zeros((1, n)), np.full((1, n), np.pi / 2)])
    T = reference(rows, q)
    goals = T[:, :3, 3] if found.task == "position" else T.reshape(len(T), 16)
    absurd = np.repeat(goals[:1], 6, axis=0)
    for row, value in zip(absurd, (np.nan, np.inf, 1e300, -1e18, 5e-324, 1e6), strict=True):
        row[2 if found.task == "position" else 3] = value
    goals = np.vstack([goals, absurd, 3 * goals[:5]])
    redundant = found.locked is not None
    block = np.hstack([goals, np.resize(q, (len(goals), n)), *([np.full((len(goals), 1), 0.4)] if redundant else [])])
    (tmp_path / "targets.bin").write_bytes(np.ascontiguousarray(block).tobytes())
    size = goals.shape[1]
    (tmp_path / "driver.c").write_text(
        DRIVER.format(
            name=name, size=size, n=n, extra=" + 1" if redundant else "",
            redundancy=f", line[{size + n}]" if redundant else "",
        )
    )  # fmt: skip
    # -O0: the optimizer takes ten times as long, and may remove what the sanitizers are to see
    flags = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g", "-O0"]
    program = tmp_path / "driver"
    run(["gcc", "-std=c99", *flags, "-o", str(program), str(tmp_path / "driver.c"), str(source), "-lm"])
    rows_found, bad = map(int, run([str(program), str(tmp_path / "targets.bin")]).split())
    assert rows_found > 40
    assert bad == 0


ROWS_DRIVER = """
#include <stdio.h>
#include "{name}_ik.h"
int main(int argc, char **argv)
{{
    double line[{size} + {n} + 1];
    FILE *file = fopen(argv[argc - 1], "rb");
    {name}_ik_solutions out;
    int i, j, k;
    for (k = 0; file && fread(line, sizeof line, 1, file) == 1; ++k) {{
        {name}_inverse_kinematics(line, line + {size}{redundancy}, (unsigned){macro}_IK_LIMITS, &out);
        for (i = 0; i < out.count; ++i) {{
            printf("%d", k);
            for (j = 0; j < {n}; ++j) printf(" %.17g", out.q[i][j]);
            printf("\\n");
        }}
    }}
    return 0;
}}
"""


def assert_rows_are_right(name, limits, build, folder):
    """``build`` turns the file driver.c into the program driver, with the solver in it."""
    rows = VARIANTS[name]
    n, found = len(rows), plan(variant(name, limits))
    only_position = found.task == "position"
    q = configurations(rows, 60, 3)
    q = np.vstack([q, np.random.default_rng(4).uniform(-1.0, 1.0, (60, n))])  # inside all limits
    T = reference(rows, q)
    goals = T[:, :3, 3] if only_position else T.reshape(len(T), 16)
    near = np.random.default_rng(5).uniform(-9.0, 9.0, q.shape)  # references some turns away
    given = [[parameter(found, each)] if found.locked is not None else [0.0] for each in q]
    (folder / "targets.bin").write_bytes(np.hstack([goals, near, given]).tobytes())
    redundancy = f", line[{goals.shape[1] + n}]" if found.locked is not None else ""
    text = ROWS_DRIVER.format(name=name, macro=name.upper(), size=goals.shape[1], n=n, redundancy=redundancy)
    (folder / "driver.c").write_text(text)
    build()
    printed = np.loadtxt(run([str(folder / "driver"), str(folder / "targets.bin")]).splitlines())
    goal, row = printed[:, 0].astype(int), printed[:, 1:]
    reached = reference(rows, row)
    error = (reached - T[goal])[:, :3, 3:] if only_position else reached - T[goal]
    assert np.abs(error).max() < 1e-9
    assert set(range(60, 120)) <= set(goal)
    if limits is not None:
        low, high = (np.array([side[k] or (-1) ** (k + 1) * np.inf for side in limits]) for k in (0, 1))
        assert np.all(row >= low - 1e-9)
        assert np.all(row <= high + 1e-9)


@pytest.mark.sweep(but=["general", "rrr", "point"])
@pytest.mark.parametrize("name", VARIANTS)
def test_the_optimizer_has_no_warning_and_keeps_rows_symbols_and_size(name, tmp_path):
    """Nothing but the documented functions is visible, nothing but mathematics is needed, nothing can be written to."""
    allowed = {"sin", "cos", "sqrt", "floor", "ceil", "fabs", "memcpy", "memset", "sincos"}

    def link():
        run([GCC, "-std=c99", "-no-pie", "-o", "driver", "driver.c", "x.o", "-lm"], cwd=tmp_path)

    optimized(written(tmp_path, name), tmp_path / "x.o")
    table = [line.split() for line in run(["nm", str(tmp_path / "x.o")]).splitlines()]
    defined = {entry[2] for entry in table if len(entry) == 3 and entry[1] == "T"}
    assert defined == {f"{name}_{function}" for function in FUNCTIONS}
    assert not [entry for entry in table if len(entry) == 3 and entry[1] in "DdBbC"]
    assert {entry[1] for entry in table if len(entry) == 2} - {"_GLOBAL_OFFSET_TABLE_"} <= allowed
    text = int(run(["size", str(tmp_path / "x.o")]).splitlines()[1].split()[0])
    limits = {"general": GENERAL_LIMIT, "sliding": SEVEN_LIMIT, "nominal": NOMINAL_LIMIT}
    assert text <= limits.get(name, TEXT_LIMIT), (name, text)
    assert_rows_are_right(name, None, link, tmp_path)


FAST, CONTRACTED, EXTENDED = "-Ofast", "-O2 -ffast-math -march=native", "-O2 -std=gnu99 -mfpmath=387"
ARITHMETIC = [
    *(("gcc", name, flags) for name in ("rrr", "general") for flags in (FAST, CONTRACTED, EXTENDED)),
    *[("gcc", "puma", CONTRACTED), ("gcc", "ur5", EXTENDED)],
    *[("clang", "rrr", "-O2"), ("clang", "general", FAST), ("clang", "ur5", CONTRACTED)],
]
"""The libraries of other tests are made at -O2, usually by gcc; clang has no arithmetic of 80 bits on x86-64."""


@pytest.mark.parametrize(("command", "name", "flags"), ARITHMETIC)
@pytest.mark.sweep(
    but=[
        "gcc-general--O2 -std=gnu99 -mfpmath=387",
        "clang-ur5--O2 -ffast-math -march=native",
        "gcc-rrr--O2 -ffast-math -march=native",
    ]
)
def test_rows_are_right_however_the_compiler_treats_arithmetic(name, command, flags, tmp_path):
    if shutil.which(command) is None:
        pytest.skip(f"{command} is not installed")
    source = written(tmp_path, name, limits=(limits := LIMITS[: len(VARIANTS[name])]))
    built = [command, "-std=c99", *flags.split(), "-o", "driver", "driver.c", str(source), "-lm"]

    def build():
        done = subprocess.run(built, cwd=tmp_path, capture_output=True, text=True, check=False)
        if flags == EXTENDED and done.returncode:
            pytest.skip(f"{command} has no arithmetic of 80 bits for this machine")
        assert done.returncode == 0, done.stderr[:3000]

    assert_rows_are_right(name, limits, build, tmp_path)


def test_manifest_names_what_is_emitted():
    data = manifest(robot("puma"))
    assert data["solver"]
    assert data["family"] == "spherical"
    assert data["max_solutions"] == 8
    assert [entry["name"] for entry in data["branch"]] == ["shoulder", "elbow", "wrist"]
    header = sources(robot("puma"))["puma_ik.h"]
    for function in data["functions"]:
        assert f"{function}(" in header
    assert "redundancy" not in header.split("puma_inverse_kinematics(")[1].split(")")[0]
