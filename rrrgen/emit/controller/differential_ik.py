"""Differential inverse kinematics in C: joint speeds dq for a wanted tip velocity V, within all joint limits.

Each tick solves a quadratic program whose only constraints are bounds on dq: minimize
``sum_i w_i (J dq - V)_i^2 + damping^2 |dq - dq_ref|^2``. The bounds follow from the limits of position, speed and
acceleration. The damping makes the solution unique; alone it would limit neither speeds nor accelerations near singular
configurations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from rrrgen.emit import Real
from rrrgen.emit.c.function_files import Extension, function_files
from rrrgen.emit.c.language import Dialect, nonfinite_function
from rrrgen.emit.printing import columns
from rrrgen.program import Port, Status

DAMPING = 0.02
"""Default damping (m, rad): small compared with the singular values of the Jacobian at regular configurations."""

LARGEST = {"double": 1e150, "float": 1e15}
ROUNDING = {"double": Fraction(1, 2**52), "float": Fraction(1, 2**23)}
TOLERANCE = 64
"""Values whose magnitude is below this many rounding errors of the terms they are summed from count as zero."""

ROUGH = {"double": 2**20, "float": 2**6}
"""Slopes that rounding leaves at free joints, in units of what counts as zero, with half of all digits lost: above them
a decomposition takes the place of a correction."""

REAL_BYTES = {"double": 8, "float": 4}
PROMISE = (
    "The function has no state, allocates nothing and takes a bounded time; it may be called from several threads at "
    "once. Matrices are row-major."
)


def steps(n: int) -> int:
    """Limit on the iterations of the active-set method, each of which frees or binds one of the ``n`` joints."""
    return 8 + 4 * n


@dataclass(frozen=True)
class Declaration:
    """Interface of a C function written from a template, from which wrappers in other languages are generated.

    ``name`` is that of the function without the robot's prefix, ``inputs`` and ``data_outputs`` are its arguments in C
    order; ``summary`` and ``formula`` describe what it computes, ``status`` what it returns.
    """

    name: str
    inputs: tuple[Port, ...]
    data_outputs: tuple[Port, ...]
    summary: str
    formula: str
    status: Status


def declaration(n: int) -> Declaration:
    """Interface of the C function ``differential_ik`` for a robot of ``n`` joints: arguments in C order, and status."""
    speed, largest = "rad/s | m/s", "INFINITY for none"
    inputs = (
        Port("q", (n,), "rad | m", "", "joint positions"),
        Port("dq_last", (n,), speed, "", "joint speeds of the last tick, as this function returned them"),
        Port("J", (6, n), "m, -", "", "Jacobian of the tip or of a point, row-major"),
        Port("V", (6,), "m/s, rad/s", "", "wanted velocity, linear, then angular, in the axes of J"),
        Port("weight", (6,), "", "", "of the rows, >= 0; zero leaves a row out"),
        Port("dq_ref", (n,), speed, "", "joint speeds to prefer where V leaves a choice; zero for none"),
        Port("damping", (), "m, rad", "", f"> 0, such as {DAMPING:g}"),
        Port("q_min", (n,), "rad | m", "", "smallest positions; -INFINITY for none"),
        Port("q_max", (n,), "rad | m", "", f"largest positions; {largest}"),
        Port("dq_max", (n,), speed, "", f"largest speeds, >= 0; {largest}"),
        Port("ddq_max", (n,), "rad/s^2 | m/s^2", "", f"largest accelerations, >= 0; {largest}"),
        Port("Ts", (), "s", "", "period"),
    )
    meaning = (
        "1: a joint is too fast for its limits and slows down; 2: the active set was not found; 3: an input is not "
        "finite, limits contradict each other, a weight is negative, or damping or Ts is not positive"
    )
    return Declaration(
        "differential_ik",
        inputs,
        (Port("dq", (n,), speed, "", "joint speeds for this tick"),),
        "Joint speeds for a velocity of the tip, within speeds, accelerations and positions.",
        "minimize  sum over k of weight_k (J dq - V)_k^2 + damping^2 |dq - dq_ref|^2  within the limits",
        Status.of(1, "LIMITS", "no joint speeds within all limits", meaning),
    )


def differential_ik_files(robot: str, n: int, real: Real) -> dict[str, str]:
    """Header and source of the C function ``<robot>_differential_ik`` for a robot of ``n`` joints, name -> text."""
    prefix = f"{robot}_differential_ik"
    dialect = Dialect(prefix, real)

    def literal(value: float | Fraction) -> str:
        return dialect.literal(Fraction(value))

    declared, fabs = declaration(n), dialect.function("fabs")
    rows = [(way, port) for way, ports in (("in", declared.inputs), ("out", declared.data_outputs)) for port in ports]
    arguments = columns([(way, port.name, port.unit, port.meaning) for way, port in rows])
    values: dict[str, object] = {
        "n": n,
        "steps": steps(n),
        "arguments": arguments,
        "stack": 512 + (3 * n * n + 16 * n) * REAL_BYTES[real] + 12 * n,
        "zero": literal(0.0),
        "one": literal(1.0),
        "two": literal(2.0),
        "largest": literal(LARGEST[real]),
        "epsilon": literal(ROUNDING[real]),
        "tolerance": literal(TOLERANCE * ROUNDING[real]),
        "rough": literal(ROUGH[real]),
        "sqrt": dialect.function("sqrt"),
        "fabs": fabs,
        "row_x": _sum_of_products([(f"row[{k}]", f"x[{k}]") for k in range(n)]),
        "row_slope": _sum_of_products([(f"row[{k}]", f"slope[{k}]") for k in range(n)]),
        "size_x": " + ".join(f"{fabs}(row[{k}] * x[{k}])" for k in range(n)),
        "column_other": _sum_of_products([(f"column[{k}]", f"other[{k * n}]") for k in range(6)]),
    }
    title = f"differential inverse kinematics of {robot} within speeds, accelerations and positions"
    return function_files(
        prefix, title, [], real, extension=Extension("differential_ik", values, PROMISE, nonfinite_function(dialect))
    )


def _sum_of_products(factors: Sequence[tuple[str, str]]) -> str:
    """The C text of ``sum of x y`` over ``factors``, added in pairs as a balanced tree, faster than one chain."""
    if len(factors) == 1:
        return " * ".join(factors[0])
    half = (len(factors) + 1) // 2
    return f"({_sum_of_products(factors[:half])}) + ({_sum_of_products(factors[half:])})"
