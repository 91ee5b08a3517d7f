"""C as a target language of the shared printer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from rrrgen.emit import printing
from rrrgen.emit.c.dialect import RESERVED, Dialect
from rrrgen.emit.c.trigonometry import LibmSinCos, SinCos
from rrrgen.emit.interface import CHOICE, PRODUCT, SUM, Text
from rrrgen.program import Op, Port, Program, Status

_FUNCTIONS = {Op.SQRT: "sqrt", Op.ABS: "fabs", Op.EXP: "exp", Op.TANH: "tanh"}


def print_body(program: Program, dialect: Dialect, sincos: SinCos | None = None) -> list[str]:
    """The C statements of ``program``, one per line, unindented; the last may return the status."""
    return printing.print_body(program, CTarget(dialect, sincos or LibmSinCos()))


@dataclass(frozen=True)
class CTarget:
    """C in the dialect of one robot, with a strategy for sines and cosines."""

    dialect: Dialect
    trigonometry: SinCos

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
        return Text(self.dialect.minimum(x.within(SUM), y.within(SUM)), CHOICE)

    def select(self, condition: Text, positive: Text, otherwise: Text) -> Text:
        """The conditional expression of C that is ``positive`` where ``condition > 0``, else ``otherwise``."""
        texts = condition.within(PRODUCT), positive.within(SUM), otherwise.within(SUM)
        return Text(self.dialect.select(*texts), CHOICE)

    def sincos(self, angle: str, sine: str | None, cosine: str | None) -> list[str]:
        """The C statements that compute the sine and the cosine of ``angle``."""
        return self.trigonometry.statements(self.dialect, angle, sine, cosine)

    def element(self, port: Port, element: int, output: bool = False) -> str:
        """The C text of an element of a port: ``q[1]``; ``name`` for a scalar input, ``*name`` for a scalar output."""
        if port.shape == ():
            return f"*{port.name}" if output else port.name
        return f"{port.name}[{element}]"

    def unused(self, port: Port) -> str:
        """The statement ``(void)name;``, which avoids the compiler's warning about an unused parameter."""
        return f"(void){port.name};"

    def branch(self, condition: Text, yes: Sequence[str], no: Sequence[str]) -> list[str]:
        """The if statement with the statements ``yes`` where ``condition > 0``, else ``no``."""
        return self.dialect.branch(condition.within(PRODUCT), yes, no)

    def outcome(self, status: Status, value: Text) -> list[str]:
        """The return statement with the enumerator of success or failure."""
        *failures, text = [
            self.dialect.failure(failure) for failure in status.failures
        ]  # NaN reads as the last failure
        codes = [0, *(failure.code for failure in status.failures)]
        for k, name in reversed(list(enumerate([self.dialect.success, *failures]))):
            below = self.dialect.literal(Fraction(2 * codes[k] + 1, 2))
            text = f"({value.within(SUM)} < {below}) ? {name} : {text if k == len(failures) else f'({text})'}"
        return [f"return {text};"]
