"""Reads the keys that mapping files and response files share: recorded files, time, columns by name or number."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from rrrgen.base.yamltext import signal_units as log_units
from rrrgen.base.yamltext.document import FaultList, Node, Scalar
from rrrgen.base.yamltext.keys import Entry, words
from rrrgen.base.yamltext.reader import Reader
from rrrgen.base.yamltext.sections import read_entries
from rrrgen.lab.data.mapping import FileSource, TimeSource

FORMATS = ("csv", "npy", "npz", "mat", "hdf5", "parquet", "rosbag")
DECIMALS = (".", ",")
FILE_KEYS = {
    "path": Entry("the file, from the folder of this file on", required=True),
    "format": Entry(f"{words(FORMATS)}; by the suffix if missing"),
    "separator": Entry("of a text file: a character, or `tab`, `space`, `comma`, `semicolon`; found out if missing"),
    "decimal": Entry(f"of a text file: {words(DECIMALS)}; found out if missing"),
    "header": Entry("of a text file: number of header lines, after the skipped ones; found out if missing"),
    "skip": Entry("of a text file: number of lines to leave out before the header"),
    "comment": Entry("of a text file: what a comment begins with; `#` if missing"),
    "encoding": Entry("of a text file; UTF-8 if missing"),
    "topic": Entry("of a ROS bag with several"),
}
TIME_KEYS = {
    "rate": Entry("constant sampling rate", "Hz"),
    "period": Entry("constant sampling period, in place of a rate", "s"),
    "file": Entry("of recorded instants; may be missing if there is only one"),
    "column": Entry("of recorded instants, in place of a rate: its name, or its number from 1"),
    "unit": Entry(f"of recorded instants: {words(log_units.TIME)}"),
}


class SourceReader(Reader):
    """Reads the keys of a YAML file that describe recorded files, their time and their columns.

    ``files`` are the recorded files by name, with paths relative to ``folder``; faults are added to ``faults``.
    """

    def __init__(self, faults: FaultList, folder: Path, elsewhere: Mapping[str, str] | None = None) -> None:
        super().__init__(faults, elsewhere)
        self.folder = folder
        self.files: dict[str, FileSource] = {}

    def read_files(self, node: Node | None) -> None:
        """Fill ``files`` from one path or description, or from a mapping of names to paths or descriptions."""
        if node is None:
            return
        if isinstance(node, Scalar):
            self.files["log"] = FileSource("log", self.folder / node.text)
            return
        entries = read_entries(node, "files", self.faults) or {}
        if "path" in entries and entries.keys() <= FILE_KEYS.keys():
            self.files["log"] = self.read_file("log", node, "files")
            return
        for alias, (_, value) in entries.items():
            if isinstance(value, Scalar):
                self.files[alias] = FileSource(alias, self.folder / self.text(value, f"files.{alias}"))
                continue
            self.files[alias] = self.read_file(alias, value, f"files.{alias}")
        if not self.files:
            self.faults.error(node, "files names no file")

    def read_file(self, alias: str, node: Node, what: str) -> FileSource:
        """Read the description of one file, a mapping that the messages call ``what``."""
        part = self.values(node, what, FILE_KEYS) or {}
        return FileSource(
            name=alias,
            path=self.folder / self.text(part["path"], "path") if "path" in part else self.folder,
            format=self.choice(part["format"], "format", FORMATS) if "format" in part else None,
            separator=self.separator(part.get("separator")),
            decimal=self.choice(part["decimal"], "decimal", DECIMALS) if "decimal" in part else None,
            header=self.whole(part.get("header"), "header", None),
            skip=self.whole(part.get("skip"), "skip", 0) or 0,
            comment=self.text(part["comment"], "comment") if "comment" in part else "#",
            encoding=self.text(part["encoding"], "encoding") if "encoding" in part else "utf-8-sig",
            topic=self.text(part["topic"], "topic") if "topic" in part else None,
        )

    def read_time(self, node: Node | None) -> TimeSource:
        """Read where the sampling instants come from: a rate (Hz), a period (s), or a column of a file."""
        part = (self.values(node, "time", TIME_KEYS) or {}) if node is not None else {}
        given = [key for key in ("rate", "period", "column") if key in part]
        if node is not None and len(given) != 1:
            self.faults.error(node, "time needs exactly one of rate, period and column", "e.g. {rate: 1 kHz}")
        if "rate" in part:
            rate = self.quantity(part["rate"], "time.rate", log_units.RATE, "Hz", positive=True)
            return TimeSource(period=1.0 / rate if rate else None)
        if "period" in part:
            return TimeSource(period=self.quantity(part["period"], "time.period", log_units.TIME, "s", positive=True))
        if "column" not in part:
            return TimeSource(period=1.0)
        unit: str | None = None
        if "unit" in part:
            unit = log_units.read_unit(part["unit"], "time", log_units.TIME, self.faults)
        elif node is not None:
            self.faults.error(node, "time.column needs a unit", f"allowed are {', '.join(log_units.TIME)}")
        return TimeSource(
            file=self.file_of(part.get("file"), "time", node),
            column=self.column(part["column"], "time.column"),
            factor=log_units.TIME[unit or "s"],
        )

    def file_of(self, node: Node | None, what: str, where: Node | None) -> str:
        """Read the name of a recorded file; None stands for the only one. A fault is located at ``where``."""
        if node is None:
            if len(self.files) > 1:
                self.faults.error(where, f"{what} needs the key 'file'", f"one of {', '.join(self.files)}")
            return next(iter(self.files), "")
        return self.choice(node, f"{what}.file", tuple(self.files))

    def column(self, node: Node, what: str) -> str | int:
        """Read a column, given by its name or by its number counted from 1; ``what`` describes it in messages."""
        text = self.text(node, what)
        quoted = isinstance(node, Scalar) and node.quoted
        return int(text) if text.isdecimal() and not quoted else text

    def separator(self, node: Node | None) -> str | None:
        """Read the separator of columns: the character itself or its name, such as "tab"; None if ``node`` is None."""
        if node is None:
            return None
        words = {"tab": "\t", "space": " ", "comma": ",", "semicolon": ";", "\\t": "\t"}
        value = node.text if isinstance(node, Scalar) else self.text(node, "separator")
        return words.get(value, value) or None
