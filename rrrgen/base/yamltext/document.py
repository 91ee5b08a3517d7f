"""Parser of YAML text into a tree of nodes with line and column, bounded in size and depth; faults are collected.

Only the event stream of the YAML parser is used. Scalars therefore keep the text that the user typed: numbers stay
exact, ``no`` and ``1:30`` stay text, and no object is ever constructed from a tag.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from rrrgen.base.errors import Fault, InputError

MAX_BYTES = 1_000_000
MAX_NODES = 20_000
MAX_WORD = 5_000  # characters without a blank; YAML scanners are quadratic in the length of a tag
MAX_DEPTH = 12
MAX_ALIASES = 100
MAX_FAULTS = 100
LATEST = 16  # parsed texts that are kept

_LINE_BREAK = re.compile("\r\n|[\n\r\x85\u2028\u2029]")
_CONTROL = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f\x80-\x84\x86-\x9f\ud800-\udfff\ufeff\ufffe\uffff]")
_SURROGATE = re.compile("[\ud800-\udfff]")
_LONG_WORD = re.compile(rf"[^\s]{{{MAX_WORD}}}")
_TAB_INDENT = re.compile(r"^ *\t[ \t]*(?=[^\s#])")


@dataclass(frozen=True)
class Place:
    """Line and column, both counted from 1."""

    line: int = 1
    column: int = 1


@dataclass(frozen=True)
class ScalarNode:
    """One scalar value, with the text that the user typed.

    ``quoted`` is true if the value stood in quotes; ``inset`` is the number of characters between ``place`` and the
    first character of the text (1 for an opening quote).
    """

    text: str
    place: Place
    quoted: bool = False
    inset: int = 0

    @property
    def is_null(self) -> bool:
        """Whether YAML reads this scalar as null: empty, ``~`` or ``null``, without quotes."""
        return not self.quoted and self.text in ("", "~", "null", "Null", "NULL")


@dataclass(frozen=True)
class SequenceNode:
    """A YAML list; ``place`` is where it begins."""

    place: Place
    items: list[Node] = field(default_factory=list)


@dataclass(frozen=True)
class MappingNode:
    """A YAML mapping: its (key, value) pairs in the order of the file, duplicate keys included."""

    place: Place
    entries: list[tuple[Node, Node]] = field(default_factory=list)


Node: TypeAlias = ScalarNode | SequenceNode | MappingNode


class FaultList:
    """Errors and warnings found in one text, each kept to at most ``MAX_FAULTS``.

    ``file`` is the name printed in messages; ``text`` supplies the source lines quoted below them.
    """

    def __init__(self, file: str, text: str) -> None:
        self.file, self.lines = file, _LINE_BREAK.split(text)
        self.errors: list[Fault] = []
        self.warnings: list[Fault] = []

    def error(self, where: Node | Place | None, message: str, hint: str = "", offset: int = 0) -> None:
        """Record an error; an identical one is recorded once.

        ``where`` is the node or place at fault, None for the file as a whole; ``hint`` says what to do about it;
        ``offset`` moves the column by that many characters into a one-line scalar.
        """
        if len(self.errors) < MAX_FAULTS:
            fault = self.fault(where, message, hint, offset, "error")
            if fault not in self.errors:
                self.errors.append(fault)

    def warning(self, where: Node | Place | None, message: str, hint: str = "", offset: int = 0) -> None:
        """Record a warning; the arguments are those of :meth:`error`."""
        if len(self.warnings) < MAX_FAULTS:
            self.warnings.append(self.fault(where, message, hint, offset, "warning"))

    def raise_errors(self) -> None:
        """Raise :class:`InputError` with all errors and warnings if there is at least one error."""
        if self.errors:
            raise InputError(self.errors + self.warnings)

    def fault(self, where: Node | Place | None, message: str, hint: str, offset: int, severity: str) -> Fault:
        """Make a fault without recording it; the arguments are those of :meth:`error`, and the severity."""
        if where is None:
            return Fault(self.file, 0, 0, message, "", hint, severity)
        place = where if isinstance(where, Place) else where.place
        column = place.column
        if isinstance(where, ScalarNode) and offset <= len(where.text) and "\n" not in where.text:
            column += where.inset + offset
        line = self.lines[place.line - 1] if 0 < place.line <= len(self.lines) else ""
        return Fault(self.file, place.line, min(column, len(line) + 1), message, line, hint, severity)


def place_at(text: str, offset: int) -> Place:
    """Line and column of the character ``offset`` of ``text``, counted from 0."""
    line, start = 1, 0
    for line_break in _LINE_BREAK.finditer(text, 0, offset):
        line, start = line + 1, line_break.end()
    return Place(line, offset - start + 1)


Read = TypeVar("Read")


def file_text(path: str | os.PathLike[str], what: str) -> str:
    """The text of the YAML file ``path``; messages of InputError name ``what`` it is, such as "mapping file"."""
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise InputError([Fault(str(path), 0, 0, f"cannot read the {what}: {error.strerror or error}")]) from None
    return decode(data, str(path))


def read_document(text: str, file: str, what: str, read: Callable[[Node, FaultList], Read | None]) -> Read:
    """What ``read`` makes of the YAML ``text`` of ``file``, which is a ``what``, such as "mapping file".

    Raises InputError with every fault that ``read`` reports, and where it returns None for an empty document.
    """
    faults = FaultList(file, text)
    document = read(parse_document(text, faults), faults)
    faults.raise_errors()
    if document is None:
        raise InputError([Fault(file, 0, 0, f"the {what} says nothing")])
    return document


def decode(data: bytes, file: str) -> str:
    """Decode the bytes of a file, which must be UTF-8 (a byte order mark is dropped) of at most 1 MB.

    Raises :class:`InputError` naming ``file`` and, for a byte that is not UTF-8, its line and column.
    """
    if len(data) > MAX_BYTES:
        raise InputError([Fault(file, 0, 0, "the file is larger than 1 MB", hint="a robot file has some kilobytes")])
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise InputError([Fault(file, 0, 0, "the file is not UTF-8 but UTF-16", hint="save it as UTF-8")])
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = data[: error.start].decode("utf-8", "replace")
        rest = data[error.start :].split(b"\n", 1)[0].decode("utf-8", "replace")
        lines = _LINE_BREAK.split(before)
        message = f"the file is not UTF-8: byte 0x{data[error.start]:02x}"
        fault = Fault(
            file, len(lines), len(lines[-1]) + 1, message, (lines[-1] + rest).rstrip("\r"), "save it as UTF-8"
        )
        raise InputError([fault]) from None


def parse_document(text: str, faults: FaultList) -> Node:
    """Parse ``text``, which must hold exactly one YAML document, and return its root node.

    Faults are added to ``faults``; raises :class:`InputError` if there are any or if the file is empty.
    """
    _check_characters(text, faults)
    faults.raise_errors()
    # YAML accepts a tab between words as white space; only tabs in the indentation are refused
    root = _Composer(_events(text.replace("\t", " "), faults), faults).document()
    faults.raise_errors()
    if root is None:
        raise InputError([Fault(faults.file, 0, 0, "the file is empty", hint="start from 'rrrgen new'")])
    return root


def _check_characters(text: str, faults: FaultList) -> None:
    if len(text) > MAX_BYTES:
        raise InputError([Fault(faults.file, 0, 0, "the text is larger than 1 MB", hint="a robot has some kilobytes")])
    for number, line in enumerate(faults.lines, start=1):
        if control := _CONTROL.search(line):
            message = f"the control character U+{ord(control.group()):04X}"
            faults.error(Place(number, control.start() + 1), message, "a robot file is plain UTF-8 text")
        if word := _LONG_WORD.search(line):
            faults.error(Place(number, word.start() + 1), f"a word of more than {MAX_WORD} characters")
        if _TAB_INDENT.match(line):
            faults.error(
                Place(number, line.index("\t") + 1), "a tab in the indentation", "YAML is indented with spaces"
            )


_latest: dict[str, list[Any]] = {}


def _events(text: str, faults: FaultList) -> Iterator[Any]:
    """Parsing events of ruamel.yaml; the exceptions of the parser are recorded as faults.

    Parsing takes most of the time of reading a file, and programs read the file of one robot many times: the events of
    the latest texts without a fault are kept.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError, YAMLError

    if text in _latest:
        yield from _latest[text]
        return
    events = []
    try:
        for event in YAML(typ="safe", pure=True).parse(text):
            events.append(event)
            yield event
        _latest[text] = events
        if len(_latest) > LATEST:
            del _latest[next(iter(_latest))]
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = Place(mark.line + 1, mark.column + 1) if mark else None
        problem = str(error.problem or error.context or "this is not YAML")
        faults.error(place, f"not valid YAML: {problem}", "check indentation, brackets, and the blank after each ':'")
    except (YAMLError, ValueError, TypeError, LookupError, AttributeError, AssertionError, RecursionError):
        # ruamel.yaml leaks such exceptions from its scanner on malformed directives and escapes
        faults.error(None, "not valid YAML", "check directives, tags and escapes")


