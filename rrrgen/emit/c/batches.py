"""C that evaluates a function for many states: loops, vector instructions, and transposition."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

from rrrgen.base.templates import render
from rrrgen.emit import Real
from rrrgen.emit.c.header_comments import function_name
from rrrgen.emit.c.language import Dialect, kernel_values, print_body
from rrrgen.emit.printing import decimal
from rrrgen.program import Program

# ------------------------------------------------------------------------------------------------------------------
# Programs printed as vectorized C (SIMD) for batches: one state per lane of a vector register.
#
# A register has 2, 4 or 8 lanes in double, twice as many in float, depending on the processor. The operations are
# those of the scalar code, so results agree to round-off (the compiler may fuse multiplications with additions).
# ------------------------------------------------------------------------------------------------------------------

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
    return program.with_fields(outputs=outputs, status=None)


# ------------------------------------------------------------------------------------------------------------------
# Transposition between arrays of states and vector registers that hold one element of several states.
#
# The states that fill the lanes occupy, in a dense array, as many whole registers as a state has elements. Loading
# whole registers and shuffling their lanes takes a fifth of the instructions of loading single numbers.
# ------------------------------------------------------------------------------------------------------------------

SIZES = range(2, 9)
"""Sizes of states that are transposed in registers; larger ones would take more shuffles than loads."""

WIDTHS = (16, 32, 64)
"""Sizes of vector registers in bytes."""


def transfers(taken: Iterable[int], given: Iterable[int], prefix: str, real_type: str, real: Real) -> str:
    """Print the C functions that transpose the elements of states, one for each size of an input or output.

    ``<prefix>_simd_in<size>`` loads the states of an input of a size in ``taken``, ``<prefix>_simd_out<size>`` stores
    those of an output of a size in ``given``.
    """
    bytes_per_number = 8 if real == "double" else 4
    functions = [_gather(size, prefix, real_type, bytes_per_number) for size in sorted(taken)]
    functions += [_scatter(size, prefix, real_type, bytes_per_number) for size in sorted(given)]
    return "\n".join(functions)


def exchanges(wanted: list[tuple[int, int]], names: list[str]) -> str:
    """The C expression of the register whose lane k is lane ``wanted[k][1]`` of the register ``wanted[k][0]``.

    ``names`` are the C variables of the registers.
    """
    lanes = len(wanted)
    sources = sorted({source for source, _ in wanted})
    value, held = names[sources[0]], {sources[0]}
    if len(sources) == 1:
        return f"SIMD_EXCHANGE({value}, {value}, {', '.join(str(place) for _, place in wanted)})"
    for step, source in enumerate(sources[1:]):
        picked = [
            lanes + place if at == source else (place if step == 0 else k) if at in held else k
            for k, (at, place) in enumerate(wanted)
        ]
        value = f"SIMD_EXCHANGE({value}, {names[source]}, {', '.join(map(str, picked))})"
        held.add(source)
    return value


def _gather(size: int, prefix: str, real: str, number: int) -> str:
    registers = [f"r{k}" for k in range(size)]

    def dense(lanes: int) -> list[str]:
        flat = [[divmod(lane * size + element, lanes) for lane in range(lanes)] for element in range(size)]
        return [f"to[{element}] = {exchanges(flat[element], registers)};" for element in range(size)]

    return "\n".join(
        [
            f"static inline void {prefix}_simd_in{size}(const {real} *x, long long step, {prefix}_simd *to)",
            "{",
            f"    if (step != {size}) {{",
            f"        for (int element = 0; element < {size}; element++)",
            f"            to[element] = ({prefix}_simd)SIMD_GATHER(x + element, step);",
            "        return;",
            "    }",
            f"    {prefix}_simd {', '.join(registers)};",
            *(f"    memcpy(&{name}, x + {k}*SIMD_LANES, sizeof {name});" for k, name in enumerate(registers)),
            *_by_width(dense, number),
            "}",
            "",
        ]
    )


def _scatter(size: int, prefix: str, real: str, number: int) -> str:
    registers = [f"from[{element}]" for element in range(size)]

    def dense(lanes: int) -> list[str]:
        lines = []
        for k in range(size):
            wanted = [divmod(k * lanes + lane, size) for lane in range(lanes)]
            lines.append(f"r = {exchanges([(element, state) for state, element in wanted], registers)};")
            lines.append(f"memcpy(x + {k * lanes}, &r, sizeof r);")
        return lines

    return "\n".join(
        [
            f"static inline void {prefix}_simd_out{size}(const {prefix}_simd *from, {real} *x)",
            "{",
            f"    {prefix}_simd r;",
            *_by_width(dense, number),
            "}",
            "",
        ]
    )


def _by_width(body: Callable[[int], list[str]], number: int) -> list[str]:
    """The lines of ``body(lanes)`` for every width of register, selected by the preprocessor.

    ``number`` is the size of one number in bytes, 8 or 4, on which the count of lanes depends.
    """
    lines: list[str] = []
    for k, width in enumerate(WIDTHS):
        lines.append(f"#{'elif' if k else 'if'} SIMD_BYTES == {width}")
        lines += [f"    {line}" for line in body(width // number)]
    return [*lines, "#endif"]


# ------------------------------------------------------------------------------------------------------------------
# C loops that evaluate functions for many states, for the extension module that Python loads.
#
# They are not part of the emitted library.
# ------------------------------------------------------------------------------------------------------------------


def loop_name(program: Program, dialect: Dialect) -> str:
    """The name of the C function that evaluates ``program`` for many states."""
    return f"{dialect.prefix}_loop_{program.name}"


STATE = "first_state"
"""The variable of a loop over states; like the others of a loop, a name that no input or output has."""


def loop_files(programs: Iterable[Program], dialect: Dialect, simd: bool = True) -> dict[str, str]:
    """Print the files ``<name>_loops.h`` and ``.c``, with one loop over states per program.

    Without ``simd``, for compilers without vector types, a loop calls the function of one state, which the header of
    the robot declares; vectorized loops need no other file.

    Each input comes with a step, in elements from one state to the next: 0 repeats one value for all states. Outputs
    are dense. The status of a program, where it has one, is stored per state in the array ``status``.
    """
    programs = list(programs)
    header, source = [], [f'#include "{dialect.prefix}_loops.h"', ""]
    if simd:
        source += [simd_functions({program.name: program for program in programs}, dialect)]
        taken = {port.size for program in programs for port in program.inputs}.intersection(SIZES)
        given = {port.size for program in programs for port in program.data_outputs}.intersection(SIZES)
        source += [transfers(taken, given, dialect.prefix, dialect.real_type, dialect.real)]
    for program in programs:
        signature = _loop_signature(program, dialect)
        header.append(f"{signature};")
        body = _loop_body(program, dialect) if simd else _scalar_body(program, dialect)
        source += [signature, "{", *(f"    {line}" for line in body), "}", ""]
    guard = f"{dialect.macro}_LOOPS_H"
    opening = f"typedef {dialect.real} {dialect.real_type};" if simd else f'#include "{dialect.prefix}.h"'
    top = [f"#ifndef {guard}", f"#define {guard}", "", opening, ""]
    return {
        f"{dialect.prefix}_loops.h": "\n".join([*top, *header, "", "#endif", ""]),
        f"{dialect.prefix}_loops.c": "\n".join(source),
    }


def loop_declarations(programs: Iterable[Program], dialect: Dialect) -> str:
    """The C declarations of the loops, in the form that cffi reads."""
    loops = [_loop_signature(program, dialect).replace(dialect.real_type, dialect.real) for program in programs]
    return "\n".join(f"{loop};" for loop in loops)


def declarations(programs: Iterable[Program], dialect: Dialect) -> str:
    """The C declarations of the functions for a single state, in the form that cffi reads: plain pointers, no enums."""
    lines = []
    for program in programs:
        inputs = [f"const {dialect.real} *" if port.shape else dialect.real for port in program.inputs]
        outputs = [f"{dialect.real} *" for _ in program.data_outputs]
        returns = "int" if program.status else "void"
        lines.append(f"{returns} {function_name(program, dialect)}({', '.join([*inputs, *outputs]) or 'void'});")
    return "\n".join(lines)


def _loop_signature(program: Program, dialect: Dialect) -> str:
    real = dialect.real_type
    parameters = ["long long count"]
    parameters += [f"const {real} *{port.name}, long long {port.name}_step" for port in program.inputs]
    parameters += ["int *status"] if program.status else []
    parameters += [f"{real} *{port.name}" for port in program.data_outputs]
    return f"void {loop_name(program, dialect)}({', '.join(parameters)})"


def _loop_body(program: Program, dialect: Dialect) -> list[str]:
    return [
        "if (count < SIMD_LANES) {",
        *(f"    {line}" for line in _few_states(program, dialect)),
        "    return;",
        "}",
        f"for (long long {STATE} = 0; {STATE} < count; {STATE} += SIMD_LANES) {{",
        f"    if ({STATE} > count - SIMD_LANES)",
        f"        {STATE} = count - SIMD_LANES; /* once more over some states, so that all are computed alike */",
        *(f"    {line}" for line in _simd_body(program, dialect)),
        "}",
    ]


def _scalar_body(program: Program, dialect: Dialect) -> list[str]:
    """Print the body of a loop that calls, for each state, the function for a single state."""
    inputs = (f"{port.name} + {STATE}*{port.name}_step" for port in program.inputs)
    arguments = [place if port.shape else f"*({place})" for place, port in zip(inputs, program.inputs, strict=True)]
    outputs = [f"{port.name} + {STATE}*{port.size}" for port in program.data_outputs]
    call = f"{function_name(program, dialect)}({', '.join([*arguments, *outputs])});"
    loop = f"for (long long {STATE} = 0; {STATE} < count; {STATE}++)"
    if program.status is None:
        return [loop, f"    {call}"]
    codes = " : ".join(
        [f"returned == {dialect.success} ? 0"]
        + [f"returned == {dialect.failure(failure)} ? {failure.code}" for failure in program.status.failures[:-1]]
        + [str(program.status.failures[-1].code)]
    )
    return [
        f"{loop} {{",
        f"    const {dialect.prefix}_status returned = {call}",
        f"    status[{STATE}] = {codes};",
        "}",
    ]


def _code(program: Program, dialect: Dialect, value: str) -> str:
    """The C expression of the code of the status ``value``, a real number; NaN reads as the last failure."""
    assert program.status is not None
    codes = [0, *(failure.code for failure in program.status.failures)]
    tests = [f"{value} < ({dialect.real_type}){code}.5 ? {code}" for code in codes[:-1]]
    return " : ".join([*tests, str(codes[-1])])


def _few_states(program: Program, dialect: Dialect) -> list[str]:
    """The code for fewer states than a register has lanes: the last state is repeated to fill it."""
    real = dialect.real_type
    few: list[str] = []
    arguments = ["SIMD_LANES"]
    for port in program.inputs:
        few += [
            f"{real} {port.name}_few[SIMD_LANES*{port.size}];",
            f"{dialect.prefix}_simd_fill({port.name}, {port.name}_step, count, {port.size}, {port.name}_few);",
        ]
        arguments += [f"{port.name}_few", f"{port.size}"]
    outputs = [("int", "status", 1)] if program.status else []
    outputs += [(real, port.name, port.size) for port in program.data_outputs]
    few += [f"{kind} {name}_few[SIMD_LANES*{size}];" for kind, name, size in outputs]
    arguments += [f"{name}_few" for _, name, _ in outputs]
    few.append(f"{loop_name(program, dialect)}({', '.join(arguments)});")
    few += [f"memcpy({name}, {name}_few, (size_t)count*{size}*sizeof *{name});" for _, name, size in outputs]
    return ["if (count <= 0)", "    return;", *few]


def _simd_body(program: Program, dialect: Dialect) -> list[str]:
    """The code that gathers one state per lane, evaluates all lanes, and scatters the results.

    No variable ends in ``_simd``: the type of a robot called T is ``T_simd``.
    """
    simd = f"{dialect.prefix}_simd"
    lines: list[str] = []
    arguments: list[str] = []
    for port in program.inputs:
        first, step = f"{port.name} + {STATE}*{port.name}_step", f"{port.name}_step"
        lines.append(f"{simd} {port.name}_lanes[{port.size}];")
        if port.size in SIZES:
            lines.append(f"{simd}_in{port.size}({first}, {step}, {port.name}_lanes);")
        else:
            lines += _each(port.size, f"{port.name}_lanes[{{0}}] = ({simd})SIMD_GATHER({first} + {{0}}, {step});")
        arguments.append(f"{port.name}_lanes" if port.shape else f"{port.name}_lanes[0]")
    stores: list[str] = []
    for k, port in enumerate(program.outputs):
        if program.is_status(k):
            lines.append(f"{simd} {STATUS_LANES}[1];")
            arguments.append(STATUS_LANES)
            stores += [
                "for (int lane = 0; lane < SIMD_LANES; lane++)",
                f"    status[{STATE} + lane] = {_code(program, dialect, f'{STATUS_LANES}[0][lane]')};",
            ]
            continue
        lines.append(f"{simd} {port.name}_lanes[{port.size}];")
        arguments.append(f"{port.name}_lanes")
        place = f"{port.name} + {STATE}*{port.size}"
        if port.size in SIZES:
            stores.append(f"{simd}_out{port.size}({port.name}_lanes, {place});")
            continue
        stores += _each(port.size, f"SIMD_SCATTER({place} + {{0}}, {port.size}, {port.name}_lanes[{{0}}]);")
    return [*lines, f"{simd_name(program, dialect)}({', '.join(arguments)});", *stores]


def _each(size: int, statement: str) -> list[str]:
    """Print a C loop of ``statement`` over ``size`` elements; unrolled text would take twice as long to compile."""
    if size == 1:
        return [statement.format(0)]
    return [f"for (int element = 0; element < {size}; element++)", f"    {statement.format('element')}"]
