"""Mechanisms, robots in which joints follow others or which branch: their chain to the tip, and text about them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import sympy as sp

from rrrgen.base.errors import DerivationError, InternalError
from rrrgen.robot.model.drives import weighted_sum
from rrrgen.robot.spec import FixedTransform, JointSpec, Limits, LoopSpec, MechanismSpec, RobotSpec


@dataclass(frozen=True)
class FollowerLimits:
    """The range of a row ``name`` that follows several joints: ``lower <= factors . q <= upper``; None for no limit.

    A row that follows one joint narrows the range of that joint instead.
    """

    name: str
    factors: tuple[float, ...]
    lower: float | None
    upper: float | None


def refuse_newton(spec: RobotSpec, what: str) -> None:
    """Raise DerivationError for a robot whose loops Newton's method solves; ``what`` is what does not exist for it."""
    if spec.newton:
        names = ", ".join(loop.name for loop in spec.loops)
        hint = "its functions take the positions of the passive joints as a further input"
        raise DerivationError(
            f"{spec.name}: {what} does not exist with loops solved by Newton's method ({names}); {hint}"
        )


def refuse_loops(spec: RobotSpec, what: str) -> None:
    """Raise DerivationError for a robot with closed loops; ``what`` is what does not exist for it."""
    if spec.loops:
        names = ", ".join(loop.name for loop in spec.loops)
        raise DerivationError(f"{spec.name}: {what} does not exist with closed loops ({names})")


def follower_limits(spec: RobotSpec) -> tuple[FollowerLimits, ...]:
    """The ranges of all rows that follow several joints; empty for a serial chain."""
    if spec.mechanism is None:
        return ()
    limits = []
    for row, factors in zip(spec.rows, spec.mechanism.matrix, strict=True):
        several = sum(factor != 0 for factor in factors) > 1
        lower, upper = (None if v is None else float(v) for v in (row.limits.lower, row.limits.upper))
        if several and (lower is not None or upper is not None):
            limits.append(FollowerLimits(row.name, tuple(map(float, factors[: spec.n])), lower, upper))
    return tuple(limits)


def limits_at(spec: RobotSpec, i: int, q: Sequence[float]) -> Limits:
    """The limits of joint ``i``, its range narrowed by rows that follow it, while the other joints stand at ``q``."""
    limits = spec.joints[i].limits
    lower, upper = limits.lower, limits.upper
    for follower in follower_limits(spec):
        factor = follower.factors[i]
        if factor == 0.0:
            continue
        rest = sum(f * float(x) for k, (f, x) in enumerate(zip(follower.factors, q, strict=True)) if k != i)
        ends = [None if v is None else (v - rest) / factor for v in (follower.lower, follower.upper)]
        least, most = ends if factor > 0.0 else ends[::-1]
        lower = least if lower is None else lower if least is None else max(float(lower), least)
        upper = most if upper is None else upper if most is None else min(float(upper), most)
    return replace(limits, lower=lower, upper=upper)


def chain_to_tip(spec: RobotSpec) -> RobotSpec:
    """Make a serial robot of the rows between base and tip, all driven and without limits, for kinematics.

    The screw ``Rz(gamma) Tz(b)`` before a row commutes with the motion of the row before it, and becomes part of its
    theta and d; that before the first row becomes part of the base transform.
    """
    if spec.mechanism is None:
        return spec
    rows: list[JointSpec] = []
    base = spec.base
    for i in spec.mechanism.path(spec.mechanism.tip):
        row = spec.rows[i]
        if row.gamma != 0 or row.b != 0:
            if rows:
                rows[-1] = replace(rows[-1], theta=rows[-1].theta + row.gamma, d=rows[-1].d + row.b)
            else:
                base = base.append_screw(row.gamma, row.b)
        rows.append(replace(row, limits=Limits(), friction=None, drive=None, gamma=sp.S.Zero, b=sp.S.Zero))
    return replace(
        spec, joints=tuple(rows), mechanism=None, links=None, base=base, drives=None, basis=None, tools={}, tips={}
    )


def coupling_to_tip(spec: RobotSpec) -> sp.Matrix:
    """The matrix (rows, n) that maps q to the displacements of the joints of :func:`chain_to_tip`."""
    if spec.mechanism is None:
        return sp.eye(spec.n)
    refuse_loops(spec, "a constant coupling of the tip")
    return sp.Matrix([list(spec.mechanism.matrix[i]) for i in spec.mechanism.path(spec.mechanism.tip)])


@dataclass(frozen=True)
class TipArm:
    """The joints that move one named tip and no tip beside it, as a robot of its own for inverse kinematics.

    ``spec``, called ``<robot>_<tip>``, holds the rows from the link of row ``carrier`` (-1: from the base) to the tip;
    its base frame is the frame of that link. ``joints`` are the numbers in q of its joints, ``shared`` those of the
    joints that move the carrier, and other tips with it.
    """

    spec: RobotSpec
    carrier: int
    joints: tuple[int, ...]
    shared: tuple[int, ...]