class _Composer:
    """Builds the node tree from parsing events with an explicit stack, within bounds on nodes, aliases and depth."""

    def __init__(self, events: Iterator[Any], faults: FaultList) -> None:
        self.events, self.faults = events, faults
        self.anchors: dict[str, Node] = {}
        self.nodes = self.aliases = 0

    def document(self) -> Node | None:
        root: Node | None = None
        stack: list[Node] = []
        keys: list[Node | None] = []  # the key waiting for its value, one per open collection
        documents = 0
        for event in self.events:
            kind = type(event).__name__
            place = Place(event.start_mark.line + 1, event.start_mark.column + 1)
            if kind == "DocumentStartEvent":
                documents += 1
                if documents > 1:
                    self.faults.error(place, "a second YAML document", "one robot per file")
                    return None
            elif kind in ("SequenceEndEvent", "MappingEndEvent"):
                stack.pop()
                keys.pop()
            elif kind in ("ScalarEvent", "AliasEvent", "SequenceStartEvent", "MappingStartEvent"):
                node = self.node(kind, event, place)
                if node is None:
                    return None
                if not stack:
                    root = node
                elif isinstance(parent := stack[-1], SequenceNode):
                    parent.items.append(node)
                elif isinstance(parent, MappingNode):
                    key = keys[-1]
                    keys[-1] = node if key is None else None
                    if key is not None:
                        parent.entries.append((key, node))
                if kind.endswith("StartEvent"):
                    stack.append(node)
                    keys.append(None)
                    if len(stack) > MAX_DEPTH:
                        self.faults.error(place, "nested too deeply", f"at most {MAX_DEPTH} levels")
                        return None
        return root

    def node(self, kind: str, event: Any, place: Place) -> Node | None:
        """Make the node that begins with ``event``, whose class has the name ``kind``.

        None, after a fault, for an alias without anchor or where a bound is exceeded.
        """
        self.nodes += 1
        if self.nodes > MAX_NODES:
            self.faults.error(place, "too many values in the file", f"at most {MAX_NODES}")
            return None
        if kind == "AliasEvent":
            self.aliases += 1
            if self.aliases > MAX_ALIASES:
                self.faults.error(place, "too many aliases", f"at most {MAX_ALIASES}")
                return None
            if event.anchor not in self.anchors:
                self.faults.error(place, f"the alias *{event.anchor} has no anchor")
                return None
            return self.anchors[event.anchor]
        if getattr(event, "tag", None) not in (None, "!"):
            self.faults.error(place, f"the YAML tag {event.tag}", "tags are not allowed; write the plain value")
        node = self.plain_node(kind, event, place)
        if event.anchor:
            self.anchors[event.anchor] = node
        return node

    def plain_node(self, kind: str, event: Any, place: Place) -> Node:
        if kind == "SequenceStartEvent":
            return SequenceNode(place)
        if kind == "MappingStartEvent":
            return MappingNode(place)
        quoted = event.style in ("'", '"', "|", ">")
        one_line = event.start_mark.line == event.end_mark.line
        text = self.encodable(event.value, place)
        return ScalarNode(text, place, quoted, int(event.style in ("'", '"') and one_line))

    def encodable(self, text: str, place: Place) -> str:
        r"""Join surrogate pairs such as ``"\ud83e\udd16"`` into characters; an unpaired surrogate is a fault."""
        if text.isascii() or not _SURROGATE.search(text):
            return text
        try:
            return text.encode("utf-16-le", "surrogatepass").decode("utf-16-le")
        except UnicodeDecodeError:
            half = ord(_SURROGATE.findall(text)[0])
            self.faults.error(place, f"the escape \\u{half:04x} is half of a character", "write the character itself")
            return _SURROGATE.sub("?", text)


def describe(node: Node) -> str:
    """Describe a node in a message: ``'its text'``, ``nothing``, ``a list`` or ``a mapping``."""
    if isinstance(node, ScalarNode):
        return "nothing" if node.is_null else f"'{shorten(node.text)}'"
    return "a list" if isinstance(node, SequenceNode) else "a mapping"


def shorten(text: str, width: int = 40) -> str:
    """Shorten ``text`` to one line of at most ``width`` characters, with ``...`` where it is cut."""
    text = " ".join(text.split())
    return text if len(text) <= width else text[: width - 3] + "..."
