"""Row-level repair of a recording: SI units, increasing time, no duplicates, complete positions, unwrapped encoders.

Every repair is counted in :class:`~rrrgen.lab.data.repairs.Findings`. What cannot be repaired soundly (a clock that
starts over, no usable row) raises :class:`InputError`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.lab.data.mapping import SIGNALS, LogMapping, Signal
from rrrgen.lab.data.repairs import Findings
from rrrgen.lab.data.tables.interface import table_fault
from rrrgen.lab.data.tables.table_formats import open_table

REORDER_WINDOW = 256  # rows held back, so that rows which arrive late can be sorted in
MAX_LATENESS = 10.0  # periods: a larger step back in time means another clock, not a late message


@dataclass(frozen=True)
class RawRows:
    """Recorded rows in SI: ``t`` (N,) in s and ``signals``, (N, n) each, at the joints or motors as recorded.

    ``first`` is the index of the first row in the recording.
    """

    t: Array
    signals: dict[Signal, Array]
    first: int

    def part(self, chosen: NDArray[np.intp] | slice) -> RawRows:
        """The ``chosen`` rows (indices or a slice)."""
        return RawRows(self.t[chosen], {k: v[chosen] for k, v in self.signals.items()}, self.first)


def raw_rows(mapping: LogMapping, size: int, findings: Findings) -> Iterator[RawRows]:
    """Read the columns of all files in parallel, ``size`` rows at a time, and scale them to SI.

    If truncated last lines are skipped in some file, files that are one row longer lose that row as well. Raises
    :class:`InputError` if the files differ in length otherwise.
    """
    signals = [signal for signal in SIGNALS if mapping.has(signal)]
    wanted: dict[str, list[str | int]] = {source.name: [] for source in mapping.files}
    for signal in signals:
        for channel in mapping.channels(signal):
            wanted[channel.file].append(channel.column)
    if mapping.time.period is None:
        wanted[mapping.time.file].append(mapping.time.column)
    sources = [source for source in mapping.files if wanted[source.name]]
    tables = [open_table(source) for source in sources]
    streams = [table.chunks(wanted[source.name], size) for table, source in zip(tables, sources, strict=True)]
    first = 0
    while True:
        blocks = [next(stream, np.zeros((0, 1))) for stream in streams]
        lengths = [len(block) for block in blocks]
        cut = sum(getattr(table, "truncated", 0) for table in tables)
        if cut and max(lengths) - min(lengths) == 1:
            blocks = [block[: min(lengths)] for block in blocks]
            lengths = [min(lengths)] * len(blocks)
        if len(set(lengths)) > 1:
            rows = ", ".join(f"{source.path.name}: {first + k}" for source, k in zip(sources, lengths, strict=True))
            raise table_fault(
                sources[0].path, f"the files of the recording are not equally long (rows: {rows} or more)"
            )
        if lengths[0] == 0:
            findings.add("truncated last line", cut, rows=1)
            return
        by_file = {source.name: block for source, block in zip(sources, blocks, strict=True)}
        yield _scaled(mapping, by_file, wanted, signals, first)
        first += lengths[0]


def _scaled(
    mapping: LogMapping,
    by_file: dict[str, Array],
    wanted: dict[str, list[str | int]],
    signals: list[Signal],
    first: int,
) -> RawRows:
    taken = dict.fromkeys(by_file, 0)

    def take(file: str) -> Array:
        taken[file] += 1
        return by_file[file][:, taken[file] - 1]

    values = {}
    for signal in signals:
        channels = mapping.channels(signal)
        values[signal] = np.column_stack([c.sign * (take(c.file) - c.zero) * c.factor for c in channels])
    rows = len(next(iter(by_file.values())))
    if mapping.time.period is not None:
        t = (first + np.arange(rows)) * mapping.time.period
    else:
        t = take(mapping.time.file) * mapping.time.factor
    return RawRows(np.asarray(t), values, first)


def ordered_rows(mapping: LogMapping, size: int, findings: Findings) -> Iterator[RawRows]:
    """Read the rows sorted by time, with each instant once, complete positions and unwrapped encoders.

    ``size`` rows are read at a time; repairs are counted in ``findings``. Raises :class:`InputError` if the clock jumps
    back or no row is usable.
    """
    pending: RawRows | None = None
    emitted = -np.inf
    unwrap = _Unwrap(mapping, findings)
    for raw in raw_rows(mapping, size, findings):
        findings.read += len(raw.t)
        rows = _complete(raw, findings)
        pending = rows if pending is None else _joined(pending, rows)
        _check_clock(mapping, pending)
        pending = _sorted(pending, findings)
        ready = max(0, len(pending.t) - REORDER_WINDOW)
        if ready:
            emitted = _after(mapping, pending, emitted)
            out, pending = pending.part(slice(0, ready)), pending.part(slice(ready, None))
            emitted = float(out.t[-1])
            yield unwrap(out)
    if pending is None or (emitted == -np.inf and not len(pending.t)):
        raise table_fault(mapping.files[0].path, "the recording holds no row with complete positions and time")
    if len(pending.t):
        _after(mapping, pending, emitted)
        yield unwrap(pending)


def _complete(raw: RawRows, findings: Findings) -> RawRows:
    """The rows whose time and positions are all finite."""
    timed = np.isfinite(raw.t)
    missing = ~np.isfinite(raw.signals["position"])
    located = ~np.any(missing, axis=1)
    findings.add("rows without time", int(np.sum(~timed)))
    findings.add("rows without all positions", int(np.sum(timed & ~located)), channels=np.sum(missing[timed], axis=0))
    keep = np.flatnonzero(timed & located)
    return raw if len(keep) == len(raw.t) else raw.part(keep)


def _joined(a: RawRows, b: RawRows) -> RawRows:
    signals = {key: np.concatenate([a.signals[key], b.signals[key]]) for key in a.signals}
    return RawRows(np.concatenate([a.t, b.t]), signals, a.first)


def _check_clock(mapping: LogMapping, rows: RawRows) -> None:
    """Raise :class:`InputError` if time steps back by over MAX_LATENESS periods: a clock reset, not a late message."""
    steps = np.diff(rows.t)
    forward = steps[steps > 0]
    if len(steps) == 0:
        return
    if len(forward) == 0:
        raise table_fault(mapping.files[0].path, "time does not advance", "is it the right column, and the right unit?")
    back = int(np.argmin(steps))
    if steps[back] < -MAX_LATENESS * float(np.median(forward)):
        raise table_fault(
            mapping.files[0].path,
            f"time jumps back by {-steps[back]:.6g} s, from {rows.t[back]:.6g} s to {rows.t[back + 1]:.6g} s",
            "two recordings in one file, or a clock that started over: split the file there",
        )


def _sorted(rows: RawRows, findings: Findings) -> RawRows:
    """Sort the rows by time (stably); of several rows at the same instant the first is kept."""
    steps = np.diff(rows.t)
    if len(steps) == 0 or np.min(steps) > 0:
        return rows
    findings.add("rows out of order", int(np.sum(steps < 0)), -min(0.0, float(np.min(steps))))
    rows = rows.part(np.argsort(rows.t, kind="stable"))
    again = np.flatnonzero(np.diff(rows.t) == 0) + 1
    if len(again):
        equal = np.ones(len(again), bool)
        for values in rows.signals.values():
            equal &= np.all((values[again] == values[again - 1]) | np.isnan(values[again]), axis=1)
        moved = np.abs(rows.signals["position"][again] - rows.signals["position"][again - 1])
        findings.add("duplicate instants", int(np.sum(equal)))
        findings.add("repeated stamps", int(np.sum(~equal)), float(moved.max()))
        rows = rows.part(np.delete(np.arange(len(rows.t)), again))
    return rows


def _after(mapping: LogMapping, rows: RawRows, emitted: float) -> float:
    """Raise :class:`InputError` unless all sorted ``rows`` are later than ``emitted`` (s); returns ``emitted``.

    ``emitted`` is the instant of the last row already delivered: an earlier row can no longer be sorted in.
    """
    if len(rows.t) and rows.t[0] <= emitted:
        raise table_fault(
            mapping.files[0].path,
            f"a row of t = {rows.t[0]:.6g} s comes after t = {emitted:.6g} s by more than {REORDER_WINDOW} rows",
            "sort the recording by time, or split it",
        )
    return emitted


class _Unwrap:
    """Unwraps encoders that start over after a period, such as one turn; its state persists from block to block."""

    def __init__(self, mapping: LogMapping, findings: Findings) -> None:
        channels = mapping.channels("position")
        if not channels:
            raise InputError("the mapping has no positions")
        self.periods = np.array([np.nan if c.wraps is None else abs(c.wraps * c.factor) for c in channels])
        self.findings = findings
        self.last: Array | None = None

    def __call__(self, rows: RawRows) -> RawRows:
        wrapped = np.isfinite(self.periods)
        if not wrapped.any() or not len(rows.t):
            return rows
        q = rows.signals["position"].copy()
        period = self.periods[wrapped]
        before = q[:1, wrapped] if self.last is None else self.last
        steps = np.diff(np.concatenate([before, q[:, wrapped]]), axis=0)
        turns = np.round(steps / period)
        doubtful = np.abs(steps - turns * period) > 0.4 * period
        for kind, steps_of in (("encoder wraps", turns != 0), ("doubtful encoder wraps", doubtful)):
            each = np.zeros(len(wrapped), np.int64)
            each[wrapped] = np.sum(steps_of, axis=0)
            self.findings.add(kind, int(np.sum(each)), channels=each)
        continuous = before + np.cumsum(steps - turns * period, axis=0)
        self.last = continuous[-1:]
        q[:, wrapped] = continuous
        return RawRows(rows.t, {**rows.signals, "position": q}, rows.first)
