"""Prototypes of emitted functions and the comments that explain them."""

from __future__ import annotations

from collections.abc import Sequence

from rrrgen.emit.c.division import divide
from rrrgen.emit.c.language import Dialect
from rrrgen.emit.c.stack import stack_bound
from rrrgen.emit.printing import columns, plain, wrap
from rrrgen.program import Port, Program, Status, count_operations

_LONGEST_LINE = 118


def function_name(program: Program, dialect: Dialect) -> str:
    """The C symbol of a function: prefix of the robot and name of the program."""
    return f"{dialect.prefix}_{program.name}"


def prototype(program: Program, dialect: Dialect) -> str:
    """The declaration without semicolon: inputs, then outputs; broken over lines where it is long."""
    returns = f"{dialect.prefix}_status" if program.status else "void"
    head = f"{returns} {function_name(program, dialect)}("
    parameters = [input_parameter(port, dialect) for port in program.inputs]
    parameters += [output_parameter(port, dialect) for port in program.data_outputs]
    return declaration(head, parameters)


def declaration(head: str, parameters: Sequence[str]) -> str:
    """The declaration that begins with ``head``, up to the parenthesis, broken over lines where it is long."""
    line = head + ", ".join(parameters or ["void"]) + ")"
    if len(line) <= _LONGEST_LINE:
        return line
    return head + (",\n" + " " * len(head)).join(parameters) + ")"


def input_parameter(port: Port, dialect: Dialect) -> str:
    """The declaration of an input in the list of parameters."""
    return (
        f"{dialect.real_type} {port.name}"
        if port.shape == ()
        else f"const {dialect.real_type} {port.name}[{port.size}]"
    )


def output_parameter(port: Port, dialect: Dialect) -> str:
    """The declaration of an output in the list of parameters."""
    restrict = f"{dialect.macro}_RESTRICT"
    if port.shape == ():
        return f"{dialect.real_type} *{restrict} {port.name}"
    return f"{dialect.real_type} {port.name}[{restrict} {port.size}]"


def explanation(program: Program, dialect: Dialect, on_device: bool = False, rounding: str = "") -> list[str]:
    """The lines of the comment in front of a prototype; ``on_device`` for a GPU, which has no bound of the stack.

    ``rounding`` is the sentence about the rounding error, if one is stated.
    """
    lines = wrap(program.summary or program.name.replace("_", " "))
    if program.formula:
        lines += ["", *(f"    {plain(line)}" for line in program.formula.splitlines())]
    rows = [("in", port) for port in program.inputs] + [("out", port) for port in program.data_outputs]
    lines += ["", *columns([_row(direction, port) for direction, port in rows])]
    if program.status:
        lines += ["", *wrap(_status_note(program.status, dialect, on_device))]
    lines += ["", f"Operations: {count_operations(program)}."]
    if not on_device:
        lines += [f"Stack: {stack_bound(program, dialect.real)}."]
        if (division := divide(program)) is not None:
            lines += wrap(
                f"It consists of {division.parts} static functions, since compilers take too long for one, with an "
                f"array of {division.size} values that several of them need; the bound of the stack includes it."
            )
    lines += wrap(rounding)
    for note in program.notes:
        lines += wrap(note)
    return lines


def _status_note(status: Status, dialect: Dialect, on_device: bool) -> str:
    failures = " or ".join(f"{dialect.failure(failure)} where {failure.meaning}" for failure in status.failures)
    text = "" if on_device else f" ({dialect.prefix}_status_string gives the text)"
    return f"Returns {dialect.success}, or {failures}{text}; the outputs are defined in either case."


def _row(direction: str, port: Port) -> tuple[str, ...]:
    shape = " x ".join(map(str, port.shape)) or "1"
    return direction, port.name, shape, port.unit or "-", port.frame or "-", port.meaning
