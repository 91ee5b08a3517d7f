"""Targets that cannot be reached, and numbers that are not targets: a reason, a distance, never a row and never NaN."""

from math import cos, sin

import numpy as np
import pytest

from ik.checks import FK_ERROR
from ik.robots import ROWS, reference, robot
from rrrgen.base.errors import DerivationError, InputError
from rrrgen.ik.solutions.general_6r import longest_span, tables_of
from rrrgen.runtime.inverse_kinematics import load_solver
from rrrgen.runtime.results import INEXACT

ACCEPTED = 6e-13
"""A target out of reach by less than the row check (4e-13 of the reach, here 1.35 m) counts as reachable."""


@pytest.mark.parametrize("offset", [10.0**-k for k in range(3, 16)])
@pytest.mark.parametrize("side", [1, -1])
def test_boundary_of_the_reference_robot(offset, side):
    """Pushed along the stretched arm by ``offset``: inside it is reached, outside the distance is what was pushed."""
    solver = load_solver(robot("rrr"))
    rng = np.random.default_rng(0)
    for _ in range(20):
        q = np.append(rng.uniform(-3, 3, 2), 0.0)
        T = reference(ROWS["rrr"], q)[0]
        p = T[:3, 3] + side * offset * T[:3, 0]
        result = solver.solve(p)
        if side < 0 or offset < ACCEPTED / 2:
            assert len(result) >= 1
            assert np.abs(reference(ROWS["rrr"], result.q)[:, :3, 3] - p).max() <= FK_ERROR
        elif offset > 4 * ACCEPTED:
            assert len(result) == 0
            assert result.status == "unreachable"
            assert "elbow" in result.reason or "shoulder" in result.reason
            assert 0.2 * offset < result.distance <= offset * (1 + 1e-6)  # the wall may be nearer in another direction


def test_distance_is_the_distance_to_the_reachable_set():
    solver = load_solver(robot("rrr"))
    rng = np.random.default_rng(2)
    cloud = reference(ROWS["rrr"], rng.uniform(-np.pi, np.pi, (200_000, 3)))[:, :3, 3]
    for p in ([0.0, 0.1, 0.5], [1.5, 0.0, 0.0], [0.3, 0.3, 1.4], [0.2591, 0.0, 0.61], [0.0, 0.0, 0.0]):
        result = solver.solve(p)
        sampled = np.linalg.norm(cloud - p, axis=1).min()
        assert len(result) == 0
        assert result.distance <= sampled + 1e-9
        assert result.distance == pytest.approx(sampled, abs=0.01)  # the cloud is dense to about a centimetre
        nearest = solver.closest(p)
        assert len(nearest) == 1
        assert nearest.flags[0] & INEXACT
        reached = reference(ROWS["rrr"], nearest.q)[0, :3, 3]
        assert np.linalg.norm(reached - p) == pytest.approx(result.distance, rel=1e-6)


@pytest.mark.parametrize("name", ["rrr", "puma", "ur5", "stanford", "scara", "iiwa14"])
def test_numbers_that_are_no_target(name):
    solver, n = load_solver(robot(name)), len(ROWS[name])
    position = solver.plan.task == "position"
    given = {"redundancy": 0.3} if solver.plan.locked is not None else {}
    T = reference(ROWS[name], np.full(n, 0.3))[0]
    for bad in (np.nan, np.inf, -np.inf):
        for place in ((0, 3), (2, 3)) if position else ((0, 0), (1, 2), (2, 3)):
            wrong = T.copy()
            wrong[place] = bad
            for ask in (solver.solve, solver.closest):
                answer = ask(wrong, **given)
                assert len(answer) == 0
                assert answer.status == "not finite"
        answer = solver.solve(T, np.full(n, bad), **given)
        assert answer.status == "not finite"
    for huge in (1e160, -1e308):  # sums and distances of such references overflow
        assert solver.solve(T, np.full(n, huge), limits=False, **given).status == "not finite"
        assert np.isfinite(solver.solve(T, np.full(n, huge / 1e154), limits=False, **given).q).all()
    far = T.copy()
    far[0, 3] = 1e300
    assert len(solver.solve(far, **given)) == 0
    assert solver.solve(far, **given).status == "unreachable"
    if not position:
        for factors in ([2, 2, 2, 1.0], [0, 0, 0, 1.0], [1, 1, -1, 1.0]):
            wrong = T @ np.diag(factors)
            assert solver.solve(wrong, **given).status == "not a rotation"
        noise = np.random.default_rng(1).standard_normal((3, 3))
        shaken = T.copy()
        shaken[:3, :3] += 1e-6 * noise
        assert solver.solve(shaken, **given).status == "not a rotation"
        shaken[:3, :3] = T[:3, :3] + 1e-9 * noise  # printed with nine digits: repaired
        answer = solver.solve(shaken, residual=True, **given)  # four joints cannot follow a tilt of 1e-9
        assert len(answer) >= 1
        assert np.abs(reference(ROWS[name], answer.q) - T).max() < 1e-8


