"""C as a target language: the dialect of one robot, the printer of programs, and the sources of sines and cosines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal, Protocol

from rrrgen.base.templates import render
from rrrgen.emit import Real, printing
from rrrgen.emit.interface import CHOICE, UNARY, Text
from rrrgen.emit.printing import decimal
from rrrgen.program import Failure, Op, Port, Program, Status
from rrrgen.robot.spec import KEYWORDS

# ------------------------------------------------------------------------------------------------------------------
# The dialect of C for one robot: real type, literals, library functions, reserved names.
# ------------------------------------------------------------------------------------------------------------------

_LIBRARY = """sin cos tan asin acos atan atan2 sinh cosh tanh exp log log10 pow sqrt ceil floor fabs fmod frexp ldexp
modf abs hypot cbrt erf erfc gamma lgamma tgamma j0 j1 jn y0 y1 yn signbit isnan isinf rint round trunc nan fma fmin
fmax signgam index time clock div labs main near far small linux unix i386"""

RESERVED = KEYWORDS | frozenset(_LIBRARY.split())
"""Names that a local variable must not have: keywords, C library functions, macros of common compilers."""


@dataclass(frozen=True)
class Dialect:
    """The naming and the floating-point type of one robot's C: ``prefix`` of every symbol, ``real`` type."""

    prefix: str
    real: Real = "double"

    @property
    def real_type(self) -> str:
        """Name of the typedef of the floating-point type."""
        return f"{self.prefix}_real"

    @property
    def macro(self) -> str:
        """Prefix of macros and enumerators."""
        return self.prefix.upper()

    @property
    def success(self) -> str:
        """The C enumerator that a function with a status returns after success, ``<NAME>_OK``."""
        return f"{self.macro}_OK"

    def failure(self, failure: Failure) -> str:
        """The C enumerator that a function returns after this ``failure``."""
        return f"{self.macro}_{failure.name.upper().replace(' ', '_')}"

    def literal(self, value: Fraction | int) -> str:
        """A constant with an explicit cast to the real type, which avoids warnings about implicit conversions."""
        return f"({self.real_type}){decimal(value, self.real)}"

    def function(self, name: str) -> str:
        """Name of the math.h function in the precision of the file, ``sin`` or ``sinf``."""
        return name if self.real == "double" else f"{name}f"

    @property
    def nonfinite(self) -> str:
        """Name of the C function that tells finite numbers (0) from infinite ones (1) and from NaN (2)."""
        return f"{self.prefix}_nonfinite"

    def select(self, condition: str, yes: str, no: str) -> str:
        """The C expression of ``yes`` if ``condition`` is positive, else ``no``."""
        return f"({condition} > {self.literal(Fraction(0))}) ? {yes} : {no}"

    def branch(self, condition: str, yes: Sequence[str], no: Sequence[str]) -> list[str]:
        """The if statement with the assignments ``yes`` if ``condition`` is positive, else ``no``."""
        head = f"if ({condition} > {self.literal(Fraction(0))}) {{"
        return [head, *(f"    {line}" for line in yes), "} else {", *(f"    {line}" for line in no), "}"]

    def minimum(self, x: str, y: str) -> str:
        """The C expression of the smaller of x and y."""
        return f"({x} < {y}) ? {x} : {y}"

    def sign(self, x: str) -> str:
        """The C expression of sgn x: -1, 0 or 1; NaN stays NaN."""
        zero, one = self.literal(Fraction(0)), self.literal(Fraction(1))
        return f"({x} > {zero}) ? {one} : (({x} < {zero}) ? -{one} : {x})"


# ------------------------------------------------------------------------------------------------------------------
# Strategies for computing the sine and the cosine of one angle in emitted C.
# ------------------------------------------------------------------------------------------------------------------

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
"""Bound of the absolute error of both results for |angle| <= RANGE, with and without contraction to fused operations;
``rrrgen/evidence/kernel_proof.py`` proves it."""


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
            f"{dialect.real_type} {first};",
            f"{dialect.real_type} {second};",
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


# ------------------------------------------------------------------------------------------------------------------
# C as a target language of the shared printer.
# ------------------------------------------------------------------------------------------------------------------

