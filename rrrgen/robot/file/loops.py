"""Reader of closed loops: two joints without drive each, and the pin that joins two links."""

from __future__ import annotations

from collections.abc import Sequence as Row

import sympy as sp

from rrrgen.base.yamltext.document import Node, ScalarNode, describe
from rrrgen.base.yamltext.fields import read_choice, read_entries, read_list, read_section
from rrrgen.base.yamltext.suggestions import did_you_mean
from rrrgen.robot.file.fields import BASE, LOOP, ROBOT_FILE
from rrrgen.robot.file.quantities import Scope, read_vector
from rrrgen.robot.spec import LoopSpec, name_fault

_ASSEMBLY = next(key for key in LOOP if key.name == "assembly")

Pin = tuple[int, tuple[sp.Expr, sp.Expr, sp.Expr]]


def read_loops(node: Node, names: Row[str], scope: Scope) -> dict[str, tuple[ScalarNode, LoopSpec]]:
    """Read ``{name: {passive: [..], pins: {..}, assembly: ..}, ..}``, with the nodes of the names.

    ``names`` are those of the joints; the passive ones of a loop stand in its result in the order of the table. Loops
    with a fault are left out.
    """
    loops: dict[str, tuple[ScalarNode, LoopSpec]] = {}
    owners: dict[str, str] = {}
    for name, (key, value) in (read_entries(node, "loops", scope.faults) or {}).items():
        if fault := name_fault(name, "loop"):
            scope.faults.error(key, *fault)
            continue
        values = read_section(value, "loop", f"loop {name}", scope.faults, ROBOT_FILE)
        if values is None or not {"passive", "pins", "assembly"} <= values.keys():
            continue
        passive = _read_passive(values["passive"], name, names, owners, scope)
        pins = _read_pins(values["pins"], name, names, scope)
        assembly = read_choice(values["assembly"], _ASSEMBLY, scope.faults)
        if len(passive) == 2 and len(pins) == 2 and assembly is not None:
            first, second = sorted(passive)
            loops[name] = key, LoopSpec(name, (first, second), (pins[0], pins[1]), -1 if assembly == "-1" else 1)
    return loops


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
