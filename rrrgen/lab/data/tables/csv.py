"""Text tables with any separator, decimal point or comma, any number of header lines, and missing entries."""

from __future__ import annotations

import contextlib
import re
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import islice
from typing import IO, AnyStr, TextIO

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError, with_names
from rrrgen.lab.data.mapping import FileSource
from rrrgen.lab.data.tables import named_column, table_fault

MOST = 0.75  # share of the lines that a separator must split alike
SEPARATORS = (";", "\t", ",", "|")
MISSING = ("", "nan", "na", "n/a", "null", "none", "-", "--", "?", "inf", "-inf", "+inf", "infinity", "-infinity")
SAMPLE_LINES = 60
LONGEST_LINE = 1_000_000
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eEdD][+-]?\d+)?")


class CsvTable:
    """A text table; separator, decimal sign and header are detected from its first lines unless declared."""

    def __init__(self, source: FileSource) -> None:
        self.source, self.path = source, source.path
        try:
            with self._open() as stream:
                numbered = list(islice(self._rows(stream), SAMPLE_LINES))
        except UnicodeError:
            raise self._undecodable() from None
        except LookupError:
            raise table_fault(self.path, f"unknown encoding '{source.encoding}'") from None
        except OSError as error:
            raise table_fault(self.path, f"cannot be read: {error.strerror or error}") from None
        head = [line for _, line in numbered]
        if not head:
            raise table_fault(self.path, "the file is empty")
        self.separator = self._separator(head)
        self.header = source.header if source.header is not None else self._header_lines(head)
        rows = [self._cells(line) for line in head]
        data = rows[self.header :]
        if not data:
            raise table_fault(self.path, f"nothing but {self.header} header lines")
        self.decimal = source.decimal or self._decimal(data)
        if self.decimal == self.separator:
            raise table_fault(
                self.path,
                "the decimal comma and the separator are the same sign",
                "name them: separator: ';', decimal: ','",
            )
        self.width, self.truncated = max(len(row) for row in data), 0
        names = [cell.strip().strip('"') for cell in rows[0]] if self.header else []
        self.columns = tuple(names) if names else tuple(str(i + 1) for i in range(len(data[0])))
        self._most, self._first = len(names) or self.width, numbered[self.header][0]
        self._check_width(numbered[self.header :])

    def chunks(self, wanted: Sequence[str | int], size: int) -> Iterator[Array]:
        """Iterate over blocks (up to ``size`` rows, columns) of the ``wanted`` columns.

        Raises :class:`InputError` at an entry that is neither a number nor missing.
        """
        places = [named_column(self.path, name, self.columns) for name in wanted]
        with self._open() as stream:
            rows = self._rows(stream)
            for _ in range(self.header):
                next(rows, None)
            block = self._block(rows, size)
            while block:
                following = self._block(rows, size)
                if not following and self._is_cut(*block[-1], places):
                    self.truncated = 1
                    block.pop()
                if block:
                    yield self._parse(block, places)
                block = following

    # -- reading -------------------------------------------------------------------------------------------------

    def _open(self) -> TextIO:
        return open(self.path, encoding=self.source.encoding, newline=None)

    def _rows(self, stream: TextIO) -> Iterator[tuple[int, str]]:
        """Iterate over the rows of the file: line number (from 1) and text without its comment.

        The first ``skip`` lines of the source, and lines that are blank without their comment, are left out.
        """
        numbered = enumerate(_bounded_lines(stream), 1)
        plain = ((number, self._plain(line)) for number, line in islice(numbered, self.source.skip, None))
        return ((number, line) for number, line in plain if line.strip())

    def _block(self, rows: Iterator[tuple[int, str]], size: int) -> list[tuple[int, str]]:
        """The next ``size`` lines, each with its number in the file; InputError where the encoding is wrong."""
        try:
            return list(islice(rows, size))
        except UnicodeError:
            raise self._undecodable() from None

    def _undecodable(self) -> InputError:
        """The error for the first line that is not text in the declared encoding, with line and column if possible."""
        message, hint = f"not text in {self.source.encoding}", "damaged, or another encoding: encoding: latin-1"
        with self.path.open("rb") as stream:
            for number, line in enumerate(_bounded_lines(stream), 1):
                try:
                    line.decode(self.source.encoding)
                except UnicodeDecodeError as error:
                    if "utf-16" in self.source.encoding.lower() or "utf-32" in self.source.encoding.lower():
                        break
                    text = line.decode(self.source.encoding, "replace").rstrip("\r\n")
                    what = f"{message}: byte 0x{line[error.start]:02x}"
                    column = len(line[: error.start].decode(self.source.encoding, "replace")) + 1
                    return table_fault(self.path, what, hint, number, column, text)
        return table_fault(self.path, message, hint)

    def _plain(self, line: str) -> str:
        """The line without its end and comment."""
        if len(line) > LONGEST_LINE:
            raise table_fault(self.path, f"a line of more than {LONGEST_LINE} characters", "is it a table of text?")
        line = line.rstrip("\r\n")
        return line.split(self.source.comment, 1)[0] if self.source.comment else line

    def _cells(self, line: str) -> list[str]:
        cells = self._pieces(line)
        return _joined_quotes(cells, self.separator) if '"' in line else cells

    def _pieces(self, line: str) -> list[str]:
        """The parts of a line between all separators, those in quotes as well."""
        if self.separator == " ":
            return line.split()
        cells = line.split(self.separator)
        # a separator at the end of every line makes no column
        return cells[:-1] if len(cells) > 1 and not cells[-1].strip() else cells

    def _check_width(self, block: list[tuple[int, str]]) -> None:
        """Raise :class:`InputError` at a line with more entries than columns: its numbers would be read shifted."""
        for number, line in block:
            # counting separators is ten times faster than splitting
            narrow = self.separator != " " and line.count(self.separator) < self._most
            if not narrow and (entries := len(self._cells(line))) > self._most:
                raise self._too_wide(entries, number, line)

    def _too_wide(self, entries: int, number: int, line: str) -> InputError:
        if not self.header:
            what = f"{entries} entries, where the first lines have {self._most}"
            return table_fault(self.path, what, "a damaged line?", number, 1, line)
        what = f"{entries} entries, where the header has {self._most} names, so it is not clear which name is whose"
        causes = []
        if entries == self._most + 1:
            by_number = f"or give columns by number, with skip: {self._first - 1}, header: 0"
            causes.append(f"row names in front, as R writes them? Write none (row.names = FALSE), {by_number}")
        if self.separator == ",":
            causes.append("decimal commas in a file separated by commas? Separate the columns by ';'")
        if self.header > 1:
            causes.append("a title above the names? Leave it out: skip: 1")
        return table_fault(self.path, what, "; ".join(causes) or "a damaged line?", number, 1, line)

    def _parse(self, block: list[tuple[int, str]], places: list[int]) -> Array:
        self._check_width(block)
        in_quotes = any('"' in line and self._cells(line) != self._pieces(line) for _, line in block)
        lines = [line.replace(",", ".") if self.decimal == "," else line for _, line in block]
        delimiter = None if self.separator == " " else self.separator
        if not in_quotes:
            with contextlib.suppress(ValueError, UserWarning, DeprecationWarning), warnings.catch_warnings():
                warnings.simplefilter("error")
                return np.loadtxt(lines, delimiter=delimiter, usecols=places, ndmin=2, comments=None)
        return np.array([self._row(number, line, places) for number, line in block])

    def _is_cut(self, number: int, line: str, places: list[int]) -> bool:
        """Whether the last line is incomplete, because the recording ended in the middle of it, and is left out.

        Such a line has too few entries, or its last entry is not a number. It is an InputError unless truncated lines
        are to be skipped; in that case a last line without a line end is left out too, because its last number may have
        lost digits.
        """
        with self.path.open("rb") as stream:
            stream.seek(-min(4, self.path.stat().st_size), 2)
            ended = stream.read().rstrip(b"\x00").endswith((b"\n", b"\r"))
        cells = self._cells(line)
        last = cells[-1].strip().strip('"') if cells else ""
        plain = last.replace(",", ".") if self.decimal == "," else last
        broken = not ended and plain.lower() not in MISSING[1:] and not _NUMBER.fullmatch(plain)
        entries = len(cells) if self.separator == " " else max(len(cells), line.count(self.separator) + 1)
        short = entries < self.width and (not ended or max(places) >= entries)
        if self.source.skip_truncated:
            return short or broken or not ended
        if short or broken:
            what = f"the last line is cut off: {len(cells)} entries, the last one '{last[:20]}', of {self.width}"
            hint = with_names("the recording ended in the middle of it; {skip_truncated_line} leaves it out")
            raise table_fault(self.path, what, hint, number, len(line) + 1, line)
        return False

    def _row(self, number: int, line: str, places: list[int]) -> list[float]:
        """Parse one line entry by entry, to locate the faulty one."""
        cells = self._cells(line)
        return [self._entry(number, line, cells, place) for place in places]

    def _entry(self, number: int, line: str, cells: list[str], place: int) -> float:
        if place >= len(cells):
            if self.separator != " " and place == len(cells) and line.rstrip().endswith(self.separator):
                return np.nan
            raise table_fault(
                self.path,
                f"{len(cells)} entries, where {place + 1} are needed",
                "is the last line cut off?",
                number,
                1,
                line,
            )
        text = cells[place].strip().strip('"')
        if text.lower() in MISSING:
            return np.nan
        plain = text.replace(",", ".") if self.decimal == "," else text
        try:
            if not (plain.isascii() and _NUMBER.fullmatch(plain)):  # Python also takes 1_0 and digits of any script
                raise ValueError
            return float(plain.replace("D", "e").replace("d", "e"))
        except ValueError:
            hint = "decimal comma? name it with decimal: ','" if "," in text else f"column {self.columns[place]}"
            at = line.find(cells[place]) + 1
            raise table_fault(self.path, f"'{text[:40]}' is not a number", hint, number, at, line) from None

    # -- detecting the format ------------------------------------------------------------------------------------

    def _separator(self, head: list[str]) -> str:
        """Detect the separator: the first one that splits all of the later lines of ``head`` into equally many cells.

        If there is none, the first one that does so with most of them, so that reading names the line that differs.
        A separator that does not occur in these lines does not count.
        """
        if self.source.separator:
            return self.source.separator
        body = head[len(head) // 2 :]
        for separator in SEPARATORS:
            counts = {line.count(separator) for line in body}
            if len(counts) == 1 and counts != {0}:
                return separator
        words = {len(line.split()) for line in body}
        for separator in SEPARATORS if words == {1} else ():
            usual, lines = Counter(line.count(separator) for line in body).most_common(1)[0]
            if usual and lines > MOST * len(body):
                return separator
        if len(words) == 1:
            return " "
        raise table_fault(
            self.path, "the separator of the columns is not clear", "name it: separator: ',' | ';' | tab | space"
        )

    def _header_lines(self, head: list[str]) -> int:
        """Number of header lines: the leading lines of ``head`` that have an entry which is not a number."""
        for count, line in enumerate(head):
            cells = [cell.strip().strip('"') for cell in self._cells(line)]
            if all(cell.lower() in MISSING or _NUMBER.fullmatch(cell) for cell in cells) and any(cells):
                return count
        raise table_fault(
            self.path, "no line of numbers among the first lines", "name the number of header lines: header: 1"
        )

    def _decimal(self, data: list[list[str]]) -> str:
        """The decimal sign: a comma if entries contain commas; both commas and points are an InputError."""
        text = [cell for row in data for cell in row if self.separator not in cell]  # others are text in quotes
        commas = any("," in cell for cell in text)
        points = any("." in cell for cell in text)
        if commas and points:
            raise table_fault(self.path, "entries with decimal points and with commas", "name it: decimal: '.' | ','")
        return "," if commas else "."


def _bounded_lines(stream: IO[AnyStr]) -> Iterator[AnyStr]:
    """Iterate over the lines of ``stream``, cut at a little over LONGEST_LINE, so that memory is bounded."""
    return iter(partial(stream.readline, LONGEST_LINE + 1), stream.read(0))


def _joined_quotes(pieces: list[str], separator: str) -> list[str]:
    """Join the ``pieces`` of a line whose separator stands in quotes; all stay apart if a quote is not closed."""
    cells: list[str] = []
    is_open = False
    for piece in pieces:
        if is_open:
            cells[-1] += separator + piece
        else:
            cells.append(piece)
        is_open ^= piece.count('"') % 2 == 1
    return pieces if is_open else cells
