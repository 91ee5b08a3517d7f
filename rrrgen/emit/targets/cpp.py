"""The C++17 backend: a header whose functions take and return std::array and matrices, around the emitted C."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from rrrgen.base.templates import render
from rrrgen.emit import Real
from rrrgen.emit.c.language import RESERVED, Dialect
from rrrgen.emit.description import programs_of, title
from rrrgen.emit.interface import Backend
from rrrgen.emit.printing import plain, wrap
from rrrgen.ik.classify import plan as make_plan
from rrrgen.ik.classify import tip_plans
from rrrgen.program import Port, Program
from rrrgen.robot.identity import Identity

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.ik.plan import SolverPlan
    from rrrgen.robot.spec import RobotSpec

_LONGEST_LINE = 118

_TAKEN = frozenset(("std", "linux", "unix", "i386", "FILE", "EOF"))
"""Names of C++, macros that compilers define by themselves outside strict modes, and capital names of C headers."""
_TYPE = re.compile(r"[A-Za-z0-9_]+_t|FP_[A-Z]+|[A-Z]+_(MAX|MIN|BIT|ERRNO)")
"""Types of C and POSIX such as size_t, and macros of C headers such as INT_MAX and FP_NAN."""


class CppBackend:
    """Prints ``<name>.hpp``."""

    def tasks(self, model: DerivedModel, identity: Identity, real: Real) -> list[Callable[[], str]]:
        """A single task, which prints the header."""
        return [partial(_header, model, identity, real)]

    def assemble(self, model: DerivedModel, identity: Identity, results: Sequence[str]) -> dict[str, str]:
        """The header, named after the robot."""
        return {f"{model.spec.name}.hpp": results[0]}


BACKEND: Backend = CppBackend()


@dataclass(frozen=True)
class _CppFunction:
    """The texts of one C++ function that the template puts together.

    ``explanation`` are the lines of its comment, ``result`` is its return type, ``call`` the call of the C function.
    ``fails`` says whether the function can fail and therefore checks a status.
    """

    explanation: tuple[str, ...]
    result_fields: tuple[tuple[str, str], ...]  # (type, name) of a result with several members; empty for a single one
    result: str
    fails: bool
    signature: str
    outputs: tuple[tuple[str, str], ...]  # (type, name)
    call: str


def namespace(robot: str) -> str:
    """The namespace of a robot: its name, with a suffix where the C library, C++ or a compiler have that name."""
    return f"{robot}_model" if robot in RESERVED | _TAKEN or _TYPE.fullmatch(robot) else robot


def _header(model: DerivedModel, identity: Identity, real: Real) -> str:
    dialect = Dialect(model.spec.name, real)
    plan = None if model.spec.gravity_input else make_plan(model.spec)
    return render(
        "cpp/robot.hpp.j2",
        prefix=dialect.prefix,
        macro=dialect.macro,
        namespace=namespace(dialect.prefix),
        identity=identity,
        title=title(model.spec),
        functions=[_function(program, dialect) for program in programs_of(model).values()],
        solver=None if plan is None or not plan.solvable else plan,
        solvers=[] if plan is None else _solvers(model.spec, plan, real),
        differential="computed_torque" in model.programs and not model.spec.gravity_input,
    )


@dataclass(frozen=True)
class _Solver:
    """The inverse kinematics of a tip: the ``prefix`` and ``macro`` of its C, and what ``lead`` its names here have.

    ``joints`` is the type of its solutions, ``plan`` says which targets it takes.
    """

    lead: str
    prefix: str
    macro: str
    joints: str
    plan: SolverPlan


def _solvers(spec: RobotSpec, plan: SolverPlan, real: Real) -> list[_Solver]:
    """The solvers of the tip and of all named tips that have one; these solve for joints of their own."""
    candidates = [("", spec.name, "vector<joints>", plan)]
    candidates += [
        (f"{tip}_", arm.name, f"vector<{arm.n}>", tip_plan) for tip, (arm, tip_plan) in tip_plans(spec).items()
    ]
    return [
        _Solver(lead, Dialect(name, real).prefix, Dialect(name, real).macro, joints, solver_plan)
        for lead, name, joints, solver_plan in candidates
        if solver_plan.solvable
    ]


def _type(port: Port) -> str:
    if len(port.shape) < 2:
        return f"vector<{port.size}>" if port.shape else "real"
    *stack, rows, columns = port.shape
    text = f"matrix<{rows}, {columns}>"
    for count in reversed(stack):
        text = f"std::array<{text}, {count}>"
    return text


def _pointer(port: Port) -> str:
    """The address of the first element of an argument."""
    if not port.shape:
        return f"&{port.name}"
    return port.name + ".front()" * (len(port.shape) - 2) + ".data()"


def _function(program: Program, dialect: Dialect) -> _CppFunction:
    outputs = program.data_outputs
    fields = tuple((_type(port), port.name) for port in outputs)
    fails = program.status is not None
    single = len(outputs) == 1 and not fails
    result = fields[0][0] if single else f"{program.name}_result"
    inputs = [f"const {_type(port)} &{port.name}" if port.shape else f"real {port.name}" for port in program.inputs]
    arguments = [_pointer(port) if port.shape else port.name for port in program.inputs]
    target = "" if single else "result."
    arguments += [f"&{target}{port.name}" if not port.shape else target + _pointer(port) for port in outputs]
    return _CppFunction(
        explanation=tuple(_explanation(program)),
        result_fields=() if single else fields,
        result=result,
        fails=fails,
        signature=_signature(f"[[nodiscard]] inline {result} {program.name}(", inputs),
        outputs=fields,
        call=f"{dialect.prefix}_{program.name}({', '.join(arguments)})",
    )


def _signature(head: str, inputs: list[str]) -> str:
    """The declaration of the function: on one line if short, otherwise one argument per line."""
    line = f"{head}{', '.join(inputs)}) noexcept"
    if len(line) <= _LONGEST_LINE:
        return line
    return head + (",\n" + " " * len(head)).join(inputs) + ") noexcept"


def _explanation(program: Program) -> list[str]:
    lines = wrap(program.summary or program.name.replace("_", " "))
    return lines + [f"    {plain(line)}" for line in program.formula.splitlines()]
