"""Angles that a target leaves open: inside the joint limits, nearest to the reference, and flagged."""

import numpy as np
import pytest

from ik.checks import FK_ERROR
from ik.robots import ROWS, make, reference
from rrrgen.runtime.inverse_kinematics import load_solver
from rrrgen.runtime.results import FREE

INSIDE = 1e-9
WRIST = [(None, None)] * 3 + [(-1.0, 1.0)] * 3
NARROW = [(-0.5, 0.5), (-3, 3), (-3, 3), (-1.5, 1.5), (-1.5, 1.5), (-1.5, 1.5)]
UR = [(-3, 3), (-1.5, 1.5), (-1.5, 1.5), (-1.5, 1.5), (-3, 3), (-1, 1)]
OTHER_TURN = [(-1.0, 1.0), (None, None), (None, None), (-7.0, -5.5), (None, None), (2.0, None)]


def wrapped(x):
    return np.mod(x + np.pi, 2 * np.pi) - np.pi


def bounds(limits):
    low = np.array([-np.inf if a is None else a for a, _ in limits])
    high = np.array([np.inf if b is None else b for _, b in limits])
    return low, high


def drawn(limits, N, seed):
    low, high = bounds(limits)
    low = np.where(np.isinf(low), np.where(np.isinf(high), -np.pi, high - np.pi), low)
    high = np.where(np.isinf(high), low + np.pi, high)
    return np.random.default_rng(seed).uniform(low, high, (N, len(limits)))


def check(solver, rows, limits, q):
    """Rows come, inside the limits and exact; with the configuration as reference it is among them."""
    low, high = bounds(limits)
    T = reference(rows, q)[0]
    for ref in (None, q):
        answer = solver.solve(T, ref)
        assert len(answer) >= 1, q
        assert np.abs(reference(rows, answer.q) - T).max() <= FK_ERROR
        assert np.all((answer.q >= low - INSIDE) & (answer.q <= high + INSIDE))
    away = np.abs(answer.q - q).max(axis=1)
    assert away.min() < 1e-6
    assert answer.flags[away.argmin()] & FREE
    return T


@pytest.mark.parametrize("name", ["puma", "kr6", "stanford"])
@pytest.mark.parametrize("limits", [WRIST, OTHER_TURN], ids=["narrow", "other turn"])
def test_aligned_wrist_inside_limits(name, limits):
    solver = load_solver(make(f"{name}limited", ROWS[name], limits=limits))
    for q in drawn(limits, 30, 5):
        q[4] = 0.0
        check(solver, ROWS[name], limits, q)


def test_the_nearest_free_angle_inside_the_limits_is_taken():
    """Of the interval in which joints 4 and 6 are inside, against a scan of it."""
    solver = load_solver(make("pumalimited", ROWS["puma"], limits=WRIST))
    rng, moved = np.random.default_rng(2), 0
    for q in drawn(WRIST, 60, 6):
        q[4] = 0.0
        T, ref = reference(ROWS["puma"], q)[0], rng.uniform(-2, 2, 6)
        answer = solver.solve(T, ref)
        free = answer.q[(answer.flags & FREE) != 0]
        mine = free[np.abs(wrapped(free[:, :3] - q[:3])).max(axis=1) < 1e-6]
        assert len(mine) == 1
        t = np.linspace(-1, 1, 20001)
        allowed = t[np.abs(wrapped(q[3] + q[5] - t)) <= 1.0]
        best = allowed[np.abs(allowed - ref[3]).argmin()]
        assert abs(abs(mine[0, 3] - ref[3]) - abs(best - ref[3])) < 2e-4
        moved += abs(ref[3] - np.clip(ref[3], -1, 1)) == 0 and abs(best - ref[3]) > 1e-3
    assert moved > 5  # joint 6 alone made joint 4 leave its reference


def on_first_axis(rows, q):
    """``q`` with joint 2 such that the wrist's centre lies on axis 1, if there is such a value."""
    from scipy.optimize import brentq

    def x(value):
        return reference(rows[:4], [0.0, value, *q[2:4]])[0][0, 3]

    grid = np.linspace(-2, 2, 21)
    signs = np.sign([x(value) for value in grid])
    k = int(np.argmax(signs[1:] * signs[:-1] < 0))
    return (
        np.array([q[0], brentq(x, grid[k], grid[k + 1], xtol=1e-16), *q[2:]]) if signs[k] * signs[k + 1] < 0 else None
    )


