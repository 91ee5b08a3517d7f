"""The elimination of general arms: roots, determinants, tables, every configuration."""

from __future__ import annotations

import ctypes
from fractions import Fraction
from math import comb, isqrt, pi

import mpmath
import numpy as np
import pytest

from ik.kernel_builds import build, pointer, prepare, table_of
from ik.kernel_types import INT, REAL, RNG, UNSIGNED
from ik.robots import make
from ik.test_emitted_c import VARIANTS
from rrrgen.ik.classify import plan


@pytest.fixture(scope="module")
def elimination(tmp_path_factory):
    """The kernels of the general solver for one arm."""
    folder = tmp_path_factory.mktemp("elimination")
    spec = make("general", VARIANTS["general"])
    prepare(folder, spec)
    names = ["angles.c", "error.c", "refine.c", "trig_roots.c", "general6r.c", "candidates6r.c", "aspect.c"]
    library = build(folder, names)
    library.ik_6r_lu.restype = REAL
    return library, plan(spec)


def test_roots_of_trigonometric_polynomials(elimination):
    library, _ = elimination
    for seed in range(40):
        rng = RNG(seed)
        a, b = rng.normal(size=(2, 9))
        root, order = np.zeros((24, 3)), np.zeros(24, np.int32)
        z = np.roots([*((a - 1j * b) / 2)[:0:-1], a[0], *((a + 1j * b) / 2)[1:]])
        count = library.ik_trig_roots_8(pointer(a), pointer(b), REAL(1e-13), pointer(root), pointer(order))
        expected = np.sort(np.angle(z[np.abs(np.abs(z) - 1) < 1e-9]))
        found = np.sort(np.arctan2(root[:count, 1], root[:count, 0]))
        np.testing.assert_allclose(found, expected, atol=1e-12)
        assert np.all(order[:count] == 1)


def test_a_double_root_is_reported_as_one_or_as_two_neighbours(elimination):
    """p = (1 - cos(x - 0.4)) (3 + cos x), which touches zero at 0.4."""
    library, _ = elimination
    points = 2 * pi * np.arange(32) / 32
    c = np.fft.fft((1 - np.cos(points - 0.4)) * (3 + np.cos(points))) / 32
    a, b = np.array([c[0].real, *(2 * c[1:9].real)]), np.array([0.0, *(-2 * c[1:9].imag)])
    root, order = np.zeros((24, 3)), np.zeros(24, np.int32)
    count = library.ik_trig_roots_8(pointer(a), pointer(b), REAL(1e-12), pointer(root), pointer(order))
    assert count >= 1
    assert np.all(order[:count] == 2)
    assert np.abs(np.arctan2(root[:count, 1], root[:count, 0]) - 0.4).max() < 1e-4


def test_determinants(elimination):
    library, _ = elimination
    a = np.hstack([RNG(12).normal(size=(6, 6)), np.zeros((6, 4))])
    assert library.ik_6r_lu(pointer(a.copy()), INT(6)) == pytest.approx(np.linalg.det(a[:, :6]))


def test_the_elimination_finds_every_configuration(elimination):
    library, found = elimination
    chain = found.chain
    for q in RNG(13).uniform(-pi, pi, (20, 6)):
        T, answer = np.ascontiguousarray(chain.forward(q)), Answer()
        stage = INT()
        arguments = (pointer(np.zeros(6)), REAL(1e-5), REAL(1e-13), ctypes.byref(answer), ctypes.byref(stage))
        rows = np.array(answer.q)[: library.ik_branches(pointer(T), *arguments)]
        rows = np.array(answer.q)[: len(rows)]
        assert len(rows) % 2 == 0
        assert min(np.abs(np.angle(np.exp(1j * (row - q)))).max() for row in rows) < 1e-7
        for row in rows:
            assert np.abs(chain.forward(row) - T).max() < 1e-11
            sign = int(np.linalg.det(chain.jacobian(row)) < 0)
            flags = UNSIGNED()
            assert library.ik_aspect(pointer(T), pointer(np.ascontiguousarray(row)), ctypes.byref(flags)) == sign
            assert flags.value == 0  # no double root


class Answer(ctypes.Structure):
    """``ik_solutions`` of the general arm."""

    _fields_ = (
        ("count", INT),
        ("stage", INT),
        ("distance", REAL),
        ("q", REAL * 6 * 16),
        ("flags", UNSIGNED * 16),
        ("branch", UNSIGNED * 16),
        ("residual", REAL * 16),
    )


def test_the_constant_tables_of_the_elimination():
    """Directions on the circle, correctly rounded; a motion nearby and its inverse; an odd direction."""
    with mpmath.workdps(40):
        turns = [2 * mpmath.pi * k / 17 for k in range(17)]
        wave = [[float(mpmath.cos(x)), float(mpmath.sin(x))] for x in turns]
    assert np.array_equal(table_of("ik_6r_wave", "general6r.c").reshape(17, 2), wave)
    motions = np.zeros((3, 4, 4))
    for motion, row in zip(motions, table_of("ik_6r_nudge", "general6r.c").reshape(3, 12), strict=True):
        motion[:3, :3], motion[:3, 3], motion[3, 3] = row[:9].reshape(3, 3), row[9:], 1.0
    np.testing.assert_allclose(motions[0], np.eye(4))
    np.testing.assert_allclose(motions[1] @ motions[2], np.eye(4), atol=1e-16)
    assert 1e-4 < np.abs(motions[1] - np.eye(4)).max() < 1e-2
    c, _, _, s = table_of("ik_6r_odd", "general6r.c")[:4]
    assert np.hypot(c, s) == pytest.approx(1, abs=1e-16)


def test_bernstein_tables():
    """Coefficients on [-t, t], t = tan(pi/8), of cos(k x) (1 + u^2)^8 and sin(k x) (1 + u^2)^8 with u = tan(x/2).

    They are polynomials in u with whole coefficients, (1 + i u)^(8 + k) (1 - i u)^(8 - k), whose Bernstein coefficient
    j is sum_m c_m t^m C(16, m)^-1 e(m, j) with e(m, j) the coefficient of z^m in (1 + z)^j (1 - z)^(16 - j).
    """
    t = Fraction(isqrt(2 * 10**120), 10**60) - 1
    even, odd = [], []
    for k in range(9):
        c = power([1, 1j], 8 + k, [1, -1j], 8 - k)
        rows = [
            sum(x * Fraction(y, comb(16, m)) * t**m for m, (x, y) in enumerate(zip(part, weights, strict=True)))
            for part in ([int(x.real) for x in c], [int(x.imag) for x in c])
            for weights in (power([1, 1], j, [1, -1], 16 - j) for j in range(9))
        ]
        rounded = [float(x) if abs(x) > 1e-30 else 0.0 for x in rows]  # the root of 2 has 60 digits
        even.append(rounded[:9])
        odd.append(rounded[9:])
    assert np.array_equal(table_of("ik_trig8_even", "trig_roots.c").reshape(9, 9), even)
    assert np.array_equal(table_of("ik_trig8_odd", "trig_roots.c").reshape(8, 9), odd[1:])


def power(a: list, times_a: int, b: list, times_b: int) -> list:
    """Coefficients of a product of powers of two linear polynomials."""
    c = [1]
    for low, high in [a] * times_a + [b] * times_b:
        c = [low * x + high * y for x, y in zip([*c, 0], [0, *c], strict=True)]
    return c


"""Its wrist has one real axis, which is turned by pi in no solution."""
