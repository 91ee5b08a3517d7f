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

from rrrgen.errors import InputError
from rrrgen.identify.columns import Array
from rrrgen.identify.log_repair import Finding, Findings, RawRows, ordered_rows
from rrrgen.identify.mapping import LogMapping
from rrrgen.identify.tables import table_fault

CHUNK = 100_000  # rows read at a time
JITTER = 0.01  # of a period: beyond it the samples are moved to uniform instants
HOLE = 1.5  # periods: a longer step is a hole
LONGEST_BRIDGE = 5.0  # periods: a longer hole splits the recording, unless the mapping says otherwise
SHORTEST_STRETCH = 32  # samples


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
    """What the first reading found: rows, ``period`` (s), whether samples must be moved, clip levels, findings."""

    rows: int
    start: float
    duration: float
    period: float
    resample: bool
    clipped_low: Array  # of the torque channels, SI on their own side; -inf where nothing is clipped
    clipped_high: Array
    findings: tuple[Finding, ...]


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

    def _rows(self) -> Iterator[RawRows]:
        return iter(self._short) if self._short is not None else ordered_rows(self.mapping, self.chunk, Findings())

    def _scan(self) -> LogFacts:
        findings = Findings()
        clock, clips = _Clock(self.mapping), _Clips(self.mapping)
        kept: list[RawRows] | None = []
        for rows in ordered_rows(self.mapping, self.chunk, findings):
            clock.see(rows.t)
            clips.see(rows)
            # a short recording stays in memory and is not parsed again
            kept = None if kept is None or clock.rows > self.chunk else [*kept, rows]
        self._short = kept
        period = clock.period()
        low, high = clips.levels(findings)
        resample = clock.report(period, self.mapping.max_gap, findings)
        told = tuple(Finding(k, c, _told(k, c, findings.worst.get(k, 0.0), period)) for k, c in findings.counts.items())
        return LogFacts(clock.rows, clock.first, clock.last - clock.first, period, resample, low, high, told)


class _Clock:
    """Statistics of the steps of time."""

    def __init__(self, mapping: LogMapping) -> None:
        self.mapping = mapping
        self.rows, self.first, self.last = 0, math.nan, math.nan
        self.typical = math.nan
        self.regular, self.total, self.shortest, self.longest = 0, 0.0, math.inf, 0.0
        self.holes: list[float] = []
        self.short, self.stretch = 0, 0  # stretches too short to be used, length of the current one

    def see(self, t: Array) -> None:
        """Take in the next instants."""
        steps = np.diff(t if self.rows == 0 else np.concatenate([[self.last], t]))
        self.first = float(t[0]) if self.rows == 0 else self.first
        self.rows, self.last = self.rows + len(t), float(t[-1])
        if math.isnan(self.typical) and len(steps):
            self.typical = float(np.median(steps))
        regular = steps[steps < HOLE * self.typical]
        self.regular, self.total = self.regular + len(regular), self.total + float(np.sum(regular))
        if len(regular):
            self.shortest = min(self.shortest, float(regular.min()))
            self.longest = max(self.longest, float(regular.max()))
        self.holes += [float(step) for step in steps[steps >= HOLE * self.typical]]
        cuts = np.flatnonzero(steps > longest_bridge(self.typical, self.mapping.max_gap))
        lengths = np.diff(np.concatenate([[-1 - self.stretch], cuts]))
        self.short += int(np.sum(lengths < SHORTEST_STRETCH))
        self.stretch = len(steps) - 1 - int(cuts[-1]) if len(cuts) else self.stretch + len(steps)

    def period(self) -> float:
        """The mean of the regular steps."""
        if self.mapping.time.period is not None:
            return self.mapping.time.period
        if self.regular == 0 or not self.total > 0:
            raise table_fault(self.mapping.files[0].path, "the period of sampling cannot be told from so few rows")
        return self.total / self.regular

    def report(self, period: float, max_gap: float | None, findings: Findings) -> bool:
        """Count jitter and holes; True where samples must be moved to uniform instants."""
        jitter = max(self.longest - period, period - self.shortest) / period if self.regular else 0.0
        if jitter > JITTER:
            findings.add("jitter", self.regular, jitter)
        bridge = longest_bridge(period, max_gap)
        bridged = [hole for hole in self.holes if hole <= bridge]
        split = [hole for hole in self.holes if hole > bridge]
        findings.add("bridged holes", len(bridged), max(bridged, default=0.0))
        findings.add("splitting holes", len(split), max(split, default=0.0))
        findings.add("short stretches", self.short + int(self.stretch + 1 < SHORTEST_STRETCH))
        return jitter > JITTER or bool(bridged)


