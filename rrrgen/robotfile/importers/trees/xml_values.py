"""Reader of numbers in the attributes of XML elements; every fault is reported with its place."""

from __future__ import annotations

import re
from typing import Any

from rrrgen.robotfile.importers.trees.exact_numbers import EQUAL, HIGH, Array, exact_multiple, norm, number, vector
from rrrgen.robotfile.importers.trees.xml_tree import Element
from rrrgen.yamltext.document import FaultList
from rrrgen.yamltext.sections import shorten

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?")
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


def _zero(value: Any) -> Any:
    return value if abs(value) > EQUAL else number(0)
