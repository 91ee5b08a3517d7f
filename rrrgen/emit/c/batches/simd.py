"""Programs printed as vectorized C (SIMD) for batches: one state per lane of a vector register.

A register has 2, 4 or 8 lanes in double, twice as many in float, depending on the processor. The operations are those
of the scalar code, so results agree to round-off (the compiler may fuse multiplications with additions).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

from rrrgen.base.templates import render
from rrrgen.emit.c.dialect import Dialect
from rrrgen.emit.c.printer import print_body
from rrrgen.emit.c.trigonometry import kernel_values
from rrrgen.emit.printing import decimal
from rrrgen.program import Program

STATUS_LANES = "status_lanes"


@dataclass(frozen=True)
class SimdDialect(Dialect):
    """C over vector registers: every local variable is a register, every constant is broadcast to all lanes."""

    @property
    def real_type(self) -> str:
        """Name of the C type of a vector register."""
        return f"{self.prefix}_simd"

    def literal(self, value: Fraction | int) -> str:
        """The C expression of a constant broadcast to all lanes."""
        return f"{self.prefix}_simd_all(({self.prefix}_real){decimal(value)})"

    def function(self, name: str) -> str:
        """Name of the C function that applies ``name`` lane by lane."""
        return f"{self.prefix}_simd_{name}"

    @property
    def nonfinite(self) -> str:
        """Name of the C function that tells finite numbers (0) from infinite ones (1) and from NaN (2), by lanes."""
        return f"{self.prefix}_simd_nonfinite"

    def select(self, condition: str, yes: str, no: str) -> str:
        """The C expression that takes, lane by lane, ``yes`` where ``condition`` is positive, else ``no``."""
        return f"{self.prefix}_simd_select({condition}, {yes}, {no})"

    def branch(self, condition: str, yes: Sequence[str], no: Sequence[str]) -> list[str]:
        """The same assignments with a selection lane by lane; both lists assign to the same places in one order."""
        lines = []
        for first, second in zip(yes, no, strict=True):
            place, chosen = first.rstrip(";").split(" = ", 1)
            otherwise = second.rstrip(";").split(" = ", 1)[1]
            lines.append(f"{place} = {self.select(condition, chosen, otherwise)};")
        return lines

    def minimum(self, x: str, y: str) -> str:
        """The C expression of the smaller of x and y in each lane."""
        return f"{self.prefix}_simd_blend(({self.prefix}_mask)({x} < {y}), {x}, {y})"

    def sign(self, x: str) -> str:
        """The C expression of the sign of each lane: -1, 0 or 1."""
        return f"{self.prefix}_simd_sign({x})"


class SimdSinCos:
    """The inline sine and cosine kernel, vectorized."""

    def preamble(self, dialect: Dialect) -> str:
        """The C text of the register type and its functions, the kernel included."""
        width = 8 if dialect.real == "double" else 4
        registers = {size: range(size // width) for size in (16, 32, 64)}  # bytes -> lanes
        values = kernel_values(Dialect(dialect.prefix, dialect.real))
        return render("c/simd.h.j2", registers=registers, **values).rstrip("\n")

    def description(self, dialect: Dialect) -> str:
        """A short name of the kernel."""
        return "vectorized inline kernel"

    def statements(self, dialect: Dialect, angle: str, sine: str | None, cosine: str | None) -> list[str]:
        """One call of the kernel for both sine and cosine; one that is not wanted is discarded."""
        first, second = sine or f"{cosine}_other", cosine or f"{sine}_other"
        return [
            f"{dialect.real_type} {first}, {second};",
            f"{dialect.prefix}_simd_sincos({angle}, &{first}, &{second});",
            *([] if sine and cosine else [f"(void){first if sine is None else second};"]),
        ]


def simd_name(program: Program, dialect: Dialect) -> str:
    """The name of the vectorized C function of ``program``."""
    return f"{dialect.prefix}_simd_{program.name}"


def simd_functions(programs: Mapping[str, Program], dialect: Dialect) -> str:
    """The C text of the preamble and one static vectorized function per program."""
    vector_dialect = SimdDialect(dialect.prefix, dialect.real)
    sincos = SimdSinCos()
    lines = [sincos.preamble(dialect), ""]
    for program in programs.values():
        lines += [f"{simd_signature(program, dialect)}", "{"]
        lines += [f"    {line}" for line in print_body(_without_status(program), vector_dialect, sincos)]
        lines += ["}", ""]
    return "\n".join(lines)


def simd_signature(program: Program, dialect: Dialect) -> str:
    """The C declaration ``static void <name>_simd_<function>(const <name>_simd *q, ..., <name>_simd *tau)``."""
    simd = f"{dialect.prefix}_simd"
    ports = [f"const {simd} *{port.name}" if port.shape else f"{simd} {port.name}" for port in program.inputs]
    ports += [f"{simd} *{port.name}" for port in _without_status(program).outputs]
    return f"static void {simd_name(program, dialect)}({', '.join(ports)})"


def _without_status(program: Program) -> Program:
    """Turn the status of ``program`` into an ordinary output, so that every lane has its own."""
    outputs = tuple(
        replace(port, name=STATUS_LANES) if program.is_status(k) else port for k, port in enumerate(program.outputs)
    )
    return program.described(outputs=outputs, status=None)
