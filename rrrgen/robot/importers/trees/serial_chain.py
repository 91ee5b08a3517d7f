"""The chain from one body of a tree to another, or to several: its axes in space, and the inertia of each link."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import sympy as sp

from rrrgen.base.yamltext.document import FaultList
from rrrgen.base.yamltext.suggestions import did_you_mean
from rrrgen.base.yamltext.units import QUANTITIES, Unit
from rrrgen.robot.file.fields import MAX_JOINTS
from rrrgen.robot.file.mechanism import mechanism_of_rows
from rrrgen.robot.importers.trees.bodies import MOVING, NO_INERTIA, Inertia, Shaft, Tree, TreeJoint
from rrrgen.robot.importers.trees.exact_numbers import Array, decimal, identity, inverse, number, rotation, transform
from rrrgen.robot.spec import (
    DriveSpec,
    DrivesSpec,
    FrictionSpec,
    JointSpec,
    Limits,
    MechanismSpec,
    MotorSpec,
    identifier,
)

MAX_NAMED = 12  # candidates that one message lists


@dataclass(frozen=True)
class SerialJoint:
    """A joint of the chain at its zero position, in the base frame: a point (3,) on its axis, its unit direction (3,).

    ``frame`` (4, 4) is the frame in which the file states the axis.
    """

    joint: TreeJoint
    point: Array
    direction: Array
    frame: Array


@dataclass(frozen=True)
class Branch:
    """The way to a further ``tip``: ``joints`` of the chain, numbered from 0, behind joint ``parent`` (-1: the base).

    There are none where the tip is on the way to another. ``tip_pose`` is (4, 4), in the base frame.
    """

    tip: str
    parent: int
    joints: range
    tip_pose: Array


@dataclass(frozen=True)
class SerialChain:
    """A serial chain at its zero position, in the base frame: its joints, their links, and the pose of the tip.

    ``links`` are the inertias that the joints carry; None where no body of a link states one. ``tip_pose`` has shape
    (4, 4), ``gravity`` (3,). ``held`` are the joints outside the chain, with the value at which they are held.
    ``branches`` lead to further tips; their joints follow those to the first.
    """

    base: str
    tip: str
    joints: tuple[SerialJoint, ...]
    links: tuple[Inertia | None, ...]
    tip_pose: Array
    gravity: Array
    held: Mapping[str, Any]
    branches: tuple[Branch, ...] = ()

    @property
    def trunk(self) -> int:
        """The number of joints on the way to the first tip."""
        return len(self.joints) - sum(len(branch.joints) for branch in self.branches)


@dataclass(frozen=True)
class Ends:
    """The user's choice of a chain: names of the bodies at its ends, and joints to hold at a value (rad, m).

    An empty ``base`` is the root of the tree, an empty ``tip`` its only leaf; ``further`` are the tips of branches.
    ``units`` are those in which values of held joints were stated.
    """

    base: str = ""
    tip: str = ""
    held: Mapping[str, Any] | None = None
    further: tuple[str, ...] = ()
    units: Mapping[str, Unit] | None = None


def motion(joint: TreeJoint, q: Any) -> Array:
    """The transform (4, 4) of a joint at ``q``, in its own frame."""
    if joint.kind == "revolute":
        return transform(rotation(joint.axis, q), (0, 0, 0))
    if joint.kind == "prismatic":
        return transform(identity(3), [q * x for x in joint.axis])
    return identity()


def serial_chain(tree: Tree, ends: Ends, faults: FaultList) -> SerialChain | None:
    """The chain of ``tree`` between its ``ends``; None and faults where there is no such chain."""
    held = dict(ends.held or {})
    _check_held(tree, held, ends.units or {}, faults)
    base = _body(ends.base or tree.root, tree, faults, "base")
    tip = _body(ends.tip, tree, faults, "tip") if ends.tip else _only_tip(tree, base, held, faults)
    further = [_body(name, tree, faults, "tip") for name in ends.further]
    if base is None or tip is None or faults.errors:
        return None
    paths = {name: list(_path(tree, base, name)) for name in (tip, *further) if name is not None}
    moving = {
        name: [(joint, forward) for joint, forward in path if joint.moves and joint.name not in held]
        for name, path in paths.items()
    }
    on_chain = {joint.name: joint for way in moving.values() for joint, _ in way}
    for name, way in moving.items():
        _check_path(tree, base, name, way, on_chain, faults)
    _check_constraints(tree, on_chain, faults)
    if faults.errors:
        return None
    beside = _beside(tree, held, set(on_chain), faults)
    return _in_space(tree, base, paths, set(on_chain), beside)


def _beside(tree: Tree, held: Mapping[str, Any], on_chain: set[str], faults: FaultList) -> dict[str, Any]:
    """Values (rad, m), by name, of the moving joints outside the chain.

    A joint has the value at which the user holds it, the value that follows from the joint that it mimics, or zero.
    """
    joints = {joint.name: joint for joint in tree.joints if joint.moves}

    def value(joint: TreeJoint, depth: int) -> Any:
        if joint.name in held or joint.mimic is None or depth > len(joints):
            return number(held.get(joint.name, 0))
        if joint.mimic.of in on_chain and depth == 0:
            hint = "what it carries is held at the pose of the chain's zero; coupled joints are in the chain itself"
            message = f"joint '{joint.name}' beside the chain follows '{joint.mimic.of}'"
            faults.warning(joint.place, message, hint)
        followed = joints.get(joint.mimic.of)
        start = number(0) if followed is None or joint.mimic.of in on_chain else value(followed, depth + 1)
        return joint.mimic.multiplier * start + joint.mimic.offset

    return {name: value(joint, 0) for name, joint in joints.items() if name not in on_chain}


def _check_held(tree: Tree, held: Mapping[str, Any], units: Mapping[str, Unit], faults: FaultList) -> None:
    kinds = {joint.name: joint.kind for joint in tree.joints if joint.kind in MOVING}
    for name in held:
        if name not in kinds:
            hint = did_you_mean(name, list(kinds)) or f"joints that can be held: {_list_names(list(kinds))}"
            faults.error(None, f"there is no joint '{name}' to hold", hint)
            continue
        quantity, unit = QUANTITIES["angle" if kinds[name] == "revolute" else "length"], units.get(name)
        if unit is not None and unit.dimension != quantity.dimension:
            message = f"joint '{name}' is {kinds[name]}: it cannot be held at a value in {unit.name}"
            faults.error(None, message, f"{quantity.name}: {', '.join(quantity.units)}")


def _body(name: str, tree: Tree, faults: FaultList, what: str) -> str | None:
    if name in tree.bodies:
        return name
    hint = did_you_mean(name, list(tree.bodies)) or f"links are {_list_names(list(tree.bodies))}"
    faults.error(None, f"the {what}: there is no link '{name}'", hint)
    return None


def _list_names(names: list[str]) -> str:
    more = f", ... ({len(names)} in all)" if len(names) > MAX_NAMED else ""
    return ", ".join(names[:MAX_NAMED]) + more


def _only_tip(tree: Tree, base: str | None, held: Mapping[str, Any], faults: FaultList) -> str | None:
    """The only leaf that moves relative to the base; a fault that lists the candidates where there are several."""
    if base is None:
        return None
    below = tree.joints_below()
    leaves: list[tuple[int, str]] = []
    stack = [(base, 0)]
    while stack:
        body, count = stack.pop()
        if not below[body] and body != base:
            leaves.append((count, body))
        stack += [(joint.child, count + (joint.moves and joint.name not in held)) for joint in below[body]]
    leaves = [leaf for leaf in leaves if leaf[0]] or leaves
    if not leaves:
        faults.error(tree.bodies[base].place, f"no joint leads away from '{base}'", "choose another base")
        return None
    if len(leaves) == 1:
        return leaves[0][1]
    shown = sorted(leaves, key=lambda leaf: (-leaf[0], leaf[1]))[:MAX_NAMED]
    named = ", ".join(f"{body} ({count} joints)" for count, body in shown)
    more = ", ..." if len(leaves) > MAX_NAMED else ""
    hint = f"choose one with --tip, or several for a robot that branches: {named}{more}, or a link before them"
    faults.error(tree.bodies[base].place, f"the file has {len(leaves)} chains from '{base}'", hint)
    return None


def _path(tree: Tree, base: str, tip: str) -> Iterator[tuple[TreeJoint, bool]]:
    """The joints between two bodies, and whether each is passed from parent to child."""
    above = tree.joint_above()

    def to_root(body: str) -> list[TreeJoint]:
        joints = []
        while body in above:
            joints.append(above[body])
            body = above[body].parent
        return joints

    up, down = to_root(base), to_root(tip)
    while up and down and up[-1] is down[-1]:
        up.pop()
        down.pop()
    for joint in up:
        yield joint, False
    for joint in reversed(down):
        yield joint, True


def _check_path(
    tree: Tree,
    base: str,
    tip: str,
    moving: list[tuple[TreeJoint, bool]],
    on_chain: Mapping[str, TreeJoint],
    faults: FaultList,
) -> None:
    for joint, forward in moving:
        if joint.kind not in MOVING:
            there = f"{'begin behind it with --base' if forward else 'end before it with --tip'} {_link(tree, joint)}"
            hint = f"revolute and prismatic joints make a serial chain; {there}"
            faults.error(joint.place, f"joint '{joint.name}' on the chain is {joint.kind}", hint)
        elif joint.mimic is not None and not _leads_to_drive(joint, on_chain):
            hint = f"hold it with --hold {joint.name}=0, or choose other ends with --base and --tip"
            message = f"joint '{joint.name}' on the chain follows '{joint.mimic.of}', which is not a moving joint of it"
            faults.error(joint.place, message, hint)
    place = tree.bodies[tip].place
    if not moving:
        faults.error(place, f"no joint moves between '{base}' and '{tip}'", "choose other ends with --base and --tip")
    if len(moving) > MAX_JOINTS:
        faults.error(place, f"{len(moving)} joints between '{base}' and '{tip}'", f"at most {MAX_JOINTS}")


def _link(tree: Tree, joint: TreeJoint) -> str:
    """The link of the file behind ``joint``; between the joints of one body of an MJCF there are invented ones."""
    above, below = tree.joint_above(), tree.joints_below()
    body = joint.child
    while above[body].kind != "fixed" and tree.bodies[body].place == above[body].place:
        body = below[body][0].child
    return body


def _check_constraints(tree: Tree, on_chain: Collection[str], faults: FaultList) -> None:
    """Report constraints that close a loop through a joint of the chain as faults, and others as left out.

    A loop through a free joint constrains nothing but the free body.
    """
    for constraint in tree.constraints:
        loop = [joint for joint, _ in _path(tree, *constraint.bodies)]
        inside = next((joint.name for joint in loop if joint.name in on_chain), None)
        if inside is None or any(joint.kind == "free" for joint in loop):
            hint = "it holds no joint of the chain"
            faults.warning(constraint.place, f"the {constraint.name} is left out", hint)
        else:
            message = f"the {constraint.name} constrains joint '{inside}' of the chain"
            hint = f"hold it with --hold {inside}=0, choose other ends, or delete the constraint"
            faults.error(constraint.place, message, hint)


def _leads_to_drive(joint: TreeJoint, on_chain: Mapping[str, TreeJoint]) -> bool:
    """Whether the joints that ``joint`` follows, one after the other, are on the chain and end at a drive."""
    seen = {joint.name}
    while joint.mimic is not None:
        if joint.mimic.of in seen or joint.mimic.of not in on_chain:
            return False
        seen.add(joint.mimic.of)
        joint = on_chain[joint.mimic.of]
    return True


def _in_space(
    tree: Tree,
    base: str,
    paths: Mapping[str, list[tuple[TreeJoint, bool]]],
    on_chain: set[str],
    held: Mapping[str, Any],
) -> SerialChain:
    """The joints along the ``paths`` from ``base`` to each tip, those that several pass once."""
    poses = _poses(tree, base, held)
    joints: list[SerialJoint] = []
    owner = {base: 0}
    branches: list[Branch] = []
    for tip, path in paths.items():
        start, carrier = len(joints), 0
        for joint, forward in path:
            body = joint.child if forward else joint.parent
            if body not in owner:
                if joint.name in on_chain:
                    frame = poses[joint.parent] @ joint.origin
                    direction = frame[:3, :3] @ joint.axis
                    joints.append(SerialJoint(joint, frame[:3, 3], direction if forward else -direction, frame))
                owner[body] = len(joints) if len(joints) > start else carrier
            elif len(joints) == start:
                carrier = owner[body]
        branches.append(Branch(tip, carrier - 1, range(start, len(joints)), poses[tip]))
    links = _links(tree, owner, poses, len(joints))
    gravity = poses[tree.root][:3, :3] @ tree.gravity
    first, *further = branches
    return SerialChain(base, first.tip, tuple(joints), links, first.tip_pose, gravity, held, tuple(further))


def _poses(tree: Tree, base: str, held: Mapping[str, Any]) -> dict[str, Array]:
    """The pose (4, 4) of every body in the frame of the base, joints at zero or where they are held."""
    poses = {tree.root: identity()}
    below = tree.joints_below()
    stack = [tree.root]
    while stack:
        body = stack.pop()
        for joint in below[body]:
            q = held.get(joint.name, 0)
            poses[joint.child] = poses[body] @ joint.origin @ motion(joint, number(q))
            stack.append(joint.child)
    to_base = inverse(poses[base])
    return {name: to_base @ T for name, T in poses.items()}


def _links(tree: Tree, owner: dict[str, int], poses: Mapping[str, Array], count: int) -> tuple[Inertia | None, ...]:
    """The inertia that each joint of the chain carries: that of the bodies after it, with branches attached to them.

    ``owner`` maps the bodies on the chain to the number of the joint before them, 0 for the base; ``poses`` are the
    poses of all bodies in the base frame, ``count`` the number of joints.
    """
    neighbours: dict[str, list[str]] = {name: [] for name in tree.bodies}
    for joint in tree.joints:
        neighbours[joint.parent].append(joint.child)
        neighbours[joint.child].append(joint.parent)
    carried = dict(owner)
    stack = list(owner)
    while stack:
        body = stack.pop()
        for other in neighbours[body]:
            if other not in carried:
                carried[other] = carried[body]
                stack.append(other)
    links: list[Inertia | None] = [None] * (count + 1)
    for tree_body in tree.bodies.values():
        if tree_body.inertia is not None and tree_body.name in carried:
            k = carried[tree_body.name]
            links[k] = (links[k] or NO_INERTIA) + tree_body.inertia.transform(poses[tree_body.name])
    return tuple(links[1:])


# ------------------------------------------------------------------------------------------------------------------
# Conversion of mimic joints of an imported chain to rows of a robot file that follow a driven joint.
# ------------------------------------------------------------------------------------------------------------------


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
    places = {chain_joint.joint.name: k for k, chain_joint in enumerate(chain.joints)}
    motions: list[Followed | None] = []
    for chain_joint in chain.joints:
        joint, factor, offset = chain_joint.joint, sp.S.One, sp.S.Zero
        while joint.mimic is not None:
            offset += factor * decimal(joint.mimic.offset)
            factor *= decimal(joint.mimic.multiplier)
            joint = chain.joints[places[joint.mimic.of]].joint
        motions.append(None if joint is chain_joint.joint else Followed(places[joint.name], factor, offset))
    return motions


def with_followers(
    joints: Sequence[JointSpec],
    places: Sequence[int | None],
    parents: tuple[int, ...],
    faults: FaultList,
    chain: SerialChain,
) -> tuple[tuple[JointSpec, ...], MechanismSpec | None]:
    """Make the driven joints and the mechanism that relates all rows to them; None where each row is a driven joint.

    ``joints`` are the rows, and ``places`` the number in ``chain`` of the joint of each, None for a fixed row;
    ``parents`` are the rows that carry them.
    Friction, inertia and limits of a following joint are transferred to the joint that it follows; a warning says so.
    """
    motions = followed_rows(chain)
    if not any(motions) and None not in places and not chain.branches:
        return tuple(joints), None
    rows = list(joints)
    row_of = {joint: k for k, joint in enumerate(places) if joint is not None}
    follows = {
        row_of[k]: None if followed is None else replace(followed, of=row_of[followed.of])
        for k, followed in enumerate(motions)
    }
    matrix = []
    driven = [k for k, followed in follows.items() if followed is None]
    for k, row in enumerate(joints):
        if k not in follows:
            matrix.append([sp.S.Zero for _ in driven])
            continue
        followed = follows[k]
        matrix.append([sp.S.One if (k if followed is None else followed.of) == i else sp.S.Zero for i in driven])
        if followed is None:
            continue
        offset = {"theta" if row.is_revolute else "d": (row.theta if row.is_revolute else row.d) + followed.offset}
        rows[followed.of] = _carrying(rows[followed.of], row, float(followed.factor))
        # limits count from the zero of the row's own variable, which now is the offset
        ends = (row.limits.lower, row.limits.upper) if followed.factor != 0 else (None, None)  # a fixed one has none
        bounds = (None if v is None else v - float(followed.offset) for v in ends)
        rows[k] = replace(row, limits=Limits(*bounds), friction=None, drive=None, **offset)
        matrix[-1] = [value * followed.factor for value in matrix[-1]]
        place = chain.joints[places[k] or 0].joint.place
        message = f"joint '{row.name}' follows '{rows[followed.of].name}' and is no joint of q"
        hint = "its friction, inertia and limits of position and speed count at the joint that it follows"
        torque = "" if row.limits.torque is None else "; its torque limit is left out"
        faults.warning(place, message, hint + torque)
    return mechanism_of_rows(rows, parents, row_of[chain.trunk - 1], [tuple(row) for row in matrix], driven)


def _carrying(joint: JointSpec, row: JointSpec, factor: float) -> JointSpec:
    """Add the limits, friction and inertia of a follower, which moves ``factor`` times as far, to ``joint``.

    Friction and inertia of the follower count ``factor`` squared times (Coulomb friction |factor| times).
    """
    size = abs(factor)
    if not size:
        return joint
    ends = {name: getattr(joint.limits, name) for name in ("velocity", "acceleration")}
    for name, limit in ends.items():
        other = getattr(row.limits, name)
        ends[name] = limit if other is None else other / size if limit is None else min(limit, other / size)
    friction, drive = joint.friction, joint.drive
    if row.friction is not None:
        old = friction or FrictionSpec()
        viscous = _total(old.viscous, row.friction.viscous, factor * factor)
        friction = replace(old, viscous=viscous, coulomb=_total(old.coulomb, row.friction.coulomb, size))
    if row.drive is not None and row.drive.inertia is not None:
        old_drive = drive or DriveSpec()
        drive = replace(old_drive, inertia=_total(old_drive.inertia, row.drive.inertia, factor * factor))
    return replace(joint, limits=replace(joint.limits, **ends), friction=friction, drive=drive)


def _total(coefficient: float | None, other: float | None, weight: float) -> float | None:
    return coefficient if other is None else (coefficient or 0.0) + weight * other


# ------------------------------------------------------------------------------------------------------------------
# Converts shafts that move several joints of a chain into the coupled drives of a robot file.
# ------------------------------------------------------------------------------------------------------------------


def drives_of(tree: Tree, chain: SerialChain, names: Sequence[str], faults: FaultList) -> DrivesSpec | None:
    """The drives of the joints ``names``; None and warnings where shafts and joints do not determine each other.

    A joint that no shaft moves has a motor of its own, which turns with it.
    """
    places = {joint.joint.name: k for k, joint in enumerate(chain.joints)}
    shafts = [shaft for shaft in tree.shafts if shaft.weights.keys() <= places.keys()]
    for shaft in tree.shafts:
        if shaft not in shafts:
            message = f"the tendon '{shaft.name}' is left out: it moves joints beside the chain"
            faults.warning(shaft.place, message, "coupled drives move joints of the chain")
    if not shafts:
        return None
    moved = {name for shaft in shafts for name in shaft.weights}
    free = [name for name in places if name not in moved]
    units = [[sp.Integer(int(place == places[name])) for place in range(len(names))] for name in free]
    rows = [_row(shaft, places) for shaft in shafts] + units
    matrix = sp.Matrix(rows)
    if matrix.rows != matrix.cols or matrix.det() == 0:
        message = f"{len(shafts)} tendons move {len(moved)} joints: they are left out"
        faults.warning(shafts[0].place, message, "as many independent tendons as joints that they move")
        return None
    inverse = matrix.inv(method="LU")
    motors = [_motor(shaft, k) for k, shaft in enumerate(shafts)]
    motors += [MotorSpec(name=f"{names[places[name]]}_drive") for name in free]
    n = len(names)
    return DrivesSpec(tuple(tuple(inverse[i, k] for k in range(n)) for i in range(n)), tuple(motors))


def _row(shaft: Shaft, places: dict[str, int]) -> list[sp.Expr]:
    row = [sp.S.Zero] * len(places)
    for name, weight in shaft.weights.items():
        row[places[name]] = decimal(weight)
    return row


def _motor(shaft: Shaft, k: int) -> MotorSpec:
    name = identifier(shaft.name.removeprefix("shaft_")) or f"m{k + 1}"
    return MotorSpec(name=name, inertia=shaft.inertia, friction=shaft.friction, torque_limit=shaft.torque_limit)
