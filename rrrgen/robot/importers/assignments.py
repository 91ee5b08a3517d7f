"""Reader of files of assignments ``NAME = VALUE`` and ``NAME = {entry, entry, ...}`` with comments ``(* ... *)``."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import sympy as sp

from rrrgen.base.yamltext.document import FaultList, Place, place_at
from rrrgen.base.yamltext.expressions import FUNCTIONS, ExpressionError, Name, parse_expression
from rrrgen.base.yamltext.sections import shorten
from rrrgen.robot.file.quantities import held_fault, held_number
from rrrgen.robot.importers.interface import Source
from rrrgen.robot.robot_spec import parameter_symbol

ZERO = sp.S.Zero

_COMMENT = re.compile(r"\(\*.*?\*\)", re.DOTALL)
_ITEM = re.compile(r"([A-Za-z_]\w*)[ \t]*=\s*(?:\{([^{}]*)\}|([^\s{}=]+))")
_SYMBOL = re.compile(r"(?<![\w.])[A-Za-z_]\w*")


@dataclass(frozen=True)
class Entry:
    """One entry of a list: its exact value and its place (line and column) in the file."""

    expr: sp.Expr
    place: Place


class Assignments:
    """The assignments of a file; ``spellings`` maps other spellings of the names of lists to the usual ones."""

    def __init__(self, source: Source, faults: FaultList, spellings: Mapping[str, str]) -> None:
        self.source, self.faults, self.spellings = source, faults, spellings
        self.text = _COMMENT.sub(lambda found: re.sub(r"\S", " ", found.group()), source.text)
        self.items: dict[str, tuple[str, int]] = {}
        self.place: dict[str, Place] = {}
        self._lists: dict[tuple[str, int], list[Entry]] = {}
        self._split()

    def _split(self) -> None:
        end = 0
        for found in _ITEM.finditer(self.text):
            self._refuse_rest(end, found.start())
            end = found.end()
            name = self.spellings.get(found.group(1), found.group(1))
            place = place_at(self.text, found.start())
            if name in self.items:
                self.faults.error(place, f"'{name}' is given twice", f"first at line {self.place[name].line}")
                continue
            group = 3 if found.group(2) is None else 2
            self.items[name], self.place[name] = (found.group(group), found.start(group)), place
        self._refuse_rest(end, len(self.text))

    def _refuse_rest(self, start: int, end: int) -> None:
        rest = self.text[start:end]
        if rest.strip():
            place = place_at(self.text, start + len(rest) - len(rest.lstrip()))
            hint = "allowed are NAME = VALUE, NAME = {entry, entry, ...} and comments (* ... *)"
            self.faults.error(place, f"'{shorten(rest)}' is no assignment", hint)

    def flag(self, name: str) -> str:
        """The text of a plain value ``NAME = VALUE``; empty if the file does not assign it."""
        return self.items.get(name, ("", 0))[0].strip()

    def entries(self, name: str, count: int, needed: bool = False) -> list[Entry]:
        """The ``count`` entries of one list; zeros if the file does not have it, a fault if it is ``needed``."""
        if (name, count) not in self._lists:
            self._lists[name, count] = self._read_list(name, count, needed)
        return self._lists[name, count]

    def _read_list(self, name: str, count: int, needed: bool) -> list[Entry]:
        if name not in self.items:
            if needed:
                self.faults.error(None, f"there is no list '{name}'", f"{name} = {{...}} with {count} entries")
            return [Entry(ZERO, Place())] * count
        text, start = self.items[name]
        entries = []
        for part in text.split(","):
            entries.append(self._entry(name, part.strip(), start + len(part) - len(part.lstrip())))
            start += len(part) + 1
        if len(entries) != count:
            message = f"{name} has {len(entries)} entries instead of {count}"
            self.faults.error(self.place[name], message, "one for each frame" if count > 4 else "")
            return [Entry(ZERO, self.place[name])] * count
        return entries

    def _entry(self, name: str, text: str, offset: int) -> Entry:
        place = place_at(self.text, offset)
        body = re.sub(r"\bPi\b", "pi", text)
        names = {word: Name(parameter_symbol(word)) for word in _SYMBOL.findall(body)}
        for word in ("pi", *FUNCTIONS):
            names.pop(word, None)
        try:
            expr = parse_expression(body, names, units=False).expr
        except ExpressionError as error:
            what = f"{name}: {error.message}" if text else f"{name}: an entry is empty"
            self.faults.error(Place(place.line, place.column + error.offset * bool(text)), what, error.hint)
            return Entry(ZERO, place)
        if not expr.free_symbols and held_number(expr) is None:
            words, hint = held_fault(expr)
            self.faults.error(place, f"{name}: an entry {words}", hint)
            return Entry(ZERO, place)
        return Entry(expr, place)

    def words(self) -> set[str]:
        """All names that occur in the file."""
        return set(_SYMBOL.findall(self.text))

    def at_given_values(self, expr: sp.Expr) -> sp.Expr:
        """Replace the names in ``expr`` by the values that the user gave; names without a value remain."""
        return expr.xreplace({parameter_symbol(k): v for k, v in self.source.values.items()})

    def number(self, entry: Entry, what: str) -> sp.Expr:
        """The value of ``entry`` with every name replaced by its value; a name without a value is a fault."""
        value = self.at_given_values(entry.expr)
        self.refuse_open(value, entry.place, what)
        if not value.free_symbols and not (value.is_real and value.is_finite):
            self.faults.error(entry.place, f"{what} is not finite and real", "division by zero, or a negative root?")
            return ZERO
        return ZERO if value.free_symbols else value

    def refuse_open(self, value: sp.Expr, place: Place, what: str) -> None:
        """Report a fault for every name in ``value`` that has no value."""
        for word in sorted(str(symbol) for symbol in value.free_symbols if str(symbol) not in self.source.values):
            self.faults.error(place, f"{what}: '{word}' has no value", f"give it one with --set {word}=VALUE, in SI")
