"""Reader of the attributes of XML elements, numbers foremost; every fault is reported with its place."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from typing import Any

from rrrgen.base.yamltext.document import FaultList, Place
from rrrgen.base.yamltext.sections import shorten
from rrrgen.base.yamltext.suggest import did_you_mean
from rrrgen.robot.importers.trees.exact_numbers import EQUAL, HIGH, Array, exact_multiple, norm, number, vector
from rrrgen.robot.importers.trees.xml_tree import Element

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?", re.ASCII)
MAX_DIGITS = 60
MAX_LISTED = 100


class Values:
    """Reads attributes of one file; ``rounded`` collects by how much (rad) angles were changed to exact ones."""

    def __init__(self, faults: FaultList, angle_tolerance: float) -> None:
        self.faults, self.tolerance = faults, number(angle_tolerance)
        self.rounded: list[Any] = []

    def numbers(self, element: Element, name: str, count: int | None, default: str | None = None) -> list[Any] | None:
        """Read an attribute that holds ``count`` decimal numbers, or any number of them if that is None.

        ``default`` is the text of an absent attribute. A fault and None if there is neither, or for other text.
        """
        text = element.attributes.get(name, default)
        if text is None:
            self.faults.error(element.place, f"<{element.tag}> has no attribute '{name}'", f'{name}="..." is needed')
            return None
        words = text.split()
        if (count is not None and len(words) != count) or len(words) > MAX_LISTED:
            wanted = f"{count} number{'s' * (count != 1)}" if count is not None else f"at most {MAX_LISTED} numbers"
            self.faults.error(element.place_of(name), f"{name} of <{element.tag}> is '{shorten(text)}'", wanted)
            return None
        for word in words:
            if not _NUMBER.fullmatch(word) or len(word) > MAX_DIGITS or abs(number(word)) > 1e15:
                message = f"'{shorten(word)}' in {name} of <{element.tag}> is not a number of this file"
                self.faults.error(element.place_of(name), message, "decimal numbers below 1e15, with a point")
                return None
        return [number(word) for word in words]

    def one(self, element: Element, name: str, default: str | None = None) -> Any:
        """Read one number of an attribute; 0 after a fault."""
        found = self.numbers(element, name, 1, default)
        return found[0] if found else number(0)

    def float_or_none(self, element: Element | None, name: str) -> float | None:
        """Read one number of an attribute as a float; None if the attribute is missing."""
        if element is None or name not in element.attributes:
            return None
        found = self.numbers(element, name, 1)
        return float(found[0]) if found else None

    def not_negative(self, element: Element, name: str) -> float:
        """Read one number of 0 or more, 0 if the attribute is missing; a fault for a negative one."""
        found = self.float_or_none(element, name) or 0.0
        if found < 0:
            self.faults.error(element.place_of(name), f"{name} of <{element.tag}> is {found:g}", "0 or more")
        return found

    def three(self, element: Element, name: str, default: str | None = "0 0 0") -> list[Any]:
        """Read three numbers of an attribute; zeros after a fault."""
        return self.numbers(element, name, 3, default) or [number(0)] * 3

    def angle(self, angle: Any) -> Any:
        """Replace an angle (rad) that is close to a multiple of 15 degrees by that multiple."""
        exact = exact_multiple(angle, self.tolerance)
        if abs(exact - angle) > EQUAL:
            self.rounded.append(abs(exact - angle))
        return exact

    def direction(self, element: Element, name: str, values: list[Any]) -> Array:
        """Normalize the vector ``values``; one close to an axis of the frame, or halfway between two, becomes exact."""
        v = vector(values)
        length = norm(v)
        if length <= EQUAL:
            self.faults.error(element.place_of(name), f"{name} of <{element.tag}> has no direction", "1 0 0")
            return vector((0, 0, 1))
        v = v / length
        exact = self._exact_direction(v)
        turned = norm(exact - v)
        if turned > EQUAL:
            self.rounded.append(turned)
        return exact

    def _exact_direction(self, v: Array) -> Array:
        """Replace ``v`` by a direction at a multiple of 15 degrees in a coordinate plane, if one is close to it."""
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            if abs(v[k]) <= self.tolerance:
                angle = HIGH.atan2(v[j], v[i])
                exact = exact_multiple(angle, self.tolerance)
                near = vector((0, 0, 0))
                near[i], near[j] = _zero(HIGH.cos(exact)), _zero(HIGH.sin(exact))
                if abs(angle - exact) <= EQUAL or exact != angle:
                    return near
        return v


def refuse_repeated(element: Element, tags: Iterable[str], faults: FaultList) -> None:
    """Report a fault for every child of ``element`` that repeats one of ``tags``, which may occur once."""
    first: dict[str, Element] = {}
    for child in element.children:
        if child.tag in tags and child.tag in first:
            hint = f"one; the first is at line {first[child.tag].place.line}"
            faults.error(child.place, f"there are two <{child.tag}> in one <{element.tag}>", hint)
        first.setdefault(child.tag, child)


def refuse_unknown(
    elements: Iterable[Element], known: Mapping[str, Collection[str]], strict: Collection[str], faults: FaultList
) -> None:
    """Report the attributes of ``elements`` that are not among those ``known`` of their tags.

    They are faults where they look like a known attribute that the element lacks, and in elements with the tags
    ``strict``, in which every attribute changes how the robot moves; else one warning for each kind. Prefixed names
    belong to other vocabularies.
    """
    left_out: dict[tuple[str, str], list[Place]] = {}
    for element in elements:
        names = known[element.tag]
        for name in element.attributes:
            if name in names or ":" in name or name == "xmlns":
                continue
            guess = did_you_mean(name, [each for each in names if each not in element.attributes])
            if guess or element.tag in strict:
                hint = guess or f"attributes are {', '.join(names)}"
                faults.error(element.place_of(name), f"<{element.tag}> has no attribute '{name}'", hint)
            else:
                left_out.setdefault((element.tag, name), []).append(element.place_of(name))
    for (tag, name), places in left_out.items():
        times = f", {len(places)} times" if len(places) > 1 else ""
        hint = f"read are {', '.join(known[tag])}" if known[tag] else "none is read"
        faults.warning(places[0], f"the attribute '{name}' of <{tag}> is left out{times}", hint)


def _zero(value: Any) -> Any:
    return value if abs(value) > EQUAL else number(0)
