"""Inverse kinematics where joints follow others: every configuration of the drives that reaches a pose."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rrrgen.errors import DerivationError
from rrrgen.robotfile import load_spec, loads_spec
from rrrgen.runtime.inverse_kinematics import load_solver
from rrrgen.verify.references.chain import chain_of
from rrrgen.verify.references.newton_euler import NewtonEuler

PALLETISER = Path(__file__).resolve().parents[2] / "examples" / "palletiser" / "robot.yaml"

GEARED = """\
schema: rrrgen/1
name: geared
convention: standard
units: {angle: deg, length: m}
gravity: [0, 0, -9.81]
joints:
  - {name: q1, type: revolute, alpha: 90, a: 0, d: 0.5, follows: {q1: 1/2}}
  - {name: q2, type: revolute, alpha: 0, a: 0.4, d: 0.1, follows: {q2: 2/3}}
  - {name: q3, type: revolute, alpha: 0, a: 0.3, d: 0, follows: {q3: 1, q2: 1/3}, limits: {lower: -400, upper: 400}}
"""


def poses(spec, q):
    return NewtonEuler(chain_of(spec), np.zeros((len(spec.rows), 10))).forward_kinematics(q)


def apart(a, b, periods):
    return np.abs(np.remainder(a - b + np.array(periods) / 2, periods) - np.array(periods) / 2).max()


def test_every_configuration_of_the_palletiser_is_found():
    spec = load_spec(PALLETISER)
    solver = load_solver(spec, backend="numpy")
    assert solver.n == 4
    q = np.random.default_rng(2).uniform(-3, 3, (40, 4))
    goals = poses(spec, q)
    found = solver.solve_batch(goals, limits=False)
    for own, goal, rows, count in zip(q, goals, found.q, found.counts, strict=True):
        assert np.abs(poses(spec, rows[:count]) - goal).max() < 1e-12
        assert min(apart(own, row, [2 * np.pi] * 4) for row in rows[:count]) < 1e-9
    assert set(found.counts.tolist()) <= {2, 4}
    tilted = goals[0].copy()
    tilted[:3, :3] = tilted[:3, :3] @ [[1, 0, 0], [0, 0.8, -0.6], [0, 0.6, 0.8]]
    assert solver.solve(tilted).status == "unreachable"


def test_limits_of_followers_count():
    """The forearm may be between -75 and 65 degrees against the upper arm: that is no limit of one drive."""
    spec = load_spec(PALLETISER)
    solver = load_solver(spec, backend="numpy")
    inside, outside = np.radians([20, 10, 40, 5]), np.radians([20, -35, 40, 5])
    goals = poses(spec, np.array([inside, outside]))
    assert apart(solver.solve(goals[0]).q[0], inside, [2 * np.pi] * 4) < 1e-9
    assert solver.solve(goals[1]).status == "outside limits"
    flagged = solver.solve(goals[1], limits=False)
    assert len(flagged)
    assert all(flagged.flags & 4)


def test_drives_behind_gears_have_one_configuration_for_every_full_turn_of_the_joints():
    spec = loads_spec(GEARED)
    solver = load_solver(spec, backend="numpy")
    q = np.random.default_rng(4).uniform(-6, 6, (10, 3))
    goals = poses(spec, q)
    periods = [4 * np.pi, 6 * np.pi, 2 * np.pi]
    found = solver.solve_batch(goals, limits=False)
    for own, goal, rows, count in zip(q, goals, found.q, found.counts, strict=True):
        rows = rows[:count]
        assert np.abs(poses(spec, rows)[:, :3, 3] - goal[:3, 3]).max() < 1e-12
        assert min(apart(own, row, periods) for row in rows) < 1e-9
        assert min(apart(a, b, periods) for i, a in enumerate(rows) for b in rows[:i]) > 1e-3
    near = solver.solve(goals[0], q_ref=q[0], sort="nearest", limits=False)
    assert np.abs(near.q[0] - q[0]).max() < 1e-9


def test_what_does_not_determine_q_is_refused_with_the_reason():
    text = PALLETISER.read_text(encoding="utf-8").replace("tip: turn", "tip: shoulder")
    with pytest.raises(DerivationError, match="elbow, turn do not move the tip"):
        load_solver(loads_spec(text), backend="numpy")
