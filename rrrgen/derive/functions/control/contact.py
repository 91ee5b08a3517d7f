"""Recorders of contact detection from estimated external torques r: thresholds, and the wrench at a point.

The joint torques of a wrench F at a point with Jacobian J are ``r = J' F``. With independent errors of r, of standard
deviations sigma, the best estimate and its covariance are

    F = P J R r,   P = inv(J R J'),   R = diag(1/sigma^2).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rrrgen.derive.algebra.positive_definite import factorize
from rrrgen.derive.algebra.vectors import Matrix, dot, flat, times
from rrrgen.derive.functions.recording import Recorder, Recording
from rrrgen.program import Port, Program, Status


def contact(r: Recording) -> Program:
    """Record contact detection: the ratios |r_i| / threshold_i (n,) of external torques r, and 1 if one exceeds 1."""
    b = r.builder
    estimate = r.extra("r", (r.n,), r.torque_unit, "estimated torques of the environment, of the momentum observer")
    threshold = r.extra("threshold", (r.n,), r.torque_unit, "of contact-free motion, of `rrrgen contact-thresholds`")
    ratios = [b.div(b.abs(value), limit) for value, limit in zip(estimate, threshold, strict=True)]
    found: Any = 0
    for ratio in ratios:
        found = b.select(b.sub(ratio, 1), 1, found)
    return b.program(
        "contact",
        [
            (Port("ratio", (r.n,), "", "", "magnitude of each torque over its threshold"), ratios),
            (Port("touches", (), "", "", "1 if a ratio exceeds 1, else 0"), [found]),
        ],
        "Contact detection: whether an external torque exceeds its threshold.",
        "ratio = |r|/threshold",
        ["INFINITY leaves a joint out. A threshold of zero makes any torque a contact."],
    )


@dataclass(frozen=True)
class _Load:
    """The kind of load to estimate: a wrench (6 rows of the Jacobian) or a pure force (the first 3 rows).

    ``name`` is that of the function, ``words`` and ``unit`` describe its result in emitted files.
    """

    rows: int
    name: str
    words: str
    unit: str


WRENCH = _Load(6, "external_wrench", "force and moment", "N, N m")
FORCE = _Load(3, "external_force", "force without a moment", "N")


def external_load(load: _Load) -> Recorder:
    """Make a recorder of the wrench or force at a point that causes the external torques r.

    The function's outputs are the estimate, its covariance and its condition number.
    """

    def record(r: Recording) -> Program:
        b, count = r.builder, load.rows
        J = r.extra("J", (6, r.n), "m, -", "Jacobian of the tip or of the point where the load acts")
        estimate = r.extra("r", (r.n,), r.torque_unit, "estimated torques of the environment")
        sigma = r.extra("sigma", (r.n,), r.torque_unit, "standard deviations of r, > 0")
        rows = [J[r.n * i : r.n * (i + 1)] for i in range(count)]
        weighted = [[b.div(x, s) for x, s in zip(row, sigma, strict=True)] for row in rows]
        G = [[dot(x, y) for y in weighted] for x in weighted]
        factors = factorize(b, G)
        P = [[b.neg(value) for value in row] for row in factors.negative_inverse()]
        scaled = [b.div(value, s) for value, s in zip(estimate, sigma, strict=True)]
        F = times(P, times(weighted, scaled))
        return b.program(
            load.name,
            [
                (Port("F", (count,), load.unit, "base frame", f"{load.words} on the arm"), F),
                (Port("P", (count, count), "", "base frame", "its covariance"), flat(P)),
                (
                    Port("condition", (), "", "", "at least 1; large near singular configurations"),
                    [_condition(r, G, P)],
                ),
                (Port("status", ()), [factors.status]),
            ],
            f"The {load.words} that estimated external torques are due to.",
            "F = P J R r,  P = inv(J R J'),  R = diag(1/sigma^2)",
            [
                f"J: its first {count} rows. F, P and condition are 0 where the status is not ok.",
                "condition = sqrt(mean eigenvalue of J R J' times that of P), linear and angular rows scaled to one "
                f"mean first; the largest over the smallest singular value is between this and {count} times this.",
            ],
            Status(3, "undetermined", "the torques do not determine the load", "the rows of the Jacobian lose rank"),
        )

    return record


def _condition(r: Recording, G: Matrix, P: Matrix) -> Any:
    """Condition number of G, from G and its inverse P, after scaling.

    The linear and the angular rows and columns are each scaled so that the mean of their diagonal entries is one.
    """
    total: Any = 0
    count = len(G)
    for part in range(0, count, 3):
        ends = range(part, part + 3)
        total = total + dot([1] * 3, [G[k][k] for k in ends]) / 3 * dot([1] * 3, [P[k][k] for k in ends])
    return r.builder.sqrt(total / count)


FUNCTIONS: dict[str, tuple[Recorder, ...]] = {
    "contact": (contact,),
    "external_wrench": (external_load(WRENCH),),
    "external_force": (external_load(FORCE),),
}

MORE_JOINTS_THAN = {"external_wrench": WRENCH.rows - 1, "external_force": FORCE.rows - 1}
"""Functions that exist only for arms with more joints than this: a wrench is found from at least six joint torques, a
force from at least three."""
