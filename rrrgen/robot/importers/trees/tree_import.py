"""Conversion of a tree of bodies to a robot description: rows, links in their link frames, friction, drives."""

from __future__ import annotations

from dataclasses import replace
from itertools import chain as in_turn
from itertools import count
from typing import Any

import sympy as sp

from rrrgen.base.yamltext.document import FaultList
from rrrgen.robot.file.quantities import LARGEST_BARE_LENGTH
from rrrgen.robot.importers.interface import ChainChoice, Found, ImportedChain, Source
from rrrgen.robot.importers.trees.denavit_hartenberg import DenavitHartenberg, Row, denavit_hartenberg
from rrrgen.robot.importers.trees.exact_numbers import (
    NOISE,
    Array,
    cross,
    decimal,
    exact_angle,
    exact_length,
    exact_rotation,
    inverse,
    norm,
)
from rrrgen.robot.importers.trees.followers import followed_rows, with_followers
from rrrgen.robot.importers.trees.serial_chain import Ends, SerialChain, serial_chain
from rrrgen.robot.importers.trees.shaft_drives import drives_of
from rrrgen.robot.importers.trees.tree import Inertia, Tree
from rrrgen.robot.names import identifier, name_fault
from rrrgen.robot.robot_spec import FixedTransform, JointSpec, JointType, LinkSpec, RobotSpec


def robot_of_tree(tree: Tree, source: Source, rounded: list[Any], faults: FaultList) -> Found | None:
    """Convert the chain that ``source`` chooses in ``tree`` to a robot; None and faults where there is no such chain.

    ``rounded`` are the changes (rad) that reading the file has made to angles.
    """
    choice = source.chain
    chain = serial_chain(tree, Ends(choice.base, choice.tip, choice.held), faults)
    if chain is None:
        return None
    table = denavit_hartenberg(chain, choice.convention, choice.angle_tolerance, fixed_rows=True)
    _tell_about_angles([*rounded, *table.rounded], choice, faults)
    _tell_about_distance(chain, table, faults)
    _tell_about_held(chain, faults)
    names = _joint_names(chain, faults)
    links = _links(chain, table, faults)
    rows = _rows(names, chain, table, choice)
    _tell_about_fixed_rows(chain, table, rows, choice, faults)
    joints, mechanism = with_followers(rows, [row.joint for row in table.rows], faults, chain)
    if mechanism is not None and tree.shafts:
        faults.warning(
            tree.shafts[0].place, "tendons are left out", "beside joints that follow others they are not read"
        )
    g = [decimal(x) for x in chain.gravity]
    spec = RobotSpec(
        name=identifier(tree.name) or source.name,
        convention=choice.convention,
        gravity=(g[0], g[1], g[2]),
        parameters={},
        joints=joints,
        links=links,
        base=fixed_transform(table.base),
        drives=drives_of(tree, chain, names, faults) if mechanism is None else None,
        mechanism=mechanism,
        tool=fixed_transform(table.tool),
        description=f"{chain.base} to {chain.tip}",
    )
    held = {joint: float(value) for joint, value in chain.held.items()}
    offsets = tuple(0.0 if each is None else float(each.offset) for each in followed_rows(chain))
    moving = tuple(each.joint.name for each in chain.joints)
    places = tuple(i for i, row in enumerate(table.rows) if row.joint is not None)
    return Found(spec, ImportedChain(chain.base, chain.tip, moving, held, offsets, places))


def _tell_about_angles(rounded: list[Any], choice: ChainChoice, faults: FaultList) -> None:
    changes = [float(change) for change in rounded if change > NOISE]
    if changes:
        message = f"{len(changes)} angles were taken as multiples of 15 degrees; the largest change is "
        hint = f"within {choice.angle_tolerance:g} rad; --angle-tolerance 0 keeps the decimals of the file"
        faults.warning(None, f"{message}{max(changes):.1e} rad", hint)


def _tell_about_distance(chain: SerialChain, table: DenavitHartenberg, faults: FaultList) -> None:
    for row in table.rows:
        if row.joint is not None and abs(row.d) > LARGEST_BARE_LENGTH:
            joint = chain.joints[row.joint]
            message = f"d of '{joint.joint.name}' is {float(row.d):g} m: two axes are nearly parallel"
            hint = "a larger --angle-tolerance takes them as parallel; far frames lose digits of positions and inertia"
            faults.warning(joint.joint.place, message, hint)


