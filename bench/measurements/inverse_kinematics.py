"""Inverse kinematics: rrrgen's emitted C against EAIK and code written by hand, every row checked."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import util
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bench.contenders.contender import OURS, Contender, DisagreementError
from bench.measurements.python_calls import turns
from bench.measurements.race import Driver, Effort
from bench.templates import render
from bench.toolchain import Toolchain
from rrrgen.verify.references.newton_euler import NewtonEuler
from rrrgen.verify.references.numeric_robot import Array, NumericRobot, chain_of

if TYPE_CHECKING:
    from rrrgen.robot.spec import RobotSpec

POSES = 32
ROW_ERROR = 1e-6
"""Rows must meet the target this well (m, rad); peers polish their rows less than this."""

REFERENCE = """
static const double x[9] = {0.3, -0.8, 1.1, 0.5, -0.2, 0.9, 1.5, -2.0, 0.4};
rrr_inverse_dynamics_nominal(x, x + 3, x + 6, out);"""

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
    """Nanoseconds per target of one solver on one robot, and rows found per target.

    ``reference`` are nanoseconds of the RRR's inverse dynamics, numbers folded, taken in turns with the solver.
    """

    robot: str
    solver: str
    nanoseconds: float
    rows: float
    instructions: float | None = None
    reference: float | None = None


def ik_scores(spec: RobotSpec, toolchain: Toolchain, effort: Effort) -> list[IKScore]:
    """rrrgen, hand-written C for elbow arms, and EAIK where it knows the geometry, on the same reachable poses."""
    chain = chain_of(spec)
    oracle = NewtonEuler(chain, np.zeros((chain.n, 10)))
    rng = np.random.default_rng([2, chain.n])
    poses = oracle.forward_kinematics(rng.uniform(-np.pi, np.pi, (POSES, chain.n)))
    scores = _compiled(spec, poses, oracle, toolchain, effort)
    solve = _eaik(spec, poses) if util.find_spec("eaik") is not None else None
    if solve is not None:
        rows = _rows_checked("EAIK", spec.name, [_exact_rows(result) for result in solve()], poses, oracle)
        seconds = turns({"EAIK": solve}, max(5, effort.rounds // 5), 1e-3)["EAIK"]
        scores.append(IKScore(spec.name, "EAIK", 1e9 * seconds / POSES, rows))
    return scores


def _compiled(
    spec: RobotSpec, poses: Array, oracle: NewtonEuler, toolchain: Toolchain, effort: Effort
) -> list[IKScore]:
    """C against C, in turns."""
    from rrrgen.emit.c.ik.files import emit
    from rrrgen.ik.classify import plan

    emitted = emit(spec, plan(spec))
    name, n, position = spec.name, spec.n, emitted.plan.task == "position"
    outputs = 1 + emitted.rows * n
    sources = {file: text for file, text in emitted.files.items() if file.endswith((".c", ".h"))}
    statements = (
        f"static {name}_ik_solutions s; (void){name}_inverse_kinematics(in, 0, 0u, &s); out[0] = s.count; "
        f"for (int i = 0; i < s.count * {n}; i++) out[1 + i] = ((const double *)s.q)[i];"
    )
    contenders = [Contender(OURS, "inverse_kinematics", outputs, statements)]
    by_hand = _elbow(spec) if position else None
    if by_hand is not None:
        sources["elbow.c"] = by_hand
        contenders.append(Contender("C by hand", "inverse_kinematics", outputs, "elbow(in, out);"))
    sources |= _reference_sources()
    contenders.append(Contender("reference", "inverse_dynamics", 3, REFERENCE))
    targets = poses[:, :3, 3] if position else poses.reshape(len(poses), -1)
    scores = []
    with tempfile.TemporaryDirectory(prefix="rrrgen-bench-") as place:
        declarations = f'#include "{name}_ik.h"\n#include "rrr.h"\nvoid elbow(const double *, double *);\n'
        driver = Driver.build(Path(place), contenders, sources, declarations, targets, toolchain)
        everything, counts, times = driver.values(), driver.instructions(effort.counted), driver.times(effort)
        for k, (contender, values) in enumerate(zip(contenders[:-1], everything[:-1], strict=True)):
            solutions = [row[1 : 1 + int(row[0]) * n].reshape(-1, n) for row in values]
            found = _rows_checked(contender.label, name, solutions, poses, oracle, position)
            reference = times[len(contenders) - 1]
            scores.append(IKScore(name, contender.label, times[k], found, counts.get(k), reference))
    return scores


@cache
def _reference_sources() -> dict[str, str]:
    """The C of the RRR's model, with which times are compared."""
    from rrrgen.derive import derive_once
    from rrrgen.emit.c.language import Dialect, sincos_strategy
    from rrrgen.emit.c.robot_files import header_and_sources
    from rrrgen.robot.file import load_spec
    from rrrgen.robot.identity import identify

    spec = load_spec("rrr")
    derived = derive_once(spec)
    return header_and_sources(derived, identify(spec), Dialect("rrr", "double"), sincos_strategy("inline"))


def _plain(chain: NumericRobot) -> bool:
    """Standard rows without offsets of angles, base and tool: all that other solvers take."""
    fixed = np.array_equal(chain.base, np.eye(4)) and np.array_equal(chain.tool, np.eye(4))
    return chain.convention == "standard" and not np.any(chain.theta) and fixed


def _elbow(spec: RobotSpec) -> str | None:
    """Hand-written C for a vertical shoulder before two parallel axes; None for other arms."""
    chain = chain_of(spec)
    axes = chain.n == 3 and all(chain.revolute) and np.allclose(chain.alpha, [np.pi / 2, 0, 0], atol=1e-15, rtol=0)
    if not _plain(chain) or not axes or chain.a[0]:
        return None
    numbers = {"height": chain.d[0], "upper": chain.a[1], "fore": chain.a[2], "offset": chain.d[1] + chain.d[2]}
    return render("elbow.c.j2", **{key: repr(float(value)) for key, value in numbers.items()})


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
    if not _plain(chain) or chain.n != 6 or not all(chain.revolute):
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
