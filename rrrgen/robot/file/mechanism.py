"""Reader of mechanisms: lists of joints in which some follow others, which branch, or which close loops.

Keys of a row: ``follows`` gives its displacement as a sum of multiples of joint positions, none for a fixed row;
``parent`` names the joint whose link carries it. The file's key ``tip`` names the joint whose link carries the tool.
Passive joints of closed loops have no drive either and may be followed.
"""

from __future__ import annotations

from collections.abc import Sequence as Row
from dataclasses import replace

import sympy as sp

from rrrgen.base.yamltext.document import MappingNode, Node, ScalarNode, SequenceNode, describe
from rrrgen.base.yamltext.fields import read_choice, read_entries, read_list, read_section
from rrrgen.base.yamltext.suggestions import did_you_mean
from rrrgen.robot.file.fields import BASE, LOOP, ROBOT_FILE
from rrrgen.robot.file.quantities import Scope, read_value, read_vector
from rrrgen.robot.spec import JointSpec, Limits, LoopSpec, MechanismSpec, name_fault

Factors = dict[str, sp.Expr]

_OF_DRIVES = ("friction", "drive")


def read_mechanism(
    node: Node, tip: Node | None, joints: Row[JointSpec | None], scope: Scope, loops: Row[LoopSpec] = ()
) -> tuple[tuple[JointSpec, ...], MechanismSpec | None]:
    """Read the driven joints, whose positions are q, and the mechanism (None for a chain of driven joints).

    ``node`` is the list of joints and ``tip`` the value of the file's key ``tip``. ``joints`` are the rows as read
    before, ``loops`` the closed loops; the sign of a row goes into the matrix of the mechanism.
    """
    rows = tuple(joint for joint in joints if joint is not None)
    items = node.items if isinstance(node, SequenceNode) else []
    keys = [_keys_of(item) for item in items]
    stated = (
        tip is not None
        or bool(loops)
        or any(key in row_keys for row_keys in keys for key in ("follows", "parent", "gamma", "b"))
    )
    if not stated or len(rows) != len(items):
        return rows, None
    names = [row.name for row in rows]
    parents = [_read_parent(row_keys.get("parent"), i, names, scope) for i, row_keys in enumerate(keys)]
    follows = [_read_follows(row_keys.get("follows"), row, scope) for row_keys, row in zip(keys, rows, strict=True)]
    passive = [names[row] for loop in loops for row in loop.passive]
    driven = [
        row.name
        for row, factors in zip(rows, follows, strict=True)
        if row.name not in passive and (factors is None or row.name in factors)
    ]
    matrix = []
    for row, factors, row_keys in zip(rows, follows, keys, strict=True):
        factors = {row.name: sp.S.One} if factors is None else factors
        if row.name in passive:
            _check_passive(row_keys, row.name, scope)
        else:
            by_sine = [] if any(loop.start is not None for loop in loops) else passive
            _check_followed(row_keys, row, factors, (driven, passive, by_sine), rows, scope)
        matrix.append(tuple(row.sign * factors.get(name, sp.S.Zero) for name in (*driven, *passive)))
    if scope.faults.errors:
        return rows, None
    tip_row = _read_tip(node, tip, parents, names, scope)
    _check_rank(node, matrix, driven, scope)
    plain = tuple(replace(row, sign=1) for row in rows)
    counted, mechanism = mechanism_of_rows(
        plain, tuple(parents), tip_row, matrix, [names.index(name) for name in driven]
    )
    return counted, replace(mechanism, loops=tuple(loops))


