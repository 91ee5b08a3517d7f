"""Automatic differentiation of programs: the derivatives are programs again.

Forward mode (:func:`tangents`) carries the derivatives of every node along a set of directions, reverse mode
(:func:`pull_back`) the derivatives of a weighted sum of the outputs with respect to every node. Zeros known while
recording never become operations, so both modes exploit sparsity: a direction costs only where a node depends on it.
sgn x has derivative 0 and |x| has derivative sgn x; both hold everywhere except at x = 0.

Rotations have a shorter rule. If ``u = c x - s y`` and ``v = s x + c y`` with the cosine and sine of one angle, then

    du = c dx - s dy - v d(angle),    dv = s dx + c dy + u d(angle),

where the products of which u and v consist are known already. Along one direction in which all joints move, the chain
rule over single products, with ``dc = -s d(angle)`` and ``ds = c d(angle)``, takes two operations more for each.
Along the single joints it takes none more, and in reverse mode the passes find the shorter form themselves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from rrrgen.base.errors import InternalError
from rrrgen.program.builder import Builder, Scalar, Value, replay
from rrrgen.program.program import Op, Port, Program, uses

Tangent = dict[int, Value]
"""Directional derivatives of one value, keyed by the number of the direction; absent ones are zero."""


def jacobian(program: Program, output: str, inputs: Sequence[str], reverse: bool = False) -> Program:
    """A program with the output port ``output`` of ``program`` and its Jacobians with respect to the ports ``inputs``.

    After ``output`` come the matrices ``d<output>_d<input>``, shape (output.size, input.size). Common subexpressions of
    value and derivatives are evaluated once. ``reverse`` chooses reverse mode (one sweep per element of the output)
    instead of forward mode (one direction per element of the inputs). Raises ValueError for an unknown port name.
    """
    position = [port.name for port in program.outputs].index(output)
    port = program.outputs[position]
    only = program.with_fields(outputs=(port,), results=(program.results[position],), status=None)
    names = [input_port.name for input_port in program.inputs]
    wanted = [names.index(name) for name in inputs]
    builder = Builder()
    values = [builder.input(input_port) for input_port in program.inputs]
    recorded = record(only, builder, values)
    rows = (_by_sweeps if reverse else _by_directions)(only, builder, values, recorded, wanted)
    outputs: list[tuple[Port, list[Value]]] = [(port, [recorded[index] for index in only.results[0]])]
    first = 0
    for k in wanted:
        source = program.inputs[k]
        block = [value for row in rows for value in row[first : first + source.size]]
        meaning = f"derivatives of {output} with respect to {source.name}"
        outputs.append((Port(f"d{output}_d{source.name}", (port.size, source.size), meaning=meaning), block))
        first += source.size
    summary = f"{program.summary.rstrip('.')}, with derivatives."
    return builder.program(f"{program.name}_derivatives", outputs, summary, program.formula, program.notes)


def _by_directions(
    program: Program,
    builder: Builder,
    inputs: Sequence[Sequence[Value]],
    recorded: Sequence[Value],
    wanted: Sequence[int],
) -> list[list[Value]]:
    seeds: list[list[Tangent]] = [[{} for _ in row] for row in inputs]
    count = 0
    for k in wanted:
        seeds[k] = [{count + element: 1} for element in range(len(inputs[k]))]
        count += len(inputs[k])
    (rows,) = tangents(program, builder, recorded, seeds)
    return [[row.get(direction, 0) for direction in range(count)] for row in rows]


def _by_sweeps(
    program: Program,
    builder: Builder,
    inputs: Sequence[Sequence[Value]],
    recorded: Sequence[Value],
    wanted: Sequence[int],
) -> list[list[Value]]:
    rows = []
    for element in range(len(program.results[0])):
        weights: list[Value] = [int(element == other) for other in range(len(program.results[0]))]
        adjoints = pull_back(program, builder, recorded, [weights])
        rows.append([value for k in wanted for value in adjoints[k]])
    return rows


def record(program: Program, builder: Builder, inputs: Sequence[Sequence[Value]]) -> list[Value]:
    """Record ``program`` into ``builder``, reading ``inputs`` for its input ports; returns the value of every node."""
    every = tuple(range(len(program.nodes)))
    flat = program.with_fields(outputs=(Port("all", (len(every),)),), results=(every,), status=None)
    return replay(flat, builder, inputs)[0]


def tangents(
    program: Program,
    builder: Builder,
    values: Sequence[Value],
    seeds: Sequence[Sequence[Tangent]],
    rotations: bool = False,
) -> list[list[Tangent]]:
    """Forward mode: the tangents of all output elements, for the tangents ``seeds`` of all input elements.

    The tangent of a value is its derivative along each of several directions in the space of the inputs. ``values``
    are the values of all nodes as :func:`record` returned them. With ``rotations``, the rule for these is used, which
    takes fewer operations along a direction in which many inputs change.
    """
    node_tangents: list[Tangent] = []
    sums = _turned_sums(program, builder, values) if rotations else {}
    for index, node in enumerate(program.nodes):
        if index in sums:
            node_tangents.append(sums[index].tangent(builder, values, node_tangents))
        elif node.op is Op.INPUT:
            port, element = node.place
            node_tangents.append(seeds[port][element])
        elif node.op is Op.SELECT:
            node_tangents.append(
                _select_tangent(builder, values[node.args[0]], *(node_tangents[a] for a in node.args[1:]))
            )
        else:
            arguments = [node_tangents[a] for a in node.args]
            if any(arguments):
                operands = [values[a] for a in node.args]
                node_tangents.append(_chain(builder, _partials(builder, node.op, operands, values[index]), arguments))
            else:
                node_tangents.append({})
    return [[node_tangents[index] for index in row] for row in program.results]


def _chain(builder: Builder, partials: Sequence[Value], arguments: Sequence[Tangent]) -> Tangent:
    """The chain rule for one node: sum over its operands of partial derivative times tangent, for every direction."""
    total: Tangent = {}
    for partial, tangent in zip(partials, arguments, strict=True):
        if is_zero(partial):
            continue
        for direction, value in tangent.items():
            term = builder.mul(partial, value)
            total[direction] = builder.add(total[direction], term) if direction in total else term
    return {direction: value for direction, value in total.items() if not is_zero(value)}


def _select_tangent(builder: Builder, condition: Value, positive: Tangent, otherwise: Tangent) -> Tangent:
    directions = [*positive, *(d for d in otherwise if d not in positive)]
    return {d: builder.select(condition, positive.get(d, 0), otherwise.get(d, 0)) for d in directions}


def pull_back(
    program: Program,
    builder: Builder,
    values: Sequence[Value],
    weights: Sequence[Sequence[Value]],
) -> list[list[Value]]:
    """Reverse mode: the derivatives of ``sum of weight * output element`` by all input elements, by input port.

    ``weights`` holds one weight for each element of each output. ``values`` are the values of all nodes as
    :func:`record` returned them.
    """
    adjoints: list[Value] = [0] * len(program.nodes)
    for elements, row in zip(program.results, weights, strict=True):
        for index, weight in zip(elements, row, strict=True):
            adjoints[index] = builder.add(adjoints[index], weight)
    results: list[list[Value]] = [[0] * port.size for port in program.inputs]
    for index in range(len(program.nodes) - 1, -1, -1):
        node, adjoint = program.nodes[index], adjoints[index]
        if is_zero(adjoint):
            continue
        if node.op is Op.INPUT:
            port, element = node.place
            results[port][element] = adjoint
        elif node.op is Op.SELECT:
            condition, positive, otherwise = node.args
            given = builder.select(values[condition], adjoint, 0), builder.select(values[condition], 0, adjoint)
            adjoints[positive] = builder.add(adjoints[positive], given[0])
            adjoints[otherwise] = builder.add(adjoints[otherwise], given[1])
        else:
            partials = _partials(builder, node.op, [values[a] for a in node.args], values[index])
            for argument, partial in zip(node.args, partials, strict=True):
                adjoints[argument] = builder.add(adjoints[argument], builder.mul(partial, adjoint))
    return results


# ------------------------------------------------------------------------------------------------------------------
# The rule for rotations
# ------------------------------------------------------------------------------------------------------------------


_SUMS = (Op.ADD, Op.SUB, Op.NEG)


@dataclass(frozen=True)
class _TurnedSum:
    """A sum with terms that turn: ``plain`` terms, as (sign, node), and ``turned`` ones by the node of their angle.

    A turned term is (sign, node of the cosine or sine, node that it multiplies); ``slopes`` holds the derivative of the
    terms of each angle by that angle.
    """

    plain: list[tuple[int, int]]
    turned: dict[int, list[tuple[int, int, int]]]
    slopes: dict[int, Value]

    def tangent(self, builder: Builder, values: Sequence[Value], node_tangents: Sequence[Tangent]) -> Tangent:
        """The tangent of the sum, from those of all earlier nodes."""
        partials: list[Value] = [sign for sign, _ in self.plain]
        arguments = [node_tangents[k] for _, k in self.plain]
        for angle, terms in self.turned.items():
            partials += [builder.mul(sign, values[k]) for sign, k, _ in terms] + [self.slopes[angle]]
            arguments += [node_tangents[k] for _, _, k in terms] + [node_tangents[angle]]
        return _chain(builder, partials, arguments)


def _turned_sums(program: Program, builder: Builder, values: Sequence[Value]) -> dict[int, _TurnedSum]:
    """The sums with at least two terms that turn by one angle, if the products in their derivative are known."""
    nodes, used = program.nodes, uses(program)
    partners: dict[int, dict[Op, int]] = {}
    for k, node in enumerate(nodes):
        if node.op in (Op.COS, Op.SIN):
            partners.setdefault(node.args[0], {})[node.op] = k
    inner = {
        arg for node in nodes if node.op in _SUMS for arg in node.args if used[arg] == 1 and nodes[arg].op in _SUMS
    }

    def leaves(k: int, sign: int) -> list[tuple[int, int]]:
        node, signed_nodes = nodes[k], []
        signs = (-sign,) if node.op is Op.NEG else (sign, sign if node.op is Op.ADD else -sign)
        for arg, arg_sign in zip(node.args, signs, strict=True):
            signed_nodes += leaves(arg, arg_sign) if arg in inner else [(arg_sign, arg)]
        return signed_nodes

    def slope(k: int, x: int) -> Value | None:
        """The derivative by its angle of factor k, a cosine or sine, times node x; None if it is not known."""
        other = partners[nodes[k].args[0]].get(Op.SIN if nodes[k].op is Op.COS else Op.COS)
        if other is None or not builder.knows_product(values[other], values[x]):
            return None
        product = builder.mul(values[other], values[x])
        return builder.neg(product) if nodes[k].op is Op.COS else product

    sums: dict[int, _TurnedSum] = {}
    for index, node in enumerate(nodes):
        if node.op not in _SUMS or index in inner:
            continue
        turning: dict[int, list[tuple[int, tuple[int, int, int], Value]]] = {}
        terms = leaves(index, 1)
        for place, (sign, leaf) in enumerate(terms):
            if nodes[leaf].op is Op.MUL:
                first, second = nodes[leaf].args
                both = nodes[first].args == nodes[second].args  # cosine and sine of one angle: one term, not two
                for k, x in [(first, second)] if both else [(first, second), (second, first)]:
                    if nodes[k].op in (Op.COS, Op.SIN) and (known := slope(k, x)) is not None:
                        turning.setdefault(nodes[k].args[0], []).append((place, (sign, k, x), builder.mul(sign, known)))
        taken: set[int] = set()
        turned, slopes = {}, {}
        for angle, entries in turning.items():
            free = [entry for entry in entries if entry[0] not in taken]
            if len(free) > 1:
                taken.update(place for place, _, _ in free)
                turned[angle] = [term for _, term, _ in free]
                total: Value = 0
                for _, _, known in free:
                    total = builder.add(total, known)
                slopes[angle] = total
        if turned:
            plain = [term for place, term in enumerate(terms) if place not in taken]
            sums[index] = _TurnedSum(plain, turned, slopes)
    return sums


def _partials(builder: Builder, op: Op, x: Sequence[Value], value: Value) -> list[Value]:
    """Partial derivatives of the operation ``op`` with respect to its operands ``x``; ``value`` is its result."""
    match op:
        case Op.CONST | Op.INPUT:
            return []
        case Op.ADD:
            return [1, 1]
        case Op.SUB:
            return [1, -1]
        case Op.MUL:
            return [x[1], x[0]]
        case Op.DIV:
            inverse = builder.div(1, x[1])
            return [inverse, builder.neg(builder.mul(value, inverse))]
        case Op.NEG:
            return [-1]
        case Op.SIN:
            return [builder.cos(x[0])]
        case Op.COS:
            return [builder.neg(builder.sin(x[0]))]
        case Op.SQRT:
            return [builder.div(Fraction(1, 2), value)]
        case Op.ABS:
            return [builder.sign(x[0])]
        case Op.MIN:
            first = builder.select(builder.sub(x[1], x[0]), 1, 0)
            return [first, builder.sub(1, first)]
        case Op.SIGN | Op.NONFINITE:
            return [0]
        case Op.EXP:
            return [value]
        case Op.TANH:
            return [builder.sub(1, builder.mul(value, value))]
    raise InternalError(f"no derivative rule for {op.value}")


def is_zero(value: Value) -> bool:
    """Whether ``value`` is a zero known while recording."""
    return not isinstance(value, Scalar) and value == 0
