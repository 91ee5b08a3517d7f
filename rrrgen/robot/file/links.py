"""Reads the links (mass, centre of mass, inertia) and tests whether they are physical."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence as Row
from typing import Literal, cast

import sympy as sp

from rrrgen.base.yamltext.document import Node, ScalarNode, SequenceNode
from rrrgen.base.yamltext.fields import read_choice, read_list, read_section, read_text
from rrrgen.base.yamltext.suggestions import with_unit
from rrrgen.robot.file.fields import INERTIA, MAX_JOINTS, ROBOT_FILE
from rrrgen.robot.file.quantities import Scope, read_rational, read_vector
from rrrgen.robot.spec import LinkSpec, name_fault

ENTRIES = ("xx", "yy", "zz", "xy", "xz", "yz")
_SHORTEST_COM = 0.005  # m; centres of mass of a mm file that are all nearer were written in metres
ROUNDING = sp.Rational(1, 10**6)  # share of the trace by which rounded decimals may miss the semidefinite cone

_ABOUT = next(key for key in INERTIA if key.name == "about")
_PRODUCTS = next(key for key in INERTIA if key.name == "products")


MASSLESS = LinkSpec(sp.S.Zero, (sp.S.Zero, sp.S.Zero, sp.S.Zero), (sp.S.Zero,) * 6, "com")
"""The link of a fixed row for which the file states none."""


def read_links(node: Node, fixed: Row[bool], strict: bool, scope: Scope) -> list[LinkSpec | None]:
    """Read the list ``links``, one link for each row of ``joints``; a link with a fault gives None.

    ``fixed`` says of each row whether it is fixed: the list may leave out the links of all fixed rows, which then have
    no mass. Non-physical inertia is a warning, with ``strict`` an error.
    """
    items = read_list(node, "links", None, scope.faults)
    if items is None:
        return []
    if not items:
        scope.faults.error(node, "links is empty", "describe every link, or leave the key out")
        return []
    joints, moving = len(fixed), [number for number, rests in enumerate(fixed, start=1) if not rests]
    if len(items) > MAX_JOINTS or (joints and len(items) not in (joints, len(moving))):
        left_out = f", or {len(moving)} without those of fixed rows" if len(moving) < joints else ""
        hint = f"describe all {joints} links{left_out}, or none" if joints else f"at most {MAX_JOINTS}"
        scope.faults.error(node, f"{len(items)} links for {joints} joints", hint)
        return []
    start = len(scope.bare_lengths)
    numbers = range(1, len(items) + 1) if not joints or len(items) == joints else moving
    stated = {n: _read_link(item, n, strict, scope) for n, item in zip(numbers, items, strict=True)}
    _check_scale(items, numbers, scope, start)
    return [stated.get(number, MASSLESS) for number in range(1, max(joints, len(items)) + 1)]


def _read_link(node: Node, number: int, strict: bool, scope: Scope) -> LinkSpec | None:
    what = f"link {number}"
    values = read_section(node, "link", what, scope.faults, ROBOT_FILE)
    return None if values is None else _read_body(values, what, strict, scope)


def read_floating_base(node: Node, joints: Row[str], strict: bool, scope: Scope) -> tuple[str, LinkSpec] | None:
    """Read ``floating_base``: the name of the body, which none of the ``joints`` may have, and its inertia."""
    values = read_section(node, "floating", "floating_base", scope.faults, ROBOT_FILE)
    if values is None or "name" not in values:
        return None
    name = read_text(values["name"], "name of floating_base", scope.faults)
    fault = name_fault(name, "joint")
    if name in joints:
        fault = f"the name '{name}' of the floating base is that of a joint", "the body needs a name of its own"
    if fault:
        scope.faults.error(values["name"], *fault)
    body = _read_body(values, "the floating base", strict, scope)
    return None if body is None else (name, body)


def _read_body(values: dict[str, Node], what: str, strict: bool, scope: Scope) -> LinkSpec | None:
    mass = read_rational(values["mass"], f"mass of {what}", "mass", scope) if "mass" in values else None
    if mass is not None and mass < 0:
        scope.faults.error(values["mass"], f"mass of {what} is negative")
        mass = None
    com = _read_com(values["com"], f"com of {what}", scope) if "com" in values else None
    inertia = _read_inertia(values["inertia"], what, scope) if "inertia" in values else None
    if mass is None or com is None or inertia is None:
        return None
    about, products, tensor = inertia
    link = LinkSpec(mass, com, tensor, about, products)
    if fault := physical_fault(link):
        report = scope.faults.error if strict else scope.faults.warning
        report(values["inertia"], f"no rigid body has the inertia of {what}: {fault}", _other_reading(link))
    return link


def _read_com(node: Node, what: str, scope: Scope) -> tuple[sp.Rational, sp.Rational, sp.Rational] | None:
    vector = read_vector(node, what, "length", scope, True)
    if vector is None:
        return None
    x, y, z = (scope.substitute(value) for value in vector)
    if not (x.is_Rational and y.is_Rational and z.is_Rational):
        scope.faults.error(node, f"{what} is not rational", "write decimal numbers")
        return None
    return x, y, z


def _check_scale(items: list[Node], numbers: Row[int], scope: Scope, start: int) -> None:
    """Report centres of mass of a mm file whose longest bare number is below 5: they were probably written in metres.

    ``numbers`` are those of the links, ``start`` is the number of bare lengths that were read before them.
    """
    longest = max(scope.bare_lengths[start:], default=0.0)
    if not 0.0 < longest < _SHORTEST_COM:
        return
    for number, item in zip(numbers, items, strict=True):
        com = next((value for key, value in getattr(item, "entries", ()) if getattr(key, "text", "") == "com"), None)
        for entry in com.items if isinstance(com, SequenceNode) else ():
            if isinstance(entry, ScalarNode) and re.fullmatch(r"-?[\d.]*[1-9][\d.]*", entry.text):
                message = f"com of link {number} is {entry.text} mm, and none of this file is longer than 5 mm"
                hint = f"com is in the units of the file; write {with_unit(entry.text, 'm')}"
                scope.faults.error(entry, message, f"{hint}, or {with_unit(entry.text, 'mm')} if that is meant")
                break


def _read_inertia(
    node: Node, what: str, scope: Scope
) -> tuple[Literal["com", "origin"], Literal["tensor", "positive"], tuple[sp.Rational, ...]] | None:
    values = read_section(node, "inertia", f"inertia of {what}", scope.faults, ROBOT_FILE)
    if values is None:
        return None
    about = read_choice(values["about"], _ABOUT, scope.faults) if "about" in values else None
    products = read_choice(values["products"], _PRODUCTS, scope.faults) if "products" in values else "tensor"
    entries: list[sp.Rational] = []
    for name in ENTRIES:
        if name in values:
            entry = read_rational(values[name], f"{name} of {what}", "inertia", scope)
            if entry is not None:
                entries.append(-entry if products == "positive" and name in ENTRIES[3:] else entry)
        elif name in ENTRIES[3:]:
            entries.append(sp.S.Zero)
    if about is None or products is None or len(entries) != len(ENTRIES):
        return None
    return cast(Literal["com", "origin"], about), cast(Literal["tensor", "positive"], products), tuple(entries)


def inertia_about_com(link: LinkSpec) -> tuple[sp.Rational, ...]:
    """Inertia tensor (xx, yy, zz, xy, xz, yz), kg m^2, about the centre of mass, by Steiner's theorem."""
    if link.about == "com":
        return link.inertia
    m, (x, y, z) = link.mass, link.com
    shift = (y * y + z * z, x * x + z * z, x * x + y * y, -x * y, -x * z, -y * z)
    return tuple(entry - m * moved for entry, moved in zip(link.inertia, shift, strict=True))