def on_floating_base(
    name: str, joints: Row[JointSpec], mechanism: MechanismSpec | None
) -> tuple[tuple[JointSpec, ...], MechanismSpec]:
    """Put the rows on the body ``name`` of a floating base, a fixed first row whose frame is that of the base.

    ``joints`` and ``mechanism`` are as :func:`read_mechanism` returns them.
    """
    zero = sp.S.Zero
    body = JointSpec(name, "revolute", alpha=zero, a=zero, d=zero, theta=zero)
    if mechanism is None:
        driven = range(len(joints))
        matrix = [tuple(joint.sign * sp.Integer(i == k) for k in driven) for i, joint in enumerate(joints)]
        parents = tuple(k - 1 for k in driven)
        joints, mechanism = mechanism_of_rows(
            tuple(replace(joint, sign=1) for joint in joints), parents, len(joints) - 1, matrix, driven
        )
    return tuple(joints), MechanismSpec(
        (body, *mechanism.rows),
        (-1, *(parent + 1 for parent in mechanism.parents)),
        mechanism.tip + 1,
        ((zero,) * len(joints), *mechanism.matrix),
    )


def fixed_rows(node: Node, joints: Row[JointSpec | None]) -> list[bool]:
    """Whether each of ``joints``, the rows of the list ``node`` as read before, is fixed: it follows none."""
    keys = [_keys_of(item) for item in node.items] if joints and isinstance(node, SequenceNode) else []
    followed = [row_keys["follows"][1] if "follows" in row_keys else None for row_keys in keys]
    return [isinstance(value, MappingNode) and not value.entries for value in followed]


def mechanism_of_rows(
    rows: Row[JointSpec],
    parents: tuple[int, ...],
    tip: int,
    matrix: list[tuple[sp.Expr, ...]],
    driven: Row[int],
) -> tuple[tuple[JointSpec, ...], MechanismSpec]:
    """Make the driven joints (the rows ``driven``) and the mechanism of all ``rows`` (:class:`MechanismSpec`).

    The position limits of a driven joint are narrowed to those of the rows that follow it.
    """
    counted = tuple(_narrow_limits(rows[i], rows, matrix, k) for k, i in enumerate(driven))
    bare = tuple(
        replace(row, limits=Limits(), friction=None, drive=None) if i in driven else row for i, row in enumerate(rows)
    )
    return counted, MechanismSpec(bare, parents, tip, tuple(matrix))


def _keys_of(item: Node) -> dict[str, tuple[ScalarNode, Node]]:
    return {key.text: (key, value) for key, value in getattr(item, "entries", ()) if isinstance(key, ScalarNode)}


def _read_joint_name(node: Node, names: Row[str], what: str, scope: Scope) -> str | None:
    """Read one of the joint names ``names``; a fault and None for anything else."""
    if isinstance(node, ScalarNode) and node.text in names:
        return node.text
    word = node.text if isinstance(node, ScalarNode) else ""
    hint = " ".join(part for part in (did_you_mean(word, names), f"allowed are {', '.join(names)}") if part)
    scope.faults.error(node, f"{what} is {describe(node)}", hint if names else "no joint stands before it")
    return None


def _read_parent(entry: tuple[ScalarNode, Node] | None, i: int, names: list[str], scope: Scope) -> int:
    if entry is None:
        return i - 1
    name = _read_joint_name(entry[1], [BASE, *names[:i]], f"parent of joint {i + 1}", scope)
    return names.index(name) if name in names[:i] else -1


def _read_follows(entry: tuple[ScalarNode, Node] | None, row: JointSpec, scope: Scope) -> Factors | None:
    """Read the factors, by joint name, of the joints that a row follows; None for a row with a drive of its own.

    A row that follows none is fixed.
    """
    if entry is None:
        return None
    factors: Factors = {}
    what = f"follows of joint '{row.name}'"
    for name, (_, value) in (read_entries(entry[1], what, scope.faults) or {}).items():
        number = read_value(value, f"the factor of {name} in {what}", "number", scope)
        factor = None if number is None else scope.substitute(number)
        if factor is not None and row.is_revolute and not factor.is_Rational:
            hint = "write a fraction or a decimal; angles in an irrational ratio have no exact base parameters"
            scope.faults.error(value, f"the factor of {name} in {what} is irrational", hint)
        elif factor is not None:
            factors[name] = factor
    return factors


