"""OpenSYMORO ``.par``: chains, trees and closed loops in Khalil and Kleinfinger's Denavit-Hartenberg parameters.

A file lists ``NAME = VALUE`` and ``NAME = {entry, entry, ...}`` with comments ``(* ... *)``. Frame j follows from frame
``ant`` by ``Rz(gamma) Tz(b) Rx(alpha) Tx(d) Rz(theta) Tz(r)``, joint j being revolute (``sigma`` 0), prismatic
(1) or fixed (2). Angles are in rad. Inertia ``XX .. ZZ`` and first moments ``MX MY MZ`` are about the frame's origin,
``G`` is the acceleration of gravity in frame 0, and ``Z`` the pose of frame 0.

With closed loops, ``Type = 2``, the frames 1 to NL are those of a tree of links, and each loop is cut at a joint: frame
``NL + k`` is that of the cut joint number k on one link, frame ``NJ + k``, fixed to the other one, coincides with it.
``mu`` is 1 for joints with a drive.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import sympy as sp

from rrrgen.base.yamltext.document import FaultList, Place, place_at, shorten
from rrrgen.base.yamltext.expressions import FUNCTIONS, ExpressionError, Name, parse_expression
from rrrgen.robot.file.fields import MAX_JOINTS
from rrrgen.robot.file.mechanism import mechanism_of_rows
from rrrgen.robot.file.quantities import LARGEST_BARE_LENGTH, held_fault, held_number
from rrrgen.robot.file.reader import LARGEST_GRAVITY, rotation_fault
from rrrgen.robot.importers.interface import Found, Importer, Source, warn_of_rounded_angles
from rrrgen.robot.importers.trees.exact_numbers import exact_angle, exact_multiple, number
from rrrgen.robot.model.loops import LoopError, ParallelogramError, with_parallelograms_followed
from rrrgen.robot.spec import (
    DriveSpec,
    FixedTransform,
    FrictionSpec,
    JointSpec,
    JointType,
    LinkSpec,
    LoopSpec,
    RobotSpec,
    name_fault,
    parameter_symbol,
)

# ------------------------------------------------------------------------------------------------------------------
# Reader of files of assignments ``NAME = VALUE`` and ``NAME = {entry, entry, ...}`` with comments ``(* ... *)``.
# ------------------------------------------------------------------------------------------------------------------

ZERO = sp.S.Zero

_COMMENT = re.compile(r"\(\*.*?\*\)", re.DOTALL)
_ITEM = re.compile(r"([A-Za-z_]\w*)[ \t]*=\s*(?:\{([^{}]*)\}|([^\s{}=]+))")
_SYMBOL = re.compile(r"(?<![\w.])[A-Za-z_]\w*")


@dataclass(frozen=True)
class ListEntry:
    """One entry of a list: its exact value and its place (line and column) in the file."""

    expr: sp.Expr
    place: Place


class Assignments:
    """The assignments of a file; ``spellings`` maps other spellings of the names of lists to the usual ones."""

    def __init__(self, source: Source, faults: FaultList, spellings: Mapping[str, str]) -> None:
        self.source, self.faults, self.spellings = source, faults, spellings
        self.text = _COMMENT.sub(lambda comment: re.sub(r"\S", " ", comment.group()), source.text)
        self.items: dict[str, tuple[str, int]] = {}
        self.place: dict[str, Place] = {}
        self.rounded: list[float] = []
        """Changes of angles that were taken as multiples of 15 degrees, rad."""
        self._lists: dict[tuple[str, int], list[ListEntry]] = {}
        self._split()

    def _split(self) -> None:
        end = 0
        for assignment in _ITEM.finditer(self.text):
            self._refuse_rest(end, assignment.start())
            end = assignment.end()
            name = self.spellings.get(assignment.group(1), assignment.group(1))
            place = place_at(self.text, assignment.start())
            if name in self.items:
                self.faults.error(place, f"'{name}' is given twice", f"first at line {self.place[name].line}")
                continue
            group = 3 if assignment.group(2) is None else 2
            self.items[name], self.place[name] = (assignment.group(group), assignment.start(group)), place
        self._refuse_rest(end, len(self.text))

    def _refuse_rest(self, start: int, end: int) -> None:
        rest = self.text[start:end]
        if rest.strip():
            place = place_at(self.text, start + len(rest) - len(rest.lstrip()))
            hint = "allowed are NAME = VALUE, NAME = {entry, entry, ...} and comments (* ... *)"
            self.faults.error(place, f"'{shorten(rest)}' is no assignment", hint)

    def flag(self, name: str) -> str:
        """The text of a plain value ``NAME = VALUE``; empty if the file does not assign it."""
        return self.items.get(name, ("", 0))[0].strip()

    def entries(self, name: str, count: int, needed: bool = False) -> list[ListEntry]:
        """The ``count`` entries of one list; zeros if the file does not have it, a fault if it is ``needed``."""
        if (name, count) not in self._lists:
            self._lists[name, count] = self._read_list(name, count, needed)
        return self._lists[name, count]

    def _read_list(self, name: str, count: int, needed: bool) -> list[ListEntry]:
        if name not in self.items:
            if needed:
                self.faults.error(None, f"there is no list '{name}'", f"{name} = {{...}} with {count} entries")
            return [ListEntry(ZERO, Place())] * count
        text, start = self.items[name]
        entries = []
        for part in text.split(","):
            entries.append(self._entry(name, part.strip(), start + len(part) - len(part.lstrip())))
            start += len(part) + 1
        if len(entries) != count:
            message = f"{name} has {len(entries)} entries instead of {count}"
            self.faults.error(self.place[name], message, "one for each frame" if count > 4 else "")
            return [ListEntry(ZERO, self.place[name])] * count
        return entries

    def _entry(self, name: str, text: str, offset: int) -> ListEntry:
        place = place_at(self.text, offset)
        body = re.sub(r"\bPi\b", "pi", text)
        names = {word: Name(parameter_symbol(word)) for word in _SYMBOL.findall(body)}
        for word in ("pi", *FUNCTIONS):
            names.pop(word, None)
        try:
            expr = parse_expression(body, names, units=False).expr
        except ExpressionError as error:
            what = f"{name}: {error.message}" if text else f"{name}: an entry is empty"
            self.faults.error(Place(place.line, place.column + error.offset * bool(text)), what, error.hint)
            return ListEntry(ZERO, place)
        if not expr.free_symbols and held_number(expr) is None:
            words, hint = held_fault(expr)
            self.faults.error(place, f"{name}: an entry {words}", hint)
            return ListEntry(ZERO, place)
        return ListEntry(self._exact(expr) if name in ANGLES else expr, place)

    def _exact(self, angle: sp.Expr) -> sp.Expr:
        """``angle`` (rad), such as t2 + 1.5708, its number taken as the multiple of 15 degrees that it means."""
        decimal, rest = angle.as_coeff_Add()
        if decimal == 0 or rest.has(sp.pi):
            return angle
        given = number(decimal)
        exact = exact_multiple(given, number(self.source.chain.angle_tolerance))
        if exact == given:
            return angle
        self.rounded.append(float(abs(exact - given)))
        return rest + exact_angle(exact)

    def words(self) -> set[str]:
        """All names that occur in the file."""
        return set(_SYMBOL.findall(self.text))

    def at_given_values(self, expr: sp.Expr) -> sp.Expr:
        """Replace the names in ``expr`` by the values that the user gave; names without a value remain."""
        return expr.xreplace({parameter_symbol(k): v for k, v in self.source.values.items()})

    def number(self, entry: ListEntry, what: str) -> sp.Expr:
        """The value of ``entry`` with every name replaced by its value; a name without a value is a fault."""
        value = self.at_given_values(entry.expr)
        self.refuse_open(value, entry.place, what)
        if not value.free_symbols and not (value.is_real and value.is_finite):
            self.faults.error(entry.place, f"{what} is not finite and real", "division by zero, or a negative root?")
            return ZERO
        return ZERO if value.free_symbols else value

    def refuse_open(self, value: sp.Expr, place: Place, what: str) -> None:
        """Report a fault for every name in ``value`` that has no value."""
        for word in sorted(str(symbol) for symbol in value.free_symbols if str(symbol) not in self.source.values):
            self.faults.error(place, f"{what}: '{word}' has no value", f"give it one with --set {word}=VALUE, in SI")


# ------------------------------------------------------------------------------------------------------------------
# OpenSYMORO ``.par``
# ------------------------------------------------------------------------------------------------------------------

ANGLES = ("gamma", "alpha", "theta")
GEOMETRY = ("ant", "sigma", "b", "d", "r", "gamma", "alpha", "theta")
INERTIA = ("XX", "YY", "ZZ", "XY", "XZ", "YZ")
MOMENTS = ("MX", "MY", "MZ")
MAX_FIXED = (
    3  # most fixed frames before the first joint and after the last: products of more symbolic transforms are long
)
REVOLUTE, PRISMATIC, FIXED = 0, 1, 2
CLOSED = "2"
"""Type of a robot with closed loops."""

SAME_AXIS = 1e-9
FORCES = ("FX", "FY", "FZ", "CX", "CY", "CZ")
BASE_MOTION = ("W0", "WP0", "V0", "VP0")
STATE = ("QP", "QDP", "GAM")
FLAGS = ("NL", "NJ", "NF", "Type", "is_floating", "is_mobile")
KNOWN = {*GEOMETRY, "mu", *INERTIA, *MOMENTS, "M", "IA", "FV", "FS", *FORCES, *BASE_MOTION, *STATE, *FLAGS, "G", "Z"}
SPELLINGS = {name.capitalize(): name for name in (*GEOMETRY, "mu")}


def _read(source: Source, faults: FaultList) -> Found | None:
    file = Assignments(source, faults, SPELLINGS)
    _refuse_other_structures(file)
    table = _table(file)
    if table is None:
        return None
    warn_of_rounded_angles(file.rounded, source.chain.angle_tolerance, faults)
    _refuse_unknown_values(file)
    kinds = [entry.expr for entry in table["sigma"]]
    links = len(kinds) - 2 * _cuts(file)
    if _branches(table) or links < len(kinds):
        return _tree(source, file, table, links)
    moving = [j for j, kind in enumerate(kinds) if kind != FIXED]
    first, last = moving[0], moving[-1]
    joints = tuple(_joint(file, table, j, kinds[j]) for j in moving)
    base, tool = _base(file, table, first), sp.eye(4)
    for j in range(last + 1, len(kinds)):
        tool = tool * _step(table, j)
    bodies = _links(file, len(kinds), first, last)
    _warn_about_rest(file, len(kinds), range(len(kinds)))
    gravity = _gravity(file)
    for matrix, what in ((base, "the base"), (tool, "the fixed frames at the tip")):
        for value in matrix:
            file.refuse_open(value, file.place["sigma"], what)
    if faults.errors:
        return None
    robot, place = _name(source)
    used = base.free_symbols | tool.free_symbols
    used |= {symbol for j in joints for value in (j.alpha, j.a, j.d, j.theta) for symbol in value.free_symbols}
    spec = RobotSpec(
        name=robot,
        convention="modified",
        gravity=gravity,
        parameters={str(s): source.values[str(s)] for s in sorted(used, key=str)},
        joints=joints,
        links=bodies,
        base=_fixed_transform(base),
        tool=_fixed_transform(tool),
    )
    return Found(spec, place=place)


def _table(file: Assignments) -> dict[str, list[ListEntry]] | None:
    """Read the geometric columns of the table; None and faults where they do not describe one chain of frames."""
    faults = file.faults
    lengths = [len(file.items[name][0].split(",")) for name in ("sigma", *GEOMETRY) if name in file.items]
    count = max(lengths, key=lengths.count) if "sigma" in file.items else 0  # that of most lists: one may be short
    if not 1 <= count <= MAX_JOINTS:
        message = f"sigma lists {count} frames" if "sigma" in file.items else "there is no list 'sigma'"
        faults.error(file.place.get("sigma"), message, f"1 to {MAX_JOINTS} frames, each 0, 1 or 2")
        return None
    table = {name: file.entries(name, count, name not in ("b", "gamma")) for name in GEOMETRY}
    for j, entry in enumerate(table["ant"]):
        if entry.expr not in range(j + 1):
            message = f"frame {j + 1} follows frame {shorten(str(entry.expr))}"
            faults.error(entry.place, message, f"a frame before it, 0 to {j}; 0 is the base")
    for entry in table["sigma"]:
        if entry.expr not in (REVOLUTE, PRISMATIC, FIXED):
            faults.error(entry.place, f"sigma is {shorten(str(entry.expr))}", "0 revolute, 1 prismatic, 2 fixed")
    moving = [j for j, entry in enumerate(table["sigma"]) if entry.expr != FIXED]
    if file.flag("Type") == CLOSED:
        _check_cuts(file, table)
        return None if faults.errors else table
    if not moving:
        faults.error(file.place["sigma"], "no joint moves", "sigma is 0 for revolute, 1 for prismatic joints")
    elif _branches(table):
        return None if faults.errors else table  # fixed frames become fixed rows
    elif max(moving[0], count - 1 - moving[-1]) > MAX_FIXED:
        faults.error(file.place["sigma"], "too many fixed frames in a row", f"at most {MAX_FIXED}; multiply them out")
    for j in range(moving[0], moving[-1]) if moving else ():
        if j not in moving:
            hint = "a fixed frame between two joints has no place in a table of one row per joint"
            faults.error(table["sigma"][j].place, f"frame {j + 1} is fixed to a moving link", hint)
    return None if faults.errors else table


def _branches(table: dict[str, list[ListEntry]]) -> bool:
    """Whether a frame follows another one than that before it."""
    return any(entry.expr != j for j, entry in enumerate(table["ant"]))


def _cuts(file: Assignments) -> int:
    """The number of cut joints, one of each closed loop."""
    if file.flag("Type") != CLOSED:
        return 0
    links, joints = (int(v) if (v := file.flag(name)).isdecimal() else 0 for name in ("NL", "NJ"))
    return joints - links if joints > links > 0 else 0


def _check_cuts(file: Assignments, table: dict[str, list[ListEntry]]) -> None:
    """Report frames of a file with closed loops that do not come in pairs, a cut joint and its fixed counterpart."""
    count, cuts = len(table["sigma"]), _cuts(file)
    if not cuts or file.flag("NL") != str(count - 2 * cuts):
        message = f"NL = {file.flag('NL') or 'none'} and NJ = {file.flag('NJ') or 'none'} with {count} frames"
        hint = "NL links, NJ joints with the cut ones, and 2 NJ - NL frames, two of every cut joint"
        file.faults.error(file.place["Type"], message, hint)
        return
    links = count - 2 * cuts
    for j in range(links, count):
        kind, place = table["sigma"][j].expr, table["sigma"][j].place
        if j < links + cuts and kind != REVOLUTE:
            what = f"the cut joint of frame {j + 1} is {'prismatic' if kind == PRISMATIC else 'fixed'}"
            file.faults.error(place, what, "cut the loop at one of its revolute joints, sigma = 0")
        elif j >= links + cuts and kind != FIXED:
            hint = "the other frame of a cut joint is fixed to its link, sigma = 2"
            file.faults.error(place, f"frame {j + 1} is not fixed", hint)
        ant = int(table["ant"][j].expr)
        if links < ant <= links + cuts or (j < links + cuts and ant > links):
            message = f"frame {j + 1} of a cut joint follows frame {ant}, which is one too"
            file.faults.error(table["ant"][j].place, message, f"a frame of a link, 0 to {links}")
    for j in range(links):
        if int(table["ant"][j].expr) > links:
            hint = f"a frame of a link, 0 to {links}"
            file.faults.error(table["ant"][j].place, f"frame {j + 1} follows a frame of a cut joint", hint)


def _tree(source: Source, file: Assignments, table: dict[str, list[ListEntry]], links: int) -> Found | None:
    """The robot of a table with branches or loops: a row for each of its ``links``, placed by its gamma and b.

    Fixed frames are fixed rows. The tip is at the last frame, with closed loops at the last one of the only branch that
    no cut joint joins to another.
    """
    kinds = [entry.expr for entry in table["sigma"][:links]]
    rows = []
    for j, kind in enumerate(kinds):
        row = _fixed_row(file, table, j) if kind == FIXED else _joint(file, table, j, kind)
        gamma, b = (table[key][j] for key in ("gamma", "b"))
        for key, entry in (("gamma", gamma), ("b", b)):
            file.refuse_open(entry.expr, entry.place, f"{key} of frame {j + 1}")
        rows.append(replace(row, gamma=gamma.expr, b=b.expr))
    parents = tuple(int(entry.expr) - 1 for entry in table["ant"][:links])
    loops = _loops(file, table, parents)
    passive = [row for loop in loops for row in loop.passive]
    rows = [_without_drive(file, table, row, j) if j in passive else row for j, row in enumerate(rows)]
    driven = [j for j, kind in enumerate(kinds) if kind != FIXED and j not in passive]
    if not driven:
        file.faults.error(file.place["sigma"], "no joint has a drive", "mu of a driven joint is 1, its sigma 0 or 1")
    matrix: list[tuple[sp.Expr, ...]] = [
        tuple(sp.Integer(int(j == k)) for k in (*driven, *passive)) for j in range(links)
    ]
    joined = {row for loop in loops for row, _ in loop.pins}
    ends = [j for j in range(links) if j not in parents and j not in joined]
    tip = ends[0] if loops and len(ends) == 1 else links - 1
    joints, mechanism = mechanism_of_rows(rows, parents, tip, matrix, driven)
    base, bodies, gravity = _pose_of_frame_0(file), _links(file, links, 0, links - 1), _gravity(file)
    _warn_about_rest(file, links, driven)
    if file.faults.errors:
        return None
    robot, name_place = _name(source)
    values = [value for row in rows for value in (row.alpha, row.a, row.d, row.theta, row.gamma, row.b)]
    values += [value for loop in loops for _, place in loop.pins for value in place]
    used = sorted({str(symbol) for value in values for symbol in value.free_symbols})
    spec = RobotSpec(
        name=robot,
        convention="modified",
        gravity=gravity,
        parameters={name: source.values[name] for name in used},
        joints=joints,
        links=bodies,
        base=_fixed_transform(base),
        mechanism=replace(mechanism, loops=tuple(loops)),
    )
    return Found(_with_followers(file, table, spec), place=name_place)


def _with_followers(file: Assignments, table: dict[str, list[ListEntry]], spec: RobotSpec) -> RobotSpec:
    """``spec`` with the rows of parallelograms following the drives; warns how the other loops are assembled."""
    from rrrgen.robot.model import build_model

    links = len(spec.rows)

    def place(loop: str) -> Place:
        return table["ant"][links + int(loop.removeprefix("loop")) - 1].place

    while spec.loops:
        try:
            build_model(spec)
            break
        except ParallelogramError as error:
            if error.follows is None:
                break  # refused with its reason when the robot file is checked
            names = " and ".join(spec.rows[row].name for row in error.follows)
            hint = "that it is crossed, an antiparallelogram, the format cannot say"
            file.faults.warning(place(error.name), f"{error.name} is a parallelogram: {names} follow the drives", hint)
            spec = with_parallelograms_followed(spec, error)
        except LoopError:
            break
    for loop in spec.loops:
        hint = "the format does not say which of its two ways to assemble it is meant; write -1 for the other one"
        file.faults.warning(place(loop.name), f"{loop.name} is taken with assembly: +1", hint)
    return spec


Pin = tuple[int, tuple[sp.Expr, sp.Expr, sp.Expr]]


def _loops(file: Assignments, table: dict[str, list[ListEntry]], parents: Sequence[int]) -> list[LoopSpec]:
    """The closed loops of a file, each with the two passive joints that no loop before it has.

    ``parents`` are those of the rows of the links. A loop with more passive joints waits until others have theirs.
    """
    links, cuts = len(parents), _cuts(file)
    if not cuts:
        return []
    mu = file.entries("mu", links + 2 * cuts, needed=True)
    free = {j for j in range(links) if mu[j].expr == 0 and table["sigma"][j].expr != FIXED}
    waiting = {k: _pins(file, table, links + k, links + cuts + k) for k in range(cuts)}
    loops: dict[int, LoopSpec] = {}
    while waiting:
        passive = {k: sorted(free & _between(parents, pins)) for k, pins in waiting.items()}
        k = next((k for k, rows in passive.items() if len(rows) == 2), None)
        if k is None:
            for k, rows in passive.items():
                names = ", ".join(f"{row + 1}" for row in rows) or "none"
                hint = "two joints of every loop have no drive, mu = 0, beside the cut one"
                place = table["ant"][links + k].place
                file.faults.error(place, f"the loop of frame {links + k + 1} has passive joints: {names}", hint)
            return []
        first, second = passive[k]
        loops[k] = LoopSpec(f"loop{k + 1}", (first, second), waiting.pop(k), 1)
        free -= {first, second}
    return [loops[k] for k in sorted(loops)]


def _between(parents: Sequence[int], pins: tuple[Pin, Pin]) -> set[int]:
    """The rows that move one of the pinned links against the other."""
    ways: list[set[int]] = []
    for row, _ in pins:
        way = set()
        while row >= 0:
            way.add(row)
            row = parents[row]
        ways.append(way)
    return ways[0] ^ ways[1]


def _pins(file: Assignments, table: dict[str, list[ListEntry]], cut: int, counterpart: int) -> tuple[Pin, Pin]:
    """Both ends of the pin at a cut joint: the rows of the links (-1: the base) and its places in their frames."""
    ends = []
    for j in (cut, counterpart):
        T = sp.eye(4)
        ant = j + 1
        while True:
            entries = {key: table[key][ant - 1] for key in ("gamma", "b", "alpha", "d", "r")}
            for key, entry in entries.items():
                file.refuse_open(entry.expr, entry.place, f"{key} of frame {ant}")
            gamma, b, alpha, d, r = (entry.expr for entry in entries.values())
            theta = table["theta"][ant - 1].expr if ant - 1 != cut else ZERO  # the angle of the cut joint is free
            T = _screw_z(gamma, b) * _screw_x(alpha, d) * _screw_z(theta, r) * T
            ant = int(table["ant"][ant - 1].expr)
            if ant <= cut:
                break
        if j == cut:
            _check_axis(file, table, cut, T)
        x, y, z = (sp.simplify(v) if v.free_symbols else v for v in T[:3, 3])
        ends.append((ant - 1, (x, y, z)))
    return ends[0], ends[1]


def _check_axis(file: Assignments, table: dict[str, list[ListEntry]], cut: int, T: sp.Matrix) -> None:
    """Report a cut joint whose axis is not parallel to that of the revolute joint before it; ``T`` is its frame."""
    axis, j = T[:3, 2], int(table["ant"][cut].expr) - 1
    while j >= 0 and table["sigma"][j].expr != REVOLUTE:
        axis, j = _step(table, j)[:3, :3] * axis, int(table["ant"][j].expr) - 1
    aside = [file.at_given_values(v) for v in axis[:2]]
    if j >= 0 and not any(v.free_symbols for v in aside) and max(abs(complex(v)) for v in aside) > SAME_AXIS:
        message = f"the axis of the cut joint of frame {cut + 1} is not parallel to that of joint {j + 1}"
        file.faults.error(table["alpha"][cut].place, message, "all revolute axes of a closed loop are parallel")


def _without_drive(file: Assignments, table: dict[str, list[ListEntry]], row: JointSpec, j: int) -> JointSpec:
    """The ``row`` of the passive joint ``j`` (from 0), without friction and drive inertia."""
    for name, value in (("friction", row.friction), ("IA", row.drive)):
        if value is not None:
            hint = "a joint without a drive has none in a robot file"
            file.faults.warning(table["sigma"][j].place, f"{name} of the passive joint {j + 1} is left out", hint)
    return replace(row, friction=None, drive=None)


def _fixed_row(file: Assignments, table: dict[str, list[ListEntry]], j: int) -> JointSpec:
    """The row of the fixed frame ``j`` (from 0), without its gamma and b."""
    alpha, d, r, theta = (table[key][j] for key in ("alpha", "d", "r", "theta"))
    for key, entry in (("alpha", alpha), ("d", d), ("r", r), ("theta", theta)):
        file.refuse_open(entry.expr, entry.place, f"{key} of frame {j + 1}")
    return JointSpec(f"fixed{j + 1}", "revolute", alpha.expr, d.expr, r.expr, theta.expr)


def _name(source: Source) -> tuple[str, Place | None]:
    """The robot's name, and its place if the file states it."""
    match = re.search(r"\(\*\s*Robotname\s*=\s*'([^'\n]*)'", source.text)
    word = re.sub(r"\W+", "_", match.group(1), flags=re.ASCII).strip("_") if match else ""
    if match is None or not word:
        return source.name, None
    return word, place_at(source.text, match.start(1))


