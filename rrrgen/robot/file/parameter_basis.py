"""Reads base parameters defined by the user: expressions in link symbols."""

from __future__ import annotations

import re
from collections.abc import Sequence as Row
from typing import Literal, cast

import sympy as sp

from rrrgen.base.yamltext.document import MappingNode, Node, Place, ScalarNode, SequenceNode, describe
from rrrgen.base.yamltext.expressions import ExpressionError, Name, parse_expression
from rrrgen.base.yamltext.fields import read_choice, read_entries, read_section
from rrrgen.base.yamltext.units import NUMBER
from rrrgen.robot.file.fields import BASIS, ROBOT_FILE
from rrrgen.robot.file.quantities import Scope, report_expression
from rrrgen.robot.spec import BasisSpec, LinkSpec, name_fault, parameter_symbol

Products = Literal["tensor", "positive"]
_OFF_DIAGONAL = re.compile(r"I(xy|xz|yz)\d+")
_PRODUCTS = next(key for key in BASIS if key.name == "products")


def link_symbol_names(joints: int) -> list[str]:
    """Names of all symbols that a basis of this many links may use."""
    stems = ("m", "mx", "my", "mz", "x", "y", "z", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
    return [f"{stem}{i}" for i in range(1, joints + 1) for stem in stems]


def read_basis(node: Node, joints: int, links: Row[LinkSpec] | None, scope: Scope) -> BasisSpec | None:
    """Read a list of ``"expr"``, ``"name = expr"`` or ``{name: expr}``, or ``{products: ..., parameters: [...]}``."""
    products: Products | None = None
    items = node
    if isinstance(node, MappingNode):
        values = read_section(node, "basis", "basis", scope.faults, ROBOT_FILE)
        if values is None or "parameters" not in values or "products" not in values:
            return None
        products = cast("Products | None", read_choice(values["products"], _PRODUCTS, scope.faults))
        items = values["parameters"]
        if products is None:
            return None
    if not isinstance(items, SequenceNode) or not items.items:
        hint = 'write ["p1 = Izz1 + a1**2*m2", ...] or {products: positive, parameters: [...]}'
        empty = "an empty list" if isinstance(items, SequenceNode) else describe(items)
        scope.faults.error(items, f"basis is {empty}", hint)
        return None
    entries = [_read_entry(item, number, joints, scope) for number, item in enumerate(items.items, start=1)]
    _check_unique(entries, scope)
    _check_free(entries, scope)
    present = [entry for entry in entries if entry is not None]
    if len(present) != len(entries):
        return None
    if products is None:
        products = _products_of(links, [str(s) for _, e, _ in present for s in e.free_symbols], node, scope)
        if products is None:
            return None
    places = tuple((place.line, place.column) for _, _, place in present)
    return BasisSpec(tuple(name for name, _, _ in present), tuple(e for _, e, _ in present), products, places)


def _read_entry(node: Node, number: int, joints: int, scope: Scope) -> tuple[str, sp.Expr, Place] | None:
    name, text, offset = f"p{number}", node, 0
    if isinstance(node, MappingNode):
        pairs = read_entries(node, f"base parameter {number}", scope.faults)
        if pairs is None or len(pairs) != 1:
            scope.faults.error(node, f"base parameter {number} is not one entry", "write {p1: expression}")
            return None
        ((name, (_, text)),) = pairs.items()
    if not isinstance(text, ScalarNode):
        scope.faults.error(text, f"base parameter {number} is {describe(text)}, not an expression")
        return None
    expression = text.text
    if not isinstance(node, MappingNode) and "=" in expression:
        head, _, expression = expression.partition("=")
        name, offset = head.strip(), len(head) + 1
    if fault := name_fault(name, "base parameter"):
        scope.faults.error(node, *fault)
        return None
    names = {word: Name(parameter_symbol(word), NUMBER) for word in link_symbol_names(joints)}
    names |= {word: Name(known.expr, NUMBER) for word, known in scope.names.items()}
    try:
        value = parse_expression(expression, names, units=False)
    except ExpressionError as error:
        report_expression(error, text, f"base parameter {name}", scope, offset)
        return None
    return name, value.expr, node.place


def _check_unique(entries: Row[tuple[str, sp.Expr, Place] | None], scope: Scope) -> None:
    seen: set[str] = set()
    for entry in entries:
        if entry is not None and entry[0] in seen:
            scope.faults.error(entry[2], f"the base parameter name '{entry[0]}' is not unique")
        if entry is not None:
            seen.add(entry[0])


def _check_free(entries: Row[tuple[str, sp.Expr, Place] | None], scope: Scope) -> None:
    """Refuse a base parameter with the name of a geometric parameter, as closed forms contain both."""
    for entry in entries:
        if entry is not None and entry[0] in scope.names:
            message = f"the base parameter name '{entry[0]}' is that of a named parameter"
            scope.faults.error(entry[2], message, "give one of them another name")


def _products_of(links: Row[LinkSpec] | None, symbols: list[str], node: Node, scope: Scope) -> Products | None:
    """The sign convention of products of inertia in the links; a fault if they differ and the basis uses one."""
    conventions = {link.products for link in links or ()}
    if len(conventions) > 1 and any(_OFF_DIAGONAL.fullmatch(symbol) for symbol in symbols):
        hint = "write basis: {products: tensor | positive, parameters: [...]}"
        scope.faults.error(node, "the links differ in the sign of products, so Ixy, Ixz, Iyz are ambiguous", hint)
        return None
    return conventions.pop() if len(conventions) == 1 else "tensor"