def _check_passive(keys: dict[str, tuple[ScalarNode, Node]], name: str, scope: Scope) -> None:
    """Check that a row that a closed loop moves states nothing of a joint with a drive."""
    hint = "drop it, or take the joint out of the loop's passive ones"
    for section in ("follows", "limits", *_OF_DRIVES):
        if section in keys:
            scope.faults.error(keys[section][0], f"joint '{name}' is passive in a loop and has no {section}", hint)


def _check_followed(
    keys: dict[str, tuple[ScalarNode, Node]],
    row: JointSpec,
    factors: Factors,
    joints: tuple[list[str], list[str], list[str]],
    rows: Row[JointSpec],
    scope: Scope,
) -> None:
    """Check a row with ``follows``: it names driven or passive joints and has no drive, no friction, only a range.

    ``keys`` are the keys of the row in the file, ``factors`` those of the joints that it follows, by name. ``joints``
    are the driven ones, the passive ones, and those of the latter of whose angles only cosine and sine are known: a row
    follows these if it is of their own type, revolute ones by whole multiples. A row that follows passive joints has no
    range.
    """
    if "follows" not in keys:
        return
    driven, passive, by_sine = joints
    allowed = [*driven, *passive]
    slides = [joint.name for joint in rows if not joint.is_revolute]
    for name, (key, value) in (read_entries(keys["follows"][1], "follows", scope.faults) or {}).items():
        if name in by_sine and row.is_revolute and name in slides:
            hint = f"'{name}' is passive in a loop and slides; prismatic rows may follow it"
            scope.faults.error(key, f"the revolute joint '{row.name}' cannot follow '{name}'", hint)
        elif name in by_sine and row.is_revolute and name in factors and not factors[name].is_Integer:
            hint = f"'{name}' is passive in a loop, which gives cosine and sine of its angle only"
            scope.faults.error(value, f"the factor of {name} in follows of joint '{row.name}' is no integer", hint)
        if name in by_sine and not row.is_revolute and name not in slides:
            hint = f"the angle of '{name}', which is passive in a loop, is known by its cosine and sine only"
            scope.faults.error(key, f"the prismatic joint '{row.name}' cannot follow '{name}'", hint)
        if name in passive and "limits" in keys:
            hint = f"it follows '{name}', which is passive in a loop"
            scope.faults.error(keys["limits"][0], f"joint '{row.name}' has no limits", hint)
        if name in allowed:
            continue
        hint = " ".join(part for part in (did_you_mean(name, allowed), f"allowed are {', '.join(allowed)}") if part)
        itself = next((joint for joint in rows if joint.name == name), None)
        why = "follows others itself" if itself is not None else "is no joint"
        scope.faults.error(key, f"joint '{row.name}' follows '{name}', which {why}", hint)
    if row.name in factors:
        return
    if not factors and "limits" in keys:
        scope.faults.error(keys["limits"][0], f"joint '{row.name}' is fixed and has no limits", "it follows no joint")
        return
    for section in _OF_DRIVES:
        if section in keys:
            hint = f"state it at {' or '.join(factors)}, seen there" if factors else "state it at the joint it follows"
            scope.faults.error(keys[section][0], f"joint '{row.name}' follows others and has no {section}", hint)
    if "limits" in keys:
        for name, (key, _) in (read_entries(keys["limits"][1], "limits", scope.faults) or {}).items():
            if name not in ("lower", "upper"):
                hint = "a joint that follows others has the limits lower and upper only"
                scope.faults.error(
                    key, f"limits of joint '{row.name}': {name} belongs to the joint that it follows", hint
                )


def _read_tip(node: Node, tip: Node | None, parents: list[int], names: list[str], scope: Scope) -> int:
    ends = [name for i, name in enumerate(names) if i not in parents]
    if tip is not None:
        name = _read_joint_name(tip, names, "tip", scope)
        return names.index(name) if name is not None else 0
    if len(ends) > 1:
        hint = f"tip: {ends[-1]}; the joint whose link carries the tool"
        scope.faults.error(node, f"the joints branch and end at {', '.join(ends)}: the file needs the key 'tip'", hint)
    return names.index(ends[-1])


