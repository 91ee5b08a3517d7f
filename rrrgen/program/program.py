"""The intermediate representation: a program of scalar definitions over named ports, operation counts and text."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from enum import Enum
from fractions import Fraction
from itertools import count
from operator import itemgetter
from typing import ClassVar, NamedTuple, cast

from rrrgen.base.errors import InternalError

# ------------------------------------------------------------------------------------------------------------------
# Ports, the named inputs and outputs of programs, and the status by which a program reports failure.
# ------------------------------------------------------------------------------------------------------------------


class Role(Enum):
    """The physical quantity of a port. Code decides by the role; the name of a port is for readers only."""

    POSITION = "position"
    VELOCITY = "velocity"
    ACCELERATION = "acceleration"
    TORQUE = "torque"
    REFERENCE_VELOCITY = "reference velocity"
    REFERENCE_ACCELERATION = "reference acceleration"
    DESIRED_POSITION = "desired position"
    DESIRED_VELOCITY = "desired velocity"
    DESIRED_ACCELERATION = "desired acceleration"
    COVECTOR = "covector"  # e in e' Y, shape (n,): multiplies the regressor from the left
    BASE_PARAMETERS = "base parameters"  # followed by the drive inertias, where the robot file states some
    STANDARD_PARAMETERS = "standard parameters"  # likewise
    GRAVITY = "gravity"  # the acceleration of gravity in the base frame, where it is an input
    FRICTION = "friction parameters"
    GEOMETRY = "geometry"  # named lengths and angles that are inputs instead of numbers
    ORIENTATION = "orientation"  # of a floating base, a quaternion x, y, z, w
    TWIST = "twist"  # of a floating base, linear part first, in base axes
    TWIST_RATE = "twist rate"  # the time derivative of its components
    LOOPS = "passive positions"  # of loops that Newton's method solves, known before the call
    PAYLOAD = "payload"  # its mass, centre of mass, inertia, or the pose of its frame
    WRENCH = "wrench"  # on a floating base, force first, about its origin, in base axes
    OTHER = "other"

    @property
    def is_parameter(self) -> bool:
        """Whether the port is constant while the robot moves."""
        return self in (
            Role.BASE_PARAMETERS,
            Role.STANDARD_PARAMETERS,
            Role.FRICTION,
            Role.GEOMETRY,
        )

    @property
    def is_rate(self) -> bool:
        """Whether the port is a velocity, an acceleration or the vector e in ``e' Y``, which multiplies a regressor."""
        return self in (
            Role.VELOCITY,
            Role.ACCELERATION,
            Role.REFERENCE_VELOCITY,
            Role.REFERENCE_ACCELERATION,
            Role.COVECTOR,
        )


class Domain(Enum):
    """The values of an input that a function accepts; :mod:`rrrgen.program.guard` refuses all others."""

    FINITE = "finite"
    ESTIMATE = "an estimate of an observer, finite"  # refused also by functions that have no state
    POSITIVE = "finite and > 0"
    PERIOD = "a time, finite and > 0"
    LIMIT = ">= 0, INFINITY for none"  # of a magnitude
    LOWER = "a lower bound, -INFINITY for none"
    UPPER = "an upper bound, INFINITY for none"  # of what the port LOWER before it bounds from below


@dataclass(frozen=True)
class Port:
    """A named input or output of a program with its unit, reference frame and meaning.

    ``shape`` is () for a scalar, (n,) for a vector, (m, n) for a row-major matrix, and so on. ``role`` is the physical
    quantity, by which code recognizes the port. ``domain`` says which values of an input are accepted. An output that
    the caller hands back at the next call has in ``state`` the name of the input that takes it. ``refused`` is the
    value of an output, other than a state, of a call whose input is refused.
    """

    name: str
    shape: tuple[int, ...]
    unit: str = ""
    frame: str = ""
    meaning: str = ""
    role: Role = Role.OTHER
    domain: Domain = Domain.FINITE
    state: str = ""
    refused: int = 0

    @property
    def size(self) -> int:
        """Number of scalars."""
        return math.prod(self.shape)


