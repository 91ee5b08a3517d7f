"""The dialect of C for one robot: real type, literals, library functions, reserved names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from rrrgen.emit import Real
from rrrgen.emit.printing import decimal
from rrrgen.program import Failure
from rrrgen.robot.names import KEYWORDS

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
