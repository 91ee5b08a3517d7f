"""Inverse kinematics: rrrgen's emitted C against EAIK, every row checked by forward kinematics."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib import util
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rrrgen.bench.contestants import Contestant, DisagreementError
from rrrgen.bench.python_calls import turns
from rrrgen.bench.race import Driver, Effort
from rrrgen.bench.toolchain import Toolchain
from rrrgen.verify.chain import Array, chain_of
from rrrgen.verify.newton_euler import NewtonEuler

if TYPE_CHECKING:
    from rrrgen.spec.robot_spec import RobotSpec

POSES = 32
ROW_ERROR = 1e-6
"""Rows must meet the target this well (m, rad); peers polish their rows less than this."""

GENERAL = """\
schema: rrrgen/1
name: general6r
description: Six revolute joints without any special geometry
convention: standard
units: {angle: rad, length: m}
gravity: [0, 0, -9.81]
joints:
  - {name: j1, type: revolute, alpha: 1.3, a: 0.12, d: 0.31, theta: 0}
  - {name: j2, type: revolute, alpha: -0.4, a: 0.41, d: 0.07, theta: 0}
  - {name: j3, type: revolute, alpha: 1.1, a: 0.09, d: -0.05, theta: 0}
  - {name: j4, type: revolute, alpha: -1.4, a: 0.05, d: 0.37, theta: 0}
  - {name: j5, type: revolute, alpha: 1.2, a: 0.03, d: 0.08, theta: 0}
  - {name: j6, type: revolute, alpha: 0.2, a: 0.02, d: 0.11, theta: 0}
"""


@dataclass(frozen=True)
class IKScore:
    """Nanoseconds per target of one solver on one robot, and rows found per target."""

    robot: str
    solver: str
    nanoseconds: float
    rows: float
    instructions: float | None = None


def ik_scores(spec: RobotSpec, toolchain: Toolchain, effort: Effort) -> list[IKScore]:
    """rrrgen and EAIK, where it is installed and knows the geometry, on the same reachable poses."""
    chain = chain_of(spec)
    oracle = NewtonEuler(chain, np.zeros((chain.n, 10)))
    rng = np.random.default_rng([2, chain.n])
    poses = oracle.forward_kinematics(rng.uniform(-np.pi, np.pi, (POSES, chain.n)))
    scores = [_own(spec, poses, oracle, toolchain, effort)]
    solve = _eaik(spec, poses) if util.find_spec("eaik") is not None else None
    if solve is not None:
        rows = _rows_checked("EAIK", spec.name, [_exact_rows(result) for result in solve()], poses, oracle)
        seconds = turns({"EAIK": solve}, max(5, effort.rounds // 5), 1e-3)["EAIK"]
        scores.append(IKScore(spec.name, "EAIK", 1e9 * seconds / POSES, rows))
    return scores


def _own(spec: RobotSpec, poses: Array, oracle: NewtonEuler, toolchain: Toolchain, effort: Effort) -> IKScore:
    from rrrgen.ik.classify import plan
    from rrrgen.ik.sources import emit

    emitted = emit(spec, plan(spec))
    name, n, rows = spec.name, spec.n, emitted.rows
    sources = {file: text for file, text in emitted.files.items() if file.endswith((".c", ".h"))}
    statements = (
        f"static {name}_ik_solutions s; (void){name}_inverse_kinematics(in, 0, 0u, &s); out[0] = s.count; "
        f"for (int i = 0; i < s.count * {n}; i++) out[1 + i] = ((const double *)s.q)[i];"
    )
    contestant = Contestant("rrrgen", "inverse_kinematics", 1 + rows * n, statements)
    targets = poses[:, :3, 3] if emitted.plan.task == "position" else poses.reshape(len(poses), -1)
    with tempfile.TemporaryDirectory(prefix="rrrgen-bench-") as place:
        driver = Driver.build(Path(place), [contestant], sources, f'#include "{name}_ik.h"\n', targets, toolchain)
        values = driver.values()[0]
        solutions = [row[1 : 1 + int(row[0]) * n].reshape(-1, n) for row in values]
        found = _rows_checked("rrrgen", name, solutions, poses, oracle, emitted.plan.task == "position")
        instructions = driver.instructions(effort.counted).get(0)
        return IKScore(name, "rrrgen", driver.times(effort)[0], found, instructions)


def _rows_checked(
    solver: str, robot: str, solutions: list[Array], poses: Array, oracle: NewtonEuler, position: bool = False
) -> float:
    """Mean number of rows per pose; every row must reach its pose, and every pose must have a row."""
    for rows, pose in zip(solutions, poses, strict=True):
        if not len(rows):
            raise DisagreementError(f"{robot}: {solver} finds no solution for a pose that is reachable")
        reached = oracle.forward_kinematics(rows)
        error = np.max(np.abs((reached - pose)[:, :3, 3:] if position else reached - pose))
        if not error < ROW_ERROR:
            raise DisagreementError(f"{robot}: a solution of {solver} misses its target by {error:.1e}")
    return float(np.mean([len(rows) for rows in solutions]))


def _eaik(spec: RobotSpec, poses: Array) -> Callable[[], list[Any]] | None:
    """EAIK on all poses in one call, on one thread; None where it knows no decomposition."""
    from eaik.IK_DH import DhRobot

    chain = chain_of(spec)
    plain = not np.any(chain.theta) and np.array_equal(chain.base, np.eye(4)) and np.array_equal(chain.tool, np.eye(4))
    if chain.convention != "standard" or chain.n != 6 or not all(chain.revolute) or not plain:
        return None
    robot = DhRobot(chain.alpha, chain.a, chain.d)
    if not robot.hasKnownDecomposition():
        return None
    targets = list(poses)
    return lambda: list(robot.IK_batched(targets, 1))


def _exact_rows(result: Any) -> Array:
    """Rows that are solutions, not least-squares approximations."""
    Q = np.asarray(result.Q)
    return Q[~np.asarray(result.is_LS, dtype=bool)] if len(Q) else Q.reshape(0, 6)
