"""States between arrays and vector registers: every size and register width, dense and strided, both directions."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from emit.c_tools import compiler
from rrrgen.emit.c.batches import SIZES, SimdSinCos, transfers
from rrrgen.emit.c.language import Dialect

WIDTHS = {"sse2": "-msse2", "avx": "-mavx", "avx512f": "-mavx512f"}

CHECK = """
static int check{size}(void)
{{
    robot_real x[SIMD_LANES*{size}], y[SIMD_LANES*{size}], wide[SIMD_LANES*({size} + 5)];
    robot_simd lanes_of[{size}], strided[{size}], same[{size}];
    int wrong = 0;
    for (int k = 0; k < SIMD_LANES*{size}; k++)
        x[k] = (robot_real)(k + 1);
    for (int k = 0; k < SIMD_LANES*({size} + 5); k++)
        wide[k] = (robot_real)(k + 1);
    robot_simd_in{size}(x, {size}, lanes_of);
    robot_simd_in{size}(wide, {size} + 5, strided);
    robot_simd_in{size}(x, 0, same);
    robot_simd_out{size}(lanes_of, y);
    for (int lane = 0; lane < SIMD_LANES; lane++)
        for (int e = 0; e < {size}; e++) {{
            wrong += lanes_of[e][lane] != x[lane*{size} + e];
            wrong += strided[e][lane] != wide[lane*({size} + 5) + e];
            wrong += same[e][lane] != x[e];
            wrong += y[lane*{size} + e] != x[lane*{size} + e];
        }}
    return wrong;
}}
"""


def runs(feature: str) -> bool:
    try:
        return feature in Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace")
    except OSError:
        return feature == "sse2"


@pytest.mark.parametrize("command_name", ["gcc", "clang"])
@pytest.mark.parametrize("feature", WIDTHS)
@pytest.mark.parametrize("real", ["double", "float"])
def test_numbers_arrive_in_their_places(tmp_path, real, feature, command_name):
    program = compiler(command_name)
    if not runs(feature):
        pytest.skip(f"this processor has no {feature}")
    source = [f"typedef {real} robot_real;", SimdSinCos().preamble(Dialect("robot", real))]
    source += [transfers(SIZES, SIZES, "robot", "robot_real", real), *(CHECK.format(size=size) for size in SIZES)]
    calls = " + ".join(f"check{size}()" for size in SIZES)
    source += [f"int main(void) {{ (void)robot_simd_fill; (void)robot_simd_sincos; return ({calls}) != 0; }}"]
    (tmp_path / "check.c").write_text("\n".join(source))
    command = [program, "-std=c99", "-O2", WIDTHS[feature], "-Wno-psabi", "check.c", "-lm", "-o", "check"]
    subprocess.run(command, cwd=tmp_path, check=True)
    assert subprocess.run([tmp_path / "check"]).returncode == 0