def physical_fault(link: LinkSpec) -> str:
    """The reason why no rigid body has the parameters of ``link``; empty if one exists.

    A body exists exactly if the pseudo-inertia ``J = integral of [r; 1][r; 1]^T dm`` (14.9) is positive
    semidefinite; that is ``m >= 0`` and ``integral of r r^T dm`` about the centre of mass positive semidefinite,
    which is the triangle inequality of the principal moments.
    """
    xx, yy, zz, xy, xz, yz = inertia_about_com(link)
    trace = (xx + yy + zz) / 2
    if link.mass == 0 and (any(link.com) or any(link.inertia)):
        return "it has no mass"
    second = ((trace - xx, -xy, -xz), (-xy, trace - yy, -yz), (-xz, -yz, trace - zz))
    slack = abs(trace) * ROUNDING
    shifted = [[value + (slack if i == j else 0) for j, value in enumerate(row)] for i, row in enumerate(second)]
    if trace >= 0 and is_positive_semidefinite(shifted):
        return ""
    a, b, c = principal_moments((xx, yy, zz, xy, xz, yz))
    return (
        f"its principal moments about the centre of mass, {a:.4g}, {b:.4g} and {c:.4g}, break the triangle inequality"
    )


def _other_reading(link: LinkSpec) -> str:
    """A hint for the user: the other values of ``about`` and ``products`` with which the numbers would be physical."""
    x, y, z, xy, xz, yz = link.inertia
    flipped = (x, y, z, -xy, -xz, -yz)
    other: Literal["com", "origin"] = "origin" if link.about == "com" else "com"
    sign: Literal["tensor", "positive"] = "positive" if link.products == "tensor" else "tensor"
    if not physical_fault(LinkSpec(link.mass, link.com, flipped, link.about, sign)):
        return f"with 'products: {sign}' it would be physical"
    if not physical_fault(LinkSpec(link.mass, link.com, link.inertia, other)):
        return f"with 'about: {other}' it would be physical"
    if not physical_fault(LinkSpec(link.mass, link.com, flipped, other)):
        return f"with 'about: {other}' and 'products: {sign}' it would be physical"
    return "the sum of any two principal moments is at least the third; check units, about and products"