def _refuse_other_structures(file: Assignments) -> None:
    for name in ("is_floating", "is_mobile"):
        if file.flag(name) not in ("", "0", "False", "false"):
            file.faults.error(file.place[name], f"{name}: a base that moves", "robot files have a fixed base")
    if file.flag("Type") not in ("", "0", "1", CLOSED):
        hint = "serial chains, Type = 0, trees, Type = 1, and closed loops, Type = 2"
        file.faults.error(file.place["Type"], f"Type {shorten(file.flag('Type'))}: no known structure", hint)


def _refuse_unknown_values(file: Assignments) -> None:
    words = file.words()
    for name in file.source.values:
        if name not in words:
            file.faults.error(None, f"--set {name}: the file has no such name")


def _joint(file: Assignments, table: dict[str, list[ListEntry]], j: int, kind: int) -> JointSpec:
    """The joint of frame ``j`` (from 0); ``kind`` is 0 for a revolute joint, otherwise it is prismatic.

    The parameters ``gamma`` and ``b`` of the first moving joint are not part of it: they belong to the base.
    """
    variable = table["r" if kind else "theta"][j]
    offset, name = _offset(file, variable, f"{'r' if kind else 'theta'} of frame {j + 1}")
    row = {key: table[key][j].expr for key in ("alpha", "d", "r", "theta")}
    row["r" if kind else "theta"] = offset
    for key, value in row.items():
        file.refuse_open(value, table[key][j].place, f"{key} of frame {j + 1}")
        length = file.at_given_values(value)
        if key in ("d", "r") and length.is_real and length.is_number and abs(length) > LARGEST_BARE_LENGTH:
            message = f"{key} of frame {j + 1} is {float(length):g} m"
            file.faults.warning(table[key][j].place, message, "values are in m, or have a unit: --set NAME=450mm")
    joint_type: JointType = "prismatic" if kind else "revolute"
    return JointSpec(
        name=name if name and name_fault(name, "joint") is None else f"q{j + 1}",
        type=joint_type,
        alpha=row["alpha"],
        a=row["d"],
        d=row["r"],
        theta=row["theta"],
        friction=_friction(file, j),
        drive=_drive(file, j),
    )