def _check_rank(node: Node, matrix: list[tuple[sp.Expr, ...]], driven: list[str], scope: Scope) -> None:
    if not driven:
        scope.faults.error(node, "every joint follows another one", "at least one joint has a drive of its own")
    elif sp.Matrix(matrix).rank() < len(matrix[0]):
        hint = "each joint without follows, or that names itself there, has a drive; drop one or change a factor"
        scope.faults.error(node, f"the positions of {', '.join(driven)} do not follow from those of the joints", hint)


def _narrow_limits(joint: JointSpec, rows: Row[JointSpec], matrix: list[tuple[sp.Expr, ...]], k: int) -> JointSpec:
    """Narrow the position limits of ``joint``, number k in q, to those of the rows that follow it alone."""
    lower, upper = joint.limits.lower, joint.limits.upper
    for row, factors in zip(rows, matrix, strict=True):
        if row.name == joint.name or any(f != 0 for i, f in enumerate(factors) if i != k) or factors[k] == 0:
            continue
        ends = [None if v is None else v / float(factors[k]) for v in (row.limits.lower, row.limits.upper)]
        least, most = ends if factors[k] > 0 else ends[::-1]
        lower = least if lower is None else lower if least is None else max(lower, least)
        upper = most if upper is None else upper if most is None else min(upper, most)
    limits: Limits = replace(joint.limits, lower=lower, upper=upper)
    return joint if limits == joint.limits else replace(joint, limits=limits)


# ------------------------------------------------------------------------------------------------------------------
# Reader of closed loops: two joints without drive each, and the pin that joins two links.
# ------------------------------------------------------------------------------------------------------------------

_ASSEMBLY, _SOLVE, _START = (next(key for key in LOOP if key.name == name) for name in ("assembly", "solve", "start"))

Pin = tuple[int, tuple[sp.Expr, sp.Expr, sp.Expr]]


def read_loops(node: Node, joints: Row[JointSpec], scope: Scope) -> dict[str, tuple[ScalarNode, LoopSpec]]:
    """Read ``{name: {passive: [..], pins: {..}, assembly: ..}, ..}``, with the nodes of the names.

    With ``solve: newton`` a loop has ``start: {..}`` instead of ``assembly``, and so have all others. The passive ones
    of the ``joints`` stand in the result of a loop in the order of the table. Loops with a fault are left out.
    """
    names = [joint.name for joint in joints]
    loops: dict[str, tuple[ScalarNode, LoopSpec]] = {}
    owners: dict[str, str] = {}
    for name, (key, value) in (read_entries(node, "loops", scope.faults) or {}).items():
        if fault := name_fault(name, "loop"):
            scope.faults.error(key, *fault)
            continue
        values = read_section(value, "loop", f"loop {name}", scope.faults, ROBOT_FILE)
        if values is None or not {"passive", "pins"} <= values.keys() or not _is_solvable(key, values, scope):
            continue
        passive = _read_passive(values["passive"], name, names, owners, scope)
        pins = _read_pins(values["pins"], name, names, scope)
        assembly = read_choice(values["assembly"], _ASSEMBLY, scope.faults) if "assembly" in values else "0"
        if len(passive) != 2 or len(pins) != 2 or assembly is None:
            continue
        first, second = sorted(passive)
        start = None
        if "start" in values:
            start = _read_start(values["start"], name, [joints[first], joints[second]], scope)
            if start is None:
                continue
        loops[name] = key, LoopSpec(name, (first, second), (pins[0], pins[1]), int(assembly), start)
    closed = {name: loop for name, (_, loop) in loops.items() if loop.start is None}
    if len(closed) < len(loops):
        for name in closed:
            hint = "give it solve: newton and start too: such loops are solved together"
            scope.faults.error(loops[name][0], f"loop {name} has no 'solve' while others have", hint)
    return loops


