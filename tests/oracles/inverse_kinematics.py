"""Every inverse kinematic solution of a pose or position by multi-start Levenberg-Marquardt on the oracle's own FK.

It knows nothing of closed forms: random starts are driven onto the target, polished by Newton steps, and sorted into
distinct solutions until many further starts bring nothing new. Prismatic joints are searched within PRISMATIC_SPAN.

Limits: a solution whose basin attracts less than about 1/patience of the starts can be missed; at a double root (a
singular configuration) convergence is linear and two solutions closer than DISTINCT count as one.
"""

from __future__ import annotations

import numpy as np

from oracles.newton_euler import Robot, cos_sin

ACCEPTED = 1e-10  # residual (m and rad) of a converged start
DISTINCT = 1e-4  # rad or m between two solutions; double roots smear over the square root of the residual
PRISMATIC_SPAN = 2.0  # m, starts of prismatic joints are drawn from +-PRISMATIC_SPAN
DAMPING = 1e-2  # times the squared error
DAMPING_FLOOR = 1e-14  # keeps the normal equations of a singular pose solvable, invisible elsewhere
ITERATIONS = 40
POLISH = 4


def batch_kinematics(robot: Robot, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tip (N, 4, 4) and Jacobian (N, 6, n), linear rows first, for configurations (N, n)."""
    N = len(q)
    T = np.broadcast_to(robot.base, (N, 4, 4))
    axes, points = [], []
    for (kind, alpha, a, d, theta), qi in zip(robot.rows, q.T, strict=True):
        c0, s0 = cos_sin(theta)
        cq, sq = (np.cos(qi), np.sin(qi)) if kind == "revolute" else (np.ones(N), np.zeros(N))
        screw = np.zeros((N, 4, 4))
        screw[:, 0, 0] = screw[:, 1, 1] = c0 * cq - s0 * sq
        screw[:, 1, 0] = s0 * cq + c0 * sq
        screw[:, 0, 1] = -screw[:, 1, 0]
        screw[:, 2, 2] = screw[:, 3, 3] = 1.0
        screw[:, 2, 3] = d + (qi if kind == "prismatic" else 0.0)
        ca, sa = cos_sin(alpha)
        twist = np.array([[1, 0, 0, a], [0, ca, -sa, 0], [0, sa, ca, 0], [0, 0, 0, 1]])
        if robot.convention == "standard":
            axes.append(T[:, :3, 2])
            points.append(T[:, :3, 3])
            T = T @ screw @ twist
        else:
            T = T @ twist @ screw
            axes.append(T[:, :3, 2])
            points.append(T[:, :3, 3])
    T = T @ robot.tool
    J = np.zeros((N, 6, robot.n))
    for i, (kind, *_) in enumerate(robot.rows):
        if kind == "revolute":
            J[:, :3, i], J[:, 3:, i] = np.cross(axes[i], T[:, :3, 3] - points[i]), axes[i]
        else:
            J[:, :3, i] = axes[i]
    return T, J


def rotation_error(R: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Rotation vectors (N, 3), base frame, that turn R (N, 3, 3) into goal (3, 3)."""
    E = goal @ np.swapaxes(R, 1, 2)
    axis = np.stack([E[:, 2, 1] - E[:, 1, 2], E[:, 0, 2] - E[:, 2, 0], E[:, 1, 0] - E[:, 0, 1]], axis=1)
    sine = 0.5 * np.linalg.norm(axis, axis=1)
    angle = np.arctan2(sine, 0.5 * (np.trace(E, axis1=1, axis2=2) - 1.0))
    # near a half turn the axis is ill defined; any bounded direction will do for a step that is damped anyway
    factor = np.where(sine > 1e-8, angle / np.maximum(2.0 * sine, 1e-300), 0.5)
    return axis * factor[:, None]


def _residual(robot: Robot, q: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Task error (N, m) and Jacobian (N, m, n): m is 6 for a pose (4, 4), 3 for a position (3,)."""
    T, J = batch_kinematics(robot, q)
    if target.shape == (3,):
        return target - T[:, :3, 3], J[:, :3]
    error = np.concatenate([target[:3, 3] - T[:, :3, 3], rotation_error(T[:, :3, :3], target[:3, :3])], axis=1)
    return error, J


def _descend(robot: Robot, q: np.ndarray, target: np.ndarray, free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Levenberg-Marquardt from every row of q; the damping follows the squared error of the row."""
    error, J = _residual(robot, q, target)
    size = np.linalg.norm(error, axis=1)
    for iteration in range(ITERATIONS + POLISH):
        A = J[:, :, free]
        damping = (DAMPING * np.minimum(size, 1.0) ** 2 if iteration < ITERATIONS else 0.0 * size) + DAMPING_FLOOR
        normal = np.swapaxes(A, 1, 2) @ A + damping[:, None, None] * np.eye(int(free.sum()))
        step = np.linalg.solve(normal, np.swapaxes(A, 1, 2) @ error[:, :, None])[:, :, 0]
        step *= np.minimum(1.0, 1.0 / np.maximum(np.max(np.abs(step), axis=1), 1e-300))[:, None]
        trial = q.copy()
        trial[:, free] += step
        new_error, new_J = _residual(robot, trial, target)
        new_size = np.linalg.norm(new_error, axis=1)
        better = (new_size < size) | (iteration < ITERATIONS // 2)  # early uphill steps leave bad regions
        q = np.where(better[:, None], trial, q)
        error = np.where(better[:, None], new_error, error)
        J = np.where(better[:, None, None], new_J, J)
        size = np.where(better, new_size, size)
    return q, size


def wrap(robot: Robot, q: np.ndarray) -> np.ndarray:
    """Angles of revolute joints to [-pi, pi)."""
    turning = np.array([row[0] == "revolute" for row in robot.rows])
    return np.where(turning, np.mod(q + np.pi, 2 * np.pi) - np.pi, q)


def distance(robot: Robot, q: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Largest joint difference between q (n,) and each row of others, angles modulo full turns."""
    return np.max(np.abs(wrap(robot, others - q)), axis=-1) if len(others) else np.zeros(0)


def same_sets(robot: Robot, first: np.ndarray, second: np.ndarray, tolerance: float = 1e-6) -> bool:
    """Whether every row of each set has a partner in the other."""
    return all(
        len(b) > 0 and distance(robot, row, b).min() <= tolerance
        for a, b in ((first, second), (second, first))
        for row in a
    )


def solve_all(
    robot: Robot,
    target: np.ndarray,
    *,
    locked: dict[int, float] | None = None,
    seed: int = 0,
    batch: int = 128,
    patience: int = 5,
    max_batches: int = 60,
) -> np.ndarray:
    """All distinct solutions (k, n), sorted by row; k is 0 when the target is out of reach.

    ``target`` is a pose (4, 4) or a position (3,). ``locked`` fixes joints at values (a redundant arm needs it: without
    it the solutions form a continuum and ValueError is raised). Ends after ``patience`` batches without a new solution.
    """
    target = np.asarray(target, dtype=float)
    locked = locked or {}
    free = np.array([i not in locked for i in range(robot.n)])
    if free.sum() > (3 if target.shape == (3,) else 6):
        raise ValueError("more free joints than task coordinates: lock the redundant ones")
    rng = np.random.default_rng(seed)
    turning = np.array([row[0] == "revolute" for row in robot.rows])
    found, quiet = np.zeros((0, robot.n)), 0
    for _ in range(max_batches):
        span = np.where(turning, np.pi, PRISMATIC_SPAN)
        starts = rng.uniform(-span, span, (batch, robot.n))
        for joint, value in locked.items():
            starts[:, joint] = value
        q, size = _descend(robot, starts, target, free)
        new = 0
        for row in wrap(robot, q[size < ACCEPTED][np.argsort(size[size < ACCEPTED])]):
            if len(found) == 0 or distance(robot, row, found).min() > DISTINCT:
                found, new = np.vstack([found, row]), new + 1
        quiet = 0 if new else quiet + 1
        if quiet >= patience:
            break
    return found[np.lexsort(found.T[::-1])]