def is_positive_semidefinite(matrix: Row[Row[sp.Rational]]) -> bool:
    """Whether a symmetric rational matrix is positive semidefinite; exact, by symmetric elimination."""
    rows = [list(row) for row in matrix]
    while rows:
        pivot, rest = rows[0][0], rows[0][1:]
        if pivot < 0 or (pivot == 0 and any(rest)):
            return False
        remaining = [row[1:] for row in rows[1:]]
        if pivot:
            remaining = [
                [value - left * top / pivot for value, top in zip(row, rest, strict=True)]
                for row, left in zip(remaining, rest, strict=True)
            ]
        rows = remaining
    return True


def principal_moments(tensor: Row[sp.Rational]) -> tuple[float, float, float]:
    """Eigenvalues of a symmetric 3x3 tensor (xx, yy, zz, xy, xz, yz), ascending, by the trigonometric formula."""
    xx, yy, zz, xy, xz, yz = (float(value) for value in tensor)
    mean = (xx + yy + zz) / 3
    a, b, c = xx - mean, yy - mean, zz - mean
    spread = math.sqrt((a * a + b * b + c * c + 2 * (xy * xy + xz * xz + yz * yz)) / 6)
    if spread == 0.0:
        return mean, mean, mean
    determinant = a * (b * c - yz * yz) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz)
    angle = math.acos(max(-1.0, min(1.0, determinant / (2 * spread**3)))) / 3
    largest = mean + 2 * spread * math.cos(angle)
    smallest = mean + 2 * spread * math.cos(angle + 2 * math.pi / 3)
    return smallest, 3 * mean - largest - smallest, largest
