"""How emitted C computes a sine and a cosine of one angle: a strategy, so that kernels can be exchanged."""

from __future__ import annotations

from typing import Protocol

from rrrgen.backends.c.dialect import Dialect


class SinCos(Protocol):
    """Prints the computation of the sine and the cosine of one angle."""

    def preamble(self, dialect: Dialect) -> str:
        """C text that the source file needs once, before the functions; may be empty."""
        ...

    def statements(self, dialect: Dialect, angle: str, sine: str | None, cosine: str | None) -> list[str]:
        """Statements that declare ``sine`` and ``cosine`` (each wanted if not None) of the expression ``angle``."""
        ...


class LibmSinCos:
    """Calls ``sin`` and ``cos`` of the C library (``sinf``, ``cosf``); compilers merge the pair where they can."""

    def preamble(self, dialect: Dialect) -> str:
        """Nothing beyond math.h."""
        return ""

    def statements(self, dialect: Dialect, angle: str, sine: str | None, cosine: str | None) -> list[str]:
        """One declaration for each that is wanted."""
        wanted = [(name, function) for name, function in ((sine, "sin"), (cosine, "cos")) if name is not None]
        return [f"const {dialect.real_type} {name} = {dialect.function(f)}({angle});" for name, f in wanted]
