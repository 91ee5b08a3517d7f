"""Differential inverse kinematics in C: joint speeds dq for a wanted tip velocity V, within all joint limits.

Each tick solves a quadratic program whose only constraints are bounds on dq: minimize
``sum_i w_i (J dq - V)_i^2 + damping^2 |dq - dq_ref|^2``. The bounds follow from the limits of position, speed and
acceleration. The damping makes the solution unique; alone it would limit neither speeds nor accelerations near singular
configurations.
"""

from __future__ import annotations

from fractions import Fraction

from rrrgen.backends import Real
from rrrgen.backends.c.dialect import Dialect
from rrrgen.backends.c.functions import Extension, function_files
from rrrgen.backends.comments import columns

DAMPING = 0.02
"""Default damping (m, rad): small compared with the singular values of the Jacobian at regular configurations."""

LARGEST = {"double": 1e150, "float": 1e15}
ROUNDING = {"double": Fraction(1, 2**52), "float": Fraction(1, 2**23)}
TOLERANCE = 64
"""Values whose magnitude is below this many rounding errors of the terms they are summed from count as zero."""

REAL_BYTES = {"double": 8, "float": 4}
PROMISE = (
    "The function has no state, allocates nothing and takes a bounded time; it may be called from several threads at "
    "once. Matrices are row-major."
)


SWEEPS = 2
"""Number of coordinate-descent sweeps that find the first active set."""

BLOCKS = 5
"""Number of active sets tried by block pivoting; then joints enter or leave the set one at a time."""


def steps(n: int) -> int:
    """Limit on the iterations of the active-set method, each of which frees or binds one of the ``n`` joints."""
    return 8 + 4 * n


def differential_ik_files(robot: str, n: int, real: Real) -> dict[str, str]:
    """Header and source of the C function ``<robot>_differential_ik`` for a robot of ``n`` joints, name -> text."""
    prefix = f"{robot}_differential_ik"
    dialect = Dialect(prefix, real)

    def literal(value: float | Fraction) -> str:
        return dialect.literal(Fraction(value))

    arguments = columns(
        [
            ("in", "q", "rad | m", "joint positions"),
            ("in", "dq_last", "per s", "joint speeds of the last tick, as this function returned them"),
            ("in", "J", "m, -", "Jacobian (6 x n) of the tip or of a point, row-major"),
            ("in", "V", "m/s, rad/s", "wanted velocity, linear, then angular, in the axes of J"),
            ("in", "weight", "", "of the rows, >= 0; zero leaves a row out"),
            ("in", "dq_ref", "per s", "joint speeds to prefer where V leaves a choice; zero for none"),
            ("in", "damping", "m, rad", f"> 0, such as {DAMPING:g}"),
            ("in", "q_min, q_max", "rad | m", "limits of the positions; -INFINITY and INFINITY for none"),
            ("in", "dq_max", "per s", "largest speeds, >= 0; INFINITY for none"),
            ("in", "ddq_max", "per s^2", "largest accelerations, >= 0; INFINITY for none"),
            ("in", "Ts", "s", "period"),
            ("out", "dq", "per s", "joint speeds for this tick"),
        ]
    )
    values: dict[str, object] = {
        "n": n,
        "steps": steps(n),
        "sweeps": SWEEPS,
        "blocks": BLOCKS,
        "arguments": arguments,
        "stack": 512 + (2 * n * n + 9 * n) * REAL_BYTES[real] + 12 * n,
        "zero": literal(0.0),
        "one": literal(1.0),
        "two": literal(2.0),
        "largest": literal(LARGEST[real]),
        "epsilon": literal(ROUNDING[real]),
        "tolerance": literal(TOLERANCE * ROUNDING[real]),
        "sqrt": dialect.function("sqrt"),
        "fabs": dialect.function("fabs"),
    }
    title = f"differential inverse kinematics of {robot} within speeds, accelerations and positions"
    return function_files(prefix, title, [], real, extension=Extension("differential_ik", values, PROMISE))
