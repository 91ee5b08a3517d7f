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
from rrrgen.lab.data.mapping import ON_BASE, LogMapping
from rrrgen.lab.data.repair import Findings, RawRows, Repairs, ordered_rows
from rrrgen.lab.data.tables import table_fault

# ------------------------------------------------------------------------------------------------------------------
# Statistics of a recording gathered in a first pass: period, jitter and holes; levels at which torques are clipped.
# ------------------------------------------------------------------------------------------------------------------

JITTER = 0.01  # periods: with larger jitter, the recording is resampled at uniform times
HOLE = 1.5  # periods: a longer step counts as a hole (missing samples)
LONGEST_BRIDGE = 5.0  # periods: a longer hole splits the recording, unless the mapping file sets max_gap
SHORTEST_STRETCH = 32  # samples: shorter stretches between holes are left out


class Clock:
    """Sampling period, jitter and holes of a recording, accumulated chunk by chunk.

    The time stamps arrive in chunks; the period is their mean difference over runs of RUN samples, over which jitter
    cancels. ``mapping`` says how the recording states its time.
    """

    RUN = 32
    FIRST = 4096  # steps that give the typical step; a fixed number, so that the size of the chunks does not matter

    def __init__(self, mapping: LogMapping) -> None:
        self.mapping = mapping
        self.rows, self.first, self.last = 0, math.nan, math.nan
        self.typical = math.nan
        self.waiting = np.zeros(0)  # points in time whose steps have not been counted
        self.total, self.counted = 0.0, 0
        self.shortest, self.longest = math.inf, 0.0
        self.holes: list[float] = []
        self.irregular = 0  # steps that are off the typical one by more than JITTER
        self.short, self.short_rows, self.stretch = 0, 0, 0  # stretches too short to be used, steps of the current one

    def add(self, t: Array, last: bool = False) -> None:
        """Add the next times ``t`` (s); ``last`` marks the end of the recording."""
        if len(t):
            self.first = float(t[0]) if self.rows == 0 else self.first
            self.rows, self.last = self.rows + len(t), float(t[-1])
            self.waiting = np.concatenate([self.waiting, t])
        if math.isnan(self.typical):
            if not last and len(self.waiting) <= self.FIRST:
                return
            self.typical = self._typical(self.waiting[: self.FIRST + 1])
        usable = len(self.waiting) - 1 if last else (len(self.waiting) - 1) // self.RUN * self.RUN
        if usable > 0:
            self._count(self.waiting[: usable + 1])
            self.waiting = self.waiting[usable:]

    def _typical(self, t: Array) -> float:
        if len(t) < 2:
            raise table_fault(self.mapping.files[0].path, "the period of sampling does not follow from so few rows")
        between_holes = _period_between_holes(np.diff(t), 4 * self.RUN)
        if between_holes is not None:
            return between_holes
        run = min(self.RUN, len(t) - 1)
        return float(np.median(t[run:] - t[:-run])) / run

    def _count(self, t: Array) -> None:
        steps = np.diff(t)
        regular = steps[steps < HOLE * self.typical]
        self.shortest = min(self.shortest, float(np.min(regular, initial=math.inf)))
        self.longest = max(self.longest, float(np.max(regular, initial=0.0)))
        self.irregular += int(np.sum(np.abs(regular - self.typical) > JITTER * self.typical))
        self.holes += [float(step) for step in steps[steps >= HOLE * self.typical]]
        for start in range(0, len(steps), self.RUN):
            part = steps[start : start + self.RUN]
            # a run with a hole is longer than its steps by at least one period; 0.75 leaves room for jitter
            if float(np.sum(part)) < (len(part) + 0.75) * self.typical:
                self.total, self.counted = self.total + float(np.sum(part)), self.counted + len(part)
        cuts = np.flatnonzero(steps > longest_bridge(self.typical, self.mapping.max_gap))
        lengths = np.diff(np.concatenate([[-1 - self.stretch], cuts]))
        short = lengths[lengths < SHORTEST_STRETCH]
        self.short, self.short_rows = self.short + len(short), self.short_rows + int(np.sum(short))
        self.stretch = len(steps) - 1 - int(cuts[-1]) if len(cuts) else self.stretch + len(steps)

    def period(self) -> float:
        """The sampling period (s): that of the mapping if given, otherwise the mean step of the runs without a hole."""
        if self.mapping.time.period is not None:
            return self.mapping.time.period
        return self.total / self.counted if self.counted else self.typical

    def report(self, period: float, max_gap: float | None, findings: Findings) -> bool:
        """Record jitter and holes in ``findings``; returns whether the samples must be moved to uniform times."""
        jitter = max(self.longest - period, period - self.shortest) / period if self.longest else 0.0
        if jitter > JITTER:
            findings.add("jitter", max(1, self.irregular), jitter)
        bridge = longest_bridge(period, max_gap)
        bridged = [hole for hole in self.holes if hole <= bridge]
        split = [hole for hole in self.holes if hole > bridge]
        for kind, holes in (("bridged holes", bridged), ("splitting holes", split)):
            missing = sum(round(hole / period) - 1 for hole in holes)
            findings.add(kind, len(holes), max(holes, default=0.0), rows=missing)
        last = self.stretch + 1
        ends_short = last < SHORTEST_STRETCH
        findings.add("short stretches", self.short + int(ends_short), rows=self.short_rows + last * int(ends_short))
        return jitter > JITTER or bool(bridged)


