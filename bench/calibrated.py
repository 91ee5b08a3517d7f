"""``python -m bench.calibrated``: whether inverse kinematics misses solutions of arms without any special geometry.

Targets are the poses of random configurations. A configuration is missed if no solution lies within 1e-4 (rad, m) of it
and the status does not say that the result may be incomplete. Calibrated arms deviate from the nominal table by
normally distributed errors with standard deviation eps (rad) in alpha and eps/2 (m) in a and d.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import click
import numpy as np

from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import Array, chain_of

if TYPE_CHECKING:
    from rrrgen.robot.spec import RobotSpec

CALIBRATED = ("panda", "iiwa14", "stanford")
ERRORS = (1e-5, 1e-4, 1e-3, 5e-3)
RANDOM = ("RRRRRRR", "PRRRRR", "RPRRRR", "RRPRRR", "RRRPRR", "RRRRPR", "RRRRRP")
SAME = 1e-4
"""Largest difference (rad, m) between the configuration of a target and the solution that counts as the same."""

FK_ERROR = 1e-9
"""Largest allowed entry of the pose error of a solution; lengths are divided by the reach of the arm."""

STROKE = 1.0
"""Displacements of prismatic joints are drawn from +-STROKE (m)."""

INCOMPLETE = 5

Row = tuple[str, float, float, float, float]
"""Type, alpha, a, d, theta."""


@dataclass(frozen=True)
class Loss:
    """The result for one arm: missed and incomplete targets, largest pose ``error``, ``microseconds`` per pose."""

    arm: str
    family: str
    poses: int
    missed: int
    incomplete: int
    error: float
    microseconds: float

    @property
    def sound(self) -> bool:
        """Whether no configuration was missed silently and every solution meets its pose."""
        return self.missed == 0 and self.error <= FK_ERROR

    def text(self) -> str:
        """The result as a line of the table."""
        return (
            f"{self.arm:16} {self.family:12} {self.poses:7} {self.missed:7} {self.incomplete:11} {self.error:9.1e} "
            f"{self.microseconds:8.0f}"
        )


def arms(seed: int) -> Iterator[tuple[str, RobotSpec]]:
    """The names and descriptions of all arms, with random errors from ``seed``."""
    from rrrgen.robot.file import load_spec

    for name in CALIBRATED:
        nominal = load_spec(name)
        for eps in ERRORS:
            yield f"{name} {eps:g}", _spec(_calibrated(nominal, eps, seed), nominal.convention)
    for types in RANDOM:
        yield types, _spec(_random(types, seed), "standard")


def _calibrated(nominal: RobotSpec, eps: float, seed: int) -> list[Row]:
    rng = np.random.default_rng([seed, 1])
    rows = []
    for joint in nominal.joints:
        alpha, a, d, theta = (float(nominal.nominal(x)) for x in (joint.alpha, joint.a, joint.d, joint.theta))
        x, y, z = eps * rng.normal(size=3) * np.array([1.0, 0.5, 0.5])
        kind = "R" if joint.is_revolute else "P"
        rows.append((kind, alpha + x, a + y, d + (z if kind == "R" else 0.0), theta))
    return rows


def _random(types: str, seed: int) -> list[Row]:
    rng = np.random.default_rng([seed, 2])
    alpha, theta = rng.uniform(-3.0, 3.0, (2, len(types)))
    a, d = rng.uniform(-0.6, 0.6, (2, len(types)))
    return list(zip(types, alpha, a, d, theta, strict=True))


def _spec(rows: list[Row], convention: str) -> RobotSpec:
    from rrrgen.robot.file import loads_spec

    kinds = {"R": "revolute", "P": "prismatic"}
    joints = [
        f"  - {{name: j{k}, type: {kinds[kind]}, alpha: {float(alpha)!r}, a: {float(a)!r}, d: {float(d)!r}, "
        f"theta: {float(theta)!r}}}"
        for k, (kind, alpha, a, d, theta) in enumerate(rows, 1)
    ]
    head = [
        "schema: rrrgen/1",
        "name: arm",
        f"convention: {convention}",
        "units: {angle: rad, length: m}",
        "gravity: [0, 0, -9.81]",
    ]
    return loads_spec("\n".join([*head, "joints:", *joints, ""]), "arm.yaml")


def measured(name: str, spec: RobotSpec, poses: int, seed: int) -> Loss:
    """Solve for the poses of random configurations and look for these among the solutions."""
    from rrrgen.runtime.inverse_kinematics import load_solver

    solver = load_solver(spec)
    turning = np.array([joint.is_revolute for joint in spec.joints])
    q = np.random.default_rng([seed, 3]).uniform(-1.0, 1.0, (poses, spec.n)) * np.where(turning, np.pi, STROKE)
    oracle = NewtonEuler(chain_of(spec), np.zeros((spec.n, 10)))
    T = oracle.forward_kinematics(q)
    given = np.array([solver.parameter(x) for x in q]) if solver.plan.locked is not None else None
    begin = time.perf_counter()
    batch = solver.solve_batch(T, limits=False, redundancy=given)
    seconds = time.perf_counter() - begin
    valid = np.arange(batch.q.shape[1]) < batch.counts[:, None]
    apart = np.abs(_wrapped(batch.q - q[:, None], turning)).max(axis=2)
    lost = ~(np.where(valid, apart, np.inf).min(axis=1) <= SAME)
    said = batch.statuses == INCOMPLETE
    off = np.abs(oracle.forward_kinematics(batch.q[valid]) - np.repeat(T, batch.counts, axis=0))
    off[:, :3, 3] /= solver.plan.chain.reach
    return Loss(
        name, solver.plan.family, poses, int(np.sum(lost & ~said)), int(np.sum(said)), float(off.max(initial=0.0)),
        1e6 * seconds / poses,
    )  # fmt: skip


def _wrapped(difference: Array, turning: Array) -> Array:
    return np.where(turning, np.remainder(difference + np.pi, 2 * np.pi) - np.pi, difference)


@click.command()
@click.option("--poses", default=10_000, show_default=True, help="Number of random poses per arm.")
@click.option("--seed", default=0, show_default=True, help="Seed of the errors and the poses.")
def calibrated(poses: int, seed: int) -> int:
    """Count the solutions that inverse kinematics misses on calibrated and random arms; exit with 1 if any."""
    click.echo(f"{'arm':16} {'family':12} {'poses':>7} {'missed':>7} {'incomplete':>11} {'FK error':>9} {'us/pose':>8}")
    sound = True
    for name, spec in arms(seed):
        loss = measured(name, spec, poses, seed)
        click.echo(loss.text())
        sound = sound and loss.sound
    return 0 if sound else 1


if __name__ == "__main__":
    raise SystemExit(calibrated(standalone_mode=False))
