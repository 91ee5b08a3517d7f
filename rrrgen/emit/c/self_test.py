"""The emitted self-test, a C program that checks the emitted functions on the processor that they are built for.

It compares results with golden values, computed by the reference evaluation in Python, and checks identities of
mechanics.
"""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from math import fsum
from typing import TYPE_CHECKING, Any

from rrrgen.base.small_matrices import is_positive_definite
from rrrgen.base.templates import render
from rrrgen.derive.functions.friction import friction_parameters
from rrrgen.derive.recursions.loop_positions import CLOSED, LoopClosure, parts_of
from rrrgen.emit.c.header_comments import function_name
from rrrgen.emit.c.language import Dialect
from rrrgen.emit.interface import SelfTestCheck
from rrrgen.program import REFUSED, Domain, Op, Port, Program, Role, evaluate_floats, specialization
from rrrgen.robot.identity import Identity
from rrrgen.robot.model import build_model
from rrrgen.robot.spec import standard_parameters

if TYPE_CHECKING:
    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.robot.spec import RobotSpec

Table = list[list[float]]
"""Values of an input at several states, one row per state."""

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
    Role.LOOPS: "loop_q",
    Role.REFERENCE_VELOCITY: "ddq",
    Role.REFERENCE_ACCELERATION: "q",
    Role.BASE_PARAMETERS: "beta",
    Role.STANDARD_PARAMETERS: "phi",
    Role.FRICTION: "friction",
    Role.GRAVITY: "gravity",
}
"""Name of the C table from which the self-test reads an input, by the role of the input; inputs of other roles have
tables of their own."""

STATES = ("q", "dq", "ddq", "e", "loop_q")
"""The C tables of the self-test that have one row per state; the last one with loops that Newton's method solves."""

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


def selftest(
    model: DerivedModel, identity: Identity, dialect: Dialect, checks: Sequence[SelfTestCheck] = ()
) -> dict[str, str]:
    """Print ``<name>_selftest.c``, a program that prints a line per check and exits with 0, or with 1 if one fails.

    ``checks`` test functions that have headers of their own, such as the inverse kinematics.
    """
    states = _states(model)
    parameters = _parameters(model)
    golden = _golden(model.programs, states, parameters, frozenset() if model.spec.newton else BY_IDENTITY)
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
        functions=set() if model.spec.newton else set(model.programs),  # the identities need loops at further positions
        passive=len(states.get("loop_q", [[]])[0]),
        gravity="gravity, " if model.spec.gravity_input else "",
        positive=_is_positive(model.programs, states, parameters),
        specializations=_specializations(model, dialect),
        checks=checks,
        solves=any(check.function.endswith("inverse_kinematics") for check in checks),
    )
    return {f"{dialect.prefix}_selftest.c": text}


def _states(model: DerivedModel) -> dict[str, Table]:
    """The states of the self-test: rest and motion at zero, right angles, half turns (singular for most), random ones.

    All numbers are multiples of 1/64, which are exact in float and double. Closed loops are assembled at all states.
    """
    spec = model.spec
    n = spec.n
    span = [3.0 if joint.is_revolute else 0.5 for joint in spec.joints]
    turn = [101 / 64 if joint.is_revolute else 0.25 for joint in spec.joints]  # 101/64 is close to pi/2
    scattered = _random_table(4, 4 * n)
    places = [[round(64 * x * most) / 64 for x, most in zip(row, span, strict=False)] for row in scattered]
    q = [[0.0] * n, [0.0] * n, turn, [2 * x for x in turn], *places]
    loop_q = None
    if spec.newton:
        q, loop_q = _positions_along_walk(spec, len(q))
    elif spec.loops:
        q = _positions_off_dead_points(model.programs["closed_loops"], span, len(q))
    moving = [_random_table(1, 3 * n, seed)[0] for seed in (5, 6, 7)]
    others = [[0.0] * (3 * n), *moving, *(row[n:] for row in scattered)]
    others = [[round(128 * x) / 64 for x in row] for row in others]  # up to 2 rad/s and rad/s^2
    parts = {name: [row[k * n : (k + 1) * n] for row in others] for k, name in enumerate(STATES[1:4])}
    return {"q": q, **parts} if loop_q is None else {"q": q, **parts, "loop_q": loop_q}


def _positions_off_dead_points(closed_loops: Program, span: Sequence[float], count: int) -> Table:
    """Random positions at which closed loops are farthest from their dead points."""
    drawn = [
        [round(64 * x * most) / 64 for x, most in zip(row, span, strict=True)] for row in _random_table(512, len(span))
    ]
    sines = [min(evaluate_floats(closed_loops, row)[2]) for row in drawn]
    best = sorted(range(len(drawn)), key=lambda k: -sines[k])
    return [drawn[k] for k in best[:count]]


def _positions_along_walk(spec: RobotSpec, count: int) -> tuple[Table, Table]:
    """Positions of drives and passive joints, away from dead points, along a random walk from the start of the file.

    Those of the drives are multiples of 1/64.
    """
    loops = LoopClosure(build_model(spec))
    start = [round(64 * x) / 64 for x in loops.drives]
    at, passive = start, loops.follow(start, loops.start, loops.drives, 1)
    side = loops.loops([*at, *passive]).sine
    positions = [(at, passive)]
    for drawn in _random_table(64 * count, spec.n, 9):
        target = [x + round(16 * dx) / 64 for x, dx in zip(at, drawn, strict=True)]
        moved = loops.follow(target, passive, at, parts_of(0.25))
        share = loops.loops([*target, *moved]).sine / side
        if share > 0.3 and loops.gap(target, moved) < CLOSED:
            at, passive = target, moved
            positions.append((at, passive))
        if len(positions) == count:
            break
    return [list(q) for q, _ in positions], [list(loop_q) for _, loop_q in positions]


