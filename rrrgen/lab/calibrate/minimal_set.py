"""The minimal set of geometric parameters that a kind of measurement can determine.

The derivative of the measurement by every parameter is stacked over random joint positions. A parameter whose column is
a linear combination of those before it has the same effect as these together, and is left out. Since the positions are
generic, no choice of poses can determine more parameters. The positions are moved until the computed measurements are
those of the file, wherever there are enough joints: an arm that touches one point, or one unknown plane, in all its
poses does not see its own size, though at other positions it would. Nearly parallel axes count as parallel: what tells
parameters apart only by their tilt is hidden in the noise. The set is refused unless dependent and independent
columns are clearly apart: their remainders must be below ``DEPENDENT`` or above ``INDEPENDENT``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError, InputError
from rrrgen.lab.calibrate.geometry import Geometry, GeometryEntry
from rrrgen.lab.calibrate.measurements import COUNT, Kind, Measurements, Numbers
from rrrgen.robot.model.mechanism import follower_limits
from rrrgen.robot.spec import RobotSpec

POSES = 120
SEED = 1
DEPENDENT = 1e-9  # largest remainder of a dependent column, as a share of its length: rounding errors are smaller
INDEPENDENT = 1e-5  # least remainder of an independent column, as a share of its length; angles in rad, lengths in m
SHOWN = 1e-6
ON_VALUE = 1e-13  # of the reach: how near moved positions come to the measured values
STEPS = 60
LONGEST = 0.3  # rad or m, of one joint in a Newton step


class UnreachableError(DerivationError):
    """The robot reaches hardly any of the measured values."""


@dataclass(frozen=True)
class MinimalSet:
    """The parameters ``kept`` for the calibration, and those that are ``left_out``.

    ``left_out`` maps the name of a parameter to a sentence that says which kept parameters have the same effect.
    """

    kept: tuple[GeometryEntry, ...]
    left_out: dict[str, str]


def minimal_set(geometry: Geometry, measured: Measurements | Kind) -> MinimalSet:
    """Find the parameters of ``geometry`` that the measurements, or any of that kind, determine.

    Raises :class:`DerivationError` where that cannot be decided, because some axes are nearly but not quite parallel,
    and :class:`UnreachableError` where the robot reaches hardly any of the measured values.
    """
    geometry = geometry.with_exact_parallels()
    entries = geometry.entries()
    sample = _sample(geometry, measured)
    J = sample.jacobian(geometry, entries).reshape(-1, len(entries))
    kept: list[int] = []
    left_out: dict[str, str] = {}
    basis = np.zeros((len(J), 0))
    for k, entry in enumerate(entries):
        column = J[:, k]
        rest = column
        for _ in range(2):  # twice is enough for orthogonality to round-off
            rest = rest - basis @ (basis.T @ rest)
        size = float(np.linalg.norm(column)) or 1.0
        share = float(np.linalg.norm(rest)) / size
        if share > INDEPENDENT:
            basis = np.column_stack([basis, rest / np.linalg.norm(rest)])
            kept.append(k)
        elif share < DEPENDENT or size < DEPENDENT:
            left_out[entry.name] = _reason(column, J[:, kept], [entries[i] for i in kept])
        else:
            message = f"{entry.name} is distinguished from other parameters only to {share:.0e}"
            raise DerivationError(f"{message}: axes nearly parallel, and not quite; calibrate from the nominal table")
    return MinimalSet(tuple(entries[k] for k in kept), left_out)


def _sample(geometry: Geometry, measured: Measurements | Kind) -> Measurements:
    """Measurements at random joint positions, where these give the values of the file."""
    random = np.random.default_rng(SEED)
    if isinstance(measured, str):
        q = random.uniform(-np.pi, np.pi, (POSES, geometry.joints))
        return Measurements(measured, q, np.zeros(POSES), 1.0, 1.0)
    anywhere = measured.kind == "pose" or (measured.kind == "point" and geometry.joints <= COUNT["point"])
    q = random.uniform(-np.pi, np.pi, (POSES if anywhere else 3 * POSES, geometry.joints))
    drawn = measured.of(random.integers(len(measured.q), size=len(q)), q)
    return drawn if anywhere else _moved_onto(geometry, drawn)


def _moved_onto(geometry: Geometry, drawn: Measurements) -> Measurements:
    """Move joint positions by Newton steps of least length until the residuals vanish; drop those that do not."""
    q, every = drawn.q, np.arange(len(drawn.q))
    reach = np.abs(geometry.forward(q)[:, :3, 3]).max()
    arrivals: list[tuple[Array, Numbers]] = []
    for _ in range(STEPS):
        at = drawn.of(every, q)
        residuals = at.residuals(geometry)
        arrived = np.abs(residuals).max(axis=1) < ON_VALUE * reach
        arrivals.append((q[arrived], every[arrived]))
        if sum(len(numbers) for _, numbers in arrivals) >= POSES:
            break
        by = at.convert_jacobian(geometry, geometry.by_joints(q))[~arrived]
        step = np.einsum("njc,nc->nj", np.linalg.pinv(by, rcond=1e-6), residuals[~arrived])
        q = q[~arrived] + step / np.maximum(1.0, np.abs(step).max(axis=1, keepdims=True) / LONGEST)
        every = every[~arrived]
    q, every = (np.concatenate(parts) for parts in zip(*arrivals, strict=True))
    if len(q) < POSES / 2:
        raise UnreachableError("the robot does not reach most of the measured values from where its base stands")
    return drawn.of(every[:POSES], q[:POSES])


def _reason(column: Array, kept: Array, entries: list[GeometryEntry]) -> str:
    if float(np.linalg.norm(column)) < SHOWN:
        return "no effect"
    factors = np.linalg.lstsq(kept, column, rcond=None)[0]
    parts = [
        f"{factor:+.4g} {entry.name}" for factor, entry in zip(factors, entries, strict=True) if abs(factor) > SHOWN
    ]
    return "acts like " + " ".join(parts)


# ------------------------------------------------------------------------------------------------------------------
# Choice of poses that determine the geometry best: D-optimal exchange from random candidates inside the limits.
# ------------------------------------------------------------------------------------------------------------------

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
    for limits in follower_limits(spec):
        value = q @ np.array(limits.factors)
        least, most = (
            end if end is not None else side * np.inf for end, side in ((limits.lower, -1), (limits.upper, 1))
        )
        q = q[(least <= value) & (value <= most)]
    return q


def _limits(spec: RobotSpec) -> tuple[Array, Array]:
    """Lower and upper limits (n,) of the joint positions; +-pi, or +-0.5 m, where the robot file states none."""
    free = [np.pi if joint.is_revolute else 0.5 for joint in spec.joints]
    lower = [-f if j.limits.lower is None else j.limits.lower for j, f in zip(spec.joints, free, strict=True)]
    upper = [f if j.limits.upper is None else j.limits.upper for j, f in zip(spec.joints, free, strict=True)]
    return np.array(lower), np.array(upper)
