"""Guards: a function with a state, limits, a period or an estimate refuses unusable input and keeps its state.

A program is guarded if one of its outputs is a state (:attr:`rrrgen.program.program.Port.state`) or one of its inputs
a limit, a period or the estimate of an observer (:class:`rrrgen.program.program.Domain`). Its results are then computed
as before, but they count only if every input that the program reads, and every result, is a number in its domain:

    refused = nonfinite(sum of |checked values|), or a bound that is NaN, negative or contradictory
    state_next = refused ? state : state_next,   output = refused ? 0 : output,   status = refused ? 2 : status

Checking all inputs one by one would cost more than the smaller laws themselves. NaN and infinity pass through sums,
products and quotients' numerators, so a few values of the program show those of nearly all inputs; the rest is checked
directly. A sum of magnitudes is finite only if all its terms are, and no compiler may simplify it. It is the bits of
that one sum that are examined (:attr:`rrrgen.program.program.Op.NONFINITE`), since comparisons with NaN mean nothing
under ``-ffast-math``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from itertools import chain

from rrrgen.program.builder import Builder, Value
from rrrgen.program.differentiation import record
from rrrgen.program.program import REFUSED, Domain, Op, Port, Program, Status

BOUNDS = (Domain.LIMIT, Domain.LOWER, Domain.UPPER)
"""The domains in which infinity is a value."""

_STRICT = (Op.ADD, Op.SUB, Op.MUL, Op.NEG, Op.SIN, Op.COS, Op.SQRT, Op.ABS)
"""Operations whose result is not finite if one of the operands is not. Of a quotient this holds for the numerator."""


def is_guarded(program: Program) -> bool:
    """Whether the program has a state, limits, a period or an estimate, and therefore refuses unusable input."""
    return any(port.state for port in program.outputs) or any(
        port.domain in (*BOUNDS, Domain.PERIOD, Domain.ESTIMATE) for port in program.inputs
    )


def add_guard(program: Program) -> Program:
    """The program with the checks of the module's docstring and a status; unchanged if it needs no guard."""
    if not is_guarded(program):
        return program
    b = Builder()
    inputs: list[Sequence[Value]] = [b.input(port) for port in program.inputs]
    values = record(program, b, inputs)
    for index, label in program.labels.items():
        b.label(values[index], label)
    refused = _record_refusal(b, program, inputs, values)
    b.label(refused, "refused")
    before = {port.name: elements for port, elements in zip(program.inputs, inputs, strict=True)}
    outputs: list[tuple[Port, list[Value]]] = []
    for k, (port, elements) in enumerate(zip(program.outputs, program.results, strict=True)):
        computed = [values[index] for index in elements]
        fixed = [REFUSED.code if program.is_status(k) else port.refused] * port.size
        outputs.append((port, _choice(b, refused, before.get(port.state, fixed), computed)))
    program_status = program.status
    if program_status is None:
        outputs.append((Port("status", (), "1"), _choice(b, refused, [REFUSED.code], [0])))
    status = (
        Status(len(program.outputs), (REFUSED,))
        if program_status is None
        else replace(program_status, failures=(*program_status.failures, REFUSED))
    )
    notes = (*program.notes, _note(program))
    guarded_program = b.program(program.name, outputs, program.summary, program.formula, notes, status)
    return guarded_program.with_fields(specializes=program.specializes)


def _choice(b: Builder, condition: Value, positive: Iterable[Value], otherwise: Iterable[Value]) -> list[Value]:
    return [b.select(condition, x, y) for x, y in zip(positive, otherwise, strict=True)]


def _note(program: Program) -> str:
    """The sentence for emitted files about the outputs of a call that is refused."""
    taken = {port.name for port in program.inputs}
    data = program.data_outputs
    kept = [f"{port.name} = {port.state}" for port in data if port.state in taken]
    fixed = [f"{port.name} = {port.refused}" for port in data if port.state not in taken]
    return f"Where the input is refused, {', '.join(kept + fixed)}."


def _record_refusal(b: Builder, program: Program, inputs: Sequence[Sequence[Value]], values: Sequence[Value]) -> Value:
    """Record a value > 0 where an input that the program reads is out of its domain, or a result is not finite."""
    positive: list[Value] = []  # must be finite and > 0
    ranges: list[Value] = []  # must be >= 0, may be infinite
    lower: Sequence[Value] = ()
    for port, elements in zip(program.inputs, inputs, strict=True):
        if port.domain in (Domain.POSITIVE, Domain.PERIOD):
            positive += elements
        elif port.domain is Domain.LIMIT:
            ranges += elements
        elif port.domain is Domain.LOWER:
            lower = elements
        elif port.domain is Domain.UPPER:
            ranges += [b.sub(high, low) for low, high in zip(lower, elements, strict=True)]
    total = _checked_sum(b, program, inputs, values)  # of magnitudes, since compilers may let terms cancel
    if ranges:  # the quotient is 0 for infinite ranges, and NaN if a range is
        total = b.add(total, b.div(1, b.add(1, _tree(b.add, ranges))))
    refused = b.nonfinite(total)
    if ranges:
        refused = b.select(b.neg(_tree(b.min, ranges)), 1, refused)
    return b.select(_tree(b.min, positive), refused, 1) if positive else refused


def _tree(operation: Callable[[Value, Value], Value], values: Sequence[Value]) -> Value:
    """Combine ``values`` by a balanced tree of the ``operation``, which is faster than a chain."""
    if len(values) == 1:
        return values[0]
    half = len(values) // 2
    return operation(_tree(operation, values[:half]), _tree(operation, values[half:]))