def _offset(file: Assignments, entry: ListEntry, what: str) -> tuple[sp.Expr, str]:
    """Split the entry of the joint variable, such as ``t2 + pi/2``, into the offset and the variable's name."""
    open_names = [s for s in sorted(entry.expr.free_symbols, key=str) if str(s) not in file.source.values]
    if not open_names:
        hint = "it is taken as the offset of the joint variable"
        file.faults.warning(entry.place, f"{what} names no joint variable", hint)
        return entry.expr, ""
    if len(open_names) > 1:
        words = ", ".join(map(str, open_names))
        file.faults.error(
            entry.place,
            f"{what} has several names without a value: {words}",
            "one is the joint variable; give the others a value with --set NAME=VALUE",
        )
        return ZERO, ""
    variable = open_names[0]
    offset = sp.expand(entry.expr - variable)
    if offset.has(variable):
        message = f"{what} is not '{variable}' plus a constant"
        file.faults.error(entry.place, message, f"write {variable} + constant; a robot file has no other sign")
        return ZERO, ""
    return offset, str(variable)


def _float(file: Assignments, name: str, j: int) -> float | None:
    """Entry ``j`` of a list of plain numbers, or None if it is 0 (not modelled) or a name without a value."""
    count = len(file.items[name][0].split(",")) if name in file.items else 0
    if j >= count:
        return None
    entry = file.entries(name, count)[j]
    value = file.at_given_values(entry.expr)
    if value.free_symbols:
        word = min(map(str, value.free_symbols))
        file.faults.warning(
            entry.place,
            f"{name} of joint {j + 1} is left out: '{word}' has no value",
            f"give it one with --set {word}=VALUE, in SI",
        )
        return None
    number = float(file.number(entry, f"{name} of joint {j + 1}"))
    if number < 0:
        file.faults.error(entry.place, f"{name} of joint {j + 1} is {number:g}", "0 or more")
    return number or None