_FUNCTIONS = {Op.SQRT: "sqrt", Op.ABS: "fabs", Op.EXP: "exp", Op.TANH: "tanh"}


def print_body(program: Program, dialect: Dialect, sincos: SinCos | None = None) -> list[str]:
    """The C statements of ``program``, one per line, unindented; the last may return the status."""
    return printing.print_body(program, CTarget(dialect, sincos or LibmSinCos()))


@dataclass(frozen=True)
class CTarget:
    """C in the dialect of one robot, with a strategy for sines and cosines."""

    dialect: Dialect
    trigonometry: SinCos
    explicit: bool = True

    @property
    def reserved(self) -> frozenset[str]:
        """Names that local variables must not have: C keywords, library functions, common macros."""
        return RESERVED

    def literal(self, value: Fraction | int) -> str:
        """A constant with a cast to the real type."""
        return self.dialect.literal(value)

    def declaration(self, name: str, value: str) -> str:
        """The declaration of a const local variable of the real type."""
        return f"const {self.dialect.real_type} {name} = {value};"

    def call(self, op: Op, argument: str) -> str:
        """A call of the math.h function for ``op``."""
        if op is Op.NONFINITE:
            return f"{self.dialect.nonfinite}({argument})"
        return f"{self.dialect.function(_FUNCTIONS[op])}({argument})"

    def sign(self, x: Text) -> Text:
        """The C expression of sgn x, by two comparisons."""
        return Text(self.dialect.sign(x.code), CHOICE)

    def minimum(self, x: Text, y: Text) -> Text:
        """The C expression of the smaller of two numbers, which compiles to one instruction."""
        return Text(self.dialect.minimum(x.within(UNARY), y.within(UNARY)), CHOICE)

    def select(self, condition: Text, positive: Text, otherwise: Text) -> Text:
        """The conditional expression of C that is ``positive`` where ``condition > 0``, else ``otherwise``."""
        texts = condition.within(UNARY), positive.within(UNARY), otherwise.within(UNARY)
        return Text(self.dialect.select(*texts), CHOICE)

    def sincos(self, angle: str, sine: str | None, cosine: str | None) -> list[str]:
        """The C statements that compute the sine and the cosine of ``angle``."""
        return self.trigonometry.statements(self.dialect, angle, sine, cosine)

    def element(self, port: Port, element: int, output: bool = False) -> str:
        """The C text of an element of a port: ``q[1]``; ``name`` for a scalar input, ``*name`` for a scalar output."""
        if port.shape == ():
            return f"*{port.name}" if output else port.name
        return f"{port.name}[{element}]"

    def discard(self, port: Port) -> str:
        """The statement ``(void)name;``, which avoids the compiler's warning about an unused parameter."""
        return f"(void){port.name};"

    def branch(self, condition: Text, yes: Sequence[str], no: Sequence[str]) -> list[str]:
        """The if statement with the statements ``yes`` where ``condition > 0``, else ``no``."""
        return self.dialect.branch(condition.within(UNARY), yes, no)

    def outcome(self, status: Status, value: Text) -> list[str]:
        """The return statements with the enumerators of success or failure; NaN reads as the last failure."""
        names = [self.dialect.success, *map(self.dialect.failure, status.failures)]
        codes = [0, *(failure.code for failure in status.failures)]
        below = [f"({value.within(UNARY)} < {self.dialect.literal(Fraction(2 * code + 1, 2))})" for code in codes[:-1]]
        early = [
            line
            for test, name in zip(below[:-1], names, strict=False)
            for line in (f"if {test} {{", f"    return {name};", "}")
        ]
        return [*early, f"return {below[-1]} ? {names[-2]} : {names[-1]};"]


def nonfinite_function(dialect: Dialect) -> str:
    """The C text of the static function ``dialect.nonfinite``, by the bits of a number.

    Under ``-ffast-math`` compilers take comparisons and arithmetic with NaN for impossible, but not integers.
    """
    return render("c/nonfinite.c.j2", prefix=dialect.prefix, real=dialect.real).rstrip("\n")
