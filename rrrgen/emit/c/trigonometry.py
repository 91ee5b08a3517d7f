"""Strategies for computing the sine and the cosine of one angle in emitted C."""

from __future__ import annotations

from typing import Literal, Protocol

from rrrgen.base.templates import render
from rrrgen.emit.c.dialect import Dialect

Trig = Literal["inline", "libm"]
"""Source of sines and cosines: ``inline`` is the kernel below, in the emitted file; ``libm`` is the C library."""


class SinCos(Protocol):
    """Prints the computation of the sine and the cosine of one angle."""

    def preamble(self, dialect: Dialect) -> str:
        """C text that the source file needs once, before the functions; may be empty."""
        ...

    def description(self, dialect: Dialect) -> str:
        """A clause for the header: the source of sines and cosines, and their accuracy."""
        ...

    def statements(self, dialect: Dialect, angle: str, sine: str | None, cosine: str | None) -> list[str]:
        """Statements that declare ``sine`` and ``cosine`` (each wanted if not None) of the expression ``angle``."""
        ...


class LibmSinCos:
    """Calls ``sin`` and ``cos`` of the C library (``sinf``, ``cosf``); some compilers merge the pair into one call."""

    def preamble(self, dialect: Dialect) -> str:
        """Text before the functions: none, as math.h has the functions."""
        return ""

    def description(self, dialect: Dialect) -> str:
        """A clause for the header that says where sines and cosines come from: the C library."""
        return "sin and cos of the C library"

    def statements(self, dialect: Dialect, angle: str, sine: str | None, cosine: str | None) -> list[str]:
        """The declarations of ``sine`` and ``cosine``, with a call of the C library for each that is not None."""
        wanted = [(name, function) for name, function in ((sine, "sin"), (cosine, "cos")) if name is not None]
        return [f"const {dialect.real_type} {name} = {dialect.function(f)}({angle});" for name, f in wanted]


SINE = {
    "double": (
        "-1.6666666666666632068e-1",
        "8.3333333333224244268e-3",
        "-1.9841269829816864792e-4",
        "2.7557313695195213322e-6",
        "-2.5050758648160703537e-8",
        "1.5896827621544006984e-10",
    ),
    "float": ("-1.6666654943634280246e-1", "8.3321781417556736664e-3", "-1.9517298368313863220e-4"),
}
"""Minimax coefficients of the polynomial S in sin(r) = r + r z S(z), z = r^2, on |r| <= pi/4, by precision (relative
error 4e-18 in double, 4e-9 in float)."""

COSINE = {
    "double": (
        "4.1666666666666599555e-2",
        "-1.3888888888874138509e-3",
        "2.4801587289491743877e-5",
        "-2.7557314355216540659e-7",
        "2.0875723680844991363e-9",
        "-1.1359669674695725385e-11",
    ),
    "float": ("4.1666646866329793798e-2", "-1.3887367509960252398e-3", "2.4438450905336603175e-5"),
}
"""Minimax coefficients of the polynomial C in cos(r) = 1 - z/2 + z^2 C(z), z = r^2, on |r| <= pi/4, by precision (error
5e-20 in double, 1e-10 in float)."""

HALF_PI = {
    "double": ("1.57079632673412561416626", "6.07710050630396597660e-11", "2.02226624879595063154e-21"),
    "float": ("1.5703125", "4.837512969970703125e-4", "7.54978995489188216e-8"),
}
"""pi/2 as a sum of three numbers; the first two have so few bits that their products with the number of quarter turns
are exact."""

ROUNDING = {"double": "6755399441055744.0", "float": "12582912.0"}
"""1.5 * 2^52 (float: 1.5 * 2^23): adding and subtracting it rounds to the nearest integer."""

RANGE = {"double": "1.0e6", "float": "2.0e3"}
"""Largest angle in rad for the kernel; beyond it the C library is called."""

ERROR_BOUND = {"double": 2.3e-16, "float": 1.2e-7}
"""Absolute error of both results for |angle| <= RANGE: one unit in the last place of 1, shown by dense tests."""


class InlineSinCos:
    """A kernel in the emitted file: Cody-Waite reduction by quarter turns and minimax polynomials, without branches.

    Both results have an absolute error below :data:`ERROR_BOUND` for ``|angle| <= RANGE``. For larger angles, NaN and
    infinities it calls the C library, and for all angles if the compiler may reorder arithmetic (-ffast-math).
    """

    def preamble(self, dialect: Dialect) -> str:
        """Text before the functions: the kernel of sine and cosine."""
        return render("c/sincos.c.j2", **kernel_values(dialect)).rstrip("\n")

    def description(self, dialect: Dialect) -> str:
        """A clause for the header on the source of sines and cosines: the kernel, its range and its error bound."""
        bound, limit = ERROR_BOUND[dialect.real], RANGE[dialect.real]
        kernel = f"inline kernel, absolute error below {bound} for |angle| <= {limit} rad"
        return f"{kernel}; the C library beyond, and with -ffast-math"

    def statements(self, dialect: Dialect, angle: str, sine: str | None, cosine: str | None) -> list[str]:
        """One call of the kernel for both sine and cosine; compilers drop the computation of one that is not wanted."""
        first, second = sine or f"{cosine}_other", cosine or f"{sine}_other"
        lines = [
            f"{dialect.real_type} {first}, {second};",
            f"{dialect.prefix}_sincos({angle}, &{first}, &{second});",
        ]
        unused = second if cosine is None else first if sine is None else None
        return lines if unused is None else [*lines, f"(void){unused};"]


def kernel_values(dialect: Dialect) -> dict[str, object]:
    """The variables of the template of the sine and cosine kernel: names, coefficients, range, error bound."""
    real = dialect.real
    return {
        "prefix": dialect.prefix,
        "macro": dialect.macro,
        "real": dialect.real_type,
        "sine": SINE[real],
        "cosine": COSINE[real],
        "half_pi": HALF_PI[real],
        "rounding": ROUNDING[real],
        "range": RANGE[real],
        "error": ERROR_BOUND[real],
        "suffix": "" if real == "double" else "f",
        "mask": "long long" if real == "double" else "int",
    }


def sincos_strategy(trig: Trig) -> SinCos:
    """The strategy for a value of the option ``--trig``."""
    return InlineSinCos() if trig == "inline" else LibmSinCos()