def _friction(file: Assignments, j: int) -> FrictionSpec | None:
    viscous, coulomb = _float(file, "FV", j), _float(file, "FS", j)
    return None if viscous is None and coulomb is None else FrictionSpec(viscous=viscous, coulomb=coulomb)


def _drive(file: Assignments, j: int) -> DriveSpec | None:
    inertia = _float(file, "IA", j)
    return None if inertia is None else DriveSpec(inertia=inertia)


def _step(table: dict[str, list[ListEntry]], j: int) -> sp.Matrix:
    """The transform of fixed frame ``j``: ``Rz(gamma) Tz(b) Rx(alpha) Tx(d) Rz(theta) Tz(r)``."""
    gamma, b, alpha, d, theta, r = (table[k][j].expr for k in ("gamma", "b", "alpha", "d", "theta", "r"))
    return _screw_z(gamma, b) * _screw_x(alpha, d) * _screw_z(theta, r)


def _screw_z(angle: sp.Expr, length: sp.Expr) -> sp.Matrix:
    c, s = sp.cos(angle), sp.sin(angle)
    return sp.Matrix([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, length], [0, 0, 0, 1]])


def _screw_x(angle: sp.Expr, length: sp.Expr) -> sp.Matrix:
    c, s = sp.cos(angle), sp.sin(angle)
    return sp.Matrix([[1, 0, 0, length], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]])