@dataclass(frozen=True)
class Failure:
    """A failure that a status reports: its ``code``, a short ``name``, ``message`` for the user, ``meaning``.

    The meaning is the exact condition.
    """

    code: int
    name: str
    message: str
    meaning: str


REFUSED = Failure(
    2, "invalid input", "an input is not finite or out of its range", "an input is not finite or out of its range"
)
"""The failure of a guarded function whose input, or a value computed from it, is unusable; the state is unchanged."""


@dataclass(frozen=True)
class Status:
    """How a program reports failure: output number ``output``, a scalar, is 0 or the code of one of its ``failures``.

    The codes ascend; 2 is that of :data:`REFUSED`, 1 that of a failure of the function itself.
    """

    output: int
    failures: tuple[Failure, ...]

    @staticmethod
    def of(output: int, name: str, message: str, meaning: str) -> Status:
        """The status of a function with a single failure, whose code is 1."""
        return Status(output, (Failure(1, name, message, meaning),))

    @property
    def message(self) -> str:
        """The messages of all failures, for the user."""
        return " or ".join(failure.message for failure in self.failures)

    @property
    def meaning(self) -> str:
        """The conditions of all failures."""
        return "; ".join(
            failure.meaning if len(self.failures) == 1 else f"{failure.code}: {failure.meaning}"
            for failure in self.failures
        )


# ------------------------------------------------------------------------------------------------------------------
# Nodes, the definitions that make up a program: an operation on earlier nodes, an input element, or a constant.
# ------------------------------------------------------------------------------------------------------------------


class Op:
    """The operations of the representation: one object per operation, compared by identity.

    Not an Enum: before Python 3.12, access to an Enum member takes as long as recording a whole node.
    """

    __slots__ = ("value",)

    INPUT: ClassVar[Op]  # value = (port index, element index)
    CONST: ClassVar[Op]  # value = int, or Fraction where it is not whole
    ADD: ClassVar[Op]
    SUB: ClassVar[Op]
    MUL: ClassVar[Op]
    DIV: ClassVar[Op]
    NEG: ClassVar[Op]
    SIN: ClassVar[Op]
    COS: ClassVar[Op]
    SQRT: ClassVar[Op]
    ABS: ClassVar[Op]
    SIGN: ClassVar[Op]  # -1, 0 or +1
    EXP: ClassVar[Op]
    TANH: ClassVar[Op]
    MIN: ClassVar[Op]
    NONFINITE: ClassVar[Op]  # 0 of a finite number, 1 of an infinite one, 2 of NaN, whatever the compiler assumes
    SELECT: ClassVar[Op]  # first operand > 0 ? second : third

    def __init__(self, value: str) -> None:
        self.value = value
        setattr(Op, value.upper(), self)

    def __repr__(self) -> str:
        return f"Op.{self.value.upper()}"

    def __reduce__(self) -> tuple[object, ...]:
        return getattr, (Op, self.value.upper())


ARITY = {
    Op("input"): 0,
    Op("const"): 0,
    Op("add"): 2,
    Op("sub"): 2,
    Op("mul"): 2,
    Op("div"): 2,
    Op("neg"): 1,
    Op("sin"): 1,
    Op("cos"): 1,
    Op("sqrt"): 1,
    Op("abs"): 1,
    Op("sign"): 1,
    Op("exp"): 1,
    Op("tanh"): 1,
    Op("min"): 2,
    Op("nonfinite"): 1,
    Op("select"): 3,
}
"""Number of operands of each operation."""


class Node(NamedTuple):
    """One definition: ``op`` applied to the nodes ``args``; inputs and constants have a ``value`` instead."""

    op: Op
    args: tuple[int, ...] = ()
    value: object = None

    @property
    def place(self) -> tuple[int, int]:
        """Input port and element (row-major) that an INPUT node reads."""
        return cast("tuple[int, int]", self.value)

    @property
    def number(self) -> Fraction | int:
        """The value of a CONST node."""
        return cast("Fraction | int", self.value)


