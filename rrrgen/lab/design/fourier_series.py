"""Finite Fourier series as joint motion: the exciting trajectory (14.24) with analytic derivatives.

Equation numbers are those of D. Kostic, B. de Jager, M. Steinbuch, Modeling and Identification for Robot Motion
Control, Robotics and Automation Handbook, CRC Press 2005, chapter 14.

The coefficients ``a`` and ``b`` are speed amplitudes; the motion is periodic with ``1/base_frequency`` and its highest
frequency is ``harmonics*base_frequency``.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rrrgen.base.errors import InputError

Floats = NDArray[np.floating[Any]]


def fourier_basis(t: ArrayLike, harmonics: int, base_frequency: float, derivative: int = 0) -> Floats:
    """The matrix that maps the Fourier coefficients of one joint to its sampled motion, or a time derivative of it.

    ``B(t) [q0, a_1..a_N, b_1..b_N]' = d^k q / dt^k`` with ``k = derivative`` and
    ``q = q0 + sum_j (a_j sin w_j t - b_j cos w_j t)/w_j``, ``w_j = 2 pi j base_frequency``.
    ``t`` (m,) in s; returns (m, 1 + 2 harmonics). Source: (14.24).
    """
    times = np.atleast_1d(np.asarray(t, dtype=float))
    omega = 2.0 * np.pi * base_frequency * np.arange(1, harmonics + 1)
    # Whole periods are removed before multiplying by the harmonic number, so that late samples are as exact as early
    # ones.
    phase = np.remainder(times * base_frequency, 1.0)
    angle = 2.0 * np.pi * np.remainder(np.outer(phase, np.arange(1, harmonics + 1)), 1.0)
    # The k-th derivative of sin(x)/w and -cos(x)/w advances the phase by k pi/2 and multiplies by w^k.
    gain = omega ** (derivative - 1)
    quarter = derivative % 4
    sine = (np.sin(angle), np.cos(angle), -np.sin(angle), -np.cos(angle))[quarter]
    cosine = (np.cos(angle), -np.sin(angle), -np.cos(angle), np.sin(angle))[quarter]
    constant = np.full((times.size, 1), 1.0 if derivative == 0 else 0.0)
    return np.hstack([constant, sine * gain, -cosine * gain])


def intersample_peak_factor(harmonics: int, samples_per_period: int) -> float:
    """Bound on the maximum of a trigonometric polynomial divided by its largest sample: ``1/cos(pi N/M)``.

    ``N`` is its degree, ``M`` the number of equispaced samples per period; infinite for ``M <= 2N``, where aliasing
    allows any maximum.
    Source: Ehlich and Zeller, Schwankung von Polynomen zwischen Gitterpunkten, Math. Z. 86 (1964).
    """
    if samples_per_period <= 2 * harmonics:
        return math.inf
    return 1.0 / math.cos(math.pi * harmonics / samples_per_period)


@dataclass(frozen=True, eq=False)
class FourierTrajectory:
    """Joint motion ``q_i = q0_i + sum_j (a_ij sin w_j t - b_ij cos w_j t)/w_j`` with ``w_j = 2 pi j base_frequency``.

    ``q0`` (n,) rad or m; ``a``, ``b`` (n, N) rad/s or m/s; ``base_frequency`` Hz. Source: (14.24).
    """

    q0: Floats
    a: Floats
    b: Floats
    base_frequency: float

    def __post_init__(self) -> None:
        for name in ("q0", "a", "b"):
            value = np.array(getattr(self, name), dtype=float)
            value.setflags(write=False)
            object.__setattr__(self, name, value)
        if self.a.ndim != 2 or self.a.shape != self.b.shape or self.q0.shape != (self.a.shape[0],):
            raise InputError(f"Fourier series: a and b must be (n, N), q0 (n,); got {self.a.shape}, {self.b.shape}")
        if not all(np.isfinite(x).all() for x in (self.q0, self.a, self.b, self.base_frequency)):
            raise InputError("Fourier series: a coefficient or the base frequency is not a finite number")
        if not self.base_frequency > 0.0:
            raise InputError(f"Fourier series: the base frequency must be positive, got {self.base_frequency} Hz")

    @property
    def n(self) -> int:
        """Number of joints."""
        return int(self.a.shape[0])

    @property
    def harmonics(self) -> int:
        """Number of harmonics N."""
        return int(self.a.shape[1])

    @property
    def period(self) -> float:
        """Duration of one cycle, s."""
        return 1.0 / self.base_frequency

    @property
    def coefficients(self) -> Floats:
        """The coefficients (1 + 2N, n), one column per joint: column i is ``[q0_i, a_i1..a_iN, b_i1..b_iN]``."""
        return np.vstack([self.q0[None, :], self.a.T, self.b.T])

    @classmethod
    def from_coefficients(cls, coefficients: ArrayLike, base_frequency: float) -> FourierTrajectory:
        """Build the trajectory from ``coefficients`` (1 + 2N, n), columns ``[q0, a_1..a_N, b_1..b_N]``, one per joint.

        ``base_frequency`` is in Hz.
        """
        X = np.asarray(coefficients, dtype=float)
        N = (X.shape[0] - 1) // 2
        return cls(X[0], X[1 : N + 1].T, X[N + 1 :].T, base_frequency)

    def derivative(self, t: ArrayLike, order: int) -> Floats:
        """Time derivative ``d^k q/dt^k``, ``k = order``, at the times ``t`` (any shape, s); returns (..., n)."""
        times = np.asarray(t, dtype=float)
        B = fourier_basis(times.ravel(), self.harmonics, self.base_frequency, order)
        return (B @ self.coefficients).reshape((*times.shape, self.n))

    def evaluate(self, t: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """Position, velocity and acceleration ``(q, dq, ddq)`` at the times ``t`` (any shape, s), each (..., n)."""
        return self.derivative(t, 0), self.derivative(t, 1), self.derivative(t, 2)

    def times(self, sample_period: float, cycles: float = 1.0) -> Floats:
        """Times (s) every ``sample_period`` (s) over ``cycles`` periods of the motion, without the end point."""
        count = round(cycles * self.period / sample_period)
        return np.arange(count) * sample_period

    def to_json(self) -> dict[str, object]:
        """The trajectory as plain data for JSON, from which :meth:`from_json` restores every float exactly."""
        return {
            "base_frequency_hz": self.base_frequency,
            "q0": self.q0.tolist(),
            "a": self.a.tolist(),
            "b": self.b.tolist(),
        }

    @classmethod
    def from_json(cls, data: dict[str, object] | str | Path) -> FourierTrajectory:
        """Restore a trajectory from the mapping of :meth:`to_json`, or from the path of a JSON file that holds it.

        Raises :class:`InputError` if the file cannot be read or a key is missing.
        """
        if isinstance(data, str | Path):
            try:
                data = json.loads(Path(data).read_text(encoding="utf-8"))
            except (OSError, ValueError) as error:
                raise InputError(f"{data}: not a trajectory: {error}") from error
        try:
            return cls(data["q0"], data["a"], data["b"], float(data["base_frequency_hz"]))  # type: ignore[index,arg-type]
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"trajectory: q0, a, b and base_frequency_hz are needed ({error})") from error


def read_trajectory(path: Path) -> FourierTrajectory:
    """Read the trajectory from an excitation result or from a JSON file that holds a trajectory alone.

    Raises :class:`InputError` if the file holds neither.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        coefficients = dict(data.get("trajectory", data))
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from None
    except (ValueError, AttributeError, TypeError) as error:
        raise InputError(f"{path} is no trajectory of `rrrgen experiment excite`: {error}") from None
    return FourierTrajectory.from_json(coefficients)