def longest_bridge(period: float, max_gap: float | None) -> float:
    """The longest hole (s) that is bridged by interpolation."""
    return max(HOLE, LONGEST_BRIDGE) * period if max_gap is None else max(HOLE * period, max_gap)


class _Clips:
    """Levels at which a torque channel is cut off: it stays exactly at its extreme, entered and left with a kink."""

    RUN = 5  # equal samples in a row
    KINK = 20.0  # a smooth top of L samples one step high lies at most 9 steps deep a run's length away

    def __init__(self, mapping: LogMapping) -> None:
        self.channels = mapping.channels("torque")
        n = len(self.channels)
        limits = np.array([math.inf if c.limit is None else 0.995 * c.limit for c in self.channels])
        self.limits = limits
        self.high, self.low = np.full(n, -math.inf), np.full(n, math.inf)
        self.cut_high, self.cut_low = np.zeros(n, bool), np.zeros(n, bool)
        self.clipped, self.missing, self.rows = np.zeros(n, int), np.zeros(n, int), 0

    def see(self, rows: RawRows) -> None:
        """Take in the next samples."""
        if not self.channels:
            return
        tau = rows.signals["torque"]
        self.rows += len(tau)
        self.missing += np.sum(~np.isfinite(tau), axis=0)
        self.clipped += np.sum(np.abs(tau) >= self.limits, axis=0)
        for j, x in enumerate(tau.T):
            for sign, best, cut in ((1.0, self.high, self.cut_high), (-1.0, self.low, self.cut_low)):
                finite = sign * x[np.isfinite(x)]
                top = float(np.max(finite, initial=-math.inf))
                if top == -math.inf or sign * best[j] > top:
                    continue
                seen = _is_cut(finite, top, self.RUN, self.KINK)
                cut[j] = seen or (bool(cut[j]) and sign * best[j] == top)
                best[j] = sign * top

    def levels(self, findings: Findings) -> tuple[Array, Array]:
        """Lowest and highest level that still count as clipped, per channel; counts what is clipped and missing."""
        if not self.channels:
            return np.full(0, -math.inf), np.full(0, math.inf)
        low = np.where(self.cut_low, np.maximum(self.low, -self.limits), -self.limits)
        high = np.where(self.cut_high, np.minimum(self.high, self.limits), self.limits)
        cut = self.cut_low | self.cut_high | (self.clipped > 0)
        findings.add("clipped torque channels", int(np.sum(cut)), float(np.max(np.where(cut, high, 0.0), initial=0.0)))
        findings.add("missing torques", int(np.sum(self.missing)))
        return low, high


def _is_cut(x: Array, top: float, run: int, kink: float) -> bool:
    """Whether ``x`` stays at ``top`` for ``run`` samples or more and leaves it steeply."""
    at = np.concatenate([[False], x == top, [False]])
    edges = np.flatnonzero(np.diff(at.astype(np.int8)))
    starts, ends = edges[::2], edges[1::2]
    lengths = ends - starts
    steps = np.abs(np.diff(x))
    step = float(np.min(steps[steps > 0], initial=math.inf))
    if not math.isfinite(step):
        return False
    for start, length in zip(starts[lengths >= run], lengths[lengths >= run], strict=True):
        before, after = start - length, start + 2 * length - 1
        depths = [top - x[i] for i in (before, after) if 0 <= i < len(x)]
        if depths and max(depths) > kink * step:
            return True
    return False


def _told(kind: str, count: int, worst: float, period: float) -> str:
    """A finding in words."""
    return {
        "rows without time": f"{count} rows without a time were left out",
        "rows without all positions": f"{count} rows without all positions were left out",
        "rows out of order": f"{count} rows were out of order (by up to {worst:.3g} s) and were sorted",
        "duplicate instants": f"{count} rows repeat an instant (positions up to {worst:.3g} apart); the first stays",
        "encoder wraps": f"{count} steps of wrapped encoders were made continuous",
        "doubtful encoder wraps": f"{count} steps of wrapped encoders are near half a period: the sense is in doubt",
        "jitter": f"steps are up to {100 * worst:.3g} % off {period:.6g} s; samples were moved to uniform instants",
        "bridged holes": f"{count} holes of up to {worst:.3g} s were bridged; torques there are not used",
        "splitting holes": f"{count} holes of up to {worst:.3g} s split the recording",
        "short stretches": f"{count} stretches of fewer than {SHORTEST_STRETCH} samples were left out",
        "clipped torque channels": f"{count} torque channels are clipped (at {worst:.6g}); these samples are not used",
        "missing torques": f"{count} torques are missing; these samples are not used",
    }[kind]


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