def reachable(nodes: Sequence[Node], roots: Iterable[int]) -> list[int]:
    """The indices of all nodes that ``roots`` depend on, roots included, ascending."""
    needed = bytearray(len(nodes))
    for index in roots:
        needed[index] = 1
    for index in range(needed.rfind(1), -1, -1):  # operands precede their users
        if needed[index]:
            for arg in nodes[index][1]:
                needed[arg] = 1
    return [index for index, is_needed in enumerate(needed) if is_needed]


# ------------------------------------------------------------------------------------------------------------------
# Counting the operations of a program.
# ------------------------------------------------------------------------------------------------------------------

_OTHER = (Op.ABS, Op.SIGN, Op.EXP, Op.TANH, Op.MIN, Op.NONFINITE, Op.SELECT)


@dataclass(frozen=True)
class OperationCount:
    """Number of operations of one evaluation, by kind.

    ``add`` includes subtractions. ``sincos`` counts angles: the sine and the cosine of one angle count once. ``neg`` is
    listed apart and left out of ``total``, since a change of sign is practically free on current processors. ``other``
    counts absolute values, signs, exponentials, hyperbolic tangents, minima, checks for finite numbers and
    selections.
    """

    mul: int = 0
    add: int = 0
    div: int = 0
    sqrt: int = 0
    sincos: int = 0
    neg: int = 0
    other: int = 0

    @property
    def total(self) -> int:
        """Number of multiplications, additions, divisions and square roots together."""
        return self.mul + self.add + self.div + self.sqrt

    def as_dict(self) -> dict[str, int]:
        """The counts by name, in the form in which the manifest lists them."""
        return asdict(self)

    def __str__(self) -> str:
        parts = [f"{self.mul} mul", f"{self.add} add"]
        parts += [f"{value} {name}" for name, value in self.as_dict().items() if name not in ("mul", "add") and value]
        return ", ".join(parts)


def count_operations(program: Program) -> OperationCount:
    """Count the operations of one evaluation of ``program``, by kind."""
    tally = Counter(map(itemgetter(0), program.nodes))  # by operation
    has_angles = tally[Op.SIN] or tally[Op.COS]
    angles = {args[0] for op, args, _ in program.nodes if op is Op.SIN or op is Op.COS} if has_angles else ()
    return OperationCount(
        mul=tally[Op.MUL],
        add=tally[Op.ADD] + tally[Op.SUB],
        div=tally[Op.DIV],
        sqrt=tally[Op.SQRT],
        sincos=len(angles),
        neg=tally[Op.NEG],
        other=sum(tally[op] for op in _OTHER),
    )


# ------------------------------------------------------------------------------------------------------------------
# Print a program as text, for reading and for comparing in tests.
#
# The text lists the ports, the definitions (one per line), the outputs and the operation counts:
#
# height: Height of the tip above the base.
#   h = d + a sin(q1)
#   in   q  (1)  rad  position  joint positions
#   out  h  ()   m    other     base frame, height
#   %1 = sin(q[0])  # s1
#   %2 = (3/5)*%1
#   %3 = 2 + %2
#   h = %3
#   operations: 1 mul, 1 add, 1 sincos
#
# Definitions are numbered in the order of evaluation; inputs and constants stand where they are used. A name
# suggested for printed code follows its definition after ``#``. Constants are exact where that is short; ``~`` marks
# the nearest double of others.
# ------------------------------------------------------------------------------------------------------------------

_INFIX = {Op.ADD: " + ", Op.SUB: " - ", Op.MUL: "*", Op.DIV: "/"}
_LONGEST_FRACTION = 12  # characters
_WIDTH = 100