def _base(file: Assignments, table: dict[str, list[ListEntry]], first: int) -> sp.Matrix:
    """The pose of the base: that of frame 0, times the fixed frames and the gamma and b of the first moving joint."""
    base = _pose_of_frame_0(file)
    for j in range(first):
        base = base * _step(table, j)
    base = base * _screw_z(table["gamma"][first].expr, table["b"][first].expr)
    for key in ("gamma", "b"):
        for j in range(first + 1, len(table[key])):
            if table[key][j].expr != 0 and table["sigma"][j].expr != 2:
                hint = "in a serial chain they are part of theta and r of the frame before"
                file.faults.error(table[key][j].place, f"{key} of frame {j + 1} is not 0", hint)
    return base


def _pose_of_frame_0(file: Assignments) -> sp.Matrix:
    if "Z" not in file.items:
        return sp.eye(4)
    Z = sp.Matrix(4, 4, [file.number(entry, "Z") for entry in file.entries("Z", 16)])
    if list(Z.row(3)) != [0, 0, 0, 1]:
        file.faults.error(file.place["Z"], "the last four entries of Z are not 0,0,0,1", "Z is a 4x4 pose, row by row")
    elif fault := rotation_fault([[float(x) for x in Z[row, :3]] for row in range(3)]):
        file.faults.error(file.place["Z"], f"the rotation in Z {fault[0]}", "Z is a 4x4 pose, row by row")
    return Z