def _checked_sum(b: Builder, program: Program, inputs: Sequence[Sequence[Value]], values: Sequence[Value]) -> Value:
    """Record a sum that is finite only if every result is, and every input that the program reads but for bounds."""
    strict = _strict_operands(program)
    covered, bounds = _coverage(program, strict)
    wanted = 0
    for index, node in enumerate(program.nodes):
        wanted |= covered[index] & ~bounds if node.op is Op.INPUT else 0
    candidates = [index for index in _always_finite(program, strict) if covered[index] and not covered[index] & bounds]
    checked = _behind_results(program, strict, set(candidates), covered, bounds)
    for index in checked:
        wanted &= ~covered[index]
    # greedy: always the value that shows most of the inputs which no value shows yet, of equal ones the last, which is
    # nearest to a result
    while wanted:
        best = max(candidates, key=lambda index: ((covered[index] & wanted).bit_count(), index), default=-1)
        if best < 0 or (covered[best] & wanted).bit_count() < 2:
            break
        checked.append(best)
        wanted &= ~covered[best]
    terms = [values[index] for index in sorted(checked)]
    terms += [value for bit, value in enumerate(chain.from_iterable(inputs)) if wanted >> bit & 1]
    unique = list(dict.fromkeys(terms))
    return _tree(b.add, [b.abs(term) for term in unique]) if unique else 0


def _behind_results(
    program: Program, strict: Sequence[tuple[int, ...]], candidates: set[int], covered: Sequence[int], bounds: int
) -> list[int]:
    """The values that must be finite so that all results are.

    A result that is selected from several values is finite if these are. Inputs are checked in any case, and a bound
    does no harm: an infinite one is never the one that is reached.
    """
    nodes: dict[int, None] = {}
    for k, elements in enumerate(program.results):
        for element in () if program.is_status(k) else elements:
            options = [
                index
                for index in _options(program, element)
                if program.nodes[index].op not in (Op.INPUT, Op.CONST) and not covered[index] & bounds
            ]
            chosen = options if candidates.issuperset(options) else [element]
            nodes |= dict.fromkeys(chosen)
    implied = _operands(strict, nodes)
    return [index for index in nodes if index not in implied]


def _options(program: Program, index: int) -> list[int]:
    """The nodes from which a node is selected; itself, if it is no selection."""
    node = program.nodes[index]
    if node.op is not Op.SELECT:
        return [index]
    return [option for arg in node.args[1:] for option in _options(program, arg)]


def _operands(strict: Sequence[tuple[int, ...]], roots: Iterable[int]) -> set[int]:
    """The nodes, other than ``roots``, that are finite if all the ``roots`` are."""
    operands: set[int] = set()
    waiting = list(roots)
    while waiting:
        args = strict[waiting.pop()]
        waiting += [arg for arg in args if arg not in operands]
        operands.update(args)
    return operands


def _strict_operands(program: Program) -> list[tuple[int, ...]]:
    """For every node its operands that make it non-finite if one of them is: the terms of a sum, a numerator, ...

    A factor that a selection may turn into the constant 0 swallows the other one under ``-ffast-math``.
    """
    strict: list[tuple[int, ...]] = []
    vanishing: list[bool] = []
    for node in program.nodes:
        op, args, _ = node
        zeros = [vanishing[arg] for arg in args]
        if op is Op.SELECT:
            vanishing.append(any(zero or program.nodes[arg].value == 0 for zero, arg in zip(zeros, args, strict=True)))
        else:
            vanishing.append(all(zeros) if op in (Op.ADD, Op.SUB) else any(zeros))
        if op is Op.MUL:
            strict.append(tuple(arg for arg, other in zip(args, zeros[::-1], strict=True) if not other))
        else:
            strict.append(args if op in _STRICT else args[:1] if op is Op.DIV else ())
    return strict


def _coverage(program: Program, strict: Sequence[tuple[int, ...]]) -> tuple[list[int], int]:
    """For every node the input elements (as bits) that make it non-finite if they are; and the bits of all bounds."""
    first, bounds, offset = [], 0, 0
    for port in program.inputs:
        first.append(offset)
        bounds |= ((1 << port.size) - 1) << offset if port.domain in BOUNDS else 0
        offset += port.size
    covered: list[int] = []
    for node, args in zip(program.nodes, strict, strict=True):
        bits = 0
        if node.op is Op.INPUT:
            port_, element = node.place
            bits = 1 << first[port_] + element
        elif node.op is Op.SELECT:
            bits = covered[node.args[1]] & covered[node.args[2]]
        for arg in args:
            bits |= covered[arg]
        covered.append(bits)
    return covered, bounds


def _always_finite(program: Program, strict: Sequence[tuple[int, ...]]) -> list[int]:
    """The nodes whose value decides about a result for every input, so that it must be finite.

    They are reached from the results and from the conditions of selections on the way. A value that only one branch of
    a selection uses, or the denominator of a quotient, may well be infinite.
    """
    through, finite = 1, 2  # a selection on the way to a result; a node to return
    reached = bytearray(len(program.nodes))
    for elements in program.results:
        for index in elements:
            reached[index] = finite
    for index in range(len(program.nodes) - 1, -1, -1):
        node, how = program.nodes[index], reached[index]
        if how == finite:
            for arg in strict[index]:
                reached[arg] = finite
        if how and node.op is Op.SELECT:
            reached[node.args[0]] = finite
            for arg in node.args[1:]:
                reached[arg] = max(reached[arg], through)
    return [index for index, how in enumerate(reached) if how == finite]