WHOLE = 0.2  # periods: steps this close to a whole number of periods agree with the period
MOST_STEPS = 0.9  # share of the steps that have to agree
RANDOM = 0.4  # share of the variance of independent drops: random drops had 0.48 or more, most coarse stamps below 0.27


def _period_between_holes(steps: Array, window: int) -> float | None:
    """Period (s) of a recording in which single rows are missing at many places, None unless its ``steps`` show that.

    Nearly all steps are whole multiples of the most frequent one then. Coarse stamps can look alike: a period of 1.3 ms
    stamped in ms has steps of 1 and 2 ms. But their sums over a ``window`` of steps stay within about one step, while
    rows dropped at random, a share p, give them the variance ``window p/(1 - p)^2`` of the geometric distribution.
    """
    single = steps[steps < HOLE * np.median(steps)]
    ratio = steps / np.median(single)  # the median of all steps lies above that of the single ones
    periods = np.round(ratio)
    agree = np.abs(ratio - periods) < WHOLE
    if np.mean(agree) < MOST_STEPS or np.mean(agree & (periods == 1.0)) <= 0.5:
        return None
    window = min(window, max(1, len(steps) // 16))
    total = np.concatenate([[0.0], np.cumsum(ratio)])
    dropped = 1.0 - len(steps) / total[-1]
    random = window * dropped / (1.0 - dropped) ** 2
    if not np.var(total[window:] - total[:-window]) > RANDOM * random:
        return None
    usable = agree & (periods <= LONGEST_BRIDGE)
    return float(np.sum(steps[usable]) / np.sum(periods[usable]))


def longest_bridge(period: float, max_gap: float | None) -> float:
    """The longest hole (s) bridged by interpolation: ``max_gap`` of the mapping, or LONGEST_BRIDGE periods."""
    return max(HOLE, LONGEST_BRIDGE) * period if max_gap is None else max(HOLE * period, max_gap)


class Clips:
    """Levels at which torque channels saturate: the signal stays exactly at its extreme, reached and left with a kink.

    If the mapping declares a limit of a channel, values from 99.5 % of that limit on also count as saturated.
    """

    RUN = 5  # equal samples in a row that make a plateau
    # A smooth maximum that stays within one quantisation step over L samples has fallen by at most 9 steps L samples
    # away; a saturated one by more.
    KINK = 20.0

    def __init__(self, mapping: LogMapping) -> None:
        self.channels = mapping.channels("torque")
        self.recorded = np.array([channel.value is None for channel in self.channels], bool)
        n = len(self.channels)
        limits = np.array([math.inf if c.limit is None else 0.995 * c.limit for c in self.channels])
        self.limits = limits
        self.high, self.low = np.full(n, -math.inf), np.full(n, math.inf)
        self.cut_high, self.cut_low = np.zeros(n, bool), np.zeros(n, bool)
        self.at_high, self.at_low = np.zeros(n, int), np.zeros(n, int)  # samples at the extremes
        self.clipped, self.missing = np.zeros(n, int), np.zeros(n, int)

    def add(self, rows: RawRows) -> None:
        """Include the torques of the next rows in the statistics."""
        if not self.channels:
            return
        tau = rows.signals["torque"]
        self.missing += np.sum(~np.isfinite(tau), axis=0) * self.recorded
        self.clipped += np.sum(np.abs(tau) >= self.limits, axis=0)
        for j, x in enumerate(tau.T):
            for sign, best, cut, at in (
                (1.0, self.high, self.cut_high, self.at_high),
                (-1.0, self.low, self.cut_low, self.at_low),
            ):
                finite = sign * x[np.isfinite(x)]
                top = float(np.max(finite, initial=-math.inf))
                if top == -math.inf or sign * best[j] > top:
                    continue
                seen = _is_cut(finite, top, self.RUN, self.KINK)
                cut[j] = seen or (bool(cut[j]) and sign * best[j] == top)
                at[j] = int(np.sum(finite == top)) + (at[j] if sign * best[j] == top else 0)
                best[j] = sign * top

    def levels(self, findings: Findings) -> tuple[Array, Array]:
        """Levels (low, high), (n,) each, at or beyond which a sample of a channel is clipped; infinite where none is.

        Clipped and missing samples are recorded in ``findings``.
        """
        if not self.channels:
            return np.full(0, -math.inf), np.full(0, math.inf)
        low = np.where(self.cut_low, np.maximum(self.low, -self.limits), -self.limits)
        high = np.where(self.cut_high, np.minimum(self.high, self.limits), self.limits)
        cut = self.cut_low | self.cut_high | (self.clipped > 0)
        # beyond a known limit all are counted; below it, those at the levels where the channel is cut off
        below_high, below_low = self.cut_high & (self.high < self.limits), self.cut_low & (self.low > -self.limits)
        clipped = self.clipped + self.at_high * below_high + self.at_low * below_low
        worst = float(np.max(np.where(cut, high, 0.0), initial=0.0))
        findings.add("clipped torque channels", int(np.sum(cut)), worst, channels=clipped)
        findings.add("missing torques", int(np.sum(self.missing)), channels=self.missing)
        return low, high


def _is_cut(x: Array, top: float, run: int, kink: float) -> bool:
    """Whether ``x`` stays at ``top`` for at least ``run`` samples and leaves that plateau with a kink.

    There is a kink where, one plateau length before or after the plateau, ``x`` is more than ``kink`` times its
    smallest step below ``top``.
    """
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


# ------------------------------------------------------------------------------------------------------------------
# A recording as a stream of uniformly sampled, uninterrupted stretches, read in constant memory
# ------------------------------------------------------------------------------------------------------------------

CHUNK = 100_000  # rows read at a time


@dataclass(frozen=True)
class Part:
    """Uniform samples at the joints in SI: ``t`` (N,), ``q`` (N, n), and ``dq``, ``ddq``, ``tau`` (N, n) or None.

    ``valid`` (N, n) is False where the torque of a joint is missing, clipped or interpolated over a hole. ``segment``
    is the number of the uninterrupted stretch that the part belongs to, ``first`` the index of its first sample
    therein. ``reference``, ``reference_velocity``, ``feedforward`` (N, n) are inputs of the controller, or None. The
    torques act ``late`` samples after their times, in the mean; an array (n,) states it joint by joint. On a
    ``floating`` base the first six columns are those of :data:`~rrrgen.lab.data.mapping.ON_BASE`.
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
    late: float | Array = 0.0
    floating: bool = False

    def __len__(self) -> int:
        return len(self.t)

    def coordinates(self, period: float) -> Array:
        """Positions (N, n) whose derivatives are the motion: ``q``, and on a floating base the integral of its twist.

        ``period`` is that of the sampling, s.
        """
        if not self.floating:
            return self.q
        assert self.dq is not None
        six = len(ON_BASE)
        twist = self.dq[:, :six]
        steps = np.vstack([np.zeros((min(1, len(twist)), six)), 0.5 * period * (twist[1:] + twist[:-1])])
        return np.hstack([np.cumsum(steps, axis=0), self.q[:, six:]])

    def slice_samples(self, start: int, stop: int) -> Part:
        """The part that holds the samples ``start`` to ``stop`` (exclusive) of this one, all columns alike."""
        s = slice(start, stop)
        optional = (self.dq, self.ddq, self.tau, self.reference, self.reference_velocity, self.feedforward)
        dq, ddq, tau, reference, speed, fed = (None if x is None else x[s] for x in optional)
        place = self.segment, self.first + start
        signals = self.t[s], self.q[s], dq, ddq, tau, self.valid[s]
        return Part(*signals, *place, reference, speed, fed, self.late, self.floating)

    def align_torques(self) -> Part:
        """The same part with the torques that act at its times, interpolated linearly between the recorded ones.

        At an end that this moves away from a recorded torque there is none: the sample is invalid.
        """
        if self.tau is None or not np.any(self.late):
            return self
        last, late = len(self) - 1, np.broadcast_to(self.late, self.tau.shape[1:])
        at = np.arange(len(self))[:, None] - late
        before = np.clip(np.floor(at).astype(int), 0, last)
        after = np.minimum(before + 1, last)
        share = at - np.floor(at)
        inside = (at >= 0.0) & (at <= last)
        joint = np.arange(len(late))
        valid = self.valid[before, joint] & (self.valid[after, joint] | (share == 0.0)) & inside
        tau = (1.0 - share) * self.tau[before, joint] + share * self.tau[after, joint]
        return replace(self, tau=tau, valid=valid, late=0.0)


def join_parts(parts: list[Part]) -> Part:
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
        floating=parts[0].floating,
    )


@dataclass(frozen=True)
class LogFacts:
    """Results of the first pass: number of rows, start, duration and period (s), clip levels, repairs.

    ``resample`` states whether the samples must be moved to uniform times.
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
        """Start and duration, s."""
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
            absent = [channel.value is not None for channel in self.mapping.channels("torque")]
            torque = None if tau is None else self.mapping.joint_side("torque", np.where(absent, 0.0, tau))
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
        repairs = findings.summarise(self.mapping.files[0].path.name, self.joints, period)
        return LogFacts(clock.rows, clock.first, clock.last - clock.first, period, resample, low, high, repairs)


class _Uniform:
    """Splits sorted rows at holes and resamples them at uniform times."""

    def __init__(self, mapping: LogMapping, facts: LogFacts) -> None:
        self.mapping, self.facts = mapping, facts
        self.bridge = longest_bridge(facts.period, mapping.max_gap)
        self.pending: Part | None = None  # samples of the open stretch that are still needed
        self.start, self.next, self.segment = 0.0, 0, 0

    def push(self, raw: RawRows) -> Iterator[Part]:
        """Add rows; yields the samples that later rows cannot change any more."""
        rows = self._at_joints(raw)
        if self.pending is not None:
            rows = join_parts([self.pending, rows])
        cuts = np.flatnonzero(np.diff(rows.t) > self.bridge) + 1
        begin = 0
        for cut in cuts:
            yield from self._close(rows.slice_samples(begin, int(cut)))
            begin = int(cut)
        yield from self._advance(rows.slice_samples(begin, len(rows)), last=False)

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
            self.next, self.pending = self.next + len(rows), rows.slice_samples(len(rows), len(rows))
        else:
            end = float(rows.t[-1] if last else rows.t[-3])
            count = math.floor((end - self.start) / period * (1 + 1e-12) + 1e-9) + 1
            out = _resample(rows, self.start + period * np.arange(self.next, count), HOLE * period)
            self.next = max(self.next, count)
            settled = int(np.searchsorted(rows.t, self.start + period * self.next)) - 4
            self.pending = rows.slice_samples(max(0, settled), len(rows))
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
        late = self.mapping.torque_lateness / self.facts.period
        rows = Part(raw.t, moved["position"], dq, ddq, tau, valid, 0, 0, *given, late=late)
        return replace(rows, floating=self.mapping.floating)


def _resample(rows: Part, t: Array, hole: float) -> Part:
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
    place = rows.segment, rows.first
    return Part(t, q, dq, ddq, tau, valid, *place, *given, late=rows.late, floating=rows.floating)