def _gravity(file: Assignments) -> tuple[sp.Expr, sp.Expr, sp.Expr]:
    """The acceleration of gravity in the robot's base frame: ``G`` of the file, rotated by the base pose ``Z``."""
    G = [file.number(entry, "G") for entry in file.entries("G", 3, needed=True)]
    for name in BASE_MOTION:
        for entry in file.entries(name, 3):
            if entry.expr != 0:
                file.faults.error(entry.place, f"{name} is not 0: the base moves", "robot files have a fixed base")
    size = math.hypot(*map(float, G))
    if size > LARGEST_GRAVITY:
        file.faults.error(file.place["G"], f"gravity is {size:g} m/s^2", f"at most {LARGEST_GRAVITY} m/s^2")
    x, y, z = _pose_of_frame_0(file)[:3, :3] * sp.Matrix(G)
    return x, y, z


def _links(file: Assignments, count: int, first: int, last: int) -> tuple[LinkSpec, ...] | None:
    """Read the inertias of the links, one per moving joint (frames ``first`` to ``last``); None without masses."""
    table = {name: file.entries(name, count) for name in (*INERTIA, *MOMENTS, "M")}
    masses = [file.at_given_values(entry.expr) for entry in table["M"]]
    if "M" not in file.items:
        return None
    if all(mass.free_symbols for mass in masses[first : last + 1]):
        hint = "give M1, MX1, ... a value each with --set; without them dynamics only take base parameters as input"
        file.faults.warning(file.place["M"], "inertial parameters are left out: no mass has a value", hint)
        return None
    for j in [*range(first), *range(last + 1, count)]:
        if any(entries[j].expr != 0 for entries in table.values()):
            _about_fixed_mass(file, table, j, j < first)
    return tuple(_link(file, table, j) for j in range(first, last + 1))


