"""The representation: a :class:`Program` is a list of scalar definitions, each made once, plus named outputs.

A node is an operation on earlier nodes. Programs are recorded by a :class:`rrrgen.program.builder.Builder`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import ClassVar, NamedTuple, cast

from rrrgen.errors import InternalError
from rrrgen.program.ports import Port, Role, Status


class Op:
    """The operations a program is made of.

    Every one is a single object, compared by identity. They are no Enum, since naming a member of one costs as much as
    recording a node before Python 3.12.
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
    Op("select"): 3,
}
"""The operations, and how many operands each takes."""


class Node(NamedTuple):
    """One definition: ``op`` applied to the nodes ``args``; ``value`` for inputs and constants."""

    op: Op
    args: tuple[int, ...] = ()
    value: object = None

    @property
    def place(self) -> tuple[int, int]:
        """Port and element that an input reads."""
        return cast("tuple[int, int]", self.value)

    @property
    def number(self) -> Fraction | int:
        """The value of a constant."""
        return cast("Fraction | int", self.value)


@dataclass(frozen=True)
class Program:
    """A straight-line function from ``inputs`` to ``outputs``.

    ``results[k]`` lists, row-major, the nodes that define output ``k``. Nodes stand in order of definition: operands
    always come before their use. ``labels`` are hints for readable names in printed code. ``status`` is None where an
    evaluation cannot fail.
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

    @property
    def data_outputs(self) -> tuple[Port, ...]:
        """The outputs other than the status, in order."""
        return tuple(port for k, port in enumerate(self.outputs) if not self.is_status(k))

    def is_status(self, output: int) -> bool:
        """Whether output number ``output`` is the status."""
        return self.status is not None and self.status.output == output

    def takes(self, role: Role) -> bool:
        """Whether an input has this role."""
        return any(port.role is role for port in self.inputs)

    def described(self, **changes: object) -> Program:
        """The same definitions under another description."""
        return replace(self, **changes)  # type: ignore[arg-type]

    def validate(self) -> None:
        """Check the representation's own rules; a violation is a fault of rrrgen."""
        for index, node in enumerate(self.nodes):
            args = node.args
            if len(args) != ARITY[node.op] or (args and not 0 <= min(args) <= max(args) < index):
                raise InternalError(f"program {self.name}: node {index} ({node.op.value}) has bad operands {args}")
            if node.op is Op.INPUT:
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


def reachable(nodes: Sequence[Node], roots: Iterable[int]) -> list[int]:
    """The nodes that ``roots`` depend on, roots included, in order of definition."""
    needed = bytearray(len(nodes))
    for index in roots:
        needed[index] = 1
    for index in range(needed.rfind(1), -1, -1):  # users stand behind their operands
        if needed[index]:
            for arg in nodes[index].args:
                needed[arg] = 1
    return [index for index, is_needed in enumerate(needed) if is_needed]


def uses(program: Program) -> list[int]:
    """How often each node is an operand or a result."""
    count = [0] * len(program.nodes)
    for node in program.nodes:
        for arg in node.args:
            count[arg] += 1
    for row in program.results:
        for index in row:
            count[index] += 1
    return count
