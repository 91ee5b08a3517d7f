"""C loops that evaluate functions for many states, for the extension module that Python loads.

They are not part of the emitted library.
"""

from __future__ import annotations

from collections.abc import Iterable

from rrrgen.emit.c.batches.simd import STATUS_LANES, simd_functions, simd_name
from rrrgen.emit.c.batches.transposition import SIZES, transfers
from rrrgen.emit.c.dialect import Dialect
from rrrgen.emit.c.header_comments import function_name
from rrrgen.program import Program


def loop_name(program: Program, dialect: Dialect) -> str:
    """The name of the C function that evaluates ``program`` for many states."""
    return f"{dialect.prefix}_loop_{program.name}"


STATE = "first_state"
"""The variable of a loop over states; like the others of a loop, a name that no input or output has."""


def loop_files(programs: Iterable[Program], dialect: Dialect, simd: bool = True) -> dict[str, str]:
    """Print the files ``<name>_loops.h`` and ``.c``, with one loop over states per program.

    Without ``simd``, for compilers without vector types, a loop calls the function of one state.

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
    top = [f"#ifndef {guard}", f"#define {guard}", "", f'#include "{dialect.prefix}.h"', ""]
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
        + [f"returned == {dialect.failure(each)} ? {each.code}" for each in program.status.failures[:-1]]
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
    """The code that gathers one state per lane, evaluates all lanes, and scatters the results."""
    simd = f"{dialect.prefix}_simd"
    lines: list[str] = []
    arguments: list[str] = []
    for port in program.inputs:
        first, step = f"{port.name} + {STATE}*{port.name}_step", f"{port.name}_step"
        lines.append(f"{simd} {port.name}_simd[{port.size}];")
        if port.size in SIZES:
            lines.append(f"{simd}_in{port.size}({first}, {step}, {port.name}_simd);")
        else:
            lines += _each(port.size, f"{port.name}_simd[{{0}}] = ({simd})SIMD_GATHER({first} + {{0}}, {step});")
        arguments.append(f"{port.name}_simd" if port.shape else f"{port.name}_simd[0]")
    stores: list[str] = []
    for k, port in enumerate(program.outputs):
        if program.is_status(k):
            lines.append(f"{simd} {STATUS_LANES}_simd[1];")
            arguments.append(f"{STATUS_LANES}_simd")
            stores += [
                "for (int lane = 0; lane < SIMD_LANES; lane++)",
                f"    status[{STATE} + lane] = {_code(program, dialect, f'{STATUS_LANES}_simd[0][lane]')};",
            ]
            continue
        lines.append(f"{simd} {port.name}_simd[{port.size}];")
        arguments.append(f"{port.name}_simd")
        place = f"{port.name} + {STATE}*{port.size}"
        if port.size in SIZES:
            stores.append(f"{simd}_out{port.size}({port.name}_simd, {place});")
            continue
        stores += _each(port.size, f"SIMD_SCATTER({place} + {{0}}, {port.size}, {port.name}_simd[{{0}}]);")
    return [*lines, f"{simd_name(program, dialect)}({', '.join(arguments)});", *stores]


def _each(size: int, statement: str) -> list[str]:
    """Print a C loop of ``statement`` over ``size`` elements; unrolled text would take twice as long to compile."""
    if size == 1:
        return [statement.format(0)]
    return [f"for (int element = 0; element < {size}; element++)", f"    {statement.format('element')}"]