def _about_fixed_mass(file: Assignments, table: dict[str, list[ListEntry]], j: int, before: bool) -> None:
    place = table["M"][j].place
    if before:
        file.faults.warning(place, f"inertia of frame {j + 1} is left out", "it is fixed to the base and never moves")
    else:
        hint = "add it to the link that carries it, in that link's frame"
        file.faults.error(place, f"the fixed frame {j + 1} at the tip has inertia of its own", hint)


def _warn_about_rest(file: Assignments, count: int, driven: Sequence[int]) -> None:
    """Warn about what is left out; ``count`` is the number of links, ``driven`` are the joints that get a drive."""
    given = [name for name in FORCES if any(entry.expr != 0 for entry in file.entries(name, count))]
    if given:
        hint = "external forces are no part of a robot file"
        file.faults.warning(file.place[given[0]], f"{', '.join(given)} left out", hint)
    for name in file.items.keys() - KNOWN:
        file.faults.warning(file.place[name], f"'{name}' is left out", "the importer knows no such entry")
    frames = count + 2 * _cuts(file)
    for j, entry in enumerate(file.entries("mu", frames)[:count] if "mu" in file.items else ()):
        if entry.expr == 0 and j in driven and file.entries("sigma", frames)[j].expr != FIXED:
            file.faults.warning(entry.place, f"joint {j + 1} is passive", "a robot file takes every joint as driven")