def test_shoulder_on_the_first_axis_inside_limits():
    """Joint 1 is free and all of the wrist moves with it: no interval in closed form."""
    solver = load_solver(make("irb120limited", ROWS["irb120"], limits=NARROW))
    found = [on_first_axis(ROWS["irb120"], q) for q in drawn(NARROW, 40, 8)]
    inside = [q for q in found if q is not None]
    assert len(inside) > 12
    for q in inside:
        check(solver, ROWS["irb120"], NARROW, q)


def test_aligned_wrist_of_an_arm_with_parallel_axes_inside_limits():
    solver = load_solver(make("ur5limited", ROWS["ur5"], limits=UR))
    for q in drawn(UR, 25, 9):
        q[4] = 0.0
        check(solver, ROWS["ur5"], UR, q)


@pytest.mark.parametrize("noise", [0.0, 1e-12])
def test_an_angle_that_the_target_does_not_decide_is_flagged(noise):
    """|q5| from 1e-16 to 1e-6, the elbow sometimes straight, and numbers as accurate as a printed pose."""
    solver, rng, rows = load_solver(make("puma", ROWS["puma"])), np.random.default_rng(10), ROWS["puma"]
    stretched = np.arctan2(0.0203, 0.4318) - np.pi / 2
    for k in range(250):
        q = rng.uniform(-np.pi, np.pi, 6)
        q[4] = rng.choice([-1, 1]) * 10 ** rng.uniform(-16, -6)
        q[2] = stretched + rng.choice([0, 1e-9, 1e-6]) if k % 4 == 0 else q[2]
        T = reference(rows, q)[0]
        T[:3] += noise * rng.uniform(-1, 1, (3, 4))
        answer = solver.solve(T, q, limits=False)
        apart = np.abs(wrapped(answer.q - q))
        same_arm = apart[:, :3].max(axis=1) < 1e-7
        bold = same_arm & (answer.flags & FREE == 0) & (np.abs(np.sin(answer.q[:, 4])) < 1e-5)
        assert not bold.any() or apart[bold, 3].min() < 0.1, (k, q)
        assert apart.max(axis=1).min() < 0.02, (k, q)  # the reference itself meets the target


def test_an_angle_that_the_target_decides_is_not_flagged():
    """Decided: the smallest singular value of the Jacobian is far above the rounding of the pose over 0.01 rad."""
    solver, rng = load_solver(make("puma", ROWS["puma"])), np.random.default_rng(11)
    decided = 0
    for q in rng.uniform(-np.pi, np.pi, (60, 6)):
        q[4] = 10 ** rng.uniform(-9, -5)
        answer = solver.solve(reference(ROWS["puma"], q)[0], q, limits=False)
        away = np.abs(wrapped(answer.q - q)).max(axis=1)
        sharpness = np.linalg.svd(solver.plan.chain.jacobian(q), compute_uv=False)[5]
        assert away.min() < 1e-14 / sharpness + 1e-8
        if sharpness > 1e-11:
            decided += 1
            assert not answer.flags[away.argmin()] & FREE
    assert decided > 50


@pytest.mark.parametrize("backend", ["c", "numpy"])
@pytest.mark.parametrize("joint", [1, 5])
def test_a_prescribed_arm_angle_decides_joints_beside_a_singular_configuration(backend, joint):
    """Beside it, and not only far from it, all eight rows come; in it one row stands for a continuum."""
    solver = load_solver(make("iiwa14", ROWS["iiwa14"]), backend=backend)
    for away in (0.0, 1e-8, 1e-6, 5e-6, 1e-5, 3e-5):
        for q in np.random.default_rng(4).uniform(-2, 2, (3, 7)):
            q[joint] = away
            T = reference(ROWS["iiwa14"], q)[0]
            answer = solver.solve(T, q, limits=False)
            assert np.abs(reference(ROWS["iiwa14"], answer.q) - T).max() <= FK_ERROR
            assert np.abs(wrapped(answer.q - q)).max(axis=1).min() < 1e-6
            assert bool(np.any(answer.flags & FREE)) == (away == 0.0), (away, q)
            assert len(answer) == (4 if away == 0.0 else 8)
