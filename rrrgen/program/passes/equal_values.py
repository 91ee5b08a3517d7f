"""The pass that computes equal values once, however differently they are written, and sums of known values by one sum.

Two expressions that differ as text may be the same function, as derivatives of a rotation show: that of
``s u + a`` by the angle, ``c u + s du``, is the difference of two entries that are already known. The pass evaluates
all nodes at a random state in a prime field, in which nothing is rounded. Values that agree there, and at a second
state, are equal as rational functions of the inputs and of the cosines and sines of angles, up to a chance of 1e-30.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial, reduce
from operator import or_
from random import Random
from typing import NamedTuple

from rrrgen.program import Builder, Op, Port, Program, Value
from rrrgen.program.evaluation import evaluate_floats
from rrrgen.program.finite_field import PRIME
from rrrgen.program.program import count_operations, uses

_COUNTED = (Op.ADD, Op.SUB, Op.MUL, Op.DIV, Op.SQRT)
_INVERSE = {factor: pow(factor, -1, PRIME) for factor in (1, -1, 2, -2)}

STATES = 4
"""Random states at which the sizes of values are compared."""

LARGEST = 8
"""The operands of a sum may be this many times as large as the sum together, so that it loses no more than three bits
where the expression that it replaces may lose none. Without a limit no fewer operations."""


@dataclass(frozen=True)
class ShareEqualValues:
    """Replaces a value by an earlier one that equals it, its negative or its half.

    With ``sums``, also by the sum or difference of two earlier values where this takes fewer operations. That search
    takes a time that grows with the square of the length: .3 s for 1000 operations.
    """

    sums: bool = False

    def __call__(self, program: Program) -> Program:
        """The rewritten ``program``, or ``program`` itself if no operation can be saved."""
        while True:
            candidate = _ProgramWalk(program, self.sums).run()
            if candidate is None or count_operations(candidate).total >= count_operations(program).total:
                return program
            program = candidate


class _Found(NamedTuple):
    """How a value is made from the earlier nodes ``args``; ``operations`` is how many that takes."""

    make: Callable[..., Value]
    args: tuple[int, ...]
    operations: int


class _ProgramWalk:
    """One walk over a program. ``self.args`` are the operands of every node, after the replacements found so far."""

    def __init__(self, program: Program, sums: bool) -> None:
        self.program, self.sums = program, sums
        self.first, self.second = _residues(program, 1), _residues(program, 2)
        self.sizes = _sizes(program) if sums else []
        self.args = [node.args for node in program.nodes]
        self.operations = [int(node.op in _COUNTED) for node in program.nodes]
        self.uses = uses(program)
        self.moving = _moving(program) if sums else [0] * len(program.nodes)
        self.groups: dict[int, list[int]] = {}  # values in the field by what they move with
        self.found: dict[int, _Found] = {}
        self.builder = Builder()

    def run(self) -> Program | None:
        """The program with all replacements; None if there are none."""
        known: dict[int, int] = {}  # value in the field -> its node
        for k, node in enumerate(self.program.nodes):
            if self.uses[k] == 0:  # nothing needs it any longer
                continue
            if node.op in _COUNTED:
                replacement = self._replacement(k, known)
                if replacement is not None:
                    self._replace(k, replacement)
            value = self.first[k]
            if value not in known:
                self.groups.setdefault(self.moving[k], []).append(value)
            if value not in known or not self.uses[known[value]]:
                known[value] = k
        return self._rewritten() if self.found else None

    def _replacement(self, k: int, known: dict[int, int]) -> _Found | None:
        if not self.first[k]:
            return _Found(lambda: 0, (), 0)
        saved, gone = self._alone(k)
        for factor, operations in ((1, 0), (-1, 0), (2, 1), (-2, 1)):
            if saved <= operations:
                return None
            i = known.get(self.first[k] * _INVERSE[factor] % PRIME)
            if i is None or i in gone or not self.uses[i] or (factor * self.second[i] - self.second[k]) % PRIME:
                continue
            return _Found(partial(self.builder.mul, factor), (i,), operations)
        return next(self._sums(k, known, gone), None) if self.sums and saved > 1 else None

    def _sums(self, k: int, known: dict[int, int], gone: set[int]) -> Iterator[_Found]:
        value, limit = self.first[k], LARGEST * self.sizes[k]
        terms = [x for moving, group in self.groups.items() if not moving & ~self.moving[k] for x in group]
        for sign in (1, -1):  # value = x + y, or value = y - x
            for wanted in known.keys() & {(value - sign * x) % PRIME for x in terms}:
                j, i = known[wanted], known[sign * (value - wanted) % PRIME]
                if i in gone or j in gone or not self.uses[i] or not self.uses[j]:
                    continue
                if (self.second[j] + sign * self.second[i] - self.second[k]) % PRIME:
                    continue
                if self.sizes[i] + self.sizes[j] <= limit:
                    yield _Found(self.builder.add if sign > 0 else self.builder.sub, (j, i), 1)

    def _alone(self, k: int) -> tuple[int, set[int]]:
        """The operations that only node ``k`` needs, its own included, and their nodes."""
        needed: dict[int, int] = {}
        count, gone, stack = 0, set[int](), [k]
        while stack:
            index = stack.pop()
            gone.add(index)
            count += self.operations[index]
            for arg in self.args[index]:
                needed[arg] = needed.get(arg, 0) + 1
                if needed[arg] == self.uses[arg]:
                    stack.append(arg)
        return count, gone

    def _replace(self, k: int, replacement: _Found) -> None:
        for arg in replacement.args:
            self.uses[arg] += 1
        dropped = list(self.args[k])
        while dropped:
            arg = dropped.pop()
            self.uses[arg] -= 1
            if not self.uses[arg]:
                dropped += self.args[arg]
        self.found[k], self.args[k], self.operations[k] = replacement, replacement.args, replacement.operations

    def _rewritten(self) -> Program:
        builder, program = self.builder, self.program
        inputs = [builder.input(port) for port in program.inputs]
        values: list[Value] = []
        for k, node in enumerate(program.nodes):
            if not self.uses[k]:
                value: Value = 0
            elif k in self.found:
                value = self.found[k].make(*(values[arg] for arg in self.args[k]))
            elif node.op is Op.INPUT:
                port, element = node.place
                value = inputs[port][element]
            elif node.op is Op.CONST:
                value = node.number
            else:
                value = getattr(builder, node.op.value)(*(values[arg] for arg in node.args))
            if k in program.labels and self.uses[k]:
                builder.label(value, program.labels[k])
            values.append(value)
        return builder.rewritten(program, [[values[k] for k in row] for row in program.results])


def _residues(program: Program, state: int) -> list[int]:
    """All nodes at a random state in the prime field. Equal operands of a function that is not rational, equal values.

    A cosine and a sine of a sum of angles are those of its terms; an angle that is no sum is a random point of the
    circle.
    """
    angles: dict[int, tuple[int, int]] = {}
    values: list[int] = []

    def draw(what: object) -> int:
        return Random(f"{state} {what}").randrange(1, PRIME)

    def angle(k: int) -> tuple[int, int]:
        if k not in angles:
            op, args, _ = program.nodes[k]
            if op in (Op.ADD, Op.SUB):
                (c, s), (d, t) = (angle(arg) for arg in args)
                t = t if op is Op.ADD else -t
                angles[k] = (c * d - s * t) % PRIME, (s * d + c * t) % PRIME
            elif op is Op.NEG:
                c, s = angle(args[0])
                angles[k] = c, -s % PRIME
            else:
                t = draw(f"half of the angle {values[k]}")
                scale = pow(1 + t * t, -1, PRIME)  # the prime is 3 modulo 4: -1 is no square
                angles[k] = (1 - t * t) * scale % PRIME, 2 * t * scale % PRIME
        return angles[k]

    for node in program.nodes:
        op, x = node.op, [values[arg] for arg in node.args]
        if op is Op.INPUT:
            values.append(draw(f"input {node.place}"))
        elif op is Op.CONST:
            values.append(node.number.numerator * pow(node.number.denominator, -1, PRIME) % PRIME)
        elif op is Op.ADD:
            values.append((x[0] + x[1]) % PRIME)
        elif op is Op.SUB:
            values.append((x[0] - x[1]) % PRIME)
        elif op is Op.MUL:
            values.append(x[0] * x[1] % PRIME)
        elif op is Op.NEG:
            values.append(-x[0] % PRIME)
        elif op is Op.DIV and x[1]:
            values.append(x[0] * pow(x[1], -1, PRIME) % PRIME)
        elif op in (Op.COS, Op.SIN):
            values.append(angle(node.args[0])[op is Op.SIN])
        else:
            values.append(draw(f"{op} {x}"))
    return values


def _moving(program: Program) -> list[int]:
    """The inputs other than parameters that each node depends on, as bits."""
    bits: dict[tuple[int, int], int] = {}
    masks: list[int] = []
    for node in program.nodes:
        if node.op is Op.INPUT:
            free = not program.inputs[node.place[0]].role.is_parameter
            masks.append(bits.setdefault(node.place, 1 << len(bits)) if free else 0)
        else:
            masks.append(reduce(or_, (masks[arg] for arg in node.args), 0))
    return masks


def _sizes(program: Program) -> list[float]:
    """The sum of the magnitudes of every node over :data:`STATES` random states."""
    every = tuple(range(len(program.nodes)))
    flat = program.with_fields(outputs=(Port("all", (len(every),)),), results=(every,), status=None)
    random = Random(1)
    total = [0.0] * len(every)
    for _ in range(STATES):
        inputs = [[random.uniform(-1, 1) for _ in range(port.size)] for port in program.inputs]
        (values,) = evaluate_floats(flat, *inputs)
        total = [size + abs(value) for size, value in zip(total, values, strict=True)]
    return total
