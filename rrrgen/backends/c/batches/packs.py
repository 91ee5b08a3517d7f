"""The same programs printed over packs: one state per lane of a vector register, for batches.

A pack holds as many states as the processor's registers do (2, 4, 8 in double, twice as many in float). The arithmetic
is the scalar code's, operation by operation, so results agree to round-off (a compiler may fuse products into sums).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction

from rrrgen.backends.c.dialect import Dialect
from rrrgen.backends.c.printer import print_body
from rrrgen.backends.c.trigonometry import kernel_values
from rrrgen.backends.printing import decimal
from rrrgen.program import Program
from rrrgen.resources import render

STATUS_LANES = "status_lanes"


@dataclass(frozen=True)
class PackDialect(Dialect):
    """C over packs: every local is a pack, every constant is spread over its lanes."""

    @property
    def real_type(self) -> str:
        """Name of the pack type."""
        return f"{self.prefix}_pack"

    def literal(self, value: Fraction | int) -> str:
        """A constant in all lanes."""
        return f"{self.prefix}_pack_all(({self.prefix}_real){decimal(value)})"

    def function(self, name: str) -> str:
        """A function applied lane by lane."""
        return f"{self.prefix}_pack_{name}"

    def select(self, condition: str, yes: str, no: str) -> str:
        """Lane by lane: ``yes`` where ``condition`` is positive."""
        return f"{self.prefix}_pack_select({condition}, {yes}, {no})"

    def sign(self, x: str) -> str:
        """Lane by lane: -1, 0 or 1."""
        return f"{self.prefix}_pack_sign({x})"


class PackSinCos:
    """The inline kernel over packs."""

    def preamble(self, dialect: Dialect) -> str:
        """The pack type and its functions, the kernel among them."""
        width = 8 if dialect.real == "double" else 4
        registers = {size: range(size // width) for size in (16, 32, 64)}  # bytes -> lanes
        values = kernel_values(Dialect(dialect.prefix, dialect.real))
        return render("c/pack.h.j2", registers=registers, **values).rstrip("\n")

    def description(self, dialect: Dialect) -> str:
        """As the scalar kernel's."""
        return "inline kernel over packs"

    def statements(self, dialect: Dialect, angle: str, sine: str | None, cosine: str | None) -> list[str]:
        """One call for both."""
        first, second = sine or f"{cosine}_other", cosine or f"{sine}_other"
        return [
            f"{dialect.real_type} {first}, {second};",
            f"{dialect.prefix}_pack_sincos({angle}, &{first}, &{second});",
            *([] if sine and cosine else [f"(void){first if sine is None else second};"]),
        ]


def pack_name(program: Program, dialect: Dialect) -> str:
    """The function over packs."""
    return f"{dialect.prefix}_pack_{program.name}"


def pack_functions(programs: Mapping[str, Program], dialect: Dialect) -> str:
    """The preamble and one static function over packs per program."""
    packs = PackDialect(dialect.prefix, dialect.real)
    sincos = PackSinCos()
    lines = [sincos.preamble(dialect), ""]
    for program in programs.values():
        lines += [f"{pack_signature(program, dialect)}", "{"]
        lines += [f"    {line}" for line in print_body(_without_status(program), packs, sincos)]
        lines += ["}", ""]
    return "\n".join(lines)


def pack_signature(program: Program, dialect: Dialect) -> str:
    """``static void <name>_pack_<function>(const pack *q, ..., pack *tau)``."""
    pack = f"{dialect.prefix}_pack"
    ports = [f"const {pack} *{port.name}" if port.shape else f"{pack} {port.name}" for port in program.inputs]
    ports += [f"{pack} *{port.name}" for port in _without_status(program).outputs]
    return f"static void {pack_name(program, dialect)}({', '.join(ports)})"


def _without_status(program: Program) -> Program:
    """The status as an ordinary output: one number per lane."""
    outputs = tuple(
        replace(port, name=STATUS_LANES) if program.is_status(k) else port for k, port in enumerate(program.outputs)
    )
    return program.described(outputs=outputs, status=None)
