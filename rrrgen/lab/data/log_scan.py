"""Statistics of a recording gathered in a first pass: period, jitter and holes; levels at which torques are clipped."""

from __future__ import annotations

import math

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.data.log_repair import RawRows
from rrrgen.lab.data.mapping import LogMapping
from rrrgen.lab.data.repairs import Findings
from rrrgen.lab.data.tables.interface import table_fault

JITTER = 0.01  # periods: with larger jitter, the recording is resampled at uniform instants
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
        self.waiting = np.zeros(0)  # instants whose steps have not been counted
        self.total, self.counted = 0.0, 0
        self.shortest, self.longest = math.inf, 0.0
        self.holes: list[float] = []
        self.irregular = 0  # steps that are off the typical one by more than JITTER
        self.short, self.short_rows, self.stretch = 0, 0, 0  # stretches too short to be used, steps of the current one

    def add(self, t: Array, last: bool = False) -> None:
        """Add the next instants ``t`` (s); ``last`` marks the end of the recording."""
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
            raise table_fault(self.mapping.files[0].path, "the period of sampling cannot be told from so few rows")
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
        """Record jitter and holes in ``findings``; returns whether the samples must be moved to uniform instants."""
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
        self.missing += np.sum(~np.isfinite(tau), axis=0)
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