def tip_arm(spec: RobotSpec, tip: str) -> TipArm:
    """The part of ``spec`` that moves the named ``tip`` alone.

    Tips are beside each other where their rows branch; a tip on the way to another shares no joint in this sense.
    Raises DerivationError where no joint moves the tip alone, or where shared joints stand behind such ones.
    """
    one = spec.at_tip(tip)
    refuse_loops(spec, f"an arm of its own at the tip {tip}")
    if one.mechanism is None:
        raise InternalError("a robot with named tips has a mechanism")
    S, path = one.mechanism.matrix, one.mechanism.path(one.tip_row)

    def moving(rows: Sequence[int]) -> set[int]:
        return {k for i in rows for k, factor in enumerate(S[i]) if factor != 0}

    ways = [one.mechanism.path(spec.at_tip(other).tip_row) for other in spec.tips]
    beside = [way for way in ways if any(x != y for x, y in zip(way, path, strict=False))]
    of_others = set().union(*map(moving, beside))
    arm_joints, shared = sorted(moving(path) - of_others), sorted(moving(path) & of_others)
    start = max((k + 1 for k, i in enumerate(path) if moving([i]) & of_others), default=0)
    name = f"{spec.name}_{tip}"
    if not arm_joints:
        raise DerivationError(f"{name}: no joint moves this tip and no other")
    if moving(path[:start]) & set(arm_joints):
        first = spec.joints[arm_joints[0]].name
        raise DerivationError(f"{name}: {first} moves this tip alone and stands before joints that other tips share")
    rows = path[start:]
    mechanism = MechanismSpec(
        tuple(spec.rows[i] for i in rows),
        tuple(range(-1, len(rows) - 1)),
        len(rows) - 1,
        tuple(tuple(S[i][k] for k in arm_joints) for i in rows),
    )
    joints = tuple(replace(spec.joints[k], friction=None, drive=None) for k in arm_joints)
    part = replace(one, name=name, joints=joints, mechanism=mechanism, links=None, drives=None, basis=None, tools={})
    part = part if start == 0 else replace(part, base=FixedTransform())
    if sp.Matrix(mechanism.matrix) == sp.eye(len(arm_joints)):  # a chain, which more solvers know
        serial = chain_to_tip(part)
        limited = (replace(row, limits=joint.limits) for row, joint in zip(serial.joints, joints, strict=True))
        part = replace(serial, joints=tuple(limited))
    return TipArm(part, path[start - 1] if start else -1, tuple(arm_joints), tuple(shared))


def mechanism_equations(spec: RobotSpec) -> list[str]:
    """Describe each row of a mechanism and each named tip by a clause: parent and motion with q. Empty for a chain."""
    if spec.mechanism is None:
        return []
    passive = [spec.rows[row].name for row in spec.mechanism.passive]
    names = [joint.name for joint in spec.joints] + passive
    clauses = []
    for row, parent, factors in zip(spec.rows, spec.parents, spec.mechanism.matrix, strict=True):
        carrier = spec.rows[parent].name if parent >= 0 else "base"
        if spec.floating_base and parent < 0:
            clauses.append(f"{row.name} is the floating base")
            continue
        moved = weighted_sum(names, [str(value) for value in factors])
        free = " without a drive" if row.name in passive else "" if moved == row.name else f", {row.name} = {moved}"
        clauses.append(f"{row.name} on {carrier}{free}")
    for loop in spec.loops:
        ends = " and ".join("base" if row < 0 else spec.rows[row].name for row, _ in loop.pins)
        moved = " and ".join(spec.rows[row].name for row in loop.passive)
        way = f"assembly {loop.assembly:+d}" if loop.start is None else "solved by Newton's method"
        clauses.append(f"loop {loop.name}: a pin of {ends} moves {moved}, {way}")
    return [*clauses, *(f"tip {name} on {tip.row}" for name, tip in spec.tips.items())]


def mechanism_data(spec: RobotSpec) -> dict[str, Any] | None:
    """Plain data about a mechanism: every row with its parent, and the exact matrix S of ``y = S q`` as text.

    With closed loops S has columns for their passive rows behind those of q. None for a serial chain.
    """
    if spec.mechanism is None:
        return None
    return {
        "rows": [row.name for row in spec.rows],
        "parents": list(spec.parents),
        "tip": spec.rows[spec.tip_row].name,
        **({"tips": {name: tip.row for name, tip in spec.tips.items()}} if spec.tips else {}),
        "matrix": [[str(value) for value in factors] for factors in spec.mechanism.matrix],
        **({"loops": [_loop_data(spec, loop) for loop in spec.loops]} if spec.loops else {}),
    }


def _loop_data(spec: RobotSpec, loop: LoopSpec) -> dict[str, Any]:
    pins = {"base" if row < 0 else spec.rows[row].name: [str(v) for v in place] for row, place in loop.pins}
    passive = [spec.rows[row].name for row in loop.passive]
    if loop.start is not None:
        return {"name": loop.name, "passive": passive, "pins": pins, "start": [str(v) for v in loop.start]}
    return {"name": loop.name, "passive": passive, "pins": pins, "assembly": loop.assembly}
