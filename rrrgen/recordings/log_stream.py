"""A recording as a stream of uniformly sampled stretches, in constant memory.

The recording is read twice: once to learn its period, jitter and the levels at which torques are clipped, and then, as
often as wanted, to deliver it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rrrgen.arrays import Array
from rrrgen.errors import InputError
from rrrgen.recordings.log_repair import RawRows, ordered_rows
from rrrgen.recordings.log_scan import HOLE, SHORTEST_STRETCH, Clips, Clock, longest_bridge
from rrrgen.recordings.mapping import LogMapping
from rrrgen.recordings.readers.tables import table_fault
from rrrgen.recordings.repairs import Findings, Repairs

CHUNK = 100_000  # rows read at a time


@dataclass(frozen=True)
class Part:
    """Uniform samples at the joints, SI: ``t`` (N,), ``q`` (N, n), and ``dq``, ``ddq``, ``tau`` where recorded.

    ``valid`` (N, n) is False where the torque of a joint is missing, clipped, or bridged over a hole. ``segment``
    counts uninterrupted stretches; ``first`` is the index of the first sample within its stretch.
    """

    t: Array
    q: Array
    dq: Array | None
    ddq: Array | None
    tau: Array | None
    valid: NDArray[np.bool_]
    segment: int
    first: int

    def __len__(self) -> int:
        return len(self.t)

    def sliced(self, start: int, stop: int) -> Part:
        """Samples ``start`` to ``stop`` (exclusive)."""
        s = slice(start, stop)
        dq, ddq, tau = (None if x is None else x[s] for x in (self.dq, self.ddq, self.tau))
        return Part(self.t[s], self.q[s], dq, ddq, tau, self.valid[s], self.segment, self.first + start)


def joined(parts: list[Part]) -> Part:
    """Consecutive parts of one stretch as one."""
    if len(parts) == 1:
        return parts[0]

    def both(name: str) -> Array | None:
        values = [getattr(part, name) for part in parts]
        return None if values[0] is None else np.concatenate(values)

    return Part(
        t=np.concatenate([p.t for p in parts]),
        q=np.concatenate([p.q for p in parts]),
        dq=both("dq"),
        ddq=both("ddq"),
        tau=both("tau"),
        valid=np.concatenate([p.valid for p in parts]),
        segment=parts[0].segment,
        first=parts[0].first,
    )


@dataclass(frozen=True)
class LogFacts:
    """What the first reading found: rows, ``period`` (s), whether samples must be moved, clip levels, repairs."""

    rows: int
    start: float
    duration: float
    period: float
    resample: bool
    clipped_low: Array  # of the torque channels, SI on their own side; -inf where nothing is clipped
    clipped_high: Array
    repairs: Repairs


class LogStream:
    """A recording on disk as a re-iterable stream of :class:`Part`."""

    def __init__(self, mapping: LogMapping, chunk: int = CHUNK) -> None:
        if chunk < 2:
            raise InputError("a recording is read in chunks of at least two rows")
        self.mapping, self.chunk = mapping, chunk
        self._short: list[RawRows] | None = None
        self.facts = self._scan()

    @property
    def joints(self) -> tuple[str, ...]:
        """Joint names."""
        return self.mapping.names

    @property
    def period(self) -> float:
        """Sampling period, s."""
        return self.facts.period

    @property
    def span(self) -> tuple[float, float]:
        """First instant and duration, s."""
        return self.facts.start, self.facts.duration

    @property
    def repairs(self) -> Repairs:
        """What was found wrong in the recording, and put right."""
        return self.facts.repairs

    def __len__(self) -> int:
        return self.facts.rows

    def parts(self) -> Iterator[Part]:
        """The recording from its beginning."""
        delivered = False
        uniform = _Uniform(self.mapping, self.facts)
        for rows in self._rows():
            for part in uniform.push(rows):
                delivered = True
                yield part
        for part in uniform.flush():
            delivered = True
            yield part
        if not delivered:
            raise table_fault(
                self.mapping.files[0].path,
                f"no uninterrupted stretch of {SHORTEST_STRETCH} samples",
                "holes split the recording; max_gap in the mapping bridges longer ones",
            )

    def samples(self) -> Iterator[Part]:
        """The rows as recorded, at the joints, in order of time: not moved to uniform instants, not cut at holes.

        A torque that is missing is NaN; ``valid`` says nothing here.
        """
        for rows in self._rows():
            q, tau = rows.signals["position"], rows.signals.get("torque")
            torque = None if tau is None else self.mapping.joint_side("torque", tau)
            at_joints = self.mapping.joint_side("position", q)
            yield Part(rows.t, at_joints, None, None, torque, np.ones(q.shape, bool), 0, 0)

    def _rows(self) -> Iterator[RawRows]:
        return iter(self._short) if self._short is not None else ordered_rows(self.mapping, self.chunk, Findings())

    def _scan(self) -> LogFacts:
        findings = Findings()
        clock, clips = Clock(self.mapping), Clips(self.mapping)
        kept: list[RawRows] | None = []
        for rows in ordered_rows(self.mapping, self.chunk, findings):
            clock.see(rows.t)
            clips.see(rows)
            # a short recording stays in memory and is not parsed again
            kept = None if kept is None or clock.rows > self.chunk else [*kept, rows]
        self._short = kept
        clock.see(np.zeros(0), last=True)
        period = clock.period()
        low, high = clips.levels(findings)
        resample = clock.report(period, self.mapping.max_gap, findings)
        repairs = findings.told(self.mapping.files[0].path.name, self.joints, period)
        return LogFacts(clock.rows, clock.first, clock.last - clock.first, period, resample, low, high, repairs)


class _Uniform:
    """Moves ordered rows to uniform instants and cuts them at holes."""

    def __init__(self, mapping: LogMapping, facts: LogFacts) -> None:
        self.mapping, self.facts = mapping, facts
        self.bridge = longest_bridge(facts.period, mapping.max_gap)
        self.pending: Part | None = None  # samples of the open stretch that are still needed
        self.start, self.next, self.segment = 0.0, 0, 0

    def push(self, raw: RawRows) -> Iterator[Part]:
        """Take in rows; deliver what is settled."""
        rows = self._at_joints(raw)
        if self.pending is not None:
            rows = joined([self.pending, rows])
        cuts = np.flatnonzero(np.diff(rows.t) > self.bridge) + 1
        begin = 0
        for cut in cuts:
            yield from self._close(rows.sliced(begin, int(cut)))
            begin = int(cut)
        yield from self._advance(rows.sliced(begin, len(rows)), last=False)

    def flush(self) -> Iterator[Part]:
        """Deliver the rest."""
        if self.pending is not None:
            yield from self._close(self.pending)

    def _close(self, rows: Part) -> Iterator[Part]:
        yield from self._advance(rows, last=True)
        self.segment, self.next, self.pending = self.segment + 1, 0, None

    def _advance(self, rows: Part, last: bool) -> Iterator[Part]:
        """Deliver the uniform samples of an open stretch that no later row can change."""
        self.pending = rows
        if self.next == 0:
            self.start = float(rows.t[0])
        if len(rows) < SHORTEST_STRETCH and self.next == 0:
            return
        period = self.facts.period
        if not self.facts.resample:
            out = replace(rows, t=self.start + period * (self.next + np.arange(len(rows))))
            self.next, self.pending = self.next + len(rows), rows.sliced(len(rows), len(rows))
        else:
            end = float(rows.t[-1] if last else rows.t[-3])
            count = math.floor((end - self.start) / period * (1 + 1e-12) + 1e-9) + 1
            out = _resampled(rows, self.start + period * np.arange(self.next, count), HOLE * period)
            self.next = max(self.next, count)
            settled = int(np.searchsorted(rows.t, self.start + period * self.next)) - 4
            self.pending = rows.sliced(max(0, settled), len(rows))
        if len(out):
            yield replace(out, segment=self.segment, first=self.next - len(out))

    def _at_joints(self, raw: RawRows) -> Part:
        """Channel values brought to the joints, with the validity of the torques."""
        signals = raw.signals
        moved = {key: self.mapping.joint_side(key, values) for key, values in signals.items() if key != "torque"}
        tau, valid = None, np.ones(signals["position"].shape, bool)
        if "torque" in signals:
            x = signals["torque"]
            bad = ~np.isfinite(x) | (x <= self.facts.clipped_low) | (x >= self.facts.clipped_high)
            tau = self.mapping.joint_side("torque", np.where(np.isfinite(x), x, 0.0))
            N = self.mapping.transmission
            valid = ~bad if N is None else ~((bad @ (N != 0.0)).astype(bool))
        dq, ddq = moved.get("velocity"), moved.get("acceleration")
        return Part(raw.t, moved["position"], dq, ddq, tau, valid, 0, 0)


def _resampled(rows: Part, t: Array, hole: float) -> Part:
    """Positions and their derivatives by cubics through four neighbours, torques by straight lines, at ``t``."""
    here = np.clip(np.searchsorted(rows.t, t, side="right") - 1, 0, len(rows) - 2)
    base = np.clip(here - 1, 0, len(rows) - 4)
    nodes = rows.t[base[:, None] + np.arange(4)]
    weights = np.ones((len(t), 4))
    for i in range(4):
        for j in range(4):
            if i != j:
                weights[:, i] *= (t - nodes[:, j]) / (nodes[:, i] - nodes[:, j])

    def cubic(x: Array | None) -> Array | None:
        return None if x is None else np.einsum("ki,kij->kj", weights, x[base[:, None] + np.arange(4)])

    step = rows.t[here + 1] - rows.t[here]
    share = ((t - rows.t[here]) / step)[:, None]
    tau = None if rows.tau is None else rows.tau[here] * (1 - share) + rows.tau[here + 1] * share
    sound = np.where(share < 1e-9, rows.valid[here], rows.valid[here] & rows.valid[here + 1])
    valid = sound & ((step < hole)[:, None] | (share < 1e-9))
    q = cubic(rows.q)
    assert q is not None
    return Part(t, q, cubic(rows.dq), cubic(rows.ddq), tau, valid, rows.segment, rows.first)
