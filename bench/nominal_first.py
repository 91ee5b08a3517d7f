"""``python -m bench.nominal_first``: calibrated arms solved from the nominal arm, against the general equations.

Arms deviate from their table by normal errors with standard deviation eps (rad) in angles and eps/2 (m) in lengths;
those of Universal Robots also by tilts of their parallel axes, which gives lists with d of up to hundreds of metres.
Targets are the poses of random configurations. A row is missed if the general equations find it and the solver that
tries the nominal arm first has none within 1e-4 (rad, m). Targets for which both give the same bits were solved by the
general equations. Times are CPU times on this machine, of code built as Python builds it (-O2).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from bench.calibrated import SAME, STROKE, _calibrated, _spec, _wrapped
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import Array, chain_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rrrgen.robot.spec import RobotSpec

LISTS = ("ur10e", "ur5")
TABLES = ("ur10e", "puma560", "stanford", "panda")
ERRORS = (1e-4, 1e-3)
CHUNK = 10_000


@dataclass(frozen=True)
class Comparison:
    """Both solvers on the poses of one arm: what was missed, the share of general solutions, errors (m), times (us)."""

    arm: str
    deviation: float
    poses: int
    rows: int
    missed: int
    general_share: float
    error: float
    nominal: float
    fast: float
    general: float

    def text(self) -> str:
        """The result as a line of the table."""
        return (
            f"{self.arm:16} {self.deviation:8.1e} {self.poses:7} {self.rows:8} {self.missed:7} "
            f"{100 * self.general_share:9.1f} {self.error:9.1e} "
            f"{self.nominal:8.2f} {self.fast:8.2f} {self.general:8.2f}"
        )


def arms(seed: int) -> Iterator[tuple[str, RobotSpec, RobotSpec]]:
    """Name, nominal arm and calibrated arm."""
    from rrrgen.robot.file import load_spec

    for name in LISTS:
        for eps in ERRORS:
            yield f"{name} list {eps:g}", load_spec(name), _listed(name, eps, seed)
    for name in TABLES:
        nominal = load_spec(name)
        for eps in ERRORS:
            yield f"{name} {eps:g}", nominal, _spec(_calibrated(nominal, eps, seed), nominal.convention)


def _listed(name: str, eps: float, seed: int) -> RobotSpec:
    """An arm with parallel axes as its calibration lists it: tilted axes have common perpendiculars far away."""
    from rrrgen.lab.calibrate.geometry import geometry_of
    from rrrgen.lab.calibrate.robot_file import calibrated_spec
    from rrrgen.robot.file import load_spec

    spec = load_spec(name)
    geometry, random = geometry_of(spec), np.random.default_rng([seed, 4])
    entries = [entry for entry in geometry.entries() if entry.place == "row"]
    steps = np.array([eps * random.normal() * (1.0 if entry.is_angle else 0.5) for entry in entries])
    return calibrated_spec(spec, geometry.with_step(entries, steps), "bench")


def compared(name: str, nominal: RobotSpec, spec: RobotSpec, poses: int, seed: int) -> Comparison:
    """Solve for the poses of random configurations both ways, in portions that fit the memory."""
    from rrrgen.runtime.inverse_kinematics import load_solver

    first = load_solver(replace(spec, ik="nominal_first"))
    general, plain = load_solver(replace(spec, ik="general")), load_solver(nominal)
    if first.plan.nominal_first is None:
        raise ValueError(f"{name}: {first.plan.approach}")
    turning = np.array([joint.is_revolute for joint in spec.joints])
    oracle = NewtonEuler(chain_of(spec), np.zeros((spec.n, 10)))
    random = np.random.default_rng([seed, 5])
    missed = rows = both = 0
    error, times = 0.0, np.zeros(3)
    for start in range(0, poses, CHUNK):
        count = min(CHUNK, poses - start)
        q = random.uniform(-1.0, 1.0, (count, spec.n)) * np.where(turning, np.pi, STROKE)
        T = oracle.forward_kinematics(q)
        given = {} if first.plan.locked is None else {"redundancy": np.array([first.parameter(x) for x in q])}
        solve: list[Callable[..., Any]] = [solver.solve_batch for solver in (general, first)]
        truth, found = (each(T, limits=False, **given) for each in solve)
        valid = np.arange(found.q.shape[1]) < found.counts[:, None]
        for k in range(truth.q.shape[1]):
            here = truth.counts > k
            apart = np.abs(_wrapped(found.q[here] - truth.q[here, k][:, None], turning)).max(axis=2)
            missed += int(np.sum(~(np.where(valid[here], apart, np.inf).min(axis=1) <= SAME)))
        rows += int(np.sum(truth.counts))
        same = np.all(truth.q[:, 0] == found.q[:, 0], axis=1)
        both += int(np.sum(same))
        off = np.abs(oracle.forward_kinematics(found.q[valid]) - np.repeat(T, found.counts, axis=0))
        error = max(error, float(off.max(initial=0.0)))
        if start == 0:
            times = _times(plain, first, general, nominal, T, q, same, given)
    return Comparison(
        name, first.plan.nominal_first.deviation, poses, rows, missed, both / poses, error, *map(float, times)
    )


def _times(
    plain: Any,
    first: Any,
    general: Any,
    nominal: RobotSpec,
    T: Array,
    q: Array,
    same: NDArray[np.bool_],
    given: dict[str, Array],
) -> Array:
    """CPU microseconds a pose: the nominal arm on its own poses, refinement where it suffices, general equations."""
    own = NewtonEuler(chain_of(nominal), np.zeros((nominal.n, 10))).forward_kinematics(q)
    easy = np.flatnonzero(~same)[:1000]
    plain_given = {} if plain.plan.locked is None else {"redundancy": np.array([plain.parameter(x) for x in q])}
    cases = (
        (plain, own[:1000], {key: value[:1000] for key, value in plain_given.items()}),
        (first, T[easy], {key: value[easy] for key, value in given.items()}),
        (general, T[easy[:200]], {key: value[easy[:200]] for key, value in given.items()}),
    )
    found = []
    for solver, targets, more in cases:
        best = np.inf
        for _ in range(5):
            begin = time.process_time()
            solver.solve_batch(targets, limits=False, **more)
            best = min(best, time.process_time() - begin)
        found.append(1e6 * best / max(len(targets), 1))
    return np.array(found)


@click.command()
@click.option("--poses", default=100_000, show_default=True, help="Number of random poses per arm.")
@click.option("--seed", default=0, show_default=True, help="Seed of the errors and the poses.")
@click.option("--arm", "only", multiple=True, help="Only arms whose name begins so; repeat for several.")
def nominal_first(poses: int, seed: int, only: tuple[str, ...]) -> int:
    """Count the rows that refinement from the nominal arm misses; exit with 1 if any."""
    click.echo(
        f"{'arm':16} {'deviat.':>8} {'poses':>7} {'rows':>8} {'missed':>7} {'general %':>9} {'FK error':>9} "
        f"{'nominal':>8} {'refined':>8} {'general':>8}   (us a pose)"
    )
    sound = True
    for name, nominal, spec in arms(seed):
        if not only or name.startswith(only):
            result = compared(name, nominal, spec, poses, seed)
            click.echo(result.text())
            sound = sound and result.missed == 0
    return 0 if sound else 1


if __name__ == "__main__":
    raise SystemExit(nominal_first(standalone_mode=False))