def text_of(program: Program) -> str:
    """Print ``program`` as text in the format of the module's docstring, ending with a line feed."""
    texts: list[str] = []
    numbers = count(1)
    lines: list[str] = []
    for index, node in enumerate(program.nodes):
        if node.op is Op.INPUT:
            port, element = node.place
            texts.append(_element(program.inputs[port], element))
        elif node.op is Op.CONST:
            texts.append(_constant(node.number))
        else:
            texts.append(f"%{next(numbers)}")
            label = f"  # {program.labels[index]}" if index in program.labels else ""
            lines.append(f"{texts[-1]} = {_operation(node, texts)}{label}")
    for port_, elements in zip(program.outputs, program.results, strict=True):
        lines += _broken(f"{port_.name} = ", [texts[index] for index in elements])
    title = f"{program.name}: {program.summary}" if program.summary else f"{program.name}:"
    formula = [line.strip() for line in program.formula.splitlines()]
    body = [*formula, *_ports(program), *lines, f"operations: {count_operations(program)}"]
    return "\n".join([title, *(f"  {line}" for line in body)]) + "\n"


def _ports(program: Program) -> list[str]:
    rows = [("in", *_facts(port)) for port in program.inputs]
    for k, port in enumerate(program.outputs):
        direction, facts = ("status", _facts(port)) if program.is_status(k) else ("out", _facts(port))
        meaning = facts[-1]
        if direction == "status" and program.status:
            meaning = "0, or " + ", ".join(
                f"{failure.code} where {failure.meaning}" for failure in program.status.failures
            )
        rows.append((direction, *facts[:-1], meaning))
    widths = [max(len(row[k]) for row in rows) for k in range(5)] if rows else []
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, [*widths, 0], strict=True)).rstrip() for row in rows
    ]


def _facts(port: Port) -> tuple[str, str, str, str, str]:
    """Name, shape, unit, role and description of a port."""
    shape = "(" + ", ".join(map(str, port.shape)) + ")"
    words = ", ".join(part for part in (port.frame, port.meaning) if part)
    return port.name, shape, port.unit or "-", port.role.value, words


def _element(port: Port, element: int) -> str:
    return f"{port.name}[{element}]" if port.shape else port.name


def _constant(value: Fraction | int) -> str:
    exact = str(value)
    return exact if len(exact) <= _LONGEST_FRACTION else f"~{float(value)!r}"


def _operation(node: Node, texts: Sequence[str]) -> str:
    args = [texts[arg] for arg in node.args]
    if node.op in _INFIX:
        left, right = (f"({arg})" if arg[0] in "-~" or "/" in arg else arg for arg in args)
        return f"{left}{_INFIX[node.op]}{right}"
    if node.op is Op.NEG:
        return f"-{args[0]}"
    if node.op is Op.SELECT:
        return f"{args[0]} > 0 ? {args[1]} : {args[2]}"
    return f"{node.op.value}({', '.join(args)})"


def _broken(head: str, values: Sequence[str]) -> list[str]:
    """Print ``head`` followed by the values, joined by commas and wrapped at the line width."""
    lines, line = [], head
    for k, value in enumerate(values):
        cell = value + (", " if k < len(values) - 1 else "")
        if len(line) + len(cell) > _WIDTH and line != head:
            lines.append(line.rstrip())
            line = " " * len(head)
        line += cell
    return [*lines, line.rstrip()]


