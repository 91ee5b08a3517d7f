"""Choice of poses that determine the geometry best: D-optimal exchange from random candidates inside the limits."""

from __future__ import annotations

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.lab.calibrate.geometry import Geometry
from rrrgen.lab.calibrate.measurements import Kind, Measurements
from rrrgen.lab.calibrate.minimal_set import minimal_set
from rrrgen.robot.model.mechanism import follower_limits
from rrrgen.robot.robot_spec import RobotSpec

CANDIDATES = 2000
ROUNDS = 20
TYPICAL = (5e-5, 1e-4)  # m, rad: typical noise of a laser tracker; only the ratio has an effect


def choose_poses(spec: RobotSpec, geometry: Geometry, kind: Kind, count: int, seed: int) -> tuple[Array, float]:
    """Choose joint positions (count, n) inside the limits of ``spec``; also returns the gain over random positions.

    The determinant of the information matrix is raised by exchanging poses for candidates until none helps; the gain
    is the root of order p of the ratio of determinants, p the number of parameters. Raises :class:`InputError` for
    fewer poses than the parameters need.
    """
    entries = minimal_set(geometry, kind).kept
    q = random_positions(spec, CANDIDATES, seed)
    candidates = Measurements(kind, q, q, *TYPICAL)
    J = candidates.jacobian(geometry, entries) * candidates.weights[:, None]
    needed = int(np.ceil(len(entries) / J.shape[1])) + 1
    if not needed <= count < len(q):
        raise InputError(f"{count} poses for {len(entries)} parameters; choose {needed} to {len(q) - 1}")
    chosen = list(range(count))
    information = np.einsum("nij,nik->jk", J[chosen], J[chosen])
    first = np.linalg.slogdet(information)[1]
    for _ in range(ROUNDS):
        changed = False
        for place in range(count):
            without = information - J[chosen[place]].T @ J[chosen[place]]
            inverse = np.linalg.pinv(without + 1e-12 * np.trace(information) * np.eye(len(entries)))
            gains = np.linalg.slogdet(np.eye(J.shape[1]) + J @ inverse @ np.swapaxes(J, 1, 2))[1]
            gains[[k for k in chosen if k != chosen[place]]] = -np.inf
            best = int(np.argmax(gains))
            if gains[best] > gains[chosen[place]] + 1e-6:
                chosen[place], changed = best, True
                information = without + J[best].T @ J[best]
        if not changed:
            break
    gain = float(np.exp((np.linalg.slogdet(information)[1] - first) / (2 * len(entries))))
    return q[chosen], gain


def random_positions(spec: RobotSpec, count: int, seed: int) -> Array:
    """Random joint positions (N, n), at most ``count``, inside the limits of joints and of rows that follow several."""
    lower, upper = _limits(spec)
    q = np.random.default_rng(seed).uniform(lower, upper, (count, spec.n))
    for each in follower_limits(spec):
        value = q @ np.array(each.factors)
        least, most = (end if end is not None else side * np.inf for end, side in ((each.lower, -1), (each.upper, 1)))
        q = q[(least <= value) & (value <= most)]
    return q


def _limits(spec: RobotSpec) -> tuple[Array, Array]:
    """Lower and upper limits (n,) of the joint positions; +-pi, or +-0.5 m, where the robot file states none."""
    free = [np.pi if joint.is_revolute else 0.5 for joint in spec.joints]
    lower = [-f if j.limits.lower is None else j.limits.lower for j, f in zip(spec.joints, free, strict=True)]
    upper = [f if j.limits.upper is None else j.limits.upper for j, f in zip(spec.joints, free, strict=True)]
    return np.array(lower), np.array(upper)
