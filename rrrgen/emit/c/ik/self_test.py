"""Checks of the emitted inverse kinematics, for the self-test that runs on the processor it is built for.

The targets are the poses of scattered configurations. The solutions that must be found for them are computed with the
derivation in Python's floats, one branch at a time. Where that is not possible (the roots of a polynomial, nearly
special arms), the configuration itself must be found.
"""

from __future__ import annotations

import re
from math import tau
from typing import TYPE_CHECKING

from rrrgen.base.small_matrices import singular_values
from rrrgen.base.templates import render
from rrrgen.ik.classify import plan as make_plan
from rrrgen.ik.classify import tip_plans
from rrrgen.ik.families import parameter
from rrrgen.ik.plan import SolverPlan
from rrrgen.ik.recording.float_builder import FloatBuilder, every_branch, wrap
from rrrgen.ik.tolerances import MEETS, SAME_GOLDEN, SHARP
from rrrgen.robot.model.mechanism import tip_arm

if TYPE_CHECKING:
    from rrrgen.ik.geometry.chain import Matrix
    from rrrgen.robot.spec import RobotSpec

TARGETS, TRIED = 3, 40


def selftest(spec: RobotSpec, real: str = "double", tip: str = "") -> str:
    """Print the C function ``static int inverse_kinematics(void)`` and its tables; empty for a chain without solver.

    With a named ``tip`` it is ``<tip>_inverse_kinematics``, and all names in the text begin with that of the tip.
    """
    if tip:
        text = _selftest(*tip_plans(spec)[tip], real, spec, tip)
        names = set(re.findall(r"^static [^=;(]*?(\w+)(?=[\[(])", text, re.M))
        return re.sub(rf"\b({'|'.join(sorted(names))})\b", rf"{tip}_\1", text) if names else text
    return _selftest(spec, make_plan(spec), real)


def _selftest(spec: RobotSpec, plan: SolverPlan, real: str, robot: RobotSpec | None = None, tip: str = "") -> str:
    """The text for the solver of ``spec``: of a whole robot, or of the own joints of the named ``tip`` of ``robot``."""
    if not plan.solvable:
        return ""
    arm = tip_arm(robot, tip) if robot is not None else None
    targets = _targets(plan)
    chain, size = plan.chain, max([1, *(len(rows) for _, rows in targets)])
    turning = _turning(plan)
    singular = [[0.0] * plan.n, [(0.78125 if turns else 0.125) * (i % 3) for i, turns in enumerate(turning)]]
    return render(
        "c/ik/selftest.c.j2",
        p=spec.name,
        joints="N" if arm is None else str(plan.n),
        arm=arm,
        about=f"inverse kinematics{f' of {tip}' if tip else ''}",
        M=f"{spec.name.upper()}_IK",
        n=plan.n,
        real=real,
        position=plan.task == "position",
        redundant=plan.locked is not None,
        answered="INCOMPLETE" if plan.incomplete else "OK",
        # general equations prove at run time that no solution is missing, which rounding may forbid beside singular
        # configurations
        unproved=plan.general and not plan.incomplete,
        reach=chain.reach,
        away_from_reach=4e6 * chain.scale if "P" in chain.types else 3.0 * chain.reach,  # sliding joints go far
        revolute=", ".join(str(int(turns)) for turns in turning),
        periods="" if plan.coupling is None else ", ".join(f"R({period!r})" for period in plan.coupling.periods),
        size=size,
        configurations=[_row(q) for q, _ in targets],
        parameters=", ".join(_number(parameter(plan, _along(plan, q))) for q, _ in targets),
        counts=", ".join(str(len(rows)) for _, rows in targets),
        complete=", ".join("1" if _evaluates(plan) else "0" for _ in targets),
        expected=[[_row(row) for row in rows] for _, rows in targets],
        singular=[_row(q) for q in singular],
        away=", ".join(_number(parameter(plan, _along(plan, q))) for q in singular),
    )


