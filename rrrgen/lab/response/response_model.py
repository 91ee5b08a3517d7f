"""A linear model of a response: difference equation, resonances, and how well it fits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError, require
from rrrgen.base.tables import text_table
from rrrgen.emit.controller.state_space import StateSpace, in_parallel, realize
from rrrgen.lab.data.run_folder import read_json
from rrrgen.lab.estimate.remainder import recorded_remainders, remainder_notes

# ------------------------------------------------------------------------------------------------------------------
# The discrete-time controller of a recorded control loop, as a transfer function.
# ------------------------------------------------------------------------------------------------------------------

Complex = NDArray[np.complexfloating[Any, Any]]


@dataclass(frozen=True)
class ControllerTransferFunction:
    """The controller ``C(z) = (c_0 + c_1 z^-1 + ..)/(d_0 + d_1 z^-1 + ..)`` of the loop ``u = n - C(z) (q - q_r)``.

    ``numerator`` holds the c_i, ``denominator`` the d_i. A PD controller with the gains kp and kd, the sampling period
    T and the backward difference of the position has ``c = [kp + kd/T, -kd/T]``, ``d = [1]``.
    """

    numerator: tuple[float, ...]
    denominator: tuple[float, ...] = (1.0,)

    def response(self, frequency: Array, period: float) -> Complex:
        """The frequency response of C, complex (L,), at ``frequency`` (L,) in Hz for the sampling ``period`` in s."""
        z = np.exp(-2j * np.pi * np.asarray(frequency) * period)
        powers = np.polynomial.polynomial.polyval
        return np.asarray(powers(z, self.numerator) / powers(z, self.denominator))


# ------------------------------------------------------------------------------------------------------------------
# A linear model of a response
# ------------------------------------------------------------------------------------------------------------------

SCHEMA = "rrrgen-response-model/1"
HIGHEST_DAMPING = 0.3  # highest damping ratio of a resonance
CERTAIN = {"frequency": 0.0025, "damping": 0.05}
"""Relative standard deviations above which frequency or damping of a resonance counts as uncertain."""
LOWEST_SHARE = 1e-3  # of the sampling rate: lowest frequency at which the rounding of a and b is determined
COARSE = 1e-6  # relative error by the rounding of a and b from which on the report states it
NOT_LINEAR = "a mode that the order leaves out, friction or backlash, or a slow disturbance"
"""Effects that let prediction errors follow each other, in words."""
OTHER_PROTOCOLS = {
    "free_run_with_state_from_fitted_rows": "free run with the state that the fitted rows lead to",
    "free_run_from_zero_state": "free run from the state zero",
    "one_step": "one step ahead",
}
HIGHEST_ZERO = 0.8  # zeros above this share of half the sampling rate are due to sampling


@dataclass(frozen=True)
class Resonance:
    """Frequency and damping ratio of a mode with the pole ``exp(s T)`` and its conjugate, T the sampling period.

    ``frequency`` is ``|s|/(2 pi)`` in Hz, ``damping`` is ``-Re s/|s|``; ``frequency_std`` and ``damping_std`` are their
    standard deviations, None where the method gives none.
    """

    frequency: float
    damping: float
    frequency_std: float | None = None
    damping_std: float | None = None

    @property
    def uncertain(self) -> tuple[str, ...]:
        """What is hardly known: "frequency" with a 95 % interval beyond .5 %, "damping" with one beyond 10 %."""
        pairs = {"frequency": (self.frequency, self.frequency_std), "damping": (self.damping, self.damping_std)}
        return tuple(
            name for name, (value, std) in pairs.items() if std is None or not std <= CERTAIN[name] * abs(value)
        )

    @property
    def unknown(self) -> bool:
        """Whether there may be a resonance and no more is known: frequency uncertain, damping without deviation."""
        return "frequency" in self.uncertain and self.damping_std is None

    def to_json(self) -> dict[str, Any]:
        """Plain data for JSON: the values with their deviations, and what is uncertain."""
        return vars(self) | {"uncertain": list(self.uncertain)}

    def __str__(self) -> str:
        frequency, damping = (
            f"{value:.4g} +- {std:.2g}" if std is not None else f"{value:.4g}"
            for value, std in ((self.frequency, self.frequency_std), (self.damping, self.damping_std))
        )
        doubt = f" ({' and '.join(self.uncertain)} hardly known: record longer)" if self.uncertain else ""
        return f"{frequency} Hz, damping {damping}{doubt}"


def resonance(frequency: float, damping: float, relative_frequency: float, relative_damping: float) -> Resonance:
    """A resonance with relative standard deviations, which are None where they exceed 1: the values are not known."""
    known = [
        std * value if std < 1.0 else None
        for std, value in ((relative_frequency, frequency), (relative_damping, damping))
    ]
    return Resonance(frequency, damping, *known)


@dataclass(frozen=True)
class ResponseModel:
    """Difference equation ``y_k = sum a_i y_{k-i} + sum b_j u_{k-delay-j}``, i from 1, j from 0, with its resonances.

    ``method`` names the kind of fit, ``delay`` is in samples, ``period`` in s. ``fit`` holds the scores of the model
    and says how they were computed; ``table`` has one row for each model that was compared; ``name`` is that of the
    recording or posture. ``fractions`` are the terms ``c/d`` of which the model is the sum, after its delay, each as
    its coefficients c and d in ascending powers of z^-1; empty where only the difference equation is known. They keep
    the precision that a and b lose where many poles are near z = 1.
    """

    method: str
    a: Array
    b: Array
    delay: int
    period: float
    resonances: tuple[Resonance, ...] = ()
    fit: dict[str, Any] = field(default_factory=dict)
    table: tuple[dict[str, Any], ...] = ()
    name: str = ""
    fractions: tuple[tuple[Array, Array], ...] = ()

    @property
    def denominator(self) -> Array:
        """Coefficients of the denominator ``1 - sum a_i z^-i`` in ascending powers of z^-1."""
        return np.concatenate([[1.0], -self.a])

    @property
    def numerator(self) -> Array:
        """Coefficients of the numerator ``sum b_j z^-(delay + j)`` in ascending powers of z^-1."""
        return np.concatenate([np.zeros(self.delay), self.b])

    def response(self, frequency: Array) -> Complex:
        """Response of the model, complex (L,), at ``frequency`` (L,) in Hz."""
        z = np.exp(-2j * np.pi * np.asarray(frequency) * self.period)
        powers = np.polynomial.polynomial.polyval
        if self.fractions:
            return np.asarray(z**self.delay * sum(powers(z, c) / powers(z, d) for c, d in self.fractions))
        return np.asarray(powers(z, self.numerator) / powers(z, self.denominator))

    @property
    def rounding(self) -> float:
        """Largest relative error of the response of a and b due to their rounding, from 1e-3 of the sampling rate on.

        The fractions tell it; without them a and b are the model, and it is 0.
        """
        if not self.fractions:
            return 0.0
        import mpmath

        share = np.geomspace(LOWEST_SHARE, 0.49, 50)
        exact = []
        with mpmath.workdps(40):  # in double precision the evaluation itself would be off by more
            for ratio in share:
                z = mpmath.expjpi(-2 * mpmath.mpf(float(ratio)))
                top, bottom = (mpmath.polyval(c[::-1].tolist(), z) for c in (self.numerator, self.denominator))
                exact.append(complex(top / bottom))
        return float(np.max(np.abs(np.array(exact) / self.response(share / self.period) - 1.0)))

    @property
    def antiresonances(self) -> tuple[Resonance, ...]:
        """The weakly damped pairs of zeros, at whose frequency the output stands still while the rest vibrates.

        Zeros near half the sampling rate are left out: they are added by sampling, not by the mechanism.
        """
        first = np.flatnonzero(self.b)
        if not len(first):
            return ()
        zeros = resonances_of(-self.b[first[0] + 1 :] / self.b[first[0]], self.period)
        return tuple(zero for zero in zeros if zero.frequency < HIGHEST_ZERO * 0.5 / self.period)

    def state_space(self) -> StateSpace:
        """The model in state space, one block for each mode."""
        if not self.fractions:
            return realize(self.numerator, self.denominator)
        late = min(self.delay, 1)  # the first sample of delay needs no state of its own
        parts = [realize(np.concatenate([np.zeros(late), c]), d) for c, d in self.fractions]
        return in_parallel(parts, self.delay - late)

    def to_control(self) -> Any:
        """The model as a ``control.StateSpace`` of python-control (extra ``response``), with its sampling period.

        Raises :class:`MissingExtraError` where python-control is not installed.
        """
        require("the export to python-control", "control")
        import control

        system = self.state_space()
        return control.ss(
            system.A, system.B[:, None], system.C[None, :], [[system.D]], self.period, name=self.name or None
        )

    def lines(self, width: int | None = None) -> list[str]:
        """The report as text: order, scores, resonances, and the models that were compared."""
        fit = self.fit
        lines = [f"{self.name}: {self.method}, order {len(self.a)}, delay {self.delay} samples"]
        lines.append(f"fit {fit['value']:.2f} %: {fit['protocol']}")
        for key, other in OTHER_PROTOCOLS.items():
            if key in fit and fit[key] != fit["value"]:
                lines.append(f"  {fit[key]:.2f} %: {other}")
        if "scored_rows" in fit:
            first, last = fit["scored_rows"]
            lines.append(f"  scored on rows {first}:{last}{'' if fit['held_out'] else ', which were fitted'}")
        left = recorded_remainders(fit.get("held_out_remainder", ()))
        lines += (f"  note: {note}" for note in remainder_notes(left, "errors", NOT_LINEAR))
        if self.rounding > COARSE:
            held = f"{100.0 * self.rounding:.2g} %"
            lines.append(f"  a and b, in double precision, hold the response to {held}: take the state space")
        lines += [f"  resonance {mode}" for mode in self.resonances]
        return [*lines, "candidates:", *text_table(_candidates(self.table), width)]

    def to_json(self) -> dict[str, Any]:
        """The model as plain data for ``results/response_model.json``."""
        return {
            "schema": SCHEMA,
            "name": self.name,
            "method": self.method,
            "equation": "y_k = sum a_i y_{k-i} + sum b_j u_{k-delay-j}, i from 1, j from 0",
            "sampling_period": self.period,
            "order": len(self.a),
            "a": self.a,
            "b": self.b,
            "delay": self.delay,
            "rounding": self.rounding,
            "state_space": self.state_space().to_json(),
            "fractions": [{"numerator": c, "denominator": d} for c, d in self.fractions],
            "resonances": [mode.to_json() for mode in self.resonances],
            "antiresonances": [vars(mode) for mode in self.antiresonances],
            "fit": self.fit,
            "candidates": list(self.table),
        }


def _candidates(table: Sequence[dict[str, Any]]) -> list[tuple[str, ...]]:
    """The rows of the table of models that were compared, below their headings."""
    keys = list(dict.fromkeys(key for row in table for key in row))
    values = ([row.get(key, "-") for key in keys] for row in table)
    rows = (tuple(f"{v:.5g}" if isinstance(v, float) else str(v) for v in row) for row in values)
    return [tuple(key.replace("_", " ") for key in keys), *rows]


def polynomial_sum(a: Array, b: Array) -> Array:
    """The sum of two polynomials with coefficients in ascending powers; the shorter one is padded with zeros."""
    size = max(len(a), len(b))
    return np.asarray(np.pad(a, (0, size - len(a))) + np.pad(b, (0, size - len(b))))


def read_response_models(path: str | Path) -> list[ResponseModel]:
    """Read the models, one for every posture, from a ``response_model.json`` of `rrrgen response model`.

    Raises :class:`InputError` for any other file.
    """
    what = "response model of `rrrgen response model`"

    def read(data: Any) -> list[ResponseModel]:
        if data["schema"] != SCHEMA:
            raise InputError(f"{path} is no {what}: schema {data['schema']!r}")
        return [_of_json(posture) for posture in data.get("postures", [data])]

    return read_json(path, what, read)


def _of_json(data: dict[str, Any]) -> ResponseModel:
    a, b = np.array(data["a"], float), np.array(data["b"], float)
    period, delay = float(data["sampling_period"]), int(data["delay"])
    if a.ndim != 1 or b.ndim != 1 or not period > 0.0 or delay < 0 or not np.all(np.isfinite([*a, *b])):
        raise ValueError("coefficients, delay or sampling period")
    return ResponseModel(
        method=str(data["method"]),
        a=a,
        b=b,
        delay=delay,
        period=period,
        resonances=tuple(
            Resonance(**{key: value for key, value in mode.items() if key != "uncertain"})
            for mode in data["resonances"]
        ),
        fit=dict(data["fit"]),
        name=str(data["name"]),
        fractions=tuple(
            (np.array(fraction["numerator"], float), np.array(fraction["denominator"], float))
            for fraction in data.get("fractions", ())
        ),
    )


def resonances_of(a: Array, period: float) -> tuple[Resonance, ...]:
    """The weakly damped pole pairs of ``1 - sum a_i z^-i`` as resonances, sorted by frequency; ``period`` is in s."""
    roots = np.roots(np.concatenate([[1.0], -a]))
    s = np.log(roots[roots.imag > 1e-9]) / period
    resonances = [Resonance(float(abs(pole) / (2.0 * np.pi)), float(-pole.real / abs(pole))) for pole in s]
    return tuple(
        sorted((mode for mode in resonances if abs(mode.damping) < HIGHEST_DAMPING), key=attrgetter("frequency"))
    )
