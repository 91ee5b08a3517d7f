"""Parser of XML text into elements with their line and column, with bounds on size and depth.

Entities and document types are refused.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.parsers import expat

from rrrgen.base.yamltext.document import FaultList, Place

MAX_DEPTH = 200
MAX_ELEMENTS = 50_000


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


class _TooLargeError(Exception):
    """Raised where the document exceeds a bound, after the fault has been reported."""


def parse_xml(text: str, faults: FaultList) -> Element | None:
    """The root element; a fault with its place and None if ``text`` is not well-formed XML within the bounds."""
    reader = _Reader(text, faults)
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


class _Reader:
    def __init__(self, text: str, faults: FaultList) -> None:
        self.faults = faults
        self.lines = text.encode("utf-8").splitlines(keepends=True)
        self.starts = [0]
        for line in self.lines:
            self.starts.append(self.starts[-1] + len(line))
        self.data = text.encode("utf-8")
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
        line = self.parser.CurrentLineNumber
        text = self.data[max(0, offset - self.parser.CurrentColumnNumber) : offset].decode("utf-8", "replace")
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
            found = re.compile(rb"\s" + re.escape(name.encode()) + rb"\s*=\s*[\"']").search(self.data, end)
            if found is None:
                continue
            end = self.data.find(found.group()[-1:], found.end())
            before = self.data[: found.end()].decode("utf-8", "replace")
            line = before.count("\n") + 1
            places[name] = Place(line, len(before) - (before.rfind("\n") + 1) + 1)
        return places

    def _end(self, _: str) -> None:
        self.stack.pop()

    def _characters(self, text: str) -> None:
        if self.stack:
            self.stack[-1].text += text
