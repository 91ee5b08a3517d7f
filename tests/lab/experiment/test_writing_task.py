"""The writing task: geometry of the letters, smoothness of the motion, and the joint motion against closed forms."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oracles import newton_euler
from oracles.chapter14 import fk_1444, ik_1445_complete, rrr
from rrrgen.base.errors import DerivationError, InputError
from rrrgen.lab.experiment.writing_task import (
    LETTERS,
    JointPath,
    W,
    WritingPlane,
    follow_branch,
    newton_inverse_kinematics,
    text_path,
    writing_task,
)

START = np.array([-1.0, -1.5, 2.0])  # elbow down, near Fig. 14.6


class ChapterArm:
    """(14.44) with the oracle's Jacobian, as the writing task sees a model."""

    robot = rrr()
    n = 3

    def forward_kinematics(self, q):
        T = np.eye(4)
        T[:3, 3] = fk_1444(q)
        return T

    def jacobian(self, q):
        q = np.asarray(q)
        if q.ndim == 1:
            return newton_euler.jacobian(self.robot, q)
        return np.array([newton_euler.jacobian(self.robot, row) for row in q])

    def jacobian_dot_dq(self, q, dq):
        return np.array([newton_euler.jacobian_dot_dq(self.robot, a, b) for a, b in zip(q, dq, strict=True)])


@pytest.fixture(scope="module")
def task():
    return writing_task("RRR", pace=(1.0, 0.55))


def test_strokes_hang_together_inside_the_box() -> None:
    for letter, strokes in LETTERS.items():
        for stroke in strokes:
            for one, other in pairwise(stroke):
                assert math.dist(one.end, other.start) < 1e-9, letter
            for segment in stroke:
                points, tangent, _ = segment.frame(np.linspace(0, segment.length, 50))
                assert np.allclose(points[0], segment.start, atol=1e-12)
                assert np.allclose(points[-1], segment.end, atol=1e-12)
                assert np.allclose(np.linalg.norm(tangent, axis=1), 1.0)
                assert points.min() > -0.01
                assert points[:, 0].max() < W + 0.01
                assert points[:, 1].max() < 1.01


@given(st.text(alphabet=[*sorted(LETTERS), " "], min_size=1, max_size=8))
def test_any_text_fits_its_box_in_one_connected_path(text: str) -> None:
    if not text.strip():
        return
    path = text_path(text, (-0.2, 0.4), (0.4, 0.3))
    for (one, _), (other, _) in pairwise(path):
        assert math.dist(one.end, other.start) < 1e-9
    points = np.vstack([segment.frame(np.linspace(0, segment.length, 30))[0] for segment, _ in path])
    assert points[:, 0].min() > -0.2 - 0.005
    assert points[:, 0].max() < 0.2 + 0.005
    assert points[:, 1].min() > 0.4 - 0.005
    assert points[:, 1].max() < 0.7 + 0.005


def test_task_keeps_to_the_window_the_time_and_the_speed_of_the_chapter(task) -> None:
    t = np.linspace(0, 10, 20_001)
    position, velocity, _ = task.evaluate(t)
    assert task.duration == pytest.approx(10.0, rel=1e-12)
    assert position[:, 0].min() >= -0.25
    assert position[:, 0].max() <= 0.25
    assert position[:, 2].min() >= 0.35
    assert position[:, 2].max() <= 0.85
    assert np.all(position[:, 1] == -0.4)
    speed = task.speed(t)
    assert np.allclose(speed, np.hypot(velocity[:, 0], velocity[:, 2]))
    assert speed.max() <= 0.7
    assert speed.max() == pytest.approx(task.peak_speed, rel=1e-4)
    assert speed.max() > 0.65  # up to 0.7 m/s
    peaks = [2 * s.length / T for s, T in zip(task.segments, task.durations, strict=True)]
    assert min(peaks) < 0.4 * max(peaks)  # slow and fast phases


