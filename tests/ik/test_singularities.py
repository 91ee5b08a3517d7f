"""Singular configurations, exactly and off by 1e-15 ... 1e-3: a valid row always, no wrong one, free angles kept."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from ik.checks import FK_ERROR, SEED_ERROR, Sample, sample
from ik.robots import ROWS, h, reference, robot
from rrrgen.runtime.inverse_kinematics import load_solver
from rrrgen.runtime.results import FREE, MULTIPLE

OFFSETS = [0.0] + [s * 10.0**-k for k in range(3, 16) for s in (1, -1)]

NOISE = 1e-9
"""Round-off times a few units: an angle known to eps/sigma is accepted where sigma times its error stays below this."""


def near(rows, joint, value, N=4, seed=0) -> np.ndarray:
    """Configurations with one joint at ``value`` plus each offset, the others at random."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-3, 3, (len(OFFSETS), N, len(rows)))
    q[:, :, joint] = value + np.array(OFFSETS)[:, None]
    return np.where([r[0] == "R" for r in rows], q, 0.3 * q).reshape(-1, len(rows))


def check(name, q) -> list:
    """Solve each pose with its own configuration as reference; returns the results."""
    solver, rows = load_solver(robot(name)), ROWS[name]
    results = []
    for x in q:
        T = reference(rows, x)[0]
        given = {"redundancy": solver.parameter(x)} if solver.plan.locked is not None else {}
        result = solver.solve(T, x, limits=False, **given)
        assert len(result) >= 1, (name, x)
        assert np.isfinite(result.q).all()
        F = reference(rows, result.q)
        error = F[:, :3, 3] - T[:3, 3] if solver.plan.task == "position" else F - T
        assert np.abs(error).max() <= FK_ERROR
        results.append(result)
    return results


def seeds_found(name, q, results, solver=None) -> None:
    """The configuration itself is among the rows as sharply as the pose determines it."""
    solver = solver or load_solver(robot(name))
    view = Sample(solver, ROWS[name], q, None, None, {})
    for x, result in zip(q, results, strict=True):
        away = np.abs(result.q - x).max(axis=1).min()
        assert away < SEED_ERROR or away * view.sharpness(x) < NOISE, (name, x)


@pytest.mark.parametrize("name", ["puma", "irb6640", "irb120", "kr6", "stanford"])
@pytest.mark.parametrize("middle", [0.0, np.pi])
def test_wrist_aligned(name, middle):
    q = near(ROWS[name], 4, middle)
    results = check(name, q)
    seeds_found(name, q, results)
    for x, result in zip(q, results, strict=True):
        if x[4] == middle:
            aligned = result.q[(result.flags & FREE) != 0]
            assert len(aligned) >= 1
            assert np.abs(aligned[:, 3] - x[3]).min() < 1e-12  # the free angle stands at its reference


def elbow_extremes(name) -> list[float]:
    """Values of joint 3 at which the wrist is farthest from and nearest to the shoulder."""
    rows = ROWS[name]

    def distance(x, sign):
        q = np.zeros(6)
        q[2] = x
        return sign * float(np.linalg.norm(reference(rows[:4], q[:4])[0, :3, 3] - reference(rows[:1], q[:1])[0, :3, 3]))

    best = []
    for sign in (1, -1):
        starts = [
            minimize_scalar(distance, bounds=(a, a + 1.2), args=(sign,), method="bounded", options={"xatol": 1e-13})
            for a in np.arange(-3.2, 3.2, 0.8)
        ]
        best.append(float(min(starts, key=lambda r: r.fun).x))
    return best


@pytest.mark.parametrize("name", ["puma", "irb120", "irb6640", "kr6"])
def test_elbow_straight_and_folded(name):
    for value in elbow_extremes(name):
        q = near(ROWS[name], 2, value, N=2)
        seeds_found(name, q, check(name, q))


