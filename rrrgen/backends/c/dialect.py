"""The spelling of C: the real type, literals, library functions, and names that must not be used."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

from rrrgen.backends import Real
from rrrgen.backends.printing import decimal
from rrrgen.program import Status
from rrrgen.robotfile.names import KEYWORDS

_LIBRARY = """sin cos tan asin acos atan atan2 sinh cosh tanh exp log log10 pow sqrt ceil floor fabs fmod frexp ldexp
modf abs hypot cbrt erf erfc gamma lgamma tgamma j0 j1 jn y0 y1 yn signbit isnan isinf rint round trunc nan fma fmin
fmax signgam index time clock div labs main near far small linux unix i386"""

RESERVED = KEYWORDS | frozenset(_LIBRARY.split())
"""What a local variable must not be called: keywords, functions of the C library, macros of common compilers."""


@dataclass(frozen=True)
class Dialect:
    """How one robot's C is spelled: ``prefix`` of every symbol and the ``real`` type behind the one switch."""

    prefix: str
    real: Real = "double"

    @property
    def real_type(self) -> str:
        """Name of the typedef."""
        return f"{self.prefix}_real"

    @property
    def macro(self) -> str:
        """Prefix of macros and enumerators."""
        return self.prefix.upper()

    @property
    def success(self) -> str:
        """The enumerator of success."""
        return f"{self.macro}_OK"

    def failure(self, status: Status) -> str:
        """The enumerator of a failure."""
        return f"{self.macro}_{status.failure.upper().replace(' ', '_')}"

    def literal(self, value: Fraction | int) -> str:
        """A constant with a cast, so that no conversion is implicit in either precision."""
        return f"({self.real_type}){decimal(value, self.real)}"

    def function(self, name: str) -> str:
        """Name of a function of math.h in the file's precision."""
        return name if self.real == "double" else f"{name}f"

    def select(self, condition: str, yes: str, no: str) -> str:
        """``yes`` where ``condition`` is positive, else ``no``."""
        return f"({condition} > {self.literal(Fraction(0))}) ? {yes} : {no}"

    def sign(self, x: str) -> str:
        """-1, 0 or 1; NaN stays NaN."""
        zero, one = self.literal(Fraction(0)), self.literal(Fraction(1))
        return f"({x} > {zero}) ? {one} : (({x} < {zero}) ? -{one} : {x})"
