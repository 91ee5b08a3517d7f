"""What stands in the place of a rounding bound of inverse kinematics: the largest residual found, and how to bound one.

Closed forms return angles of directions, whose errors grow without limit where a direction vanishes: at singular
positions. Solutions meet their targets there too, because such an angle matters little, but that is no bound. What
holds for every solution is the bound of forward kinematics: the exact pose of q is as near to what the emitted function
computes for q, so that its difference from the target bounds the residual but for this number.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rrrgen.base.errors import DerivationError
from rrrgen.verify.inverse_kinematics import BatchKinematics
from rrrgen.verify.references.numeric_robot import Array, chain_of

if TYPE_CHECKING:
    from rrrgen.runtime.model import Model

RANDOM, SINGULAR = 2000, 1000
"""Targets: poses of random configurations, and of configurations near multiples of an eighth of a turn."""

_CLIMBED, _NEIGHBOURS, _STEPS = 8, 64, 10


class Residuals(NamedTuple):
    """The largest difference between the pose of a solution and its target, and how many targets were solved.

    Entries of rotations, and positions over ``reach``, m.
    """

    largest: float
    targets: int
    reach: float


def largest_residual(model: Model, seed: int) -> Residuals | None:
    """The largest residual of all solutions for random and nearly singular targets and by a search uphill.

    None if the robot has no solver. The poses of solutions are those of independent forward kinematics, in double.
    """
    try:
        solver = model.ik
    except DerivationError:
        return None
    arm = BatchKinematics(
        chain_of(model.spec), position=solver.plan.task == "position", redundant=solver.plan.locked is not None
    )
    rng = np.random.default_rng(seed)

    def residuals(q: Array) -> Array:
        """The largest residual (N,) of the solutions for the poses of ``q`` (N, n)."""
        goals = arm.poses(q)
        given: dict[str, Any] = {}
        if solver.plan.locked is not None:
            given["redundancy"] = np.array([solver.parameter(configuration) for configuration in q])
        solutions = solver.solve_batch(goals[:, :3, 3] if arm.position else goals, limits=False, **given)
        owner = np.repeat(np.arange(len(q)), solutions.counts)
        every = np.concatenate([rows[:count] for rows, count in zip(solutions.q, solutions.counts, strict=True)])
        worst = np.zeros(len(q))
        np.maximum.at(worst, owner, arm.distance(goals[owner], every))
        return worst

    eighths = np.pi / 4.0 * rng.integers(-4, 5, (SINGULAR, arm.n)) * np.where(arm.revolute, 1.0, 0.1)
    near = eighths + 10.0 ** rng.uniform(-12.0, -1.0, (SINGULAR, 1)) * rng.uniform(-1.0, 1.0, (SINGULAR, arm.n))
    q = np.concatenate([arm.draw_configurations(RANDOM, rng), near])
    worst, targets = residuals(q), len(q)
    for step in range(_STEPS):
        order = np.argsort(-worst, kind="stable")[:_CLIMBED]
        best, around = q[order], 0.1 * 0.5**step
        moved = (best + rng.uniform(-around, around, (_NEIGHBOURS, *best.shape))).reshape(-1, arm.n)
        q = np.concatenate([best, moved])
        worst = np.concatenate([worst[order], residuals(moved)])
        targets += len(moved)
    return Residuals(float(worst.max()), targets, arm.reach)


def inverse_kinematics_row(model: Model, forward: Mapping[str, Any] | None, seed: int) -> tuple[str, str] | None:
    """Why inverse kinematics of ``model`` has no bound, and what stands in its place; None if it has no solver.

    ``forward`` are the bounds of forward kinematics by output, in the precision of the code, if there are any.
    """
    residuals = largest_residual(model, seed)
    if residuals is None:
        return None
    reason = (
        "angles have no bound near a singular position; the code checks the residual, but not by forward kinematics "
        "where the equations of a closed form leave no error"
    )
    instead = (
        f"the pose of every solution, by independent forward kinematics, misses its target by at most "
        f"{residuals.largest:.2g} (entries of the rotation, position over {residuals.reach:.3g} m) for "
        f"{residuals.targets} random, nearly singular and sought targets, in double"
    )
    if forward is not None:
        worst = max(value for row in forward.values() for value in row)
        instead += (
            f"; for any q in the box, the exact pose misses the target by no more than {worst:.2g} beyond what "
            "forward_kinematics(q) misses it by"
        )
    return reason, instead
