"""The emitted self-test, a C program that checks the emitted functions on the processor that they are built for.

It compares results with golden values, computed by the reference evaluation in Python, and checks identities of
mechanics.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.templates import render
from rrrgen.derive.functions.friction import friction_parameters
from rrrgen.emit.c.header_comments import function_name
from rrrgen.emit.c.language import Dialect
from rrrgen.emit.interface import Check
from rrrgen.program import REFUSED, Domain, Op, Port, Program, Role, evaluate, specialization
from rrrgen.robot.identity import Identity
from rrrgen.robot.model.inertial_parameters import standard_parameters

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.robot.spec import RobotSpec

Array = NDArray[np.float64]

BY_IDENTITY = frozenset(
    {"standard_regressor", "kinematics", "dynamics_terms", "inverse_dynamics_derivatives", "momentum_terms"}
)
"""Functions that are checked by identities instead of golden values: the standard regressor times phi is the torque,
and functions with several results give the same as the functions of each result. Functions that can fail are not
compared with golden values either: forward dynamics must invert inverse dynamics (its own values are uncertain where M
is ill-conditioned)."""

TABLES = {
    Role.POSITION: "q",
    Role.VELOCITY: "dq",
    Role.ACCELERATION: "ddq",
    Role.COVECTOR: "e",
    Role.REFERENCE_VELOCITY: "ddq",
    Role.REFERENCE_ACCELERATION: "q",
    Role.BASE_PARAMETERS: "beta",
    Role.STANDARD_PARAMETERS: "phi",
    Role.FRICTION: "friction",
    Role.GRAVITY: "gravity",
}
"""Name of the C table from which the self-test reads an input, by the role of the input; inputs of other roles have
tables of their own."""

STATES = ("q", "dq", "ddq", "e")
"""The C tables of the self-test that have one row per state."""

GIVEN = {
    "mass": [1.5],
    "com": [0.0625, -0.03125, 0.125],
    "inertia": [0.03125, 0.0078125, -0.00390625, 0.0078125, 0.046875, 0.001953125, -0.00390625, 0.001953125, 0.015625],
    "tool": [0.0, 0.0, -1.0, 0.125, -1.0, 0.0, 0.0, 0.0625, 0.0, 1.0, 0.0, -0.25, 0.0, 0.0, 0.0, 1.0],
    "frame": [0.0, -1.0, 0.0, 0.25, 0.0, 0.0, -1.0, -0.125, 1.0, 0.0, 0.0, 0.0625, 0.0, 0.0, 0.0, 1.0],
}
"""Values of inputs by name: a payload whose centre of mass lies off all axes, given in a frame with permuted axes, and
the pose of a tool."""

GRAVITY = [3.0, -5.0, -7.5]
"""Gravity in the self-test of functions with gravity as an input, in no special direction."""


@dataclass(frozen=True)
class GoldenResult:
    """The expected values of one output of a function at all states of the self-test, as text for the template.

    ``variable`` is the C variable that holds the computed output, ``size`` its number of elements; ``rows`` holds the
    initializer of one row of the table per state.
    """

    name: str  # of the table
    variable: str
    size: int
    scale: str  # largest absolute value over all states
    rows: tuple[str, ...]


@dataclass(frozen=True)
class Golden:
    """The expected outputs of the function ``name`` at all states of the self-test."""

    name: str
    call: str  # arguments in C, for state k
    results: tuple[GoldenResult, ...]
    arithmetic: bool  # no function of the C library but the square root: the bits are the same everywhere


def selftest(model: DerivedModel, identity: Identity, dialect: Dialect, checks: Sequence[Check] = ()) -> dict[str, str]:
    """Print ``<name>_selftest.c``, a program that prints a line per check and exits with 0, or with 1 if one fails.

    ``checks`` test functions that have headers of their own, such as the inverse kinematics.
    """
    states = _states(model.spec)
    parameters = _parameters(model)
    golden = _golden(model.programs, states, parameters)
    tables = {name: _rows(values) for name, values in states.items()}
    vectors = {name: _lines(values) for name, values in parameters.items()}
    text = render(
        "c/selftest.c.j2",
        prefix=dialect.prefix,
        macro=dialect.macro,
        real=dialect.real,
        identity=identity,
        n=model.spec.n,
        b=model.beta_size,
        standard="10 * N" if len(parameters["phi"]) == 10 * model.spec.n else str(len(parameters["phi"])),
        count=len(states["q"]),
        states=tables,
        parameters=vectors,
        golden=golden,
        functions=set(model.programs),
        gravity="gravity, " if model.spec.gravity_input else "",
        positive=_is_positive(model.programs, states, parameters),
        specializations=_specializations(model, dialect),
        checks=checks,
        solves=any(check.function == "inverse_kinematics" for check in checks),
    )
    return {f"{dialect.prefix}_selftest.c": text}


def _states(spec: RobotSpec) -> dict[str, Array]:
    """The states of the self-test: rest and motion at zero, right angles, half turns (singular for most), random ones.

    All numbers are multiples of 1/64, which are exact in float and double.
    """
    n = spec.n
    span = np.array([3.0 if joint.is_revolute else 0.5 for joint in spec.joints])
    turn = np.array([101 / 64 if joint.is_revolute else 0.25 for joint in spec.joints])  # 101/64 is close to pi/2
    scattered = _scattered(4, 4 * n)
    zero = np.zeros(n)
    q = [zero, zero, turn, 2 * turn, *(np.round(64 * row[:n] * span) / 64 for row in scattered)]
    moving = [_scattered(1, 3 * n, seed)[0] for seed in (5, 6, 7)]
    rest = np.zeros(3 * n)
    others = np.array([rest, *moving, *(row[n:] for row in scattered)])
    others = np.round(128 * others) / 64  # up to 2 rad/s and rad/s^2
    return {"q": np.array(q), "dq": others[:, :n], "ddq": others[:, n : 2 * n], "e": others[:, 2 * n :]}


def _scattered(rows: int, columns: int, seed: int = 1) -> Array:
    """A (rows, columns) array of random numbers in (-1, 1), by a generator of its own, the same with every NumPy."""
    values, state = [], seed
    for _ in range(rows * columns):
        state = (1103515245 * state + 12345) % 2**31
        values.append(2 * (state >> 16) / 2**15 - 1)
    return np.array(values).reshape(rows, columns)


def _parameters(model: DerivedModel) -> dict[str, Array]:
    """The parameters phi and beta of the robot file; made up for plausible links if the file states none."""
    known = [np.array(standard_parameters(link), float) for link in model.spec.links or ()]
    phi = np.concatenate(known or _plausible(len(model.spec.rows)))
    K = np.array(model.base_projection, dtype=float).reshape(-1, len(phi))
    nominal = model.beta_nominal
    beta = K @ phi if nominal is None else np.array([float(x) for x in nominal])
    drives = np.array([float(value) for value in model.drive_inertia_nominal or ()])
    parameters = {name: np.concatenate([links, drives]) for name, links in (("phi", phi), ("beta", beta))}
    if any(program.takes(Role.FRICTION) for program in model.programs.values()):
        stated = [float(value) for _, value in friction_parameters(model.spec)]
        parameters["friction"] = np.array([value or 0.25 + k / 64 for k, value in enumerate(stated)])
    if model.spec.gravity_input:
        parameters["gravity"] = np.array(GRAVITY)
    for program in _with_golden(model.programs).values():
        for port in program.inputs:
            if (name := _table(port)) not in (*STATES, *parameters):
                made_up = -np.abs(_some(port)) if port.domain is Domain.LOWER else np.abs(_some(port))
                parameters[name] = np.array(GIVEN[name]) if name in GIVEN else made_up
    return parameters


def _some(port: Port) -> Array:
    """Arbitrary values for an input of any shape: multiples of 1/64, below 1 in magnitude, none of them zero."""
    return np.asarray((np.round(31 * _scattered(1, port.size, len(port.name))[0]) * 2 + 1) / 64)


def _plausible(n: int) -> list[Array]:
    """Standard parameters of ``n`` made-up links, (10,) each, none of them zero, for which M is positive definite.

    The mass decreases from link to link; the centre of mass of each link lies off all axes of its frame.
    """
    rows = []
    for i in range(n):
        m, c = 2.0 - i / n, np.array([0.125, -0.0625, 0.03125])
        tensor = m * (c @ c * np.eye(3) - np.outer(c, c)) + m * np.diag([0.03125, 0.046875, 0.0390625])
        places = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))
        rows.append(np.array([m, *(m * c), *(tensor[place] for place in places)]))
    return rows


def _golden(programs: Mapping[str, Program], states: dict[str, Array], parameters: dict[str, Array]) -> list[Golden]:
    found = []
    for name, program in _with_golden(programs).items():
        results = []
        values_of = dict(zip(program.outputs, _evaluated(program, states, parameters), strict=True))
        for port in program.data_outputs:
            values = values_of[port]
            rows = values.reshape(len(values), -1)
            scale = max(float(np.abs(rows).max()), 1e-6)
            table, variable = (
                (f"{name}_{port.name}", f"x_{port.name}") if len(program.data_outputs) > 1 else (name, "result")
            )
            results.append(GoldenResult(table, variable, rows.shape[1], f"{scale:.3g}", _rows(rows)))
        found.append(Golden(name, ", ".join(_arguments(program)), tuple(results), _is_arithmetic(program)))
    return found


def _is_arithmetic(program: Program) -> bool:
    return not any(node.op in (Op.EXP, Op.TANH) for node in program.nodes)


def _with_golden(programs: Mapping[str, Program]) -> dict[str, Program]:
    """The functions that are compared with golden vectors: all but specializations and :data:`BY_IDENTITY`."""
    return {
        name: program
        for name, program in programs.items()
        if _never_fails(program) and name not in BY_IDENTITY and not program.specializes
    }


def _never_fails(program: Program) -> bool:
    """Whether the function has a result for every usable input."""
    return program.status is None or program.status.failures == (REFUSED,)


def _evaluated(program: Program, states: dict[str, Array], parameters: dict[str, Array]) -> tuple[Any, ...]:
    known = {**states, **parameters}
    values = evaluate(program, *(known[_table(port)].reshape(-1, *port.shape) for port in program.inputs))
    count = len(states["q"])
    return tuple(np.broadcast_to(v, (count, *port.shape)) for v, port in zip(values, program.outputs, strict=True))


def _is_positive(programs: Mapping[str, Program], states: dict[str, Array], parameters: dict[str, Array]) -> bool:
    """Whether M is positive definite at all states; it may not be, as unphysical inertias are only warned about."""
    if "mass_matrix" not in programs:
        return False
    (M,) = _evaluated(programs["mass_matrix"], states, parameters)
    return bool(np.linalg.eigvalsh(M).min() > 1e-9 * np.abs(M).max())


def _specializations(model: DerivedModel, dialect: Dialect) -> list[dict[str, Any]]:
    """The template variables that compare functions with their nominal specializations: both calls, and the results.

    Functions that can fail are left out, because their values are as uncertain as M is ill-conditioned.
    """
    specializations = []
    for name, program in model.programs.items():
        nominal = specialization(model.programs, name)
        if nominal is None or not _never_fails(nominal):
            continue
        results = [port.name for port in program.data_outputs]
        general = [*_arguments(program), *(f"{result}_general" for result in results)]
        special = [*_arguments(nominal), *(f"{result}_special" for result in results)]
        specializations.append(
            {
                "name": name,
                "general": f"{function_name(program, dialect)}({', '.join(general)})",
                "nominal": f"{function_name(nominal, dialect)}({', '.join(special)})",
                "results": [(port.name, port.size) for port in program.data_outputs],
            }
        )
    return specializations


def _arguments(program: Program) -> list[str]:
    """The arguments of a call in C: row k of the tables of states, and the parameter vectors."""
    return [_argument(port) for port in program.inputs]


def _argument(port: Port) -> str:
    table = _table(port)
    if port.shape == ():
        return f"{table}[0]"
    return f"{table}[k]" if table in STATES else table


def _table(port: Port) -> str:
    """The name of the C table that holds the values of an input; it contains the size where that can vary."""
    if port.role in TABLES:
        return TABLES[port.role]
    return port.name if port.name in GIVEN else f"{port.name}_{port.size}"


def _rows(table: Array) -> tuple[str, ...]:
    """One C initializer in braces per state, wrapped over lines."""
    return tuple("{" + ",\n     ".join(_lines(row)) + "}" for row in table)


def _lines(values: Array, width: int = 108) -> list[str]:
    """Numbers ``R(...)`` joined by commas, as lines of at most ``width`` characters."""
    lines, line = [], ""
    for value in values:
        cell = f"R({float(value) + 0.0!r})"  # + 0.0 turns -0.0 into 0.0
        if line and len(line) + len(cell) + 2 > width:
            lines.append(line)
            line = cell
        else:
            line = f"{line}, {cell}" if line else cell
    return [*lines, line]