@pytest.mark.parametrize("name", ["puma", "ur5", "kr6", "stanford"])
def test_far_poses_have_a_reason_and_a_nearest_configuration(name):
    solver = load_solver(robot(name))
    rng = np.random.default_rng(0)
    for _ in range(5):
        T = reference(ROWS[name], rng.uniform(-1, 1, 6))[0]
        T[:3, 3] += 10.0 * T[:3, 3] / np.linalg.norm(T[:3, 3])
        result = solver.solve(T)
        if name == "stanford":  # its third joint has no end here
            assert result.status in ("ok", "unreachable")
            continue
        assert (len(result), result.status) == (0, "unreachable")
        assert result.reason
        nearest = solver.closest(T)
        assert nearest.distance == pytest.approx(result.distance, rel=1e-3)
        reached = reference(ROWS[name], nearest.q)[0]
        assert np.linalg.norm(reached[:3, 3] - T[:3, 3]) <= result.distance * (1 + 1e-9)


def test_the_span_of_general_arms_is_the_longest_there_is():
    """The distance between a point of axis 1 and one of axis 6 never exceeds the bound, and nearly meets it."""
    for seed in range(12):
        rng = np.random.default_rng(seed)
        alpha = rng.choice([0.0, np.pi / 2, -np.pi / 2, 0.9, 1e-12], 6) if seed % 2 else rng.uniform(-np.pi, np.pi, 6)
        a, d = rng.uniform(-1.0, 1.0, (2, 6)) * rng.integers(0, 2, (2, 6))
        first, last, longest = longest_span(list(zip(np.cos(alpha), np.sin(alpha), a, d, strict=True)))
        rows = [("R", *row, 0.0) for row in zip(alpha, a, d, strict=True)]
        rows[5] = ("R", 0.0, 0.0, 0.0, 0.0)
        T = reference(rows, rng.uniform(-np.pi, np.pi, (100_000, 6)))
        spans = np.linalg.norm(T[:, :3, 3] + last * T[:, :3, 2] - [0.0, 0.0, first], axis=1)
        assert spans.max() <= longest
        assert spans.max() >= 0.98 * longest


@pytest.mark.sweep(but=["crx10ia-c", "crx10ia-numpy"])
@pytest.mark.parametrize("backend", ["c", "numpy"])
@pytest.mark.parametrize("name", ["crx10ia", "jaco2"])
def test_general_arms_prove_that_a_target_is_out_of_reach(name, backend):
    """Without elimination: a target 0.1 % farther away than the longest reach has no solution."""
    solver, rng = load_solver(robot(name), backend=backend), np.random.default_rng(5)
    tables = tables_of(solver.plan.solving)
    first, last, longest = (tables.length * x for x in tables.span)
    tip = np.array([*solver.plan.solving.tip, [0, 0, 0, 1]])  # behind the axis of joint 6
    for q in rng.uniform(-np.pi, np.pi, (5, 6)):
        T, away = reference(ROWS[name], q)[0], rng.normal(size=3)
        T[:3, 3] = [0.0, 0.0, first] + 1.001 * longest * away / np.linalg.norm(away) - last * T[:3, 2]
        answer = solver.solve(T @ tip, limits=False)
        assert (len(answer), answer.status) == (0, "unreachable")


def test_closest_on_a_reachable_target_is_a_solution():
    for name in ("rrr", "puma", "ur5"):
        solver = load_solver(robot(name))
        q = np.random.default_rng(3).uniform(-2, 2, len(ROWS[name]))
        T = reference(ROWS[name], q)[0]
        nearest = solver.closest(T, q)
        reached = reference(ROWS[name], nearest.q)[0]
        error = reached[:3, 3] - T[:3, 3] if solver.plan.task == "position" else reached - T
        assert np.abs(error).max() <= FK_ERROR
        assert nearest.flags[0] & INEXACT == 0


def test_constrained_arm_off_its_set():
    """A SCARA arm cannot tilt: no row, the distance says by how much, the residual rows come on request."""
    solver, angle = load_solver(robot("scara")), 0.01
    T = reference(ROWS["scara"], np.array([0.3, 0.4, 0.1, 0.2]))[0]
    tilted = T @ np.array([[1, 0, 0, 0], [0, cos(angle), -sin(angle), 0], [0, sin(angle), cos(angle), 0], [0, 0, 0, 1]])
    result = solver.solve(tilted)
    assert (len(result), result.status) == (0, "unreachable")
    assert result.distance == pytest.approx(angle * solver.plan.chain.reach, rel=1e-3)
    relaxed = solver.solve(tilted, residual=True)
    assert len(relaxed) == 2
    assert (relaxed.flags & INEXACT).all()
    assert relaxed.residual == pytest.approx(angle, rel=1e-3)


def test_wrong_shapes_are_the_callers_fault():
    solver = load_solver(robot("puma"))
    with pytest.raises(InputError, match="4, 4"):
        solver.solve(np.zeros(3))
    with pytest.raises(InputError, match="q_ref"):
        solver.solve(np.eye(4), np.zeros(5))
    with pytest.raises(DerivationError, match="no redundancy"):
        solver.sweep(np.eye(4), [0.0])
    with pytest.raises(InputError, match="redundancy"):
        load_solver(robot("panda")).solve(np.eye(4))
