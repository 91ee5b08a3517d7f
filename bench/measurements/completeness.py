"""Whether the elimination for six joints loses solutions at special poses, and how often it says that it may.

    python -m bench.measurements.completeness [--quick] [--float] [--poses N] [--seed S] [--arm NAME] ... [--jobs N]

Targets are the poses of configurations. A *special* configuration has one or two joints at a multiple of pi/2 (a
displacement at zero), exactly or off by 1e-12 to 1e-1; a *random* one has none. The configuration of a target is
*lost* if it is regular (smallest singular value of the Jacobian, in rad and m, above 1e-3), no solution lies within
1e-4 of it, and the status is OK; *missing* if the status is INCOMPLETE. *Silent* is a singular configuration that is
lost, while no solution has the flag FREE. The shares of targets with the status INCOMPLETE are of all, and of those
whose solutions are all well off singular configurations (above 0.01). In float all these bounds are larger.
Exit status 1 if a configuration is lost or more than 0.5 % of the random targets are INCOMPLETE. Targets are drawn in
blocks, each with a seed of its own, which ``--jobs`` processes share; an interrupt (Ctrl-C) ends the count, and the
table has what was counted until then.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Literal

import click
import numpy as np
from numpy.typing import NDArray

from bench.calibrated import STROKE, _calibrated, _random, _spec, _wrapped
from rrrgen.base.parallel import as_computed
from rrrgen.cli.terminal import progress_bar
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import Array, chain_of

if TYPE_CHECKING:
    from bench.calibrated import Row
    from rrrgen.robot.spec import RobotSpec

Kind = Literal["special", "random"]
Counts = NDArray[np.integer]

Real = Literal["double", "float"]

POSES, QUICK = 20_000, 1_000
BLOCK, CHUNK = 10_000, 2_000
"""Targets that have a seed of their own, and those that are solved together: their Jacobians stay within some ten
megabytes."""

BUNDLED = ("xarm6", "gen3")
"""The robots that come with rrrgen and are solved by elimination; of gen3 the last joint is prescribed."""

REGULAR = {"double": 1e-3, "float": 0.05}
"""A configuration is regular if the smallest singular value of its Jacobian (rad, m) is larger."""

WELL = {"double": 0.01, "float": 0.1}
"""All solutions of a target are well off singular configurations if that of each is larger."""

SAME = {"double": 1e-4, "float": 2e-2}
"""Largest difference (rad, m) between the configuration of a target and the solution that counts as the same."""

MOST = 0.005
"""Largest share of random targets that may be INCOMPLETE."""

INCOMPLETE = 5
FREE = 2

HEAD = f"{'poses':>8} {'lost':>6} {'missing':>8} {'INCOMPLETE':>11} {'all > .01':>11} {'silent':>8}"

h = np.pi / 2


@dataclass(frozen=True)
class Loss:
    """What became of the targets of one kind for one arm: counts, out of ``poses``."""

    poses: int = 0
    lost: int = 0
    missing: int = 0
    incomplete: int = 0
    well: int = 0
    incomplete_well: int = 0
    silent: int = 0

    def __add__(self, other: Loss) -> Loss:
        return Loss(*(getattr(self, name) + getattr(other, name) for name in self.__dataclass_fields__))

    def text(self) -> str:
        """The counts as a line of the table."""
        share, well = self.incomplete / max(1, self.poses), self.incomplete_well / max(1, self.well)
        return f"{self.poses:8} {self.lost:6} {self.missing:8} {100 * share:9.2f} % {100 * well:9.3f} % {self.silent:8}"


def arms(seed: int) -> Iterator[tuple[str, RobotSpec]]:
    """The names and descriptions of 12 arms with six revolute joints, 4 with a prismatic one, and the bundled ones."""
    from rrrgen.robot.file import load_spec

    exact: dict[str, list[Row]] = {
        "crx10ia": _rows((-h, np.pi, -h, h, -h, 0), (0, 0.54, 0, 0, 0, 0), (0, 0, 0, -0.54, 0.15, -0.16), {1: -h}),
        "manseur_doty": _rows((h, h / 90) * 3, (0.3, 1, 0, 1.5, 0, 1.1353), (0.0106, 0, 0.2, 0, 0, 0.1049)),
        "jaco2": _jaco(),
        "oblique": _rows((-h, 0, -h, 0.9, -0.9, 0), (0.15, 0.6, 0.1, 0, 0, 0), (0.4, 0, 0, 0.6, 0.1, 0.1), {1: -h}),
        "offset wrist": _rows((-h, 0, -h, h, -h, 0), (0.1, 0.5, 0.1, 0, 0.08, 0), (0.4, 0, 0, 0.5, 0, 0.1), {1: -h}),
    }
    for name, rows in exact.items():
        yield name, _spec(rows, "standard")
    crx = _spec(exact["crx10ia"], "standard")
    for name, nominal, eps in (
        ("crx10ia", crx, 5e-4),
        ("puma560", load_spec("puma560"), 1e-3),
        ("ur5", load_spec("ur5"), 1e-4),
        ("ur10e", load_spec("ur10e"), 1e-3),
        ("puma560", load_spec("puma560"), 1e-5),
    ):
        yield f"{name} {eps:g}", _spec(_calibrated(nominal, eps, seed), nominal.convention)
    for k in range(2):
        yield f"random {k + 1}", _spec(_random("RRRRRR", seed + k), "standard")
    stanford = load_spec("stanford")
    for eps in (1e-4, 1e-3):
        yield f"stanford {eps:g}", _spec(_calibrated(stanford, eps, seed), stanford.convention)
    wrist = _rows((-h, h, 0, -h, h, 0), (0.1, 0, 0, 0, 0.08, 0), (0.4, 0.15, 0, 0, 0, 0.26), {2: -h})
    yield "slide, offset wrist", _spec([("P", *row[1:]) if k == 2 else row for k, row in enumerate(wrist)], "standard")
    yield "slide, random", _spec(_random("RRRPRR", seed), "standard")
    for name in BUNDLED:
        yield name, load_spec(name)


def _rows(
    alpha: Sequence[float], a: Sequence[float], d: Sequence[float], theta: dict[int, float] | None = None
) -> list[Row]:
    return [
        ("R", x, float(y), float(z), (theta or {}).get(k, 0.0))
        for k, (x, y, z) in enumerate(zip(alpha, a, d, strict=True))
    ]


def _jaco() -> list[Row]:
    """The six-joint Jaco with a wrist whose axes are inclined by 60 degrees."""
    k, d3, d4, d6 = 0.5 / np.sin(np.pi / 3), 0.2073, 0.0741, 0.16
    third = np.pi / 3
    d = (0.2755, 0, -0.0098, -(d3 + k * d4), -2 * k * d4, -(k * d4 + d6))
    return _rows((h, np.pi, h, third, third, np.pi), (0, 0.41, 0, 0, 0, 0), d)


def configurations(turning: Array, kind: Kind, poses: int, seed: int) -> Array:
    """Configurations (poses, n), rad or m, of the targets of one kind; ``turning`` says which joints are revolute."""
    rng, n = np.random.default_rng([seed, 3]), len(turning)
    q = rng.uniform(-1.0, 1.0, (poses, n)) * np.where(turning, np.pi, STROKE)
    if kind == "special":
        for k in range(poses):
            joints = rng.permutation(n)[: 1 + k % 2]
            near = 10.0 ** -rng.uniform(1.0, 12.0) * rng.choice((-1.0, 1.0)) * (k // 2 % 2)
            q[k, joints] = np.where(turning[joints], h * rng.integers(-1, 3, len(joints)), 0.0) + near
    return q


class Study:
    """The compiled solver of an arm, in "double" or "float", and the references that judge it."""

    def __init__(self, spec: RobotSpec, real: Real = "double") -> None:
        from rrrgen.emit.c.ik.files import emit
        from rrrgen.ik.classify import plan
        from rrrgen.runtime.build import build_extension
        from rrrgen.runtime.inverse_kinematics import _declarations

        emitted = emit(spec, plan(spec), real)
        name, self.family = spec.name, emitted.plan.family
        self._ffi, lib = build_extension(emitted.files, _declarations(emitted.files[f"{name}_ik.h"]), f"{name}_ik")
        self._batch, self._rows, self._real = getattr(lib, f"{name}_inverse_kinematics_batch"), emitted.rows, real
        self.turning = np.array([joint.is_revolute for joint in spec.joints])
        self._model, self._n = NewtonEuler(chain_of(spec), np.zeros((spec.n, 10))), spec.n
        self._locked = emitted.plan.locked

    def judge(self, q: Array) -> Loss:
        """Solve for the poses of the configurations ``q`` (poses, n) and look for these among the solutions."""
        return sum((self._judged(q[k : k + CHUNK]) for k in range(0, len(q), CHUNK)), Loss())

    def _judged(self, q: Array) -> Loss:
        rows, counts, flags, statuses = self.solve(q)
        valid = np.arange(self._rows) < counts[:, None]
        gains = np.full(valid.shape, np.inf)
        gains[valid] = self.gain(rows[valid])
        away = np.abs(_wrapped(rows - q[:, None], self.turning)).max(axis=2)
        away = np.where(valid, away, np.inf)
        missing, regular = away.min(axis=1) > SAME[self._real], self.gain(q) > REGULAR[self._real]
        said = statuses == INCOMPLETE
        well = (gains.min(axis=1) > WELL[self._real]) & (counts > 0)
        silent = missing & ~regular & ~said & ~((flags & FREE) * valid).any(axis=1)
        lost, unsure = missing & regular & ~said, missing & regular & said
        figures = (lost, unsure, said, well, said & well, silent)
        return Loss(len(q), *(int(np.sum(figure)) for figure in figures))

    def solve(self, configurations: Array) -> tuple[Array, Counts, Counts, Counts]:
        """Solve for the poses of ``configurations`` (poses, n).

        Solutions (poses, rows, n), their numbers (poses,), flags (poses, rows) and statuses (poses,).
        """
        poses, dtype = len(configurations), np.float64 if self._real == "double" else np.float32
        T = np.ascontiguousarray(self._model.forward_kinematics(configurations), dtype)
        q = np.zeros((poses, self._rows, self._n), dtype)
        given = [] if self._locked is None else [np.ascontiguousarray(configurations[:, self._locked], dtype)]
        counts, statuses = np.zeros((2, poses), np.int32)
        flags = np.zeros((poses, self._rows), np.uint32)
        cast, real, null = self._ffi.cast, f"{self._real} *", self._ffi.NULL
        self._batch(
            poses, cast(real, T.ctypes.data), null, *(cast(real, x.ctypes.data) for x in given), 0,
            cast(real, q.ctypes.data), cast("int *", counts.ctypes.data),
            cast("unsigned *", flags.ctypes.data), null, cast("int *", statuses.ctypes.data), null,
        )  # fmt: skip
        return q.astype(float), counts, flags, statuses

    def gain(self, q: Array) -> Array:
        """The smallest singular value of the Jacobian (rad, m) of the joints not prescribed, at ``q`` (..., n)."""
        free = [k for k in range(self._n) if k != self._locked]
        return np.asarray(np.linalg.svd(self._model.jacobian(q)[..., free], compute_uv=False)[..., -1])


@cache
def _study(name: str, real: Real, seed: int) -> Study:
    return Study(dict(arms(seed))[name], real)


@dataclass(frozen=True)
class Block:
    """Targets of one kind for one arm, with the seeds of the arms and of the targets."""

    name: str
    kind: Kind
    poses: int
    arms: int
    seed: int

    def judged(self, real: Real) -> Loss:
        """What became of them with code in "double" or "float"."""
        study = _study(self.name, real, self.arms)
        return study.judge(configurations(study.turning, self.kind, self.poses, self.seed))


def _judged(real: Real, block: Block) -> Loss:
    return block.judged(real)


@click.command()
@click.option("--poses", type=int, help=f"Targets of each kind per arm; {POSES} by default, {QUICK} with --quick.")
@click.option("--quick", is_flag=True, help="Fewer targets.")
@click.option("--float", "single", is_flag=True, help="Code in single precision.")
@click.option("--seed", default=0, show_default=True, help="Seed of the arms and of the first block of targets.")
@click.option("--arm", "names", multiple=True, help="Only this arm; repeat for several.")
@click.option("--jobs", default=1, show_default=True, help="Processes.")
def completeness(poses: int | None, quick: bool, single: bool, seed: int, names: tuple[str, ...], jobs: int) -> int:
    """Count the solutions that the elimination loses with the status OK; exit with 1 if there are any."""
    poses = poses or (QUICK if quick else POSES)
    real: Real = "float" if single else "double"
    kinds: tuple[Kind, ...] = ("special", "random")
    chosen = [name for name, _ in arms(seed) if not names or name in names]
    found = {(name, kind): Loss() for name in chosen for kind in kinds}
    blocks = [
        Block(name, kind, min(BLOCK, poses - first), seed, seed + first // BLOCK)
        for first in range(0, poses, BLOCK)
        for name, kind in found
    ]
    with progress_bar() as tell, suppress(KeyboardInterrupt):
        for done, (k, loss) in enumerate(as_computed(_judged, blocks, jobs, shared=(real,))):
            block = blocks[k]
            found[block.name, block.kind] += loss
            tell(done + 1, len(blocks), f"{block.name}, {block.kind}")
    click.echo(f"{'arm':20} {'targets':8} {HEAD}")
    sound = True
    for (name, kind), loss in found.items():
        click.echo(f"{name:20} {kind:8} {loss.text()}")
        sound = sound and loss.lost == 0 and (kind == "special" or loss.incomplete <= MOST * loss.poses)
    click.echo(f"{'all':20} {'':8} {sum(found.values(), Loss()).text()}")
    return 0 if sound else 1


if __name__ == "__main__":
    raise SystemExit(completeness(standalone_mode=False))