# ------------------------------------------------------------------------------------------------------------------
# The intermediate representation: a :class:`Program` is a list of scalar single assignments with named outputs.
#
# Programs are recorded by a :class:`rrrgen.program.builder.Builder`.
# ------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Program:
    """A straight-line function from ``inputs`` to ``outputs``.

    ``results[k]`` lists the nodes of the elements of output ``k``, row-major. Nodes stand in order of evaluation:
    operands come before their use. ``labels`` suggests readable variable names for nodes in printed code. ``status`` is
    None for a function whose evaluation cannot fail. ``summary``, ``formula`` and ``notes`` describe the function in
    emitted files. In a nominal specialization the parameters of the robot file are constants; ``specializes`` then
    names the general function, and is empty otherwise.
    """

    name: str
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    nodes: tuple[Node, ...]
    results: tuple[tuple[int, ...], ...]
    summary: str = ""
    formula: str = ""
    notes: tuple[str, ...] = ()
    labels: dict[int, str] = field(default_factory=dict, compare=False)
    status: Status | None = None
    specializes: str = ""

    @property
    def function(self) -> str:
        """Name of the function of which this program is the nominal specialization, or else its own name."""
        return self.specializes or self.name

    @property
    def data_outputs(self) -> tuple[Port, ...]:
        """The outputs other than the status, in order."""
        return tuple(port for k, port in enumerate(self.outputs) if not self.is_status(k))

    @property
    def status_first(self) -> tuple[int, ...]:
        """The numbers of the outputs, that of the status before the others."""
        return tuple(sorted(range(len(self.outputs)), key=lambda k: not self.is_status(k)))

    def is_status(self, output: int) -> bool:
        """Whether output number ``output`` is the status."""
        return self.status is not None and self.status.output == output

    def takes(self, role: Role) -> bool:
        """Whether any input has this role."""
        return any(port.role is role for port in self.inputs)

    def with_fields(self, **changes: object) -> Program:
        """Copy the program with the fields ``changes`` replaced."""
        return replace(self, **changes)  # type: ignore[arg-type]

    def dump(self) -> str:
        """The program as readable, reproducible text: ports, one definition per line, outputs, operation counts."""
        return text_of(self)

    def validate(self) -> None:
        """Raise InternalError unless operands precede their use, inputs exist and every output is fully defined."""
        for index, node in enumerate(self.nodes):
            op, args, _ = node
            sound = len(args) == ARITY[op]
            for arg in args:
                sound = sound and 0 <= arg < index
            if not sound:
                raise InternalError(f"program {self.name}: node {index} ({op.value}) has bad operands {args}")
            if op is Op.INPUT:
                port, element = node.place
                if not 0 <= element < self.inputs[port].size:
                    raise InternalError(f"program {self.name}: node {index} reads outside input {port}")
        for port_, elements in zip(self.outputs, self.results, strict=True):
            if len(elements) != port_.size or any(not 0 <= e < len(self.nodes) for e in elements):
                raise InternalError(f"program {self.name}: output {port_.name} is not fully defined")
        if self.status is not None and not (
            0 <= self.status.output < len(self.outputs) and self.outputs[self.status.output].shape == ()
        ):
            raise InternalError(f"program {self.name}: the status is no scalar output")


def nominal_name(function: str) -> str:
    """Name of the nominal specialization of ``function``."""
    return f"{function}_nominal"


def specialization(programs: Mapping[str, Program], function: str) -> Program | None:
    """The nominal specialization of ``function`` among ``programs``, if there is one."""
    return next((program for program in programs.values() if program.specializes == function), None)


def with_results(program: Program, results: Sequence[Sequence[int]]) -> Program:
    """The nodes of a program with other results, one output for each list, without status; other nodes are dropped."""
    kept = reachable(program.nodes, (index for row in results for index in row))
    place = {old: new for new, old in enumerate(kept)}
    nodes = tuple(
        program.nodes[old]._replace(args=tuple(place[arg] for arg in program.nodes[old].args)) for old in kept
    )
    return program.with_fields(
        nodes=nodes,
        outputs=tuple(Port(f"values{k}", (len(row),)) for k, row in enumerate(results)),
        results=tuple(tuple(place[index] for index in row) for row in results),
        labels={},
        status=None,
    )


def uses(program: Program) -> list[int]:
    """For each node, how often it occurs as an operand or as an element of an output."""
    count = [0] * len(program.nodes)
    for _, args, _ in program.nodes:
        for arg in args:
            count[arg] += 1
    for row in program.results:
        for index in row:
            count[index] += 1
    return count
