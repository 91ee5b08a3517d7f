"""A recording as a stream of uniformly sampled, uninterrupted stretches, read in constant memory.

A first pass finds the period, the jitter and the levels at which torques are clipped; every further pass delivers the
samples.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.lab.data.log_repair import RawRows, ordered_rows
from rrrgen.lab.data.log_scan import HOLE, SHORTEST_STRETCH, Clips, Clock, longest_bridge
from rrrgen.lab.data.mapping import LogMapping
from rrrgen.lab.data.repairs import Findings, Repairs
from rrrgen.lab.data.tables.interface import table_fault

CHUNK = 100_000  # rows read at a time


@dataclass(frozen=True)
class Part:
    """Uniform samples at the joints in SI: ``t`` (N,), ``q`` (N, n), and ``dq``, ``ddq``, ``tau`` (N, n) or None.

    ``valid`` (N, n) is False where the torque of a joint is missing, clipped or interpolated over a hole. ``segment``
    is the number of the uninterrupted stretch that the part belongs to, ``first`` the index of its first sample
    therein. ``reference``, ``reference_velocity``, ``feedforward`` (N, n) are inputs of the controller, or None. The
    torques act ``late`` samples after their instants, in the mean.
    """

    t: Array
    q: Array
    dq: Array | None
    ddq: Array | None
    tau: Array | None
    valid: NDArray[np.bool_]
    segment: int
    first: int
    reference: Array | None = None
    reference_velocity: Array | None = None
    feedforward: Array | None = None
    late: float = 0.0

    def __len__(self) -> int:
        return len(self.t)

    def sliced(self, start: int, stop: int) -> Part:
        """The samples ``start`` to ``stop`` (exclusive)."""
        s = slice(start, stop)
        optional = (self.dq, self.ddq, self.tau, self.reference, self.reference_velocity, self.feedforward)
        dq, ddq, tau, reference, speed, fed = (None if x is None else x[s] for x in optional)
        place = self.segment, self.first + start
        return Part(self.t[s], self.q[s], dq, ddq, tau, self.valid[s], *place, reference, speed, fed, self.late)

    def aligned(self) -> Part:
        """The same part with the torques that act at its instants, interpolated linearly between the recorded ones.

        At an end that this moves away from a recorded torque there is none: the sample is invalid.
        """
        if self.late == 0.0 or self.tau is None:
            return self
        at = np.arange(len(self)) - self.late
        before = np.clip(np.floor(at).astype(int), 0, len(self) - 1)
        after = np.minimum(before + 1, len(self) - 1)
        share = (at - np.floor(at))[:, None]
        inside = (at >= 0.0) & (at <= len(self) - 1)
        valid = self.valid[before] & (self.valid[after] | (share == 0.0)) & inside[:, None]
        return replace(self, tau=(1.0 - share) * self.tau[before] + share * self.tau[after], valid=valid, late=0.0)


def joined(parts: list[Part]) -> Part:
    """Concatenate consecutive parts of one stretch."""
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
        reference=both("reference"),
        reference_velocity=both("reference_velocity"),
        feedforward=both("feedforward"),
        late=parts[0].late,
    )


@dataclass(frozen=True)
class LogFacts:
    """Results of the first pass: number of rows, start, duration and period (s), clip levels, repairs.

    ``resample`` states whether the samples must be moved to uniform instants.
    """

    rows: int
    start: float
    duration: float
    period: float
    resample: bool
    clipped_low: Array  # (n,) torque at or below which a channel is clipped, SI, joint or motor side; -inf if never
    clipped_high: Array  # (n,) torque at or above which it is clipped; inf if never
    repairs: Repairs


class LogStream:
    """A recording on disk that can be iterated repeatedly as a stream of :class:`Part`.

    ``chunk`` is the number of rows read at a time. Raises :class:`InputError` for files that cannot be read or
    repaired.
    """

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
        """The faults found in the recording and how they were repaired."""
        return self.facts.repairs

    def __len__(self) -> int:
        return self.facts.rows

    def parts(self) -> Iterator[Part]:
        """Iterate over the uniformly sampled parts from the beginning.

        Raises :class:`InputError` if no uninterrupted stretch is long enough.
        """
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
        """Iterate over the recorded rows at the joints, sorted by time, neither resampled nor split at holes.

        A missing torque is NaN; ``valid`` is True throughout and carries no information here.
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
            clock.add(rows.t)
            clips.add(rows)
            # a short recording stays in memory and is not parsed again
            kept = None if kept is None or clock.rows > self.chunk else [*kept, rows]
        self._short = kept
        clock.add(np.zeros(0), last=True)
        period = clock.period()
        low, high = clips.levels(findings)
        resample = clock.report(period, self.mapping.max_gap, findings)
        repairs = findings.summarised(self.mapping.files[0].path.name, self.joints, period)
        return LogFacts(clock.rows, clock.first, clock.last - clock.first, period, resample, low, high, repairs)


class _Uniform:
    """Splits sorted rows at holes and resamples them at uniform instants."""

    def __init__(self, mapping: LogMapping, facts: LogFacts) -> None:
        self.mapping, self.facts = mapping, facts
        self.bridge = longest_bridge(facts.period, mapping.max_gap)
        self.pending: Part | None = None  # samples of the open stretch that are still needed
        self.start, self.next, self.segment = 0.0, 0, 0

    def push(self, raw: RawRows) -> Iterator[Part]:
        """Add rows; yields the samples that later rows cannot change any more."""
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
        """Yield the remaining samples at the end of the recording."""
        if self.pending is not None:
            yield from self._close(self.pending)

    def _close(self, rows: Part) -> Iterator[Part]:
        yield from self._advance(rows, last=True)
        self.segment, self.next, self.pending = self.segment + 1, 0, None

    def _advance(self, rows: Part, last: bool) -> Iterator[Part]:
        """Yield the uniform samples of the current stretch that no later row can change."""
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
        """Transform channel values to the joints and mark the samples whose torque is valid."""
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
        given = moved.get("reference"), moved.get("reference_velocity"), moved.get("feedforward")
        late = self.mapping.torque_delay / self.facts.period
        return Part(raw.t, moved["position"], dq, ddq, tau, valid, 0, 0, *given, late=late)


def _resampled(rows: Part, t: Array, hole: float) -> Part:
    """Interpolate at ``t``: motion by the cubic through four neighbouring samples, torques linearly.

    A torque is invalid next to an invalid one, and across a step longer than ``hole`` (s).
    """
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

    def linear(x: Array | None) -> Array | None:
        return None if x is None else x[here] * (1 - share) + x[here + 1] * share

    tau = linear(rows.tau)
    sound = np.where(share < 1e-9, rows.valid[here], rows.valid[here] & rows.valid[here + 1])
    valid = sound & ((step < hole)[:, None] | (share < 1e-9))
    q = cubic(rows.q)
    assert q is not None
    given = linear(rows.reference), linear(rows.reference_velocity), linear(rows.feedforward)
    dq, ddq = cubic(rows.dq), cubic(rows.ddq)
    return Part(t, q, dq, ddq, tau, valid, rows.segment, rows.first, *given, late=rows.late)
