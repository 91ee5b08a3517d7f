"""Loops over many states, for the extension that Python loads; they are not part of the emitted library."""

from __future__ import annotations

from collections.abc import Iterable

from rrrgen.backends.c.batches.packs import STATUS_LANES, pack_functions, pack_name
from rrrgen.backends.c.batches.transposition import SIZES, transfers
from rrrgen.backends.c.dialect import Dialect
from rrrgen.backends.c.signature import function_name
from rrrgen.program import Program


def loop_name(program: Program, dialect: Dialect) -> str:
    """The loop over ``program``."""
    return f"{dialect.prefix}_loop_{program.name}"


def loop_files(programs: Iterable[Program], dialect: Dialect) -> dict[str, str]:
    """``<name>_loops.h`` and ``.c``: one loop per program.

    Each input comes with a step, in elements from one state to the next: 0 repeats one value for all states. Outputs
    are dense. The status of a program, where it has one, is stored per state in the array ``status``.
    """
    programs = list(programs)
    header, source = [], [f'#include "{dialect.prefix}_loops.h"', ""]
    source += [pack_functions({program.name: program for program in programs}, dialect)]
    taken = {port.size for program in programs for port in program.inputs}.intersection(SIZES)
    given = {port.size for program in programs for port in program.data_outputs}.intersection(SIZES)
    source += [transfers(taken, given, dialect.prefix, dialect.real_type, dialect.real)]
    for program in programs:
        signature = _loop_signature(program, dialect)
        header.append(f"{signature};")
        source += [signature, "{", *(f"    {line}" for line in _loop_body(program, dialect)), "}", ""]
    guard = f"{dialect.macro}_LOOPS_H"
    top = [f"#ifndef {guard}", f"#define {guard}", "", f'#include "{dialect.prefix}.h"', ""]
    return {
        f"{dialect.prefix}_loops.h": "\n".join([*top, *header, "", "#endif", ""]),
        f"{dialect.prefix}_loops.c": "\n".join(source),
    }


def loop_declarations(programs: Iterable[Program], dialect: Dialect) -> str:
    """What cffi must know of the loops."""
    loops = [_loop_signature(program, dialect).replace(dialect.real_type, dialect.real) for program in programs]
    return "\n".join(f"{loop};" for loop in loops)


def declarations(programs: Iterable[Program], dialect: Dialect) -> str:
    """What cffi must know of the functions for one state, with plain pointers and without enums."""
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
        "if (count < PACK_LANES) {",
        *(f"    {line}" for line in _few_states(program, dialect)),
        "    return;",
        "}",
        "for (long long k = 0; k < count; k += PACK_LANES) {",
        "    if (k > count - PACK_LANES)",
        "        k = count - PACK_LANES; /* once more over some states, so that all are computed alike */",
        *(f"    {line}" for line in _pack_body(program, dialect)),
        "}",
    ]


def _few_states(program: Program, dialect: Dialect) -> list[str]:
    """A batch that fills no pack: its last state is repeated until it does."""
    real = dialect.real_type
    few: list[str] = []
    arguments = ["PACK_LANES"]
    for port in program.inputs:
        few += [
            f"{real} {port.name}_few[PACK_LANES*{port.size}];",
            f"{dialect.prefix}_pack_fill({port.name}, {port.name}_step, count, {port.size}, {port.name}_few);",
        ]
        arguments += [f"{port.name}_few", f"{port.size}"]
    outputs = [("int", "status", 1)] if program.status else []
    outputs += [(real, port.name, port.size) for port in program.data_outputs]
    few += [f"{kind} {name}_few[PACK_LANES*{size}];" for kind, name, size in outputs]
    arguments += [f"{name}_few" for _, name, _ in outputs]
    few.append(f"{loop_name(program, dialect)}({', '.join(arguments)});")
    few += [f"memcpy({name}, {name}_few, (size_t)count*{size}*sizeof *{name});" for _, name, size in outputs]
    return ["if (count <= 0)", "    return;", *few]


def _pack_body(program: Program, dialect: Dialect) -> list[str]:
    """Gather one state per lane, evaluate the pack, scatter the results."""
    pack = f"{dialect.prefix}_pack"
    lines: list[str] = []
    arguments: list[str] = []
    for port in program.inputs:
        first, step = f"{port.name} + k*{port.name}_step", f"{port.name}_step"
        lines.append(f"{pack} {port.name}_pack[{port.size}];")
        if port.size in SIZES:
            lines.append(f"{pack}_in{port.size}({first}, {step}, {port.name}_pack);")
        else:
            lines += _each(port.size, f"{port.name}_pack[{{0}}] = ({pack})PACK_GATHER({first} + {{0}}, {step});")
        arguments.append(f"{port.name}_pack" if port.shape else f"{port.name}_pack[0]")
    stores: list[str] = []
    for k, port in enumerate(program.outputs):
        if program.is_status(k):
            lines.append(f"{pack} {STATUS_LANES}_pack[1];")
            arguments.append(f"{STATUS_LANES}_pack")
            stores += [
                "for (int lane = 0; lane < PACK_LANES; lane++)",  # a NaN must not read as ok
                f"    status[k + lane] = ({STATUS_LANES}_pack[0][lane] < ({dialect.real_type})0.5) ? 0 : 1;",
            ]
            continue
        lines.append(f"{pack} {port.name}_pack[{port.size}];")
        arguments.append(f"{port.name}_pack")
        place = f"{port.name} + k*{port.size}"
        if port.size in SIZES:
            stores.append(f"{pack}_out{port.size}({port.name}_pack, {place});")
            continue
        stores += _each(port.size, f"PACK_SCATTER({place} + {{0}}, {port.size}, {port.name}_pack[{{0}}]);")
    return [*lines, f"{pack_name(program, dialect)}({', '.join(arguments)});", *stores]


def _each(size: int, statement: str) -> list[str]:
    """The statement for every element, in a loop: written out, many elements take the C compiler twice as long."""
    if size == 1:
        return [statement.format(0)]
    return [f"for (int element = 0; element < {size}; element++)", f"    {statement.format('element')}"]
