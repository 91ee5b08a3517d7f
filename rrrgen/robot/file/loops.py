"""Reader of closed loops: two joints without drive each, and the pin that joins two links."""

from __future__ import annotations

from collections.abc import Sequence as Row

import sympy as sp

from rrrgen.base.yamltext.document import Node, ScalarNode, describe
from rrrgen.base.yamltext.fields import read_choice, read_entries, read_list, read_section
from rrrgen.base.yamltext.suggestions import did_you_mean
from rrrgen.robot.file.fields import BASE, LOOP, ROBOT_FILE
from rrrgen.robot.file.quantities import Scope, read_value, read_vector
from rrrgen.robot.spec import JointSpec, LoopSpec, name_fault

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
    found = []
    for joint in passive:
        if joint.name not in entries:
            scope.faults.error(node, f"{what} has no displacement of '{joint.name}'", f"it names {names}")
            return None
        label, quantity = f"{joint.name} in {what}", _START.quantity_for(joint.type)
        found.append(read_value(entries[joint.name][1], label, quantity, scope, _START.file_units))
    first, second = found
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
    found = []
    for item in read_list(node, f"passive of loop {loop}", 2, scope.faults) or ():
        name = _joint(item, names, f"passive joint of loop {loop}", scope)
        if name in owners:
            scope.faults.error(item, f"joint '{name}' is passive twice", f"it belongs to loop {owners[name]}")
        elif name is not None:
            owners[name] = loop
            found.append(names.index(name))
    return found


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