def _link(file: Assignments, table: dict[str, list[ListEntry]], j: int) -> LinkSpec:
    def value(name: str) -> sp.Expr:
        number = file.number(table[name][j], f"{name} of frame {j + 1}")
        if not number.is_Rational:
            file.faults.error(
                table[name][j].place, f"{name} of frame {j + 1} is not a rational number", "write a decimal"
            )
            return ZERO
        return number

    mass, moments = value("M"), [value(name) for name in MOMENTS]
    inertia = tuple(value(name) for name in INERTIA)
    if mass < 0:
        file.faults.error(table["M"][j].place, f"the mass of frame {j + 1} is negative")
    if mass == 0 and any(moments):
        hint = "a robot file gives mass and centre of mass; regrouped parameters belong into beta"
        file.faults.error(table["M"][j].place, f"frame {j + 1} has first moments and no mass", hint)
    x, y, z = (moment / mass if mass else ZERO for moment in moments)
    return LinkSpec(mass, (x, y, z), inertia, "origin")


def _fixed_transform(matrix: sp.Matrix) -> FixedTransform:
    entries: Sequence[sp.Expr] = [matrix[i, k] for i in range(3) for k in range(3)]
    return FixedTransform(tuple(entries), (matrix[0, 3], matrix[1, 3], matrix[2, 3]))


IMPORTER = Importer(
    "symoro",
    "OpenSYMORO .par: modified Denavit-Hartenberg parameters of a chain, tree or closed loops, inertia, friction",
    (".par",),
    lambda text: re.search(r"^\s*[Ss]igma\s*=\s*\{", text, re.MULTILINE) is not None,
    _read,
    rounds_angles=True,
)
