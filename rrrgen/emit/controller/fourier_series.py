"""A finite Fourier series in C with its coefficients at run time: ``<name>_fourier.h`` and ``.c``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from rrrgen.base.errors import InputError
from rrrgen.emit import Real
from rrrgen.emit.c.function_files import Extension, function_files
from rrrgen.emit.c.language import Dialect, SinCos, nonfinite_function
from rrrgen.emit.printing import columns
from rrrgen.program import Builder, Port, Program, Role, Value

LARGEST = {"double": 1e150, "float": 1e15}
"""Base frequencies above these (Hz) are refused: products with them could overflow."""

PROMISE = (
    "The function has no state and allocates nothing; it takes the same time for all series with the same number of "
    "harmonics, and may be called from several threads at once."
)


def fourier_series_files(robot: str, n: int, real: Real, sincos: SinCos) -> dict[str, str]:
    """Header and source of the C function ``<robot>_fourier`` for a robot of ``n`` joints, name -> text.

    ``sincos`` says how sine and cosine are computed.
    """
    prefix = f"{robot}_fourier"
    dialect = Dialect(prefix, real)
    arguments = columns(
        [
            ("in", "series", "", "the coefficients"),
            ("in", "t", "s", "time, of any sign"),
            ("out", "q_d", "rad | m", "positions"),
            ("out", "dq_d", "per s", "velocities"),
            ("out", "ddq_d", "per s^2", "accelerations"),
        ]
    )
    values: dict[str, object] = {
        "n": n,
        "arguments": arguments,
        "kernel": sincos.preamble(dialect),
        "sincos": sincos.statements(dialect, "angle", "sine", "cosine"),
        "zero": dialect.literal(Fraction(0)),
        "one": dialect.literal(Fraction(1)),
        "turn": dialect.literal(Fraction(2.0 * math.pi)),
        "largest": dialect.literal(Fraction(LARGEST[real])),
        "floor": dialect.function("floor"),
        "fabs": dialect.function("fabs"),
    }
    title = f"a Fourier series for the joints of {robot}, with its coefficients at run time"
    extension = Extension("fourier", values, PROMISE, nonfinite_function(dialect))
    return function_files(prefix, title, [], real, extension=extension)


# ------------------------------------------------------------------------------------------------------------------
# Program that evaluates a finite Fourier series on the controller, such as an exciting trajectory.
# ------------------------------------------------------------------------------------------------------------------


def fourier_program(joints: int, harmonics: int) -> Program:
    """Program for position, velocity and acceleration of all joints under a finite Fourier series.

    ``q_i = q0_i + sum_j (a_ij sin w_j t - b_ij cos w_j t)/w_j``, ``w_j = 2 pi j f0``. Inputs ``t`` (s), ``f0`` (Hz) and
    ``coefficients`` (joints, 1 + 2 harmonics), rows ``[q0, a_1.., b_1..]``; outputs ``q``, ``dq``, ``ddq`` (joints,).
    The program calls sin and cos once; the multiples of the angle follow by addition theorems, each from two about half
    as large, so that rounding grows with the logarithm of ``harmonics``. In a long run pass t mod 1/f0 for ``t``, to
    keep its precision. Source: (14.24).
    """
    builder = Builder()
    t = builder.input(Port("t", (), "s", "", "time, best within one cycle"))[0]
    f0 = builder.input(Port("f0", (), "Hz", "", "base frequency"))[0]
    size = 1 + 2 * harmonics
    meaning = "row per joint: q0, then a_1.. and b_1.., speed amplitudes"
    values = builder.input(Port("coefficients", (joints, size), "rad, rad/s | m, m/s", "joint", meaning))
    rows = [values[i * size : (i + 1) * size] for i in range(joints)]
    return _record_trajectory(builder, t, f0, rows, harmonics, "fourier_trajectory")


def fixed_fourier_program(
    q0: Sequence[float], a: Sequence[Sequence[float]], b: Sequence[Sequence[float]], base_frequency: float
) -> Program:
    """Program for a finite Fourier series with fixed coefficients: the motion as a function of time alone.

    ``q0`` (n,) in rad or m, ``a`` and ``b`` (n, harmonics) in rad/s or m/s, ``base_frequency`` in Hz. Input ``t`` (s);
    outputs ``q``, ``dq``, ``ddq`` (n,). Raises InputError for inconsistent shapes. Source: (14.24).
    """
    harmonics = len(a[0])
    if any(len(row) != harmonics for row in (*a, *b)) or not len(q0) == len(a) == len(b):
        raise InputError("Fourier series: a and b must be (n, N), q0 (n,)")
    builder = Builder()
    t = builder.input(Port("t", (), "s", "", "time, best within one cycle"))[0]
    rows: list[list[Value]] = [[Fraction(float(v)) for v in (q0[i], *a[i], *b[i])] for i in range(len(q0))]
    return _record_trajectory(builder, t, Fraction(float(base_frequency)), rows, harmonics, "exciting_trajectory")


def _record_trajectory(
    builder: Builder, t: Value, f0: Value, rows: Sequence[Sequence[Any]], harmonics: int, name: str
) -> Program:
    omega = builder.mul(Fraction(2.0 * math.pi), f0)
    sines, cosines = _harmonics(builder, builder.mul(omega, t), harmonics)
    q, dq, ddq = [], [], []
    for row in rows:
        a, b = row[1 : 1 + harmonics], row[1 + harmonics :]
        position: Any = 0
        speed: Any = 0
        acceleration: Any = 0
        for j in range(1, harmonics + 1):
            along = a[j - 1] * cosines[j] + b[j - 1] * sines[j]
            across = a[j - 1] * sines[j] - b[j - 1] * cosines[j]
            position = position + across / j
            speed = speed + along
            acceleration = acceleration - across * j
        q.append(row[0] + position / omega)
        dq.append(speed)
        ddq.append(acceleration * omega)
    n = len(rows)
    outputs = [
        (Port("q", (n,), "rad | m", "joint", "positions", Role.POSITION), q),
        (Port("dq", (n,), "rad/s | m/s", "joint", "velocities", Role.VELOCITY), dq),
        (Port("ddq", (n,), "rad/s^2 | m/s^2", "joint", "accelerations", Role.ACCELERATION), ddq),
    ]
    formula = "q_i = q0_i + sum_j (a_ij sin w_j t - b_ij cos w_j t)/w_j, w_j = 2 pi j f0   (14.24)"
    return builder.program(name, outputs, summary="Exciting trajectory: a finite Fourier series.", formula=formula)


def _harmonics(builder: Builder, angle: Value, count: int) -> tuple[dict[int, Any], dict[int, Any]]:
    """Sines and cosines of the multiples 1..``count`` of an angle, each as multiple -> value.

    Each follows by the addition theorem from two multiples about half as large.
    """
    sines: dict[int, Any] = {1: builder.sin(angle)}
    cosines: dict[int, Any] = {1: builder.cos(angle)}
    for j in range(2, count + 1):
        one, other = j // 2, j - j // 2
        sines[j] = sines[one] * cosines[other] + cosines[one] * sines[other]
        cosines[j] = cosines[one] * cosines[other] - sines[one] * sines[other]
    return sines, cosines
