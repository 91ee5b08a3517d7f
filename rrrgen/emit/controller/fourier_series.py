"""A finite Fourier series in C with its coefficients at run time: ``<name>_fourier.h`` and ``.c``."""

from __future__ import annotations

import math
from fractions import Fraction

from rrrgen.emit import Real
from rrrgen.emit.c.dialect import Dialect
from rrrgen.emit.c.function_files import Extension, function_files
from rrrgen.emit.c.sources import nonfinite_function
from rrrgen.emit.c.trigonometry import SinCos
from rrrgen.emit.comments import columns

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
