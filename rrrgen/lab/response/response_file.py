"""Reader of response files, which say which columns of recordings are excitation, input and output of one loop.

The loop is ``u = n - C(z) (q - q_r)``, with the excitation n that was added, the input u of the plant (acceleration of
the feedback linearisation (14.34) of the chapter, or torque) and its output q.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.yamltext import signal_units as units
from rrrgen.base.yamltext.document import Node, ScalarNode, SequenceNode, file_text, read_document
from rrrgen.base.yamltext.fields import Entry, words
from rrrgen.lab.data.mapping import TIME_KEYS, FileSource, SourceReader, TimeSource
from rrrgen.lab.data.tables import table_fault
from rrrgen.lab.data.tables.formats import open_table
from rrrgen.lab.response.response_model import ControllerTransferFunction

SCHEMA = "rrrgen-response/1"
UNITS = (
    {"one": 1.0} | units.POSITION | units.VELOCITY | units.ACCELERATION | units.TORQUE | units.FORCE
    | {"A": 1.0, "mA": 1e-3, "V": 1.0}
)  # fmt: skip
SEVERAL = ("realisations", "postures")
SLOWEST = 0.1  # s: a longer sampling period is believed where the unit of the times is stated
KEYS = {
    "schema": Entry(words([SCHEMA]), required=True),
    "name": Entry("of the recordings"),
    "files": Entry("as in a mapping file, or a list of paths", required=True),
    "time": Entry("when the samples were taken", required=True),
    "excitation": Entry("what was added to the loop: a column, or a mapping"),
    "input": Entry("of the plant, alike", required=True),
    "output": Entry("of the plant, alike", required=True),
    "period": Entry("of a periodic excitation", "s"),
    "controller": Entry("of the loop, for the plant alone"),
    "recordings": Entry(f"what several are, of the excitation or of the arm: {words(SEVERAL)}; the former if missing"),
}
CONTROLLER_KEYS = {
    "numerator": Entry("list of coefficients in rising powers of 1/z", required=True),
    "denominator": Entry("list of coefficients in rising powers of 1/z; [1] if missing"),
}
CHANNEL_KEYS = {
    "file": Entry("where one recording has several files"),
    "column": Entry("its name, or its number from 1", required=True),
    "unit": Entry("of the column; SI if missing"),
    "sign": Entry("1 or -1"),
}
JITTER = 0.02  # of a sampling period: what timestamps may deviate from a grid
CHUNK = 65536

Several = Literal["realisations", "postures"]


@dataclass(frozen=True)
class SignalColumn:
    """One column of a recording: its ``file`` (empty where every file has it), name or number, and factor to SI."""

    file: str
    column: str | int
    factor: float = 1.0


@dataclass(frozen=True)
class ResponseFile:
    """The contents of a response file: recorded ``files``, their ``time``, and the columns of the signals.

    ``input`` is u, ``output`` q, ``excitation`` n, None if it was not recorded; ``period`` is that of the excitation in
    s, None where the file states none; ``controller`` is C(z), if known. ``several`` says how several recordings
    differ: "realisations" of the excitation, which are averaged, or "postures"; ``unit_of_time`` whether the file
    states the unit of a column of times.
    """

    files: tuple[FileSource, ...]
    time: TimeSource
    input: SignalColumn
    output: SignalColumn
    excitation: SignalColumn | None = None
    period: float | None = None
    controller: ControllerTransferFunction | None = None
    several: Several = "realisations"
    name: str = ""
    source: str = ""
    unit_of_time: bool = True


@dataclass(frozen=True)
class ResponseRecording:
    """One recording at the constant sampling ``period`` (s): ``n``, ``u``, ``q`` (N,) in SI.

    Where no excitation was recorded, n is the input.
    """

    name: str
    period: float
    n: Array
    u: Array
    q: Array


def load_response(path: str | os.PathLike[str]) -> ResponseFile:
    """Read a response file; paths in it are relative to it. Raises :class:`InputError` with every fault."""
    return loads_response(file_text(path, "response file"), str(path))


def loads_response(text: str, file: str = "response.yaml") -> ResponseFile:
    """Read a response file from YAML text; ``file`` is the name for messages, paths are relative to its folder."""
    folder = Path(file).parent
    return read_document(
        text, file, "response file", lambda root, faults: _ResponseReader(faults, folder).response(root)
    )


class _ResponseReader(SourceReader):
    """Reads one response file; files, times and columns are described as in mapping files."""

    unit_of_time = True

    def response(self, root: Node) -> ResponseFile | None:
        top = self.values(root, "the response file", KEYS)
        if top is None:
            return None
        if "schema" in top:
            self.choice(top["schema"], "schema", (SCHEMA,))
        self.read_sources(top.get("files"))
        excitation = top.get("excitation")
        several = self.choice(top["recordings"], "recordings", SEVERAL) if "recordings" in top else SEVERAL[0]
        response = ResponseFile(
            files=tuple(self.files.values()),
            time=self.instants(top.get("time")),
            input=self.signal(top.get("input"), "input"),
            output=self.signal(top.get("output"), "output"),
            excitation=None if excitation is None else self.signal(excitation, "excitation"),
            period=self.quantity(top.get("period"), "period", units.TIME, "s", positive=True),
            controller=self.control(top.get("controller")),
            several="postures" if several == "postures" else "realisations",
            name=self.text(top["name"], "name") if "name" in top else "",
            source=self.faults.file,
            unit_of_time=self.unit_of_time,
        )
        for what, node in (("input", top.get("input")), ("excitation", excitation)):
            signal = getattr(response, what)
            if node is not None and signal.column and signal == response.output:
                self.faults.error(node, f"{what} and output are the same column", "an output follows them")
        named = [
            bool(column.file) for column in (response.input, response.output, response.excitation) if column is not None
        ]
        if any(named) and not all(named) and len(self.files) > 1:
            self.faults.error(root, "some signals name a file and some do not", "all do, or every file is a recording")
        return response

    def read_sources(self, node: Node | None) -> None:
        """Read the recorded files, described as in a mapping file or given as a path or a list of paths."""
        if isinstance(node, ScalarNode):
            path = self.folder / node.text
            self.files[path.stem] = FileSource(path.stem, path)
            return
        if not isinstance(node, SequenceNode):
            self.read_files(node)
            return
        for number, item in enumerate(node.items, start=1):
            path = self.folder / self.text(item, f"files[{number - 1}]")
            alias = path.stem if path.stem not in self.files else f"{path.stem} ({number})"
            self.files[alias] = FileSource(alias, path)
        if not node.items:
            self.faults.error(node, "files names no file")

    def instants(self, node: Node | None) -> TimeSource:
        """Read ``time``: a column of times, whose file and unit (s) may be left out, or a rate or period."""
        entries = self.values(node, "time", TIME_KEYS) if node is not None else None
        if not entries or "column" not in entries or "rate" in entries or "period" in entries:
            return self.read_time(node)
        self.unit_of_time = "unit" in entries
        unit = units.read_unit(entries["unit"], "time", units.TIME, self.faults) if "unit" in entries else "s"
        file = self.choice(entries["file"], "time.file", tuple(self.files)) if "file" in entries else ""
        return TimeSource(None, file, self.column(entries["column"], "time.column"), units.TIME[unit or "s"])

    def signal(self, node: Node | None, what: str) -> SignalColumn:
        if node is None:
            return SignalColumn("", "")
        if isinstance(node, ScalarNode):
            return SignalColumn("", self.column(node, what))
        part = self.values(node, what, CHANNEL_KEYS) or {}
        unit = units.read_unit(part["unit"], what, UNITS, self.faults) if "unit" in part else None
        sign = self.number(part["sign"], f"{what}.sign") if "sign" in part else 1.0
        if sign not in (1.0, -1.0):
            self.faults.error(part.get("sign"), f"{what}.sign is not +1 or -1")
        return SignalColumn(
            file=self.choice(part["file"], f"{what}.file", tuple(self.files)) if "file" in part else "",
            column=self.column(part["column"], f"{what}.column") if "column" in part else "",
            factor=UNITS[unit or "one"] * (sign or 1.0),
        )

    def control(self, node: Node | None) -> ControllerTransferFunction | None:
        """Read the controller as it is implemented: the coefficients of its transfer function in powers of z^-1."""
        if node is None:
            return None
        part = self.values(node, "controller", CONTROLLER_KEYS) or {}
        powers = {key: self.coefficients(part[key], f"controller.{key}") for key in CONTROLLER_KEYS if key in part}
        denominator = powers.get("denominator", [1.0])
        if denominator and denominator[0] == 0.0:
            self.faults.error(part["denominator"], "controller.denominator starts with 0", "e.g. [1, -0.9]")
        return ControllerTransferFunction(tuple(powers.get("numerator", ())), tuple(denominator))

    def coefficients(self, node: Node, what: str) -> list[float]:
        if isinstance(node, SequenceNode) and node.items:
            return self.numbers(node, what, len(node.items))
        self.faults.error(node, f"{what} needs a list of numbers in powers of z^-1", "e.g. [1001, -1000]")
        return []


def read_recordings(response: ResponseFile) -> list[ResponseRecording]:
    """Read all recordings into memory; raises :class:`InputError` where times or values cannot be used."""
    if response.input.file:
        return [_read(response, response.files[0], response.name or "recording")]
    return [_read(response, source, source.name) for source in response.files]


def _read(response: ResponseFile, source: FileSource, name: str) -> ResponseRecording:
    by_name = {file_source.name: file_source for file_source in response.files}
    signals = [response.excitation or response.input, response.input, response.output]
    wanted = [(by_name[signal.file] if signal.file else source, signal.column, signal.factor) for signal in signals]
    if response.time.period is None:
        place = by_name[response.time.file] if response.time.file else source
        wanted.append((place, response.time.column, response.time.factor))
    values: list[Array] = [np.empty(0)] * len(wanted)
    for path in {file.path for file, _, _ in wanted}:
        members = [i for i, (file, _, _) in enumerate(wanted) if file.path == path]
        table = open_table(wanted[members[0]][0])
        rows = np.concatenate([*table.chunks([wanted[i][1] for i in members], CHUNK), np.empty((0, len(members)))])
        for i, column in zip(members, rows.T, strict=True):
            values[i] = column * wanted[i][2]
    lengths = {len(column) for column in values}
    if len(lengths) > 1:
        raise table_fault(source.path, f"the files of one recording have {sorted(lengths)} rows")
    for (file, column, _), numbers in zip(wanted, values, strict=True):
        if not np.all(np.isfinite(numbers)):
            row = int(np.flatnonzero(~np.isfinite(numbers))[0]) + 1
            raise table_fault(file.path, f"column '{column}' has no number in row {row}", "mend or cut the recording")
    period = response.time.period or _sampling_period(values[3], source.path)
    if not response.unit_of_time and period > SLOWEST:
        raise table_fault(
            source.path,
            f"the times are {period:.4g} apart, which would be seconds: state their unit",
            f"time: {{column: {response.time.column}, unit: ms}}, or unit: s if they are",
        )
    return ResponseRecording(name, period, values[0], values[1], values[2])


def _sampling_period(t: Array, path: Path) -> float:
    """The sampling period (s) of the times ``t``; raises :class:`InputError` unless they are evenly spaced."""
    if len(t) < 2:
        raise table_fault(path, f"{len(t)} rows: too few to tell the sampling period")
    period = float(t[-1] - t[0]) / (len(t) - 1)
    if not np.all(np.diff(t) > 0.0):
        row = int(np.argmin(np.diff(t) > 0.0)) + 2
        raise table_fault(path, f"the times do not increase in row {row}", "is it the right column?")
    worst = float(np.max(np.abs(np.diff(t) - period)))
    if not worst <= JITTER * period:
        row = int(np.argmax(np.abs(np.diff(t) - period))) + 2
        message = f"the times are not on a grid: mean step {period:.6g} s, row {row} is off by {worst:.3g} s"
        hint = "a frequency response needs equidistant samples without gaps; if only the times are inexact, state the"
        raise table_fault(path, message, f"{hint} rate of sampling (time: {{rate: ...}})")
    return period