@pytest.mark.parametrize("value", [0.0, np.pi])
def test_reference_robot_stretched_and_folded(value):
    q = near(ROWS["rrr"], 2, value)
    results = check("rrr", q)
    seeds_found("rrr", q, results)
    for x, result in zip(q, results, strict=True):
        if x[2] == value:
            assert len(result) == 2  # in front and behind, the elbow's two merged and flagged
            assert (result.flags & MULTIPLE).all()
        elif abs(x[2] - value) > 1e-6:
            assert len(result) == 4
            assert not result.flags.any()


def test_reference_robot_shoulder():
    q = near(ROWS["rrr"], 0, 0.3)
    q[:, 1] = np.arctan2(0.415 * np.cos(q[:, 2]) + 0.2, 0.415 * np.sin(q[:, 2])) + np.repeat(OFFSETS, 4)  # rho = 0
    seeds_found("rrr", q, check("rrr", q))


@pytest.mark.parametrize("name", ["ur5", "ur10e"])
@pytest.mark.parametrize(("joint", "value"), [(2, 0.0), (2, np.pi), (4, 0.0), (4, np.pi)])
def test_ur_elbow_and_wrist(name, joint, value):
    q = near(ROWS[name], joint, value)
    seeds_found(name, q, check(name, q))


def test_ur_free_wrist_takes_an_angle_that_the_arm_can_reach():
    """With q5 = 0 joint 6 is free, but not every angle leaves the arm long enough: the reference may not do."""
    solver, rows = load_solver(robot("ur5")), ROWS["ur5"]
    rng = np.random.default_rng(4)
    moved = 0
    for _ in range(200):
        q = rng.uniform(-3, 3, 6)
        q[4] = 0.0
        q[2] = rng.uniform(-0.4, 0.4)  # nearly stretched
        T = reference(rows, q)[0]
        ref = rng.uniform(-3, 3, 6)
        result = solver.solve(T, ref, limits=False)
        assert len(result) >= 1
        assert np.abs(reference(rows, result.q) - T).max() <= FK_ERROR
        free = result.q[(result.flags & FREE) != 0]
        moved += int(len(free) > 0 and np.abs(free[:, 5] - ref[5]).min() > 1e-6)
    assert moved > 20  # the reference was often infeasible, and an answer came all the same


def test_ur_wrist_and_elbow_at_once():
    q = near(ROWS["ur5"], 4, 0.0)
    q[:, 2] = 0.0
    check("ur5", q)


@pytest.mark.parametrize(
    "name",
    ["rrr", "ortho3r", "puma", "irb6640", "irb120", "kr6", "stanford", "ur5", "ur10e", "scara", "panda", "iiwa14"],
)
@pytest.mark.sweep(but=["rrr", "puma", "ur5", "scara", "panda", "iiwa14"])
def test_round_angles(name):
    rng = np.random.default_rng(1)
    n = len(ROWS[name])
    q = rng.choice([0.0, h / 2, -h / 2, h, -h, np.pi], (80, n))
    turning = np.array([row[0] == "R" for row in ROWS[name]])
    check(name, np.vstack([np.zeros(n), np.where(turning, q, 0.2 * q)]))
    jitter = rng.choice([1e-15, -1e-12, 1e-9, 1e-7, -1e-6, 1e-4], q.shape)
    check(name, np.where(turning, q, 0.2 * q) + jitter)


def test_batch_says_the_same_as_single_calls():
    q = near(ROWS["puma"], 4, 0.0, N=1)
    solver = load_solver(robot("puma"))
    result = sample("puma", q=q, solver=solver)
    for k, x in enumerate(q):
        single = solver.solve(reference(ROWS["puma"], x)[0], limits=False)
        count = result.batch.counts[k]
        assert len(single) == count
        assert np.array_equal(single.q, result.batch.q[k, :count])
        assert np.array_equal(single.flags, result.batch.flags[k, :count])
        assert np.array_equal(single.branch, result.batch.branch[k, :count])
