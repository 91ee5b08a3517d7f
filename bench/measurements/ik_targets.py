"""Targets of the inverse kinematics for its measurements: poses of configurations, at random and at singular ones.

A record of a target has 17 numbers: the pose (4, 4), row by row, and the redundancy parameter of the configuration
behind it (0 for an arm that has none).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rrrgen.ik.classify import plan_chain
from rrrgen.ik.families import parameter
from rrrgen.ik.geometry.chain import numeric_chain
from rrrgen.ik.plan import ARM_ANGLE, SolverPlan
from rrrgen.robot.file import load_spec
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import Array, NumericRobot, chain_of

Indices = NDArray[np.intp]

GRID = 48
"""Values of a joint between which the determinant of the Jacobian is searched for a change of its sign."""

HALVINGS = 60
"""Of the interval between two such values: down to rounding."""

ELBOW, WRIST = 2, 4
"""Links of an arm with an arm angle whose frames have their origins at its elbow and its wrist."""


@dataclass(frozen=True)
class Task:
    """What the inverse kinematics of a robot solves, by the references of the verification."""

    plan: SolverPlan
    chain: NumericRobot
    model: NewtonEuler
    revolute: NDArray[np.bool_]
    reach: float

    @classmethod
    def of(cls, robot: str) -> Task:
        """The task of a bundled robot."""
        spec = load_spec(robot)
        numbers, chain = numeric_chain(spec), chain_of(spec)
        model = NewtonEuler(chain, np.zeros((spec.n, 10)))
        return cls(plan_chain(numbers), chain, model, np.asarray(chain.revolute), numbers.reach)

    @property
    def position(self) -> bool:
        """Whether the target is a position, not a pose."""
        return self.plan.task == "position"

    @property
    def arm_angle(self) -> bool:
        """Whether the redundancy parameter is the arm angle."""
        return self.plan.locked == ARM_ANGLE

    def jacobian(self, q: Array) -> Array:
        """Jacobian (N, m, n) of the task in parts of the reach; a prescribed joint has a zero column.

        With an arm angle, three rows for the position of the elbow, which pose and angle prescribe, follow.
        """
        J = self.model.jacobian(q)
        J[:, :3] /= self.reach
        if self.position:
            return J[:, :3]
        if self.arm_angle:
            return np.concatenate([J, self.model.link_jacobians(q)[:, ELBOW, :3] / self.reach], axis=1)
        if self.plan.locked is not None:
            J[:, :, self.plan.locked] = 0.0
        return J

    def apart(self, a: Array, b: Array) -> Array:
        """Differences ``b - a`` of configurations (..., n), angles in [-pi, pi)."""
        d = b - a
        return np.asarray(np.where(self.revolute, (d + np.pi) % (2 * np.pi) - np.pi, d))

    def determinant(self, q: Array) -> Array:
        """A determinant (N,) that is zero in singular configurations, of the directions in which the tip can move."""
        J = self.jacobian(q)
        if self.arm_angle:
            frames = self.model.link_frames(q)[:, :, :3, 3]
            shoulder = frames[:, 0]
            across = np.cross(frames[:, WRIST] - shoulder, frames[:, ELBOW] - shoulder)
            J = np.concatenate([J[:, :6], np.einsum("ki,kij->kj", across, J[:, 6:])[:, None]], axis=1)
        elif self.plan.locked is not None:
            J = np.delete(J, self.plan.locked, axis=2)
        if J.shape[1] > J.shape[2]:  # a planar arm: its motions stay in one space
            usual = self.jacobian(np.full((1, q.shape[1]), 0.7))[0]
            J = np.linalg.svd(usual)[0][:, : J.shape[2]].T @ J
        return np.asarray(np.linalg.det(J))


Kind = Callable[[Task, int], Array]


def mixed(task: Task, count: int) -> Array:
    """Targets: two thirds of random configurations, the others of angles that are multiples of 45 degrees or beside."""
    q, rng = _drawn(task, count)
    special = slice(2 * count // 3, count)
    q[special] = rng.integers(-4, 5, q[special].shape) * (np.pi / 4)
    beside = slice(5 * count // 6, count)
    q[beside] += _small(rng, q[beside].shape)
    return records(task, q)


def random(task: Task, count: int) -> Array:
    """Targets of random configurations."""
    return records(task, _drawn(task, count)[0])


def singular(task: Task, count: int) -> Array:
    """Targets at and beside singular configurations, a quarter each.

    Angles that are multiples of 45 degrees, where an arm is often singular in several ways at once; these with 1e-14 to
    1e-3 (rad, m) added; random configurations in which one joint is moved to where the determinant of the Jacobian
    changes its sign; these with 1e-14 to 1e-3 added.
    """
    q, rng = _drawn(task, count)
    half = count // 2
    q[:half] = rng.integers(-4, 5, q[:half].shape) * (np.pi / 4)
    q[half:] = _where_singular(task, q[half:], rng)
    for quarter in (1, 3):
        beside = slice(quarter * count // 4, (quarter + 1) * count // 4)
        q[beside] += _small(rng, q[beside].shape)
    return records(task, q)


def records(task: Task, q: Array) -> Array:
    """The records (N, 17) of the targets of configurations (N, n), whose displacements are made ten times smaller."""
    q = np.where(task.revolute, q, 0.1 * q)
    given = [parameter(task.plan, row) for row in q] if task.plan.locked is not None else [0.0] * len(q)
    return np.column_stack([task.model.forward_kinematics(q).reshape(-1, 16), given])


def _drawn(task: Task, count: int) -> tuple[Array, np.random.Generator]:
    rng = np.random.default_rng([7, task.chain.n])
    return rng.uniform(-np.pi, np.pi, (count, task.chain.n)), rng


def _small(rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    """Normal deviates times 1e-14 to 1e-3, one power of ten a row."""
    return np.asarray(rng.normal(size=shape) * 10.0 ** rng.integers(-14, -2, (shape[0], 1)))


def _where_singular(task: Task, q: Array, rng: np.random.Generator) -> Array:
    """``q`` with one joint of each row moved to a change of sign of the determinant, if any joint has one."""
    values = np.linspace(-np.pi, np.pi, GRID + 1)
    left = np.arange(len(q))
    orders = rng.permuted(np.tile(np.arange(q.shape[1]), (len(q), 1)), axis=1)
    for place in range(q.shape[1]):
        joint = orders[left, place]

        def sign(x: Array, joint: Indices = joint, left: Indices = left) -> Array:
            at = q[left]
            at[np.arange(len(at)), joint] = x
            return np.sign(task.determinant(np.where(task.revolute, at, 0.1 * at)))

        signs = np.stack([sign(np.full(len(left), x)) for x in values], axis=1)
        turns = signs[:, 1:] != signs[:, :-1]
        first = turns.argmax(axis=1)
        low, high, before = values[first], values[first + 1], signs[np.arange(len(left)), first]
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            same = sign(middle) == before
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        found = turns.any(axis=1)
        q[left[found], joint[found]] = low[found]
        left = left[~found]
    return q
