"""The outcome of a verification: one row per comparison, a verdict, text and JSON."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import Any

from rrrgen.base.tables import folded, text_table

HEADINGS = ("function", "reference", "beta", "states", "max rel. difference", "tolerance", "verdict")


@dataclass(frozen=True)
class Row:
    """One comparison of a ``function`` of the model with a ``reference`` over a number of states (``samples``).

    ``parameters`` names the set of inertial parameters. ``difference`` is the largest relative difference
    ``max|a - b| / scale`` (:func:`rrrgen.verify.checks.verify` lists the scales); a NaN fails. ``note`` holds details,
    such as the error that the model raised.
    """

    function: str
    reference: str
    parameters: str
    samples: int
    difference: float
    tolerance: float
    note: str = ""

    @property
    def ok(self) -> bool:
        """Whether the difference is within the tolerance; False for nan."""
        return self.difference <= self.tolerance

    @property
    def verdict(self) -> str:
        """The result of the comparison as a word, ``pass`` or ``FAIL``."""
        return "pass" if self.ok else "FAIL"


@dataclass(frozen=True)
class Report:
    """All comparisons (``rows``) of the model of one ``robot``, over ``samples`` random states drawn with ``seed``.

    ``skipped`` holds pairs (what was not compared, reason).
    """

    robot: str
    samples: int
    seed: int
    rows: tuple[Row, ...]
    skipped: tuple[tuple[str, str], ...] = ()

    @property
    def ok(self) -> bool:
        """Whether there is at least one comparison and all have passed."""
        return bool(self.rows) and all(row.ok for row in self.rows)

    @property
    def failures(self) -> tuple[Row, ...]:
        """The rows that failed."""
        return tuple(row for row in self.rows if not row.ok)

    def to_dict(self) -> dict[str, Any]:
        """The report as plain data; a difference that is infinite or not a number becomes None."""
        rows = [
            {
                "function": row.function,
                "reference": row.reference,
                "parameters": row.parameters,
                "samples": row.samples,
                "max_relative_difference": row.difference if math.isfinite(row.difference) else None,
                "tolerance": row.tolerance,
                "verdict": row.verdict.lower(),
                "note": row.note,
            }
            for row in self.rows
        ]
        skipped = [{"reference": name, "reason": reason} for name, reason in self.skipped]
        return {
            "robot": self.robot,
            "ok": self.ok,
            "samples": self.samples,
            "seed": self.seed,
            "rows": rows,
            "skipped": skipped,
        }

    def to_json(self) -> str:
        """The report as JSON text."""
        return json.dumps(self.to_dict(), indent=2, allow_nan=False) + "\n"

    def to_text(self, width: int | None = None) -> str:
        """The report as text: a table of all comparisons, the references not available, and the verdict.

        Table and notes are folded to lines of ``width`` characters; None: lines of any length.
        """
        cells = [HEADINGS] + [
            (
                row.function,
                row.reference,
                row.parameters,
                str(row.samples),
                f"{row.difference:.1e}",
                f"{row.tolerance:.0e}" if row.tolerance else "0",
                row.verdict,
            )
            for row in self.rows
        ]
        text = text_table(cells, width, indent="", rule=True)
        notes = [f"note: {row.function}: {row.note}" for row in self.rows if row.note]
        notes += [f"not asked: {name}: {reason}" for name, reason in self.skipped]
        text += [folded(note, width) for note in notes]
        failed = len(self.failures)
        verdict = "all comparisons pass" if self.ok else f"{failed} of {len(self.rows)} comparisons FAIL"
        return "\n".join([*text, f"{self.robot}: {verdict} ({self.samples} states, seed {self.seed})"]) + "\n"

    def __str__(self) -> str:
        return self.to_text()