def _turning(plan: SolverPlan) -> list[bool]:
    """Whether each joint of a configuration is revolute."""
    return [j.revolute for j in plan.chain.joints] if plan.coupling is None else list(plan.coupling.revolute)


def _along(plan: SolverPlan, q: list[float]) -> list[float]:
    """The joint values of the chain from base to tip at the configuration ``q``."""
    return q if plan.coupling is None else plan.coupling.rows(q)


def _targets(plan: SolverPlan) -> list[tuple[list[float], list[list[float]]]]:
    """Test configurations q, each with all solutions for its pose; none is close to a singularity."""
    targets = []
    state = 7
    for _ in range(TRIED):
        q = []
        for turns in _turning(plan):
            state = (1103515245 * state + 12345) % 2**31
            q.append(round(((state >> 16) / 2**14 - 1) * (160 if turns else 24)) / 64)
        rows = _rows(plan, q) if _evaluates(plan) else [q]
        if any(_apart(plan, row, q) < SAME_GOLDEN for row in rows) and all(
            _sharpness(plan, row) > SHARP for row in rows
        ):
            targets.append((q, rows))
        if len(targets) == TARGETS:
            break
    return targets


def _evaluates(plan: SolverPlan) -> bool:
    return not plan.general and not plan.snapped and plan.companion is None


def _rows(plan: SolverPlan, q: list[float]) -> list[list[float]]:
    """The distinct solutions, over all branches, that reach the pose of the configuration ``q``."""
    y = _along(plan, q)
    T, given = plan.chain.tip_pose(y), parameter(plan, y)
    every = every_branch(plan.equations.play, lambda script: FloatBuilder(T, [0.3] * len(y), script, redundancy=given))
    solutions: list[list[float]] = []
    for values in every:
        if len(values) < len(y):
            continue
        for row in _configurations(plan, values[: len(y)]):
            if _meets(plan, row, T) and all(_apart(plan, row, other) > SAME_GOLDEN for other in solutions):
                solutions.append(row)
    return solutions


def _configurations(plan: SolverPlan, values: list[float]) -> list[list[float]]:
    """Convert the joint ``values`` of the chain to configurations of the robot; a mechanism can have several."""
    if plan.coupling is not None:
        return list(plan.coupling.leading(values))
    return [[wrap(x) if joint.revolute else x for x, joint in zip(values, plan.chain.joints, strict=True)]]


def _meets(plan: SolverPlan, row: list[float], T: Matrix) -> bool:
    first = 3 if plan.task == "position" else 0
    rows = zip(plan.chain.tip_pose(_along(plan, row)), T, strict=True)
    error = max(abs(x - y) for have, want in rows for x, y in zip(have[first:], want[first:], strict=True))
    return bool(error < MEETS * max(1.0, plan.chain.scale))


def _apart(plan: SolverPlan, a: list[float], b: list[float]) -> float:
    periods = [tau * turns for turns in _turning(plan)] if plan.coupling is None else plan.coupling.periods
    return max(
        abs(x - y - period * round((x - y) / period)) if period else abs(x - y)
        for period, x, y in zip(periods, a, b, strict=True)
    )


def _sharpness(plan: SolverPlan, q: list[float]) -> float:
    """The smallest singular value of the Jacobian that is not zero by the arm's redundancy; lengths over the reach."""
    rows = 3 if plan.task == "position" else 6
    motion = plan.chain.tip_motion(_along(plan, q))
    columns = [[*(x / plan.chain.reach for x in column[:3]), *column[3:]][:rows] for column in motion]
    if plan.coupling is not None:  # J S, its columns for the robot's joints
        S = plan.coupling.matrix
        columns = [
            [sum(float(S[k][j]) * column[i] for k, column in enumerate(columns)) for i in range(rows)]
            for j in range(len(S[0]))
        ]
    return singular_values(columns)[min(len(columns) - (plan.locked is not None), rows) - 1]


def _row(values: list[float]) -> str:
    return "{" + ", ".join(_number(x) for x in values) + "}"


def _number(x: float) -> str:
    return f"R({float(f'{x:.9g}') + 0.0!r})"
