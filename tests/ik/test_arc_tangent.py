"""The arc tangent of the emitted C: within its bound, with the signs and the special cases of its comment."""

import ctypes
import subprocess

import numpy as np
import pytest
from mpmath import atan2, mp, mpf

from ik.robots import robot
from rrrgen.emit.c.ik.files import sources

BOUND = 2.7
"""Units in the last place; stands in the comment of the function."""

EXPORT = """
#include "rrr_ik.c"
void arcs(int count, const rrr_ik_real *y, const rrr_ik_real *x, rrr_ik_real *angle);
void arcs(int count, const rrr_ik_real *y, const rrr_ik_real *x, rrr_ik_real *angle)
{
    rrr_ik_arcs(count, y, x, angle);
}
"""


@pytest.fixture(scope="module", params=["double", "float"])
def arcs(request, tmp_path_factory):
    """The function over arrays, and its type."""
    folder = tmp_path_factory.mktemp("arcs")
    for name, text in sources(robot("rrr"), real=request.param).items():
        (folder / name).write_text(text)
    (folder / "export.c").write_text(EXPORT)
    library = folder / "arcs.so"
    flags = ["-std=c99", "-O2", "-shared", "-fPIC"]
    subprocess.run(["cc", *flags, "-o", str(library), str(folder / "export.c"), "-lm"], check=True)
    loaded = ctypes.CDLL(str(library))
    real = np.float64 if request.param == "double" else np.float32

    def angles(y, x):
        arrays = [np.ascontiguousarray(v, real) for v in (y, x, np.zeros(len(y)))]
        loaded.arcs(len(y), *(ctypes.c_void_p(array.ctypes.data) for array in arrays))
        return arrays[2]

    return angles, real


def points(rng, count, real):
    """All directions, and those at eighths of half a turn, where the formula changes, at all distances."""
    x = rng.uniform(-np.pi, np.pi, count)
    edge = rng.integers(-8, 9, count) * np.pi / 8 + rng.choice([-1, 1], count) * 10.0 ** rng.uniform(-17, -1, count)
    angle = np.where(rng.random(count) < 0.5, x, edge)
    size = 10.0 ** rng.uniform(-6, 6, count)
    return (size * np.sin(angle)).astype(real), (size * np.cos(angle)).astype(real)


def test_bound(arcs):
    angles, real = arcs
    count = 20_000 if real is np.float64 else 2_000_000
    y, x = points(np.random.default_rng(3), count, real)
    found = angles(y, x)
    if real is np.float64:
        with mp.workprec(100):
            true = [atan2(mpf(a), mpf(b)) for a, b in zip(y, x, strict=True)]
            off = np.array([float(mpf(a) - b) for a, b in zip(found, true, strict=True)])
    else:
        off = found - np.arctan2(y.astype(float), x.astype(float))
    assert np.max(np.abs(off) / np.spacing(np.abs(found))) < BOUND


def test_bound_stands_in_the_comment():
    assert f"with an error of at most {BOUND} ulp" in sources(robot("rrr"))["rrr_ik.c"]


@pytest.mark.parametrize(
    ("y", "x", "angle"),
    [
        (0.0, 1.0, 0.0), (-0.0, 1.0, 0.0), (0.0, -1.0, np.pi), (-0.0, -1.0, np.pi), (1.0, 0.0, np.pi / 2),
        (-1.0, 0.0, -np.pi / 2), (1.0, -0.0, np.pi / 2), (1.0, 1.0, np.pi / 4), (1.0, -1.0, 3 * np.pi / 4),
        (-1.0, -1.0, -3 * np.pi / 4), (-1.0, 1.0, -np.pi / 4), (0.0, 0.0, np.pi / 2),
    ],
)  # fmt: skip
def test_special_directions(arcs, y, x, angle):
    angles, real = arcs
    (found,) = angles([y], [x])
    assert found == real(angle)


def test_what_is_not_a_number_has_no_angle(arcs):
    angles, _ = arcs
    assert np.all(np.isnan(angles([np.nan, np.nan], [1.0, -1.0])))
