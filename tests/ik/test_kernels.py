"""The C kernels of the inverse kinematics: each compiles alone without a warning and computes what NumPy computes."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from dataclasses import replace
from math import pi

import numpy as np
import pytest

from ik.kernel_builds import KERNELS, build, pointer, prepare
from ik.kernel_types import INT, REAL, RNG, UNSIGNED
from ik.robots import robot
from ik.test_emitted_c import COMPILERS, LIMITS, VARIANTS, WARNINGS, run, variant
from ik.test_mechanisms import TEXTS
from rrrgen.base.errors import InternalError
from rrrgen.cli.main import run as rrrgen
from rrrgen.emit.c.ik.files import sources
from rrrgen.emit.c.ik.kernels import KernelSettings, specialize
from rrrgen.ik.classify import plan
from rrrgen.robot.file import loads_spec

MECHANISMS = {
    name: TEXTS[name.removesuffix("_mechanism")] for name in ("palletiser", "sliding_mechanism", "redundant_mechanism")
}


def arm(name: str):
    """An arm with limits, or a mechanism of test_mechanisms.py."""
    if name in MECHANISMS:
        return loads_spec(MECHANISMS[name])
    return variant(name, LIMITS[: len(VARIANTS[name])])


# -- every kernel alone -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "name", "real"),
    [
        (COMPILERS[0], "sliding", "double"),
        (COMPILERS[0], "nearly", "float"),
        (COMPILERS[1], "nominal", "float"),
        (COMPILERS[1], "incomplete", "double"),
        (COMPILERS[2], "nominal", "double"),
        (COMPILERS[3], "sliding", "float"),
        (COMPILERS[0], "sliding_mechanism", "float"),
        (COMPILERS[3], "palletiser", "double"),
        (COMPILERS[1], "redundant_mechanism", "double"),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else value,
)
@pytest.mark.sweep(but=["clang-nominal-float", "gcc-sliding-double"])
def test_every_kernel_compiles_alone_without_a_warning(command, name, real, tmp_path):
    """As C and as C++."""
    if shutil.which(command[0]) is None:
        pytest.skip(f"{command[0]} is not installed")
    files = prepare(tmp_path, arm(name), real)
    run([*command, "-fsyntax-only", *WARNINGS, *files], cwd=tmp_path)


def test_no_kernel_is_left_out(tmp_path):
    used = {file for name in ("sliding", "nearly", "nominal", "palletiser") for file in prepare(tmp_path, arm(name))}
    assert used == set(KERNELS)


@pytest.fixture(scope="module")
def turning(tmp_path_factory):
    """Angles, roots and refinement for an arm of six revolute joints with limits."""
    folder = tmp_path_factory.mktemp("kernels")
    spec = arm("puma")
    prepare(folder, spec)
    names = ["angles.c", "roots.c", "error.c", "refine.c", "rows.c", "order.c", "target.c"]
    library = build(folder, names)
    for name in ("ik_wrap", "ik_opposite", "ik_atan2", "ik_feasible", "ik_error", "ik_refine", "ik_apart"):
        getattr(library, name).restype = REAL
    return library, plan(spec)


def reals(*values: float) -> list:
    return [REAL(value) for value in values]


def test_angles(turning):
    library, _ = turning
    for x in RNG(0).uniform(-30, 30, 200):
        assert library.ik_wrap(REAL(x)) == pytest.approx(np.angle(np.exp(1j * x)), abs=1e-13)
        assert np.exp(1j * library.ik_opposite(REAL(x / 10))) == pytest.approx(-np.exp(1j * x / 10))
    assert library.ik_wrap(REAL(pi)) == pi
    assert library.ik_wrap(REAL(-pi)) == pi
    y, x = RNG(1).normal(size=(2, 40))
    angle = np.zeros(40)
    library.ik_arcs(INT(40), pointer(y), pointer(x), pointer(angle))
    np.testing.assert_allclose(angle, np.arctan2(y, x), rtol=1e-15)


def test_linear_equations(turning):
    """a cos x + b sin x = k: two roots, a double one, none, and every angle."""
    library, _ = turning
    slack, least = REAL(1e-5), REAL(1e-13)
    for a, b, k in RNG(2).uniform(-1, 1, (100, 3)):
        c = [REAL(value) for value in (a, b, k)]
        w, flags = REAL(), UNSIGNED()
        count = library.ik_linear(
            *map(ctypes.byref, c), *reals(-1, 1, 0.3), least, UNSIGNED(256), UNSIGNED(2), slack,
            ctypes.byref(w), ctypes.byref(flags),
        )  # fmt: skip
        assert count == (2 if a * a + b * b > k * k else 0)
        a, b, scaled = (value.value for value in c)
        for sign in (1, -1) if count else ():
            cosine, sine = a * scaled - sign * b * w.value, b * scaled + sign * a * w.value
            assert np.hypot(cosine, sine) == pytest.approx(1)
            assert a * cosine + b * sine == pytest.approx(k)
    c = [REAL(value) for value in (0.6, 0.8, 1.0)]
    w, flags = REAL(), UNSIGNED()
    arguments = (*reals(-1, 1, 0.3), least, UNSIGNED(256), UNSIGNED(2), slack, ctypes.byref(w), ctypes.byref(flags))
    assert library.ik_linear(*map(ctypes.byref, c), *arguments) in (1, 2)
    assert flags.value & (1 | 16)  # a double root, or two that may be one
    c = [REAL(value) for value in (0.0, 0.0, 0.0)]
    assert library.ik_linear(*map(ctypes.byref, c), *arguments) == 1
    assert (c[0].value, c[1].value) == pytest.approx((np.cos(0.3), np.sin(0.3)))
    assert flags.value & 2


def test_cosines_and_unit_vectors(turning):
    library, _ = turning
    for k in (-1.2, -1.0, -0.3, 0.0, 0.9, 1.0, 1.000001, 1.1):
        cosine, w, flags = REAL(k), REAL(), UNSIGNED()
        count = library.ik_cosine(
            ctypes.byref(cosine), REAL((1 - k) * (1 + k)), REAL(1e-5), ctypes.byref(w), ctypes.byref(flags)
        )
        assert count == (2 if abs(k) < 1 else 1 if abs(k) < 1.00001 else 0)
        if count:
            assert cosine.value**2 + w.value**2 == pytest.approx(1)
    for c, s in RNG(3).normal(size=(20, 2)):
        x, y = REAL(c), REAL(s)
        assert library.ik_unit(ctypes.byref(x), ctypes.byref(y), REAL(1e-13), UNSIGNED(256), UNSIGNED(2)) == 0
        assert complex(x.value, y.value) == pytest.approx(complex(c, s) / abs(complex(c, s)))
    for length, flag in ((1e-6, 256), (1e-14, 2)):
        x, y = REAL(length), REAL(0.0)
        assert library.ik_unit(ctypes.byref(x), ctypes.byref(y), REAL(1e-13), UNSIGNED(256), UNSIGNED(2)) == flag


def test_quartics_in_an_angle(turning):
    """Against the roots that a fine grid brackets."""
    library, _ = turning
    grid = np.linspace(-pi, pi, 20_001)
    for k in RNG(4).normal(size=(60, 5)):
        c, s, x = (np.zeros(4) for _ in range(3))
        branches = np.zeros(4, np.uint32)
        count = library.ik_quartic(*reals(*k), REAL(1e-9), *map(pointer, (c, s, x, branches)))
        f = k @ [np.ones_like(grid), np.cos(grid), np.sin(grid), np.cos(2 * grid), np.sin(2 * grid)]
        expected = grid[:-1][np.sign(f[:-1]) != np.sign(f[1:])]
        np.testing.assert_allclose(x[:count], expected, atol=4e-4)
        np.testing.assert_allclose([c[:count], s[:count]], [np.cos(x[:count]), np.sin(x[:count])], atol=1e-14)
        assert len(set(branches[:count])) == count


def test_polynomials_in_a_length(turning):
    library, _ = turning
    for k in RNG(5).normal(size=(60, 5)):
        x, g, flags = np.zeros(4), np.zeros(4, np.uint32), UNSIGNED()
        count = library.ik_power4(*reals(*k, 0.5, 1e-9), pointer(x), pointer(g), ctypes.byref(flags))
        z = np.roots(k[::-1])
        np.testing.assert_allclose(x[:count], np.sort(z[abs(z.imag) < 1e-8].real), rtol=1e-9)
        count = library.ik_quadratic(*reals(*k[:3], 0.5, 1e-5), pointer(x), pointer(g), ctypes.byref(flags))
        z = np.roots(k[2::-1])
        np.testing.assert_allclose(x[:count], np.sort(z[abs(z.imag) == 0].real)[::-1], rtol=1e-9)
    count = library.ik_quadratic(*reals(2.0, 4.0, 0.0, 0.5, 1e-5), pointer(x), pointer(g), ctypes.byref(flags))
    assert (count, x[0]) == (1, -0.5)


def test_the_nearest_feasible_angle(turning):
    library, _ = turning
    grid = np.linspace(-pi, pi, 20_001)
    for ref, mean, a, b, middle, half in RNG(6).uniform(-1, 1, (60, 6)):
        lower, upper = middle - abs(half), middle + abs(half)
        value = mean + a * np.cos(ref + grid) + b * np.sin(ref + grid)
        inside = np.abs(grid[(lower <= value) & (value <= upper)])
        found = library.ik_feasible(*reals(ref, mean, a, b, lower, upper))
        assert abs(found - ref) == pytest.approx(inside.min() if len(inside) else 0.0, abs=4e-4)


def test_the_task_error_and_its_jacobian(turning):
    library, found = turning
    chain, rng = found.chain, RNG(7)
    q, other = rng.uniform(-2, 2, (2, 6))
    T = np.ascontiguousarray(chain.forward(other))
    e, J = np.zeros(6), np.zeros((6, 6))
    cost = library.ik_error(pointer(T), pointer(q), pointer(e), pointer(J), UNSIGNED(0b100))
    expected = chain.jacobian(q)
    expected[:3] /= chain.reach
    expected[:, 2] = 0.0  # this joint is held
    np.testing.assert_allclose(J, expected, atol=1e-14)
    F = chain.forward(q)
    np.testing.assert_allclose(e[:3], (T - F)[:3, 3] / chain.reach, atol=1e-14)
    angle = np.linalg.norm(e[3:])
    K = np.cross(np.eye(3), e[3:] / angle)  # K x = axis x x
    turned = np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K  # Rodrigues
    np.testing.assert_allclose(turned @ F[:3, :3], T[:3, :3], atol=1e-12)
    assert cost == pytest.approx(e @ e)


def test_refinement(turning):
    """Its step is the damped least-squares one; from nearby it meets the target to rounding."""
    library, found = turning
    rng = RNG(8)
    J, e, d = rng.normal(size=(6, 6)), rng.normal(size=6), np.zeros(6)
    library.ik_step(pointer(J.copy()), pointer(e), REAL(0.3), pointer(d))
    stacked = np.vstack([J, 0.3 * np.eye(6)])
    np.testing.assert_allclose(d, np.linalg.lstsq(stacked, [*e, *np.zeros(6)], rcond=None)[0], rtol=1e-10)
    q = rng.uniform(-1, 1, 6)
    T, x = np.ascontiguousarray(found.chain.forward(q)), q + 1e-3
    assert library.ik_refine(pointer(T), pointer(x), INT(12), REAL(0.01), UNSIGNED(0)) < 1e-26
    assert np.abs(found.chain.forward(x) - T).max() < 1e-13


def test_turns_limits_and_order_of_rows(turning):
    library, _ = turning
    low, high = (np.array([(-1e30, 1e30)[side] if x[side] is None else x[side] for x in LIMITS[:6]]) for side in (0, 1))
    turns = 2 * pi * np.arange(-3, 4)[:, None]
    inside = 0
    for q in RNG(9).uniform(-9, 9, (100, 6)):
        x = q.copy()
        fits = library.ik_place(pointer(x), None)
        can = np.any((low <= q + turns) & (q + turns <= high), axis=0)
        assert fits == can.all()
        assert np.all((low - 1e-9 <= x) & (x <= high + 1e-9) | ~can)
        np.testing.assert_allclose(np.exp(1j * x), np.exp(1j * q))
        inside += fits
    assert 0 < inside < 100
    a, b = RNG(10).uniform(-9, 9, (2, 6))
    assert library.ik_apart(pointer(a), pointer(b)) == pytest.approx(np.abs(np.angle(np.exp(1j * (a - b)))).max())


def test_targets_are_checked_and_repaired(turning):
    library, found = turning
    T = np.ascontiguousarray(found.chain.forward(np.full(6, 0.4)))
    out = np.zeros(16)
    library.ik_accuracy.restype = REAL

    def check(target) -> int:
        return library.ik_check(pointer(np.ascontiguousarray(target)), None, pointer(out))

    assert check(T) == 0
    assert check(T + np.diag([np.nan, 0, 0, 0])) == 3
    mirrored = T * np.array([-1.0, 1, 1, 1])
    assert check(mirrored) == 4
    assert check(T * 1.01) == 4
    rough = np.ascontiguousarray(T + 1e-8 * RNG(11).normal(size=(4, 4)))
    assert check(rough) == 0
    R = out.reshape(4, 4)[:3, :3]
    assert np.abs(R.T @ R - np.eye(3)).max() < 1e-14
    assert 1e-9 < library.ik_accuracy(pointer(rough)) < 1e-6
    assert 0 < library.ik_accuracy(pointer(T)) < 1e-12
    assert library.ik_far(pointer(T.ravel())) == 0
    assert library.ik_far(pointer(T.ravel() * 1e9)) == 1


# -- the elimination for six joints ------------------------------------------------------------------------------------


# -- joints left open, and the public functions -----------------------------------------------------------------------

NO_CANDIDATES = """
int ik_branches(const REAL *T, const REAL *ref LOCK_PARAMETER, REAL slack, REAL least BAND_PARAMETER, ik_solutions *found, int *stage)
{
    (void)T; (void)ref; (void)slack; (void)least; (void)found;
    *stage = 1;
    return 0;
}
"""  # noqa: E501


@pytest.fixture(scope="module")
def searching(tmp_path_factory):
    """All that surrounds the candidates, of which there are none: what remains is descent."""
    folder = tmp_path_factory.mktemp("searching")
    spec = arm("puma")
    names = [*prepare(folder, spec)]
    library = build(folder, names, NO_CANDIDATES)
    library.ik_outside.restype = REAL
    library.ik_clamped.restype = REAL
    library.ik_reason.restype = ctypes.c_char_p
    return library, plan(spec)


class FewRows(ctypes.Structure):
    """``ik_solutions`` of a Puma."""

    _fields_ = (
        ("count", INT),
        ("stage", INT),
        ("distance", REAL),
        ("q", REAL * 6 * 8),
        ("flags", UNSIGNED * 8),
        ("branch", UNSIGNED * 8),
        ("residual", REAL * 8),
    )


def test_descent_finds_what_no_branch_lists(searching):
    library, found = searching
    q = np.array([0.3, 0.5, -0.4, 0.2, 0.6, -0.3])
    T, answer = np.ascontiguousarray(found.chain.forward(q)), FewRows()
    assert library.robot_inverse_kinematics(pointer(T), pointer(q + 0.05), UNSIGNED(0), ctypes.byref(answer)) == 0
    assert answer.count >= 1
    assert np.abs(np.array(answer.q[0]) - q).max() < 1e-6
    T[0, 3] += 20.0
    status = library.robot_inverse_kinematics(pointer(T), pointer(q), UNSIGNED(0), ctypes.byref(answer))
    assert (status, answer.count, answer.stage) == (1, 0, 1)
    assert answer.distance > 15.0
    assert b"shoulder equation" in library.ik_reason(answer.stage)


def test_how_far_a_row_is_outside_its_limits(searching):
    library, _ = searching
    low, high = (
        np.array([(-np.inf, np.inf)[side] if x[side] is None else x[side] for x in LIMITS[:6]]) for side in (0, 1)
    )
    turns = 2 * pi * np.arange(-4, 5)[:, None]
    for q in RNG(14).uniform(-9, 9, (50, 6)):
        out = np.maximum(np.maximum(low - q - turns, q + turns - high), 0.0).min(axis=0)
        assert library.ik_outside(pointer(q), REAL(0.0)) == pytest.approx(out.max(), abs=1e-12)
        for j, x in enumerate(q):
            assert library.ik_clamped(REAL(x), INT(j)) == np.clip(x, low[j], high[j])


def test_a_joint_on_a_common_axis_is_found_loose(searching):
    """A Puma with its wrist stretched: joints 4 and 6 turn about one axis, so that only their sum is decided."""
    library, found = searching
    q = np.array([0.3, 0.5, -0.4, 0.2, 0.0, -0.3])
    T, answer = np.ascontiguousarray(found.chain.forward(q)), FewRows()
    answer.q[0][:] = q
    answer.flags[0] = 256 << 3
    assert library.ik_loose(pointer(T), REAL(1e-13), ctypes.byref(answer), INT(0)) == 1 << 3
    assert library.ik_shift(pointer(T), pointer(q), INT(3), pointer(q + 0.4)) == 1
    np.testing.assert_allclose(found.chain.forward(q), T, atol=1e-12)
    q[4] = 0.5
    T = np.ascontiguousarray(found.chain.forward(q))
    answer.q[0][:], answer.flags[0] = q, 256 << 3
    assert library.ik_loose(pointer(T), REAL(1e-13), ctypes.byref(answer), INT(0)) == 0


# -- the step from a kernel to the code of a robot ---------------------------------------------------------------------

SETTINGS = KernelSettings(
    options={"WIDE": True, "DEEP": False},
    words={"REAL": "arm_real", "SQRT": "sqrtf", "FREE": "2u", "EXTRA": ", 0u", "FIRST": "T,", "NOTHING": ""},
    prefixes={"ik_": "arm_ik_", "IK_": "ARM_IK_"},
)


@pytest.mark.parametrize(
    ("text", "becomes"),
    [
        ("(REAL)1e-3 * SQRT(x)", "(arm_real)1e-3 * sqrtf(x)"),
        ("f(\"REAL SQRT FREE ik_x\", 'R')", "f(\"REAL SQRT FREE ik_x\", 'R')"),
        ("/* the REAL `ik_x` */ ik_x(IK_Y) // FREE", "/* the REAL `ik_x` */ arm_ik_x(ARM_IK_Y) // FREE"),
        ('"a \\" REAL" REAL', '"a \\" REAL" arm_real'),
        ("REALM myREAL 0xFREE 1.FREE", "REALM myREAL 0xFREE 1.FREE"),
        ("f(x EXTRA)", "f(x, 0u)"),
        ("f(FIRST x NOTHING)", "f(T, x)"),
        ("f(NOTHING x)", "f(x)"),
        ("#if WIDE\na\n#else\nb\n#endif\nc\n", "a\nc\n"),
        ("#if WIDE && DEEP || !WIDE\na\n#else\nb\n#endif\n", "b\n"),
        ("#if DEEP\n#if defined(X)\na\n#endif\n#else\nb\n#endif\n", "b\n"),
        ("#if defined(X)\n#if WIDE\na\n#endif\n#else\nb\n#endif\n", "#if defined(X)\na\n#else\nb\n#endif\n"),
    ],
)
def test_what_the_step_replaces(text, becomes):
    assert specialize(text, SETTINGS) == becomes


@pytest.mark.parametrize("text", ["#if WIDE\na\n", "#endif\n", "#if WIDE\n#elif DEEP\n#endif\n"])
def test_conditions_that_do_not_match_are_a_fault(text):
    with pytest.raises(InternalError):
        specialize(text, SETTINGS)


NAMES = ("FREE", "REAL", "SQRT", "ROWS", "ik_root", "IK_FREE")


def test_joints_called_like_words_keep_their_names_in_every_message():
    """In the reasons, which are strings; and the robot may be called like one."""
    spec = robot("puma")
    joints = tuple(replace(joint, name=name) for joint, name in zip(spec.joints, NAMES, strict=True))
    spec = replace(spec, name="real", joints=joints)
    for real in ("double", "float"):
        text = sources(spec, real)["real_ik.c"]
        texts = [line for line in text.splitlines() if "equation of" in line]
        assert len(texts) >= 2
        for line in texts:
            assert any(f"equation of {name} has" in line for name in NAMES), line


TWO_SLIDES = """\
schema: rrrgen/1
name: two_slides
convention: standard
units: {angle: rad, length: m}
gravity: [0, 0, -9.81]
joints:
  - {type: prismatic, alpha: -pi/2, a: -0.25, d: -0.34, theta: 0}
  - {type: prismatic, alpha: pi/2, a: 0.1, d: 0.348, theta: 0}
  - {type: revolute, alpha: 0, a: 0, d: 0.1, theta: 0}
tool: {rotation: [[0, 0, 1], [0, -1, 0], [1, 0, 0]]}
"""
"""Its wrist has one real axis, which is turned by pi in no solution."""


@pytest.mark.skipif(shutil.which("clang") is None, reason="needs clang, which warns of unused static functions")
def test_no_function_of_a_kernel_is_unused(tmp_path):
    file = tmp_path / "two_slides.yaml"
    file.write_text(TWO_SLIDES, encoding="utf-8")
    assert rrrgen(["generate", str(file), "-o", str(tmp_path / "code"), "--no-casadi-files"]) == 0
    source = tmp_path / "code/two_slides_ik.c"
    assert "two_slides_ik_opposite" not in source.read_text(encoding="utf-8")
    subprocess.run(["clang", "-std=c99", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", str(source)], check=True)
