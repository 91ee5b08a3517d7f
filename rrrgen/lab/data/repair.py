"""Row-level repair of a recording: SI units, increasing time, no duplicates, complete positions, unwrapped encoders.

Every repair is counted in :class:`~rrrgen.lab.data.repair.Findings`. What cannot be repaired soundly (a clock that
starts over, no usable row) raises :class:`InputError`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.lab.data.mapping import ON_BASE, SIGNALS, LogMapping, Signal
from rrrgen.lab.data.tables import table_fault
from rrrgen.lab.data.tables.formats import open_table

# ------------------------------------------------------------------------------------------------------------------
# The faults found in a recording and their repairs: counted by kind and channel, described in words, with warnings.
#
# Every repair replaces or leaves out measured data. A few repairs are usual; if they affect more than
# :data:`WARN_SHARE` of the rows, the estimates depend on the repairs as much as on the measurement, and the user is
# warned.
# ------------------------------------------------------------------------------------------------------------------

WARN_SHARE = 0.01
"""Share of the rows above which a repair causes a warning."""
NEVER_WARNED = ("encoder wraps",)
"""Kinds that never cause a warning: unwrapping an encoder is exact, however often it happens."""
MESSAGES = {
    "rows without time": "{count} rows without a time were left out",
    "rows without all positions": "{count} rows without all positions were left out",
    "truncated last line": "{count} last lines were cut off in the middle and were left out",
    "rows out of order": "{count} rows were out of order (by up to {worst:.3g} s) and were sorted",
    "duplicate times": "{count} rows are there twice, value by value; the first stays",
    "repeated stamps": "{count} rows repeat a time with other values (positions up to {worst:.3g} apart); "
    "the first stays",
    "encoder wraps": "{count} steps of wrapped encoders were made continuous",
    "doubtful encoder wraps": "{count} steps of wrapped encoders are near half a period: the sense is in doubt",
    "jitter": "{count} steps are off the period of {period:.6g} s, by up to {percent:.3g} % of it; "
    "all samples were moved to uniform times",
    "bridged holes": "{count} holes of up to {worst:.3g} s ({rows} rows) were bridged; torques there are not used",
    "splitting holes": "{count} holes of up to {worst:.3g} s ({rows} rows) split the recording",
    "short stretches": "{count} stretches between holes are too short ({rows} rows) and were left out",
    "clipped torque channels": "{count} torque channels are clipped (at {worst:.6g}, {rows} samples at most); "
    "these samples are not used",
    "missing torques": "{count} torques are missing; these samples are not used",
}


@dataclass(frozen=True)
class RepairedFault:
    """One kind of fault found in a recording, how often it occurred and how it was repaired.

    ``kind`` names the fault, ``count`` is the number of faults, ``message`` describes fault and repair. ``rows`` is the
    number of rows affected in the worst channel, ``share`` that number divided by all rows read.
    ``channels`` lists the affected samples by joint; it is empty if whole rows are affected.
    """

    kind: str
    count: int
    message: str
    rows: int = 0
    share: float = 0.0
    channels: tuple[tuple[str, int], ...] = ()

    @property
    def warned(self) -> bool:
        """Whether the finding causes a warning: it affects over WARN_SHARE of the rows, and its repair is not exact."""
        return self.share > WARN_SHARE and self.kind not in NEVER_WARNED

    def to_json(self) -> dict[str, Any]:
        """The finding as plain data for JSON."""
        return {
            "kind": self.kind,
            "count": self.count,
            "rows": self.rows,
            "share_of_rows": self.share,
            "channels": dict(self.channels),
            "message": self.message,
            "warning": self.warned,
        }


@dataclass(frozen=True)
class Repairs:
    """All findings of one ``recording`` (its name, for messages) of ``rows`` rows."""

    recording: str = "recording"
    rows: int = 0
    findings: tuple[RepairedFault, ...] = ()

    def lines(self) -> list[str]:
        """The repairs in words, a heading and one line per kind; empty if there are none."""
        if not self.findings:
            return []
        lines = [f"repairs of {self.recording} ({self.rows} rows):"]
        for finding in self.findings:
            where = ", ".join(f"{name} {count}" for name, count in finding.channels if count)
            where = f"; samples by joint: {where}" if where else ""
            lines.append(f"  {finding.message} ({100 * finding.share:.2g} % of the rows{where})")
        return lines

    def warnings(self) -> list[str]:
        """A sentence for every kind of fault that affects more than :data:`WARN_SHARE` of the rows."""
        return [
            f"warning: {self.recording}: {100 * finding.share:.3g} % of the rows, more than "
            f"{100 * WARN_SHARE:g} %: {finding.message}"
            for finding in self.findings
            if finding.warned
        ]

    def to_json(self) -> dict[str, Any]:
        """The repairs as plain data for JSON."""
        return {
            "recording": self.recording,
            "rows": self.rows,
            "findings": [finding.to_json() for finding in self.findings],
        }


@dataclass
class Findings:
    """Faults counted while a recording is read; each dict maps the kind of fault to a figure.

    ``counts`` holds the number of faults, ``worst`` the largest one in the unit of its message, ``rows`` the number of
    rows affected and ``channels`` (n,) the faults by joint. ``read`` is the number of rows read.
    """

    counts: dict[str, int] = field(default_factory=dict)
    worst: dict[str, float] = field(default_factory=dict)
    rows: dict[str, int] = field(default_factory=dict)
    channels: dict[str, NDArray[np.int64]] = field(default_factory=dict)
    read: int = 0

    def add(
        self,
        kind: str,
        count: int,
        worst: float = 0.0,
        rows: int | None = None,
        channels: NDArray[np.int64] | None = None,
    ) -> None:
        """Add ``count`` faults of a ``kind``.

        ``worst`` is the largest of them in the unit of the message, ``rows`` the number of rows affected (``count`` by
        default) and ``channels`` (n,) the faults by joint.
        """
        if not count:
            return
        self.counts[kind] = self.counts.get(kind, 0) + int(count)
        self.worst[kind] = max(self.worst.get(kind, 0.0), float(worst))
        self.rows[kind] = self.rows.get(kind, 0) + int(count if rows is None else rows)
        if channels is not None:
            self.channels[kind] = self.channels.get(kind, np.zeros(len(channels), np.int64)) + channels

    def summarise(self, recording: str, joints: Sequence[str], period: float) -> Repairs:
        """Summarise the counts as :class:`Repairs` of a recording with these ``joints``, sampled at ``period`` (s)."""
        faults = []
        for kind, count in self.counts.items():
            channel_counts = self.channels.get(kind)
            channels = (
                () if channel_counts is None else tuple(zip(joints, (int(c) for c in channel_counts), strict=True))
            )
            rows = self.rows[kind] if channel_counts is None else int(np.max(channel_counts))
            worst = self.worst[kind]
            message = MESSAGES[kind].format(count=count, worst=worst, percent=100 * worst, rows=rows, period=period)
            faults.append(RepairedFault(kind, count, message, rows, min(1.0, rows / max(1, self.read)), channels))
        return Repairs(recording, self.read, tuple(faults))


# ------------------------------------------------------------------------------------------------------------------
# Row-level repair of a recording
# ------------------------------------------------------------------------------------------------------------------

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
            if channel.value is None:
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
        yield _scale_channels(mapping, by_file, wanted, signals, first)
        first += lengths[0]


def _scale_channels(
    mapping: LogMapping,
    by_file: dict[str, Array],
    wanted: dict[str, list[str | int]],
    signals: list[Signal],
    first: int,
) -> RawRows:
    taken = dict.fromkeys(by_file, 0)
    rows = len(next(iter(by_file.values())))

    def take(file: str) -> Array:
        taken[file] += 1
        return by_file[file][:, taken[file] - 1]

    values = {}
    for signal in signals:
        channels = mapping.channels(signal)
        columns = [
            c.sign * (take(c.file) - c.zero) * c.factor if c.value is None else np.full(rows, c.value) for c in channels
        ]
        values[signal] = np.column_stack(columns)
    if mapping.time.period is not None:
        t = (first + np.arange(rows)) * mapping.time.period
    else:
        t = take(mapping.time.file) * mapping.time.factor
    return RawRows(np.asarray(t), values, first)


def ordered_rows(mapping: LogMapping, size: int, findings: Findings) -> Iterator[RawRows]:
    """Read the rows sorted by time, with each time once, complete positions and unwrapped encoders.

    ``size`` rows are read at a time; repairs are counted in ``findings``. Raises :class:`InputError` if the clock jumps
    back or no row is usable.
    """
    pending: RawRows | None = None
    emitted = -np.inf
    unwrap = _Unwrap(mapping, findings)
    for raw in raw_rows(mapping, size, findings):
        findings.read += len(raw.t)
        rows = _complete(mapping, raw, findings)
        pending = rows if pending is None else _join_rows(pending, rows)
        _check_clock(mapping, pending)
        pending = _sort_rows(pending, findings)
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


def missing_number(mapping: LogMapping, signal: Signal, joints: Sequence[str], size: int) -> InputError | None:
    """The error that names file, column and row, from 1, of the first value of a ``signal`` that is no finite number.

    Rows without time or positions, which are left out, do not count. ``joints`` are those that are looked at; ``size``
    rows are read at a time. None if there is no such value.
    """
    places = [i for i, name in enumerate(mapping.names) if name in joints]
    for raw in raw_rows(mapping, size, Findings()):
        kept = np.isfinite(raw.t) & np.all(np.isfinite(raw.signals["position"]), axis=1)
        gone = np.argwhere(~np.isfinite(raw.signals[signal][:, places]) & kept[:, None])
        if len(gone):
            row, place = gone[0]
            channel = mapping.channels(signal)[places[place]]
            file = next(source for source in mapping.files if source.name == channel.file)
            message = f"column '{channel.column}' has no number in row {raw.first + row + 1}"
            return table_fault(file.path, message, "mend or cut the recording")
    return None


def _complete(mapping: LogMapping, raw: RawRows, findings: Findings) -> RawRows:
    """The rows whose time and positions are all finite, and the twist of a floating base, whose integral is one."""
    timed = np.isfinite(raw.t)
    missing = ~np.isfinite(raw.signals["position"])
    if mapping.floating:
        missing[:, : len(ON_BASE)] |= ~np.isfinite(raw.signals["velocity"][:, : len(ON_BASE)])
    located = ~np.any(missing, axis=1)
    findings.add("rows without time", int(np.sum(~timed)))
    findings.add("rows without all positions", int(np.sum(timed & ~located)), channels=np.sum(missing[timed], axis=0))
    keep = np.flatnonzero(timed & located)
    return raw if len(keep) == len(raw.t) else raw.part(keep)


def _join_rows(a: RawRows, b: RawRows) -> RawRows:
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


def _sort_rows(rows: RawRows, findings: Findings) -> RawRows:
    """Sort the rows by time (stably); of several rows at the same time the first is kept."""
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
        findings.add("duplicate times", int(np.sum(equal)))
        findings.add("repeated stamps", int(np.sum(~equal)), float(moved.max()))
        rows = rows.part(np.delete(np.arange(len(rows.t)), again))
    return rows


def _after(mapping: LogMapping, rows: RawRows, emitted: float) -> float:
    """Raise :class:`InputError` unless all sorted ``rows`` are later than ``emitted`` (s); returns ``emitted``.

    ``emitted`` is the time of the last row already delivered: an earlier row can no longer be sorted in.
    """
    if len(rows.t) and rows.t[0] <= emitted:
        raise table_fault(
            mapping.files[0].path,
            f"a row of t = {rows.t[0]:.6g} s comes after t = {emitted:.6g} s by more than {REORDER_WINDOW} rows",
            "sort the recording by time, or split it",
        )
    return emitted


class _Unwrap:
    """Unwraps encoders that start over after a period, such as one turn, and signs of quaternions; keeps its state."""

    def __init__(self, mapping: LogMapping, findings: Findings) -> None:
        channels = mapping.channels("position")
        if not channels:
            raise InputError("the mapping has no positions")
        self.periods = np.array([np.nan if c.wraps is None else abs(c.wraps * c.factor) for c in channels])
        self.findings = findings
        self.last: Array | None = None
        self.mapping = mapping
        self.orientation: Array | None = None

    def __call__(self, rows: RawRows) -> RawRows:
        rows = self._with_signs(rows)
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
            wraps = np.zeros(len(wrapped), np.int64)
            wraps[wrapped] = np.sum(steps_of, axis=0)
            self.findings.add(kind, int(np.sum(wraps)), channels=wraps)
        continuous = before + np.cumsum(steps - turns * period, axis=0)
        self.last = continuous[-1:]
        q[:, wrapped] = continuous
        return RawRows(rows.t, {**rows.signals, "position": q}, rows.first)

    def _with_signs(self, rows: RawRows) -> RawRows:
        """Give quaternions of a floating base the sign of the one before, between which samples are interpolated."""
        if not self.mapping.floating or not len(rows.t):
            return rows
        q = rows.signals["position"].copy()
        place = slice(2, len(ON_BASE))
        before = q[:1, place] if self.orientation is None else self.orientation
        chain = np.concatenate([before, q[:, place]])
        turned = np.sum(chain[1:] * chain[:-1], axis=1) < 0.0
        q[:, place] *= np.cumprod(np.where(turned, -1.0, 1.0))[:, None]
        self.orientation = q[-1:, place]
        return RawRows(rows.t, {**rows.signals, "position": q}, rows.first)
