"""Conversion of mimic joints of an imported chain to rows of a robot file that follow a driven joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import sympy as sp

from rrrgen.base.yamltext.document import FaultList
from rrrgen.robot.file.mechanism import mechanism_of_rows
from rrrgen.robot.importers.trees.exact_numbers import decimal
from rrrgen.robot.importers.trees.serial_chain import SerialChain
from rrrgen.robot.robot_spec import (
    DriveSpec,
    FrictionSpec,
    JointSpec,
    Limits,
    MechanismSpec,
)


@dataclass(frozen=True)
class Followed:
    """The motion of a mimic joint: ``factor y + offset``, with y the displacement of row ``of`` of the chain."""

    of: int
    factor: sp.Rational
    offset: sp.Rational


def followed_rows(chain: SerialChain) -> list[Followed | None]:
    """For every joint of the chain, its motion relative to the driven joint that it follows; None for driven joints.

    A joint may follow a driven joint through other mimic joints.
    """
    places = {each.joint.name: k for k, each in enumerate(chain.joints)}
    found: list[Followed | None] = []
    for each in chain.joints:
        joint, factor, offset = each.joint, sp.S.One, sp.S.Zero
        while joint.mimic is not None:
            offset += factor * decimal(joint.mimic.offset)
            factor *= decimal(joint.mimic.multiplier)
            joint = chain.joints[places[joint.mimic.of]].joint
        found.append(None if joint is each.joint else Followed(places[joint.name], factor, offset))
    return found


def with_followers(
    joints: Sequence[JointSpec], places: Sequence[int | None], faults: FaultList, chain: SerialChain
) -> tuple[tuple[JointSpec, ...], MechanismSpec | None]:
    """Make the driven joints and the mechanism that relates all rows to them; None where each row is a driven joint.

    ``joints`` are the rows, and ``places`` the number in ``chain`` of the joint of each, None for a fixed row.
    Friction, inertia and limits of a following joint are transferred to the joint that it follows; a warning says so.
    """
    found = followed_rows(chain)
    if not any(found) and None not in places:
        return tuple(joints), None
    rows = list(joints)
    row_of = {joint: k for k, joint in enumerate(places) if joint is not None}
    follows = {row_of[k]: None if each is None else replace(each, of=row_of[each.of]) for k, each in enumerate(found)}
    matrix = []
    driven = [k for k, each in follows.items() if each is None]
    for k, row in enumerate(joints):
        if k not in follows:
            matrix.append([sp.S.Zero for _ in driven])
            continue
        each = follows[k]
        matrix.append([sp.S.One if (k if each is None else each.of) == i else sp.S.Zero for i in driven])
        if each is None:
            continue
        offset = {"theta" if row.is_revolute else "d": (row.theta if row.is_revolute else row.d) + each.offset}
        rows[each.of] = _carrying(rows[each.of], row, float(each.factor))
        # limits count from the zero of the row's own variable, which now is the offset
        bounds = (None if v is None else v - float(each.offset) for v in (row.limits.lower, row.limits.upper))
        rows[k] = replace(row, limits=Limits(*bounds), friction=None, drive=None, **offset)
        matrix[-1] = [value * each.factor for value in matrix[-1]]
        place = chain.joints[places[k] or 0].joint.place
        message = f"joint '{row.name}' follows '{rows[each.of].name}' and is no joint of q"
        hint = "its friction, inertia and limits of position and speed count at the joint that it follows"
        told = "" if row.limits.torque is None else "; its torque limit is left out"
        faults.warning(place, message, hint + told)
    parents = tuple(range(-1, len(rows) - 1))
    return mechanism_of_rows(rows, parents, len(rows) - 1, [tuple(row) for row in matrix], driven)


def _carrying(joint: JointSpec, row: JointSpec, factor: float) -> JointSpec:
    """Add the limits, friction and inertia of a follower, which moves ``factor`` times as far, to ``joint``.

    Friction and inertia of the follower count ``factor`` squared times (Coulomb friction |factor| times).
    """
    size = abs(factor)
    if not size:
        return joint
    ends = {name: getattr(joint.limits, name) for name in ("velocity", "acceleration")}
    for name, own in ends.items():
        other = getattr(row.limits, name)
        ends[name] = own if other is None else other / size if own is None else min(own, other / size)
    friction, drive = joint.friction, joint.drive
    if row.friction is not None:
        old = friction or FrictionSpec()
        viscous = _total(old.viscous, row.friction.viscous, factor * factor)
        friction = replace(old, viscous=viscous, coulomb=_total(old.coulomb, row.friction.coulomb, size))
    if row.drive is not None and row.drive.inertia is not None:
        old_drive = drive or DriveSpec()
        drive = replace(old_drive, inertia=_total(old_drive.inertia, row.drive.inertia, factor * factor))
    return replace(joint, limits=replace(joint.limits, **ends), friction=friction, drive=drive)


def _total(own: float | None, other: float | None, weight: float) -> float | None:
    return own if other is None else (own or 0.0) + weight * other