def _is_solvable(key: ScalarNode, values: dict[str, Node], scope: Scope) -> bool:
    """Whether a loop says how it is solved; otherwise a fault at its ``key``."""
    faults, name = scope.faults, key.text
    if "solve" in values:
        if "assembly" in values:
            hint = "the start says how a loop with solve: newton is assembled"
            faults.error(values["assembly"], f"loop {name} has both assembly and solve", hint)
        elif "start" not in values:
            hint = "start: {joint: displacement, ..} of both passive joints"
            faults.error(key, f"loop {name} with solve: newton has no 'start'", hint)
        else:
            return read_choice(values["solve"], _SOLVE, faults) is not None
    elif "start" in values:
        faults.error(values["start"], f"loop {name} has a start without solve: newton", "write assembly, or both")
    elif "assembly" in values:
        return True
    else:
        faults.error(key, f"missing key 'assembly' in loop {name}", f"{_ASSEMBLY.meaning}; or solve: newton and start")
    return False


def _read_start(node: Node, loop: str, passive: Row[JointSpec], scope: Scope) -> tuple[sp.Expr, sp.Expr] | None:
    """The displacements of both ``passive`` joints of ``loop``, rad or m; faults and None where one is missing."""
    what = f"start of loop {loop}"
    entries = read_entries(node, what, scope.faults)
    if entries is None:
        return None
    names = " and ".join(joint.name for joint in passive)
    for name, (key, _) in entries.items():
        if all(name != joint.name for joint in passive):
            hint = f"{did_you_mean(name, [joint.name for joint in passive])} it names {names}".strip()
            scope.faults.error(key, f"{what} names '{name}', which is not passive in it", hint)
            return None
    displacements = []
    for joint in passive:
        if joint.name not in entries:
            scope.faults.error(node, f"{what} has no displacement of '{joint.name}'", f"it names {names}")
            return None
        label, quantity = f"{joint.name} in {what}", _START.quantity_for(joint.type)
        displacements.append(read_value(entries[joint.name][1], label, quantity, scope, _START.file_units))
    first, second = displacements
    return None if first is None or second is None else (first, second)


def _joint(node: Node, names: Row[str], what: str, scope: Scope) -> str | None:
    """Read one of the ``names``; a fault and None for anything else."""
    if isinstance(node, ScalarNode) and node.text in names:
        return node.text
    word = node.text if isinstance(node, ScalarNode) else ""
    hint = " ".join(part for part in (did_you_mean(word, names), f"allowed are {', '.join(names)}") if part)
    scope.faults.error(node, f"{what} is {describe(node)}", hint)
    return None


def _read_passive(node: Node, loop: str, names: Row[str], owners: dict[str, str], scope: Scope) -> list[int]:
    """The rows of the passive joints of ``loop``; ``owners``, the loops of those read before, is extended."""
    rows = []
    for item in read_list(node, f"passive of loop {loop}", 2, scope.faults) or ():
        name = _joint(item, names, f"passive joint of loop {loop}", scope)
        if name in owners:
            scope.faults.error(item, f"joint '{name}' is passive twice", f"it belongs to loop {owners[name]}")
        elif name is not None:
            owners[name] = loop
            rows.append(names.index(name))
    return rows


def _read_pins(node: Node, loop: str, names: Row[str], scope: Scope) -> list[Pin]:
    what = f"pins of loop {loop}"
    entries = read_entries(node, what, scope.faults) or {}
    if entries and len(entries) != 2:
        hint = "name the two links that the pin joins, each by its joint, or base"
        scope.faults.error(node, f"{what} names {len(entries)} links instead of 2", hint)
        return []
    pins: list[Pin] = []
    for name, (key, value) in entries.items():
        place = read_vector(value, f"the place on {name} in {what}", "length", scope, True)
        if _joint(key, [BASE, *names], f"a link in {what}", scope) is not None and place is not None:
            x, y, z = place
            pins.append((-1 if name == BASE else names.index(name), (x, y, z)))
    return pins