def _tell_about_fixed_rows(
    chain: SerialChain, table: DenavitHartenberg, rows: list[JointSpec], choice: ChainChoice, faults: FaultList
) -> None:
    for i, row in enumerate(table.rows):
        if row.joint is None:
            before, behind = (chain.joints[table.rows[k].joint or 0] for k in (i - 1, i + 1))
            tilt = float(norm(cross(before.direction, behind.direction)))
            between = f"the axes of '{before.joint.name}' and '{behind.joint.name}' are parallel to {tilt:.1e} rad"
            hint = f"a larger --angle-tolerance than {choice.angle_tolerance:g} rad takes them as parallel"
            faults.warning(behind.joint.place, f"{between}: the fixed row {rows[i].name} holds that tilt", hint)


def _tell_about_held(chain: SerialChain, faults: FaultList) -> None:
    if chain.held:
        listed = ", ".join(f"{name} at {float(value):g}" for name, value in chain.held.items())
        hint = "what they carry belongs to the link that carries them; other values with --hold JOINT=VALUE"
        faults.warning(None, f"joints beside the chain from {chain.base} to {chain.tip} are held: {listed}", hint)


def _joint_names(chain: SerialChain, faults: FaultList) -> list[str]:
    names: list[str] = []
    for k, joint in enumerate(chain.joints):
        given = joint.joint.name
        name = identifier(given)
        if name_fault(name, "joint") is not None or name in names:
            name = f"q{k + 1}"
        if name != given:
            faults.warning(joint.joint.place, f"joint '{given}' is called {name}", "a name is a C identifier")
        names.append(name)
    return names


def _rows(names: list[str], chain: SerialChain, table: DenavitHartenberg, choice: ChainChoice) -> list[JointSpec]:
    """The rows of the robot file; those without a joint are named after the joint behind them."""
    rows: list[JointSpec] = []
    taken = set(names)
    for i, row in enumerate(table.rows):
        twist = row if choice.convention == "standard" else table.rows[i - 1] if i else Row()
        geometry = {"alpha": exact_angle(twist.alpha), "a": exact_length(twist.a)}
        geometry |= {"d": exact_length(row.d), "theta": exact_angle(row.theta)}
        if row.joint is None:
            behind = names[table.rows[i + 1].joint or 0]
            name = next(
                each for each in in_turn((f"tilt_{behind}",), map("tilt{}".format, count(1))) if each not in taken
            )
            taken.add(name)
            rows.append(JointSpec(name, "revolute", **geometry))
        else:
            joint = chain.joints[row.joint].joint
            kind: JointType = "revolute" if joint.kind == "revolute" else "prismatic"
            named = JointSpec(names[row.joint], kind, **geometry)
            rows.append(replace(named, limits=joint.limits, friction=joint.friction, drive=joint.drive))
    return rows


def _links(chain: SerialChain, table: DenavitHartenberg, faults: FaultList) -> tuple[LinkSpec, ...] | None:
    if not any(chain.links):
        hint = "without links, base parameters are an input of the model at run time"
        faults.warning(None, "no link of the chain has inertia", hint)
        return None
    links = []
    for row, frame in zip(table.rows, table.link_frames, strict=True):
        inertia = None if row.joint is None else chain.links[row.joint]
        if row.joint is not None and inertia is None:
            joint = chain.joints[row.joint].joint
            faults.warning(joint.place, f"the link behind '{joint.name}' has no inertia", "its mass is taken as 0")
        links.append(link_in_frame(inertia, frame))
    return tuple(links)


def link_in_frame(inertia: Inertia | None, frame: Array) -> LinkSpec:
    """The link with this ``inertia``, converted to the link frame ``frame`` (4, 4); massless if it is None.

    Inertia and the pose of the link frame are given in one common frame.
    """
    if inertia is None:
        return LinkSpec(sp.S.Zero, (sp.S.Zero,) * 3, (sp.S.Zero,) * 6, "com")
    moved = inertia.moved(inverse(frame))
    x, y, z = (decimal(value) for value in moved.com)
    places = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    return LinkSpec(decimal(moved.mass), (x, y, z), tuple(decimal(moved.tensor[place]) for place in places), "com")


def fixed_transform(T: Array) -> FixedTransform:
    """Convert a rigid transform (4, 4) to exact entries; others than simple numbers are rounded to 25 decimals."""
    x, y, z = (exact_length(value) for value in T[:3, 3])
    return FixedTransform(exact_rotation(T[:3, :3]), (x, y, z))