def test_motion_is_twice_continuously_differentiable(task) -> None:
    h = 1e-5
    t = np.arange(0.0, 10.0, 7.3e-3)[1:-1]
    before, now, after = (task.evaluate(t + d) for d in (-h, 0.0, h))
    scale = [np.abs(part).max() for part in now]
    assert np.abs((after[0] - before[0]) / (2 * h) - now[1]).max() < 1e-6 * scale[1]
    assert np.abs((after[1] - before[1]) / (2 * h) - now[2]).max() < 1e-3 * scale[2]
    ends = np.cumsum(task.durations)
    for part in task.evaluate(ends)[1:]:
        assert np.abs(part).max() < 1e-9  # at rest where direction or curvature jumps
    fine = task.evaluate(np.arange(0.0, 10.0, 1e-4))[2]
    assert np.abs(np.diff(fine, axis=0)).max() < 0.02 * scale[2]  # no steps in the acceleration
    outside = task.evaluate(np.array([-1.0, 11.0]))
    assert np.allclose(outside[1], 0.0)
    assert np.allclose(outside[0][1, [0, 2]], task.segments[-1].end)


def test_newton_follows_the_closed_form_solution(task) -> None:
    arm = ChapterArm()
    t = np.arange(0.0, 10.0, 0.02)
    position = task.evaluate(t)[0]
    q = newton_inverse_kinematics(arm, START)(position)
    solutions = np.array([ik_1445_complete(p) for p in position])
    closed = follow_branch(solutions, np.ones(solutions.shape[:2], bool), START)
    assert solutions.shape == (500, 4, 3)
    assert np.abs(q - closed).max() < 1e-10
    assert np.abs(np.diff(closed, axis=0)).max() < 0.2
    assert closed.min() > -2.3
    assert closed.max() < 2.5
    reached = np.array([fk_1444(row) for row in closed])
    assert np.abs(reached - position).max() < 1e-12


def test_joint_path_moves_the_tip_as_the_task_says(task) -> None:
    arm = ChapterArm()
    path = JointPath(task, arm, newton_inverse_kinematics(arm, START))
    t = np.linspace(1.0, 1.3, 301)
    q, dq, ddq = path.evaluate(t)
    h = t[1] - t[0]
    assert np.abs((q[2:] - q[:-2]) / (2 * h) - dq[1:-1]).max() < 1e-4 * np.abs(dq).max()
    assert np.abs((dq[2:] - dq[:-2]) / (2 * h) - ddq[1:-1]).max() < 1e-3 * np.abs(ddq).max()


def test_branches_are_unwound_and_faults_named(task) -> None:
    angles = np.linspace(3.0, 3.5, 20)
    wrapped = (angles + np.pi) % (2 * np.pi) - np.pi
    solutions = np.stack([wrapped, wrapped + 1.0], axis=1)[:, :, None]
    assert np.allclose(follow_branch(solutions, np.ones((20, 2), bool))[:, 0], angles)
    slid = follow_branch(solutions, np.ones((20, 2), bool), revolute=[False])
    assert not np.allclose(slid[:, 0], angles)
    valid = np.ones((20, 2), bool)
    valid[7] = False
    with pytest.raises(DerivationError, match="point 7"):
        follow_branch(solutions, valid)
    far = writing_task("I", plane=WritingPlane(y=-3.0))
    with pytest.raises(DerivationError, match=r"no joint position .* no nearer than [12]\.\d+ m"):
        newton_inverse_kinematics(ChapterArm(), START)(far.evaluate(np.zeros(1))[0])


def test_what_cannot_be_written_is_refused() -> None:
    with pytest.raises(InputError, match="letters"):
        writing_task("R2D2")
    with pytest.raises(InputError, match="empty"):
        writing_task("  ")
    with pytest.raises(InputError, match="give it"):
        writing_task("RRR", duration=2.0)
    with pytest.raises(InputError, match="window"):
        WritingPlane(x=(0.2, 0.1))
    with pytest.raises(InputError, match="pace"):
        writing_task("RRR", pace=(0.0,))


@pytest.mark.parametrize("far", [1e40, math.inf, math.nan])
def test_a_window_beyond_any_reach_is_refused(far):
    with pytest.raises(InputError, match=r"the writing window (reaches|needs)"):
        WritingPlane(z=(0.35, far))
