"""XML of robot descriptions: a tree with line numbers, and readers of its attributes that report every fault."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import accumulate
from typing import Any
from xml.parsers import expat
from xml.sax.saxutils import escape, quoteattr

from rrrgen.base.yamltext.document import FaultList, Place, shorten
from rrrgen.base.yamltext.suggestions import did_you_mean
from rrrgen.robot.importers.trees.exact_numbers import EQUAL, HIGH, Array, exact_multiple, norm, number, vector

# ------------------------------------------------------------------------------------------------------------------
# Parser of XML text into elements with their line and column, with bounds on size and depth.
#
# Entities and document types are refused.
# ------------------------------------------------------------------------------------------------------------------

MAX_DEPTH = 200
MAX_ELEMENTS = 50_000

_LINE_END = re.compile("\r\n|[\n\r]")  # in YAML, U+0085, U+2028 and U+2029 end a line too; in XML 1.0 they do not


@dataclass
class Element:
    """One element: its attributes as text, its children in order, and ``place``, where it begins.

    ``places`` are those of the values of its attributes.
    """

    tag: str
    attributes: dict[str, str]
    place: Place
    children: list[Element] = field(default_factory=list)
    text: str = ""
    places: dict[str, Place] = field(default_factory=dict)

    def place_of(self, attribute: str) -> Place:
        """The place where the value of an attribute begins; that of the element if it has no such attribute."""
        return self.places.get(attribute, self.place)

    def child(self, tag: str) -> Element | None:
        """The first child with this tag."""
        return next((child for child in self.children if child.tag == tag), None)

    def all(self, tag: str) -> list[Element]:
        """All children with this tag."""
        return [child for child in self.children if child.tag == tag]

    def walk(self) -> Iterator[Element]:
        """This element and everything below it, in the order of the file."""
        yield self
        for child in self.children:
            yield from child.walk()


def xml_text(element: Element) -> str:
    """The text of an element and everything below it, without the line breaks between elements."""
    attributes = "".join(f" {name}={quoteattr(value)}" for name, value in element.attributes.items())
    inside = escape(element.text.strip()) + "".join(xml_text(child) for child in element.children)
    return f"<{element.tag}{attributes}>{inside}</{element.tag}>"


class _TooLargeError(Exception):
    """Raised where the document exceeds a bound, after the fault has been reported."""


def parse_xml(text: str, faults: FaultList) -> Element | None:
    """The root element; a fault with its place and None if ``text`` is not well-formed XML within the bounds."""
    reader = _XmlReader(text, faults)
    try:
        reader.parser.Parse(text.encode("utf-8"), True)
    except expat.ExpatError as error:
        place = Place(error.lineno, min(error.offset, _longest(faults, error.lineno)) + 1)
        faults.error(place, f"not valid XML: {expat.ErrorString(error.code)}", "check tags, quotes and &...; entities")
        return None
    except _TooLargeError:
        return None
    return None if faults.errors else reader.root


def _longest(faults: FaultList, line: int) -> int:
    return len(faults.lines[line - 1]) if 0 < line <= len(faults.lines) else 0


class _XmlReader:
    def __init__(self, text: str, faults: FaultList) -> None:
        self.faults = faults
        faults.lines = _LINE_END.split(text)
        self.data = text.encode("utf-8")
        self.starts = list(accumulate((len(line) for line in self.data.splitlines(keepends=True)), initial=0))
        self.root: Element | None = None
        self.stack: list[Element] = []
        self.count = 0
        self.parser = expat.ParserCreate("utf-8")
        self.parser.ordered_attributes = True
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._characters
        self.parser.StartDoctypeDeclHandler = self._refuse_doctype
        self.parser.EntityDeclHandler = self._refuse_doctype

    def _refuse_doctype(self, *_: object) -> None:
        self._stop("a document type declaration", "plain elements only: remove <!DOCTYPE ...> and its entities")

    def _stop(self, message: str, hint: str) -> None:
        self.faults.error(self._place(self.parser.CurrentByteIndex), message, hint)
        raise _TooLargeError

    def _place(self, offset: int) -> Place:
        line = bisect_right(self.starts, offset, 0, max(1, len(self.starts) - 1))  # the last start is the end
        text = self.data[self.starts[line - 1] : offset].decode("utf-8", "replace")
        return Place(line, len(text) + 1)

    def _start(self, tag: str, attributes: list[str]) -> None:
        self.count += 1
        if self.count > MAX_ELEMENTS or len(self.stack) >= MAX_DEPTH:
            self._stop("the file is too large or nested too deeply", f"{MAX_ELEMENTS} elements, {MAX_DEPTH} levels")
        start = self.parser.CurrentByteIndex
        names, values = attributes[::2], attributes[1::2]
        element = Element(tag, dict(zip(names, values, strict=True)), self._place(start))
        element.places = self._places(start, names)
        if self.stack:
            self.stack[-1].children.append(element)
        else:
            self.root = element
        self.stack.append(element)

    def _places(self, start: int, names: list[str]) -> dict[str, Place]:
        """The places where the values of the attributes ``names`` of the tag at offset ``start`` begin."""
        end, places = start, {}
        for name in names:
            match = re.compile(rb"\s" + re.escape(name.encode()) + rb"\s*=\s*[\"']").search(self.data, end)
            if match is None:
                continue
            end = self.data.find(match.group()[-1:], match.end())
            places[name] = self._place(match.end())
        return places

    def _end(self, _: str) -> None:
        self.stack.pop()

    def _characters(self, text: str) -> None:
        if self.stack:
            self.stack[-1].text += text


# ------------------------------------------------------------------------------------------------------------------
# Reader of the attributes of XML elements, numbers foremost; every fault is reported with its place.
# ------------------------------------------------------------------------------------------------------------------

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,3})?", re.ASCII)
MAX_DIGITS = 60
MAX_LISTED = 100
LARGEST = 1e15  # of the numbers that mean a quantity


class Values:
    """Reads attributes of one file; ``rounded`` collects by how much (rad) angles were changed to exact ones."""

    def __init__(self, faults: FaultList, angle_tolerance: float) -> None:
        self.faults, self.tolerance = faults, number(angle_tolerance)
        self.rounded: list[Any] = []

    def numbers(
        self, element: Element, name: str, count: int | None, default: str | None = None, largest: float = LARGEST
    ) -> list[Any] | None:
        """Read an attribute that holds ``count`` decimal numbers, or any number of them if that is None.

        ``default`` is the text of an absent attribute. A fault and None if there is neither, or for other text and
        for magnitudes above ``largest``.
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
            if not _NUMBER.fullmatch(word) or len(word) > MAX_DIGITS or abs(number(word)) > largest:
                message = f"'{shorten(word)}' in {name} of <{element.tag}> is not a number of this file"
                self.faults.error(element.place_of(name), message, "decimal numbers below 1e15, with a point")
                return None
        return [number(word) for word in words]

    def one(self, element: Element, name: str, default: str | None = None) -> Any:
        """Read one number of an attribute; 0 after a fault."""
        numbers = self.numbers(element, name, 1, default)
        return numbers[0] if numbers else number(0)

    def float_or_none(self, element: Element | None, name: str, largest: float = LARGEST) -> float | None:
        """Read one number of an attribute as a float, at most ``largest``; None if the attribute is missing."""
        if element is None or name not in element.attributes:
            return None
        numbers = self.numbers(element, name, 1, largest=largest)
        return float(numbers[0]) if numbers else None

    def not_negative(self, element: Element, name: str) -> float:
        """Read one number of 0 or more, 0 if the attribute is missing; a fault for a negative one."""
        value = self.float_or_none(element, name) or 0.0
        if value < 0:
            self.faults.error(element.place_of(name), f"{name} of <{element.tag}> is {value:g}", "0 or more")
        return value

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
            guess = did_you_mean(name, [candidate for candidate in names if candidate not in element.attributes])
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
