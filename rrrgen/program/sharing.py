"""Sharing of operations between programs: what several of them compute from the same inputs is computed once.

A law and an observer that are called with the same q each take its sines and cosines. Sharing makes a program of these
operations alone, and gives the results to the others as one more input:

    tau = law(q, ..), r = observer(q, ..)   ->   sines = shared(q), tau = law(q, .., sines), r = observer(q, .., sines)
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

from rrrgen.program.builder import Builder, Value, replay
from rrrgen.program.program import Op, Port, Program


def share_values(
    programs: Mapping[str, Program], name: str, of: Collection[str], operations: Collection[Op], summary: str
) -> dict[str, Program]:
    """Take the ``operations`` whose arguments depend on the inputs named in ``of`` alone out of ``programs``.

    Returns the program ``name`` of these inputs, whose one output of that name holds all those values, and every
    program that used some: with an input ``name`` for them at its end, it computes what it did. The order of the inputs
    is that of ``of``, which mean the same in all programs. Nothing is returned if fewer than two programs use any.
    """
    builder = Builder()
    ports = {port.name: port for program in programs.values() for port in program.inputs}
    inputs = {input_name: builder.input(ports[input_name]) for input_name in of if input_name in ports}
    users: dict[str, dict[int, int]] = {}
    elements: dict[Value, int] = {}  # value -> its place in the output
    for program_name, program in programs.items():
        values: dict[int, Value] = {}
        for index, (op, args, _) in enumerate(program.nodes):
            if op is Op.CONST:
                values[index] = program.nodes[index].number
            elif op is Op.INPUT:
                k, element = program.nodes[index].place
                known = inputs.get(program.inputs[k].name)
                if known is not None:
                    values[index] = known[element]
            elif all(arg in values for arg in args):
                values[index] = getattr(builder, op.value)(*(values[arg] for arg in args))
                if op in operations:
                    users.setdefault(program_name, {})[index] = elements.setdefault(values[index], len(elements))
    if len(users) < 2:
        return {}
    port = Port(name, (len(elements),), "", "", f"values of the function {name}")
    made = builder.program(name, [(port, list(elements))], summary)
    return {name: made} | {
        program_name: _taking(programs[program_name], port, places) for program_name, places in users.items()
    }


def _taking(program: Program, port: Port, places: Mapping[int, int]) -> Program:
    """The ``program`` with the input ``port``, whose element ``places[k]`` is the value of node k."""
    builder = Builder()
    inputs = [builder.input(input_port) for input_port in program.inputs]
    given = builder.input(port)
    return builder.rewritten(program, replay(program, builder, inputs, {k: given[e] for k, e in places.items()}))
