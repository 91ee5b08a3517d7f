"""Relative differences between values and references, collected as rows of a report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from rrrgen.verify.references.numeric_robot import Array
from rrrgen.verify.report import Row


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


def rate(function: Callable[[float], Array], step: float) -> Array:
    """The derivative df/ds at s = 0, by eighth-order central differences with the given step."""
    return np.asarray(sum(w * (function(k * step) - function(-k * step)) for k, w in STENCIL) / step)


def size(value: Array) -> float:
    """The largest magnitude, 0 for an empty array."""
    return float(np.max(np.abs(value), initial=0.0))


def relative_difference(value: Array, expected: Array, scale: float) -> float:
    """The relative difference max|value - expected| / scale; inf if the shapes differ, nan if there is a nan."""
    value, expected = np.asarray(value), np.asarray(expected)
    if value.shape != expected.shape:
        return float("inf")
    return size(value - expected) / max(scale, 1e-300)


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
