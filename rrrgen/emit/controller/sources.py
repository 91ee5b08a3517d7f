"""C code of the online estimators, recursive least squares and the gradient method; the caller holds their state."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

from rrrgen.base.errors import InputError
from rrrgen.emit import Real
from rrrgen.emit.c.dialect import Dialect
from rrrgen.emit.c.function_files import Extension, function_files
from rrrgen.emit.c.sources import nonfinite_function
from rrrgen.emit.comments import columns
from rrrgen.emit.controller.programs import Regression

Kind = Literal["rls", "gradient"]
KINDS: tuple[Kind, ...] = ("rls", "gradient")
TITLES = {"rls": "recursive least squares with directional forgetting", "gradient": "gradient estimation"}

DEFAULT_NOISE = 0.1
DEFAULT_FORGETTING = 0.999
DEFAULT_REST = 0.01
DEFAULT_SPREAD = 10.0
LARGEST = {"double": 1e150, "float": 1e15}
REAL_BYTES = {"double": 8, "float": 4}
SPARE_STACK = 512
"""Bytes beside the arrays of an update: saved registers and sums."""
NEGLIGIBLE = {"double": 1e-24, "float": 1e-12}
"""Share of the noise variance below which a row says nothing about the parameters: the square of the rounding."""


@dataclass(frozen=True)
class EstimatorSettings:
    """Initial values and tuning of an online estimator of p parameters for a robot of n joints.

    - ``start`` (p,): initial parameters; if None those of the robot file, or 0 if it states no link masses.
    - ``spread`` (p,): their standard deviations, for recursive least squares; if None, each is ten times the largest
      parameter of the robot file, or 10 if it states no link masses.
    - ``noise`` (n, n): covariance of the torque noise, (N m)^2; 0.1 N m at every joint if None.
    - ``forgetting``: forgetting factor of recursive least squares, in (0, 1]; 1 weights all samples alike.
    - ``gain``: gain ``alpha Ts`` of the gradient method, (14.23).
    - ``rest``: speed in rad/s (m/s) below which a joint's equation is skipped, because friction at rest is unknown.
    """

    start: tuple[float, ...] | None = None
    spread: tuple[float, ...] | None = None
    noise: tuple[tuple[float, ...], ...] | None = None
    forgetting: float = DEFAULT_FORGETTING
    gain: float | None = None
    rest: float = DEFAULT_REST

    def completed(self, regression: Regression) -> Tuning:
        """These settings with every default filled in; raises :class:`InputError` that lists all invalid ones."""
        p, n = len(regression.names), regression.joints
        typical = max((abs(value) for value in regression.nominal or ()), default=0.0) or 1.0
        found = Tuning(
            start=self.start if self.start is not None else regression.nominal or (0.0,) * p,
            spread=self.spread if self.spread is not None else (DEFAULT_SPREAD * typical,) * p,
            noise=self.noise
            if self.noise is not None
            else tuple(tuple(DEFAULT_NOISE**2 * (i == j) for j in range(n)) for i in range(n)),
            forgetting=self.forgetting,
            gain=self.gain,
            rest=self.rest,
        )
        faults = found.faults(p, n)
        if faults:
            raise InputError(f"online estimator: {'; '.join(faults)}")
        return found


@dataclass(frozen=True)
class Tuning:
    """Complete settings of an online estimator; the fields are those of :class:`EstimatorSettings`.

    Only ``gain`` may be None, because recursive least squares has none.
    """

    start: tuple[float, ...]
    spread: tuple[float, ...]
    noise: tuple[tuple[float, ...], ...]
    forgetting: float
    gain: float | None
    rest: float

    def faults(self, p: int, n: int) -> list[str]:
        """Messages about settings that are invalid for ``p`` parameters and ``n`` joints; empty if all are valid."""
        usable = {
            f"the start needs {p} finite values": len(self.start) == p and all(map(math.isfinite, self.start)),
            f"the standard deviations at the start are {p} values, finite and not negative": len(self.spread) == p
            and all(math.isfinite(value) and value >= 0.0 for value in self.spread),
            f"the forgetting factor lies in (0, 1], not {self.forgetting:g}": 0.0 < self.forgetting <= 1.0,
            "the speed of a joint at rest is finite and not negative": math.isfinite(self.rest) and self.rest >= 0.0,
            "the gain is finite and positive": self.gain is None or (math.isfinite(self.gain) and self.gain > 0.0),
            f"the torque noise needs a symmetric, positive definite {n} x {n} covariance": _is_covariance(
                self.noise, n
            ),
        }
        return [fault for fault, holds in usable.items() if not holds]


def _is_covariance(rows: Sequence[Sequence[float]], n: int) -> bool:
    """Whether ``rows`` form a symmetric, positive definite matrix (n, n), judged by the pivots of its elimination."""
    if len(rows) != n or any(len(row) != n or not all(map(math.isfinite, row)) for row in rows):
        return False
    if any(rows[i][j] != rows[j][i] for i in range(n) for j in range(i)):
        return False
    left = [list(row) for row in rows]
    for k in range(n):
        if not left[k][k] > 0.0:
            return False
        for i in range(k + 1, n):
            factor = left[i][k] / left[k][k]
            left[i] = [a - factor * b for a, b in zip(left[i], left[k], strict=True)]
    return True


def estimator_files(regression: Regression, kind: Kind, settings: EstimatorSettings, real: Real) -> dict[str, str]:
    """Header and source of an online estimator in C, as file name -> text: ``<robot>_<kind>.h`` and ``.c``.

    They define the state struct that the caller holds, a function that initializes it and one that updates it with a
    sample. ``kind`` is "rls" or "gradient", ``real`` the C type of all numbers. Raises :class:`InputError` for invalid
    settings, or for a gradient estimator without a gain.
    """
    prefix = f"{regression.robot}_{kind}"
    chosen = settings.completed(regression)
    if kind == "gradient" and chosen.gain is None:
        raise InputError("the gradient estimator needs a gain")
    dialect = Dialect(prefix, real)
    values = _values(regression, kind, chosen, dialect)
    title = f"online estimation of {len(regression.names)} parameters of {regression.robot}, {TITLES[kind]}"
    program = regression.rows if kind == "rls" else regression.gradient
    return function_files(
        prefix, title, [program], real, extension=Extension(kind, values, preamble=nonfinite_function(dialect))
    )


def _values(regression: Regression, kind: Kind, chosen: Tuning, dialect: Dialect) -> dict[str, object]:
    """Values of the variables in the C templates of the estimator ``kind``, by name."""

    def literal(value: float) -> str:
        return dialect.literal(Fraction(value))

    unit = "SI"
    arguments = columns(
        [
            ("in", "q, dq, ddq", "rad | m, per s", "the motion at this sample, as the Kalman filter returns it"),
            ("in", "tau", "N m | N", "measured torques, less friction compensated with known parameters"),
            ("out", "e", "N m | N", _ERRORS[kind]),
        ]
    )
    n, p = regression.joints, len(regression.names)
    arrays = n * (p + n + 3) + 3 * p if kind == "rls" else p
    values: dict[str, object] = {
        "n": n,
        "p": p,
        "stack": SPARE_STACK + arrays * REAL_BYTES[dialect.real],
        "names": regression.names,
        "zero": literal(0.0),
        "one": literal(1.0),
        "largest": literal(LARGEST[dialect.real]),
        "negligible": literal(NEGLIGIBLE[dialect.real]),
        "rest": literal(chosen.rest),
        "arguments": arguments,
    }
    listed = zip(regression.names, chosen.start, chosen.spread, strict=True)
    if chosen.gain is not None and kind == "gradient":
        values |= {"initial": [literal(v) for v in chosen.start], "gain": literal(chosen.gain)}
        values["start"] = columns(
            [(f"p[{k}]", name, unit, f"{value:.9g}") for k, (name, value, _) in enumerate(listed)]
        )
        return values
    values |= {
        "initial": [(literal(v), literal(s * s)) for v, s in zip(chosen.start, chosen.spread, strict=True)],
        "noise": [literal(v) for row in chosen.noise for v in row],
        "forgetting": literal(chosen.forgetting),
        "start": columns(
            [(f"p[{k}]", name, unit, f"{value:.9g} +- {std:.4g}") for k, (name, value, std) in enumerate(listed)]
        ),
    }
    return values


_ERRORS = {
    "rls": "measured minus model torque, before the update",
    "gradient": "model minus measured torque, before the update",
}
