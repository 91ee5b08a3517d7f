"""Computation of Denavit-Hartenberg rows from joint axes in space.

The chain is ``base Rz(theta_1) Tz(d_1) . Tx(a_1) Rx(alpha_1) . Rz(theta_2) Tz(d_2) ... tool`` with z along the axis of
joint i in the i-th factor Rz Tz: the common perpendicular of axes i and i+1 is the x axis between them. Where axes
intersect, it has the direction of their vector product; where they are parallel, it starts at the last origin; where
they coincide, the last x axis is kept. Of its two directions the one with theta in (-90, 90] degrees is taken, so that
a may be negative.

The common perpendicular of nearly parallel axes may lie kilometres away, where doubles lose the digits of positions and
inertia. There a *fixed row* stands between the rows of the two joints: a row without motion, whose axis leads from one
joint axis to the other at a right angle. It holds the small tilt, and all frames stay at the arm.

Every row starts from the frame that the rows before it give. Where an angle was replaced by an exact one, the following
rows are computed from the changed frame, so that errors do not add up from row to row; only the change of the last row
moves the tip.

A branch starts from the frame of the link that carries it, in the modified convention: the common perpendicular to its
first axis gives gamma and b of its first row.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import chain as in_turn
from itertools import count
from typing import Any

import numpy as np
import sympy as sp

from rrrgen.base.yamltext.document import FaultList
from rrrgen.robot.file.quantities import LARGEST_BARE_LENGTH
from rrrgen.robot.importers.interface import ChainChoice, Found, ImportedChain, Source, warn_of_rounded_angles
from rrrgen.robot.importers.trees.bodies import Inertia, Tree
from rrrgen.robot.importers.trees.exact_numbers import (
    EQUAL,
    HIGH,
    NOISE,
    Array,
    cross,
    decimal,
    exact_angle,
    exact_length,
    exact_multiple,
    exact_rotation,
    identity,
    inverse,
    norm,
    number,
    rotation,
    transform,
    vector,
)
from rrrgen.robot.importers.trees.serial_chain import (
    Branch,
    Ends,
    SerialChain,
    drives_of,
    followed_rows,
    serial_chain,
    with_followers,
)
from rrrgen.robot.spec import (
    Convention,
    FixedTransform,
    JointSpec,
    JointType,
    LinkSpec,
    RobotSpec,
    TipSpec,
    identifier,
    name_fault,
    robot_identifier,
)

PARALLEL = 1e-8  # rad; nearer directions are one: doubles lose as much at a perpendicular 10^8 times as far away
NO_TILT = 1e-11  # rad; the same where fixed rows are allowed: the pose changes by 3e-11 of the reach
FAR = 1e3  # m; with frames farther away doubles lose more than 1e-10 of the torques of an arm of 1 m, as (d/m)^2 eps
_Z = vector((0, 0, 1))


@dataclass
class TableRow:
    """One row of the table at q = 0: ``theta`` about and ``d`` along z, then ``a`` along and ``alpha`` about the new x.

    Angles are in rad, lengths in m. ``joint`` is the number (from 0) of its joint in the chain; None for a fixed row.
    ``parent`` is the row before it. ``start``, of the first row of a branch, is the step to its axis from the frame of
    the link that carries it: theta and d are gamma and b.
    """

    theta: Any = 0
    d: Any = 0
    a: Any = 0
    alpha: Any = 0
    joint: int | None = None
    parent: int = -1
    start: TableRow | None = None


@dataclass
class DenavitHartenberg:
    """Rows (theta, d, a, alpha) at q = 0 with ``base`` and ``tool`` (4, 4), and the link frames (4, 4) in the base.

    ``rounded`` lists by how much (rad) each angle was changed to make it exact; ``tips`` is the row and the tool (4, 4)
    of every tip by name, if there are several.
    """

    base: Array
    rows: list[TableRow]
    tool: Array
    link_frames: list[Array]
    rounded: list[Any] = field(default_factory=list)
    tips: dict[str, tuple[int, Array]] = field(default_factory=dict)


def denavit_hartenberg(
    chain: SerialChain, convention: Convention, tolerance: float, fixed_rows: bool = False
) -> DenavitHartenberg:
    """The rows of ``chain``; an angle within ``tolerance`` (rad) of a multiple of 15 degrees becomes that multiple.

    With ``fixed_rows``, fixed rows hold the tilt of nearly parallel axes; otherwise there is a row for every joint. A
    chain with branches has modified rows.
    """
    table = _JointWalk(chain, convention, number(tolerance), fixed_rows).result
    if not chain.branches:
        return table
    row_of = {row.joint: i for i, row in enumerate(table.rows)}
    table.tips[chain.tip] = row_of[chain.trunk - 1], table.tool
    for branch in chain.branches:
        carrier = row_of[branch.parent] if branch.parent >= 0 else -1
        frame = table.link_frames[carrier] if carrier >= 0 else table.base
        if not branch.joints:
            table.tips[branch.tip] = carrier, inverse(frame) @ branch.tip_pose
            continue
        more = _JointWalk(chain, convention, number(tolerance), fixed_rows, branch, frame).result
        first, *rows = more.rows
        for k, row in enumerate(rows):
            row.parent = len(table.rows) + k - 1 if k else carrier
        rows[0].start = first
        row_of |= {row.joint: len(table.rows) + k for k, row in enumerate(rows)}
        table.rows += rows
        table.link_frames += more.link_frames[1:]
        table.rounded += more.rounded
        table.tips[branch.tip] = len(table.rows) - 1, more.tool
    return table


class _JointWalk:
    """Goes along the joints to the first tip, or from the ``frame`` of the link that carries a ``branch`` to its tip.

    The first row of a branch is the step from that frame, a row without a joint.
    """

    def __init__(
        self,
        chain: SerialChain,
        convention: Convention,
        tolerance: Any,
        fixed_rows: bool,
        branch: Branch | None = None,
        frame: Array | None = None,
    ) -> None:
        self.chain, self.tolerance = chain, tolerance
        self.parallel = max(tolerance, number(NO_TILT if fixed_rows else PARALLEL))
        self.tip_pose = chain.tip_pose if branch is None else branch.tip_pose
        if frame is None:
            self.frame, d = _first_frame(chain)
            self.rows = [TableRow(d=d, joint=0)]
        else:
            self.frame, d = frame, number(0)
            self.rows = [TableRow()]
        self.result = DenavitHartenberg(self.frame, self.rows, identity(), [])
        self._move(transform(identity(3), (0, 0, d)))
        for k in range(1, chain.trunk) if branch is None else branch.joints:
            joint = chain.joints[k]
            across = (
                self._tilted_axis(joint.point, joint.direction)
                if fixed_rows and len(self.rows) > (branch is not None)
                else None
            )
            if across is not None:
                self._to_axis(*across, convention, None)
            self._to_axis(joint.point, joint.direction, convention, k)
        self._to_tip(convention)

    def _tilted_axis(self, point: Array, direction: Array) -> tuple[Array, Array] | None:
        """The axis (point, direction) of a fixed row towards the next axis; None where no fixed row is needed.

        It starts at the last origin and meets the next axis where that crosses the plane normal to z.
        """
        p, u = self._axis_in_last_frame(point, direction)
        _, height = self._perpendicular(p, u)
        if abs(height) <= FAR:
            return None
        met = p - p[2] / u[2] * u
        return self.frame[:3, 3], self.frame[:3, :3] @ (met / norm(met))

    def _axis_in_last_frame(self, point: Array, direction: Array) -> tuple[Array, Array]:
        """An axis in the last frame."""
        to_frame = inverse(self.frame)
        return to_frame[:3, :3] @ point + to_frame[:3, 3], to_frame[:3, :3] @ direction

    def _move(self, step: Array) -> None:
        self.frame = self.frame @ step

    def _exact(self, angle: Any) -> Any:
        exact = exact_multiple(angle, self.tolerance)
        if abs(exact - angle) > EQUAL:
            self.result.rounded.append(abs(exact - angle))
        return exact

    def _to_axis(self, point: Array, direction: Array, convention: Convention, joint: int | None) -> None:
        """Complete the last row so that it leads to the next axis (``point``, ``direction``), and begin its row."""
        p, u = self._axis_in_last_frame(point, direction)
        x, height = self._perpendicular(p, u)
        theta = self._exact(HIGH.atan2(x[1], x[0]))
        x = vector((HIGH.cos(theta), HIGH.sin(theta), 0))
        side = cross(_Z, x)
        alpha = self._exact(HIGH.atan2(-sum(u * side), u[2]))
        a = _no_noise(sum(p * x))
        row = self.rows[-1]
        row.theta, row.d, row.a, row.alpha = row.theta + theta, row.d + height, a, alpha
        self._move(transform(rotation((0, 0, 1), theta), (0, 0, height)))
        self._link_frame(convention, "modified")
        self._move(transform(rotation((1, 0, 0), alpha), (a, 0, 0)))
        self._link_frame(convention, "standard")
        self.rows.append(TableRow(joint=joint, parent=len(self.rows) - 1))

    def _link_frame(self, convention: Convention, ends_here: Convention) -> None:
        if convention == ends_here:
            self.result.link_frames.append(self.frame)

    def _perpendicular(self, p: Array, u: Array) -> tuple[Array, Any]:
        """The common perpendicular of z and the axis (p, u): its direction (3,), and the height where it meets z."""
        across = HIGH.sqrt(u[0] ** 2 + u[1] ** 2)
        offset = HIGH.sqrt(p[0] ** 2 + p[1] ** 2)
        height = number(0)
        if across > self.parallel:
            x = vector((-u[1] / across, u[0] / across, 0))
            y = cross(_Z, x)
            height = _no_noise(p[2] - sum(p * y) / sum(u * y) * u[2])
        elif offset > NOISE:
            x = vector((p[0] / offset, p[1] / offset, 0))
        else:
            x = vector((1, 0, 0))
        backwards = x[0] < -EQUAL or (abs(x[0]) <= EQUAL and x[1] < 0)
        return (-x if backwards else x), height

    def _to_tip(self, convention: Convention) -> None:
        """Complete the last row so that the rotation about and shift along the last axis lead to the tip; set the tool.

        The tool is the transform that then remains between the last link frame and the tip.
        """
        rest = inverse(self.frame) @ self.tip_pose
        row = self.rows[-1]
        theta, height = number(0), _no_noise(rest[2, 3])
        if abs(rest[2, 2] - 1) <= EQUAL:
            theta = self._exact(HIGH.atan2(rest[1, 0], rest[0, 0]))
        row.theta, row.d = row.theta + theta, row.d + height
        self._move(transform(rotation((0, 0, 1), theta), (0, 0, height)))
        self.result.link_frames.append(self.frame)
        tool = inverse(self.frame) @ self.tip_pose
        tool[:3, 3] = [_no_noise(x) for x in tool[:3, 3]]
        self.result.tool = tool


def _no_noise(length: Any) -> Any:
    return length if abs(length) > NOISE else number(0)


def _first_frame(chain: SerialChain) -> tuple[Array, Any]:
    """Choose a frame with z on the first joint axis, if possible the base frame: (frame, height of the joint)."""
    first = chain.joints[0]
    z, p = first.direction, first.point
    if abs(abs(z[2]) - 1) <= EQUAL:
        turned = HIGH.pi if z[2] < 0 else number(0)
        return transform(rotation((1, 0, 0), turned), (_no_noise(p[0]), _no_noise(p[1]), 0)), _no_noise(p[2] * z[2])
    x = _across(z, [*identity(3), *first.frame[:3, :3].T])
    R = identity(3)
    R[:, 0], R[:, 1], R[:, 2] = x, cross(z, x), z
    return transform(R, [_no_noise(value) for value in p]), number(0)


def _across(z: Array, candidates: Sequence[Array]) -> Array:
    """Choose a unit vector perpendicular to ``z``.

    It is the first perpendicular one of the ``candidates``; if there is none, the candidate nearest to perpendicular is
    projected on the plane normal to ``z``.
    """
    for x in candidates:
        if abs(sum(x * z)) <= EQUAL:
            return x
    x = min(candidates, key=lambda candidate: abs(sum(candidate * z)))
    x = x - sum(x * z) * z
    return np.asarray(x / norm(x))


# ------------------------------------------------------------------------------------------------------------------
# Conversion of a tree of bodies to a robot description: rows, links in their link frames, friction, drives.
# ------------------------------------------------------------------------------------------------------------------


def robot_of_tree(tree: Tree, source: Source, rounded: list[Any], faults: FaultList) -> Found | None:
    """Convert the chain that ``source`` chooses in ``tree`` to a robot; None and faults where there is no such chain.

    ``rounded`` are the changes (rad) that reading the file has made to angles.
    """
    choice = source.chain
    if choice.further_tips and choice.convention == "standard":
        faults.error(None, "standard rows cannot branch", "--convention modified writes gamma and b for branches")
        return None
    ends = Ends(choice.base, choice.tip, choice.held, choice.further_tips, choice.held_units)
    chain = serial_chain(tree, ends, faults)
    if chain is None:
        return None
    table = denavit_hartenberg(chain, choice.convention, choice.angle_tolerance, fixed_rows=True)
    changes = [float(change) for change in (*rounded, *table.rounded)]
    warn_of_rounded_angles(changes, choice.angle_tolerance, faults)
    _tell_about_distance(chain, table, faults)
    _tell_about_held(chain, faults)
    names = _joint_names(chain, faults)
    links = _links(chain, table, faults)
    rows = _rows(names, chain, table, choice)
    _tell_about_fixed_rows(chain, table, rows, choice, faults)
    parents = tuple(row.parent for row in table.rows)
    joints, mechanism = with_followers(rows, [row.joint for row in table.rows], parents, faults, chain)
    if mechanism is not None and tree.shafts:
        faults.warning(
            tree.shafts[0].place, "tendons are left out", "beside joints that follow others they are not read"
        )
    g = [decimal(x) for x in chain.gravity]
    tips = _tips(table, rows, faults)
    if faults.errors:
        return None
    spec = RobotSpec(
        name=robot_identifier(tree.name) or source.name,
        convention=choice.convention,
        gravity=(g[0], g[1], g[2]),
        parameters={},
        joints=joints,
        links=links,
        base=fixed_transform(table.base),
        drives=drives_of(tree, chain, names, faults) if mechanism is None else None,
        mechanism=mechanism,
        tool=fixed_transform(table.tool),
        tips=tips,
        description=f"{chain.base} to {', '.join([chain.tip, *(branch.tip for branch in chain.branches)])}",
    )
    held = {joint: float(value) for joint, value in chain.held.items()}
    offsets = tuple(0.0 if followed is None else float(followed.offset) for followed in followed_rows(chain))
    moving = tuple(chain_joint.joint.name for chain_joint in chain.joints)
    places = tuple(i for i, row in enumerate(table.rows) if row.joint is not None)
    links_of_tips = dict(zip(tips, table.tips, strict=True))
    imported = ImportedChain(chain.base, chain.tip, moving, held, offsets, places, links_of_tips, sum(changes))
    return Found(spec, imported, tree.place)


def _tips(table: DenavitHartenberg, rows: list[JointSpec], faults: FaultList) -> dict[str, TipSpec]:
    tips: dict[str, TipSpec] = {}
    for k, (link, (row, tool)) in enumerate(table.tips.items(), 1):
        if row < 0:
            faults.error(None, f"no joint moves the tip '{link}'", "leave it out, or choose another --base")
            continue
        name = identifier(link)
        if name_fault(name, "tip") is not None or name in tips:
            name = f"tip{k}"
        if name != link:
            faults.warning(None, f"tip '{link}' is called {name}", "a name is a C identifier")
        tips[name] = TipSpec(rows[row].name, fixed_transform(tool))
    return tips


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
            before, behind = (chain.joints[table.rows[k].joint or 0] for k in (row.parent, i + 1))
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
        before = row.start or (table.rows[row.parent] if i else TableRow())
        twist = row if choice.convention == "standard" else before
        geometry = {} if row.start is None else {"gamma": exact_angle(before.theta), "b": exact_length(before.d)}
        geometry |= {"alpha": exact_angle(twist.alpha), "a": exact_length(twist.a)}
        geometry |= {"d": exact_length(row.d), "theta": exact_angle(row.theta)}
        if row.joint is None:
            behind = names[table.rows[i + 1].joint or 0]
            name = next(
                candidate
                for candidate in in_turn((f"tilt_{behind}",), map("tilt{}".format, count(1)))
                if candidate not in taken
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
    moved = inertia.transform(inverse(frame))
    x, y, z = (decimal(value) for value in moved.com)
    places = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    return LinkSpec(decimal(moved.mass), (x, y, z), tuple(decimal(moved.tensor[place]) for place in places), "com")


def fixed_transform(T: Array) -> FixedTransform:
    """Convert a rigid transform (4, 4) to exact entries; others than simple numbers are rounded to 25 decimals."""
    x, y, z = (exact_length(value) for value in T[:3, 3])
    return FixedTransform(exact_rotation(T[:3, :3]), (x, y, z))
