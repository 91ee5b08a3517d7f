"""The intermediate representation: a :class:`Program` is a list of scalar single assignments with named outputs.

Programs are recorded by a :class:`rrrgen.program.builder.Builder`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from rrrgen.base.errors import InternalError
from rrrgen.program.dump import text_of
from rrrgen.program.nodes import ARITY, Node, Op
from rrrgen.program.ports import Port, Role, Status


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

    def described(self, **changes: object) -> Program:
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
