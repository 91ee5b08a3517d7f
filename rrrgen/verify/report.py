"""The outcome of a verification: one row per comparison, a verdict, text and JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from rrrgen.base.tables import fold_lines, text_table
from rrrgen.verify.references.numeric_robot import Array

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
        text += [fold_lines(note, width) for note in notes]
        failed = len(self.failures)
        verdict = "all comparisons pass" if self.ok else f"{failed} of {len(self.rows)} comparisons FAIL"
        return "\n".join([*text, f"{self.robot}: {verdict} ({self.samples} states, seed {self.seed})"]) + "\n"

    def __str__(self) -> str:
        return self.to_text()


# ------------------------------------------------------------------------------------------------------------------
# Relative differences between values and references, collected as rows of a report.
# ------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Tolerances:
    """The largest accepted relative differences for a model in double or in float arithmetic.

    ``exact``: both sides are closed computations, so only round-off differs; the margin covers cancellation in sums of
    hundreds of terms. ``differenced``: one side is an eighth-order difference over ``step`` (rad or m per unit speed),
    which costs round-off / step. ``foreign``: another library, with its own normalisations.
    """

    exact: float
    differenced: float
    foreign: float
    step: float


DOUBLE = Tolerances(exact=1e-11, differenced=1e-8, foreign=1e-10, step=2e-3)
SINGLE = Tolerances(exact=1e-4, differenced=5e-3, foreign=1e-4, step=5e-2)

STENCIL = ((1, 4 / 5), (2, -1 / 5), (3, 4 / 105), (4, -1 / 280))
"""Pairs (k, w_k) of the eighth-order central difference f'(0) h = sum w_k (f(k h) - f(-k h))."""

SECOND_STENCIL = ((1, 8 / 5), (2, -1 / 5), (3, 8 / 315), (4, -1 / 560))
"""Pairs (k, w_k) of the difference f''(0) h^2 = sum w_k (f(k h) + f(-k h)) - 205/72 f(0), of eighth order too."""


def rate(function: Callable[[float], Array], step: float) -> Array:
    """The derivative df/ds at s = 0, by eighth-order central differences with the given step."""
    return np.asarray(sum(w * (function(k * step) - function(-k * step)) for k, w in STENCIL) / step)


def curvature(function: Callable[[float], Array], step: float) -> Array:
    """The second derivative at s = 0, by eighth-order central differences with the given step."""
    sides = sum(w * (function(k * step) + function(-k * step)) for k, w in SECOND_STENCIL)
    return np.asarray((sides - 205 / 72 * function(0.0)) / step**2)


def size(value: Array) -> float:
    """The largest magnitude, 0 for an empty array."""
    return float(np.max(np.abs(value), initial=0.0))


def relative_difference(value: Array, expected: Array, scale: float) -> float:
    """The relative difference max|value - expected| / scale; inf if the shapes differ, nan if there is a nan."""
    value, expected = np.asarray(value), np.asarray(expected)
    if value.shape != expected.shape:
        return float("inf")
    return size(value - expected) / max(scale, 1e-300)


LEAST_CURVATURE = 1e-3
"""A second difference that is smaller than this share of the values may be rounding: that of torques that are linear in
the states is nothing else."""


def curvature_scale(second: Array, values: Array) -> float:
    """What errors of the second derivative ``second`` of ``values`` are relative to; see :data:`LEAST_CURVATURE`."""
    return max(size(second), LEAST_CURVATURE * size(values))


class Check(Protocol):
    """Interface of a comparison with one reference, for one set of parameters, at one tolerance."""

    def __call__(
        self, function: str, value: Callable[[], Array], expected: Array, *, scale: float | None = None
    ) -> None:
        """Add one row: ``value()`` against ``expected``, relative to ``scale`` (default max|expected|)."""
        ...


@dataclass
class Collector:
    """Collects the rows of a report.

    If the model raises an error or lacks a function, the row fails, with the error message as its note.
    ``skipped`` holds references that are not installed, and functions that cannot exist for a robot, such as the
    inverse kinematics of a chain without a solver.
    """

    rows: list[Row] = field(default_factory=list)
    skipped: list[tuple[str, str]] = field(default_factory=list)

    def against(self, reference: str, parameters: str, tolerance: float, samples: int) -> Check:
        """Make a function that compares values and adds a row with this reference, parameter set and tolerance.

        ``samples`` is the number of states compared, for the report.
        """

        def check(function: str, value: Callable[[], Array], expected: Array, *, scale: float | None = None) -> None:
            note, difference = "", float("inf")
            try:
                got = np.asarray(value(), dtype=np.float64)
                difference = relative_difference(got, expected, size(expected) if scale is None else scale)
                if got.shape != np.shape(expected):
                    note = f"shape {got.shape} instead of {np.shape(expected)}"
            except Exception as error:  # any exception means that the comparison was not made
                note = f"{type(error).__name__}: {error}"
            self.rows.append(Row(function, reference, parameters, samples, difference, tolerance, note))

        return check