def _random_table(rows: int, columns: int, seed: int = 1) -> Table:
    """A table of random numbers in (-1, 1), by a linear congruential generator."""
    values, state = [], seed
    for _ in range(rows * columns):
        state = (1103515245 * state + 12345) % 2**31
        values.append(2 * (state >> 16) / 2**15 - 1)
    return [values[k * columns : (k + 1) * columns] for k in range(rows)]


def _parameters(model: DerivedModel) -> dict[str, list[float]]:
    """The parameters phi and beta of the robot file; made up for plausible links if the file states none."""
    known = [[float(x) for x in standard_parameters(link)] for link in model.spec.links or ()]
    phi = list(chain.from_iterable(known or _plausible(len(model.spec.rows))))
    nominal = model.beta_nominal
    if nominal is None:  # beta = K phi
        beta = [fsum(float(k) * x for k, x in zip(row, phi, strict=True)) for row in model.base_projection]
    else:
        beta = [float(x) for x in nominal]
    drives = [float(value) for value in model.drive_inertia_nominal or ()]
    parameters = {"phi": phi + drives, "beta": beta + drives}
    if any(program.takes(Role.FRICTION) for program in model.programs.values()):
        stated = [float(value) for _, value in friction_parameters(model.spec)]
        parameters["friction"] = [value or 0.25 + k / 64 for k, value in enumerate(stated)]
    if model.spec.gravity_input:
        parameters["gravity"] = GRAVITY
    for program in _with_golden(model.programs).values():
        for port in program.inputs:
            if (name := _table(port)) not in (*STATES, *parameters):
                sign = -1.0 if port.domain is Domain.LOWER else 1.0
                parameters[name] = GIVEN[name] if name in GIVEN else [sign * abs(x) for x in _some(port)]
    return parameters


def _some(port: Port) -> list[float]:
    """Arbitrary values for an input of any shape: multiples of 1/64, below 1 in magnitude, none of them zero."""
    return [(round(31 * x) * 2 + 1) / 64 for x in _random_table(1, port.size, len(port.name))[0]]


def _plausible(n: int) -> Table:
    """Standard parameters of ``n`` made-up links, ten each, none of them zero, for which M is positive definite.

    The mass decreases from link to link; the centre of mass of each link lies off all axes of its frame.
    """
    rows = []
    for i in range(n):
        m, (x, y, z) = 2.0 - i / n, (0.125, -0.0625, 0.03125)
        inertia = (0.03125 + y * y + z * z, -x * y, 0.046875 + x * x + z * z, -x * z, -y * z, 0.0390625 + x * x + y * y)
        rows.append([m, m * x, m * y, m * z, *(m * entry for entry in inertia)])
    return rows


def _golden(
    programs: Mapping[str, Program],
    states: Mapping[str, Table],
    parameters: Mapping[str, list[float]],
    excluded: Container[str],
) -> list[Golden]:
    goldens = []
    for name, program in _with_golden(programs, excluded).items():
        results = []
        values_of = dict(zip(program.outputs, _evaluate_states(program, states, parameters), strict=True))
        for port in program.data_outputs:
            rows = values_of[port]
            scale = max(1e-6, *(abs(x) for row in rows for x in row))
            table, variable = (
                (f"{name}_{port.name}", f"x_{port.name}") if len(program.data_outputs) > 1 else (name, "result")
            )
            results.append(GoldenResult(table, variable, port.size, f"{scale:.3g}", _rows(rows)))
        goldens.append(Golden(name, ", ".join(_arguments(program)), tuple(results), _is_arithmetic(program)))
    return goldens


def _is_arithmetic(program: Program) -> bool:
    return not any(node.op in (Op.EXP, Op.TANH) for node in program.nodes)


def _with_golden(programs: Mapping[str, Program], excluded: Container[str] = BY_IDENTITY) -> dict[str, Program]:
    """The functions that are compared with golden vectors: all but specializations and those ``excluded``."""
    return {
        name: program
        for name, program in programs.items()
        if _never_fails(program) and name not in excluded and not program.specializes
    }


def _never_fails(program: Program) -> bool:
    """Whether the function has a result for every usable input."""
    return program.status is None or program.status.failures == (REFUSED,)


def _evaluate_states(
    program: Program, states: Mapping[str, Table], parameters: Mapping[str, list[float]]
) -> tuple[Table, ...]:
    """For every output of a program its flat values at all states."""
    tables = [_table(port) for port in program.inputs]
    results = [
        evaluate_floats(program, *(states[name][k] if name in states else parameters[name] for name in tables))
        for k in range(len(states["q"]))
    ]
    return tuple(map(list, zip(*results, strict=True)))


def _is_positive(
    programs: Mapping[str, Program], states: Mapping[str, Table], parameters: Mapping[str, list[float]]
) -> bool:
    """Whether M is positive definite at all states; it may not be, as unphysical inertias are only warned about."""
    if "mass_matrix" not in programs:
        return False
    (values,) = _evaluate_states(programs["mass_matrix"], states, parameters)
    least, n = 1e-9 * max(abs(x) for M in values for x in M), len(states["q"][0])
    return all(is_positive_definite([M[n * i : n * (i + 1)] for i in range(n)], least) for M in values)


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


def _rows(table: Table) -> tuple[str, ...]:
    """One C initializer in braces per state, wrapped over lines."""
    return tuple("{" + ",\n     ".join(_lines(row)) + "}" for row in table)


def _lines(values: Sequence[float], width: int = 108) -> list[str]:
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
