"""The faults found in a recording and their repairs: counted by kind and channel, described in words, with warnings.

Every repair replaces or leaves out measured data. A few repairs are usual; if they affect more than
:data:`WARN_SHARE` of the rows, the estimates depend on the repairs as much as on the measurement, and the user is
warned.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

WARN_SHARE = 0.01
"""Share of the rows above which a repair causes a warning."""
NEVER_WARNED = ("encoder wraps",)
"""Kinds that never cause a warning: unwrapping an encoder is exact, however often it happens."""
MESSAGES = {
    "rows without time": "{count} rows without a time were left out",
    "rows without all positions": "{count} rows without all positions were left out",
    "truncated last line": "{count} last lines were cut off in the middle and were left out",
    "rows out of order": "{count} rows were out of order (by up to {worst:.3g} s) and were sorted",
    "duplicate instants": "{count} rows are there twice, value by value; the first stays",
    "repeated stamps": "{count} rows repeat an instant with other values (positions up to {worst:.3g} apart); "
    "the first stays",
    "encoder wraps": "{count} steps of wrapped encoders were made continuous",
    "doubtful encoder wraps": "{count} steps of wrapped encoders are near half a period: the sense is in doubt",
    "jitter": "{count} steps are off the period of {period:.6g} s, by up to {percent:.3g} % of it; "
    "all samples were moved to uniform instants",
    "bridged holes": "{count} holes of up to {worst:.3g} s ({rows} rows) were bridged; torques there are not used",
    "splitting holes": "{count} holes of up to {worst:.3g} s ({rows} rows) split the recording",
    "short stretches": "{count} stretches between holes are too short ({rows} rows) and were left out",
    "clipped torque channels": "{count} torque channels are clipped (at {worst:.6g}, {rows} samples at most); "
    "these samples are not used",
    "missing torques": "{count} torques are missing; these samples are not used",
}


@dataclass(frozen=True)
class Finding:
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
    findings: tuple[Finding, ...] = ()

    def lines(self) -> list[str]:
        """The repairs in words, a heading and one line per kind; empty if there are none."""
        if not self.findings:
            return []
        found = [f"repairs of {self.recording} ({self.rows} rows):"]
        for finding in self.findings:
            where = ", ".join(f"{name} {count}" for name, count in finding.channels if count)
            where = f"; samples by joint: {where}" if where else ""
            found.append(f"  {finding.message} ({100 * finding.share:.2g} % of the rows{where})")
        return found

    def warnings(self) -> list[str]:
        """A sentence for every kind that affects more than :data:`WARN_SHARE` of the rows."""
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

    def summarised(self, recording: str, joints: Sequence[str], period: float) -> Repairs:
        """Summarise the counts as :class:`Repairs` of a recording with these ``joints``, sampled at ``period`` (s)."""
        found = []
        for kind, count in self.counts.items():
            each = self.channels.get(kind)
            channels = () if each is None else tuple(zip(joints, (int(c) for c in each), strict=True))
            rows = self.rows[kind] if each is None else int(np.max(each))
            worst = self.worst[kind]
            message = MESSAGES[kind].format(count=count, worst=worst, percent=100 * worst, rows=rows, period=period)
            found.append(Finding(kind, count, message, rows, min(1.0, rows / max(1, self.read)), channels))
        return Repairs(recording, self.read, tuple(found))
