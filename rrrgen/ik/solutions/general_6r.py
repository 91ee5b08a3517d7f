"""Tables for the solver of general six-joint chains: any geometry, at most one joint prismatic.

Such a chain has up to 16 solutions, the real roots of a polynomial of degree 16 (Raghavan and Roth, 1990).
:mod:`rrrgen.ik.solutions.elimination` derives the equations, ``templates/c/ik/general6r.c`` solves them at run time:

* The polynomial is kept in trigonometric form (degree 8 in the angle), interpolated from 17 values of a determinant.
  Unlike a polynomial in the half-angle tangent it has no root at infinity.
* Where several roots lie closer together than its noise resolves, that arc of the circle is magnified by a Moebius
  transform, which keeps the degree, and the determinant is sampled again there.
* The compiler chooses the labelling of the joints for the least loss of digits. Where the result is in doubt (a root
  that yields no solution of its own, or an odd number of solutions) the solver repeats the computation at poses nearby
  and with a second labelling.
* Every solution is refined on the target pose, so that its error is that of forward kinematics.

A seven-joint chain whose first or last joint is prescribed is solved as a six-joint chain whose base or tool moves with
that joint.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

from rrrgen.base.errors import DerivationError
from rrrgen.ik.geometry.chain import Joint, KinematicChain, Link
from rrrgen.ik.recording.steps import Stage
from rrrgen.ik.solutions.elimination import Elimination, eliminations, shallowness
from rrrgen.ik.tolerances import (
    BEYOND_SPAN,
    MOST_NOISE,
    NOISE,
    NOISE_FACTORS,
    NOISE_OF_FLOAT,
    QUARTER,
    SPAN_LEAST,
    SPAN_STEPS,
)

MAX_SOLUTIONS = 16

ASPECT = ("aspect", 0, 1)
"""Branch label (name, lowest bit, bits) of a general arm, which has no shoulder, elbow or wrist: the sign of the
determinant of the Jacobian. It is constant along a path that meets no singular configuration."""


@dataclass(frozen=True)
class General6RTables:
    """DH table of a six-joint chain and the eliminations that solve it.

    ``rows`` are (cos alpha, sin alpha, a, d), with lengths in units of ``length`` (m). ``eliminations`` holds one or
    two choices, best first. Joint ``slide`` (0 .. 5), if any, is prismatic; ``turn`` is the cosine and sine of its
    theta. ``span`` bounds the targets, see :func:`longest_span`; None with a prismatic joint, which may go anywhere.
    """

    rows: tuple[tuple[float, float, float, float], ...]
    length: float
    eliminations: tuple[Elimination, ...]
    slide: int | None = None
    turn: tuple[float, float] = (1.0, 0.0)
    span: tuple[float, float, float] | None = None


def general6r_tables(
    alpha: Sequence[float], a: Sequence[float], d: Sequence[float], slide: int | None = None, theta: float = 0.0
) -> General6RTables:
    """Compute the tables for the chain Rz(q1) Tz(d1) Tx(a1) Rx(alpha1) .. Rz(q6) Tz(d6) Tx(a6) Rx(alpha6).

    ``alpha`` (rad), ``a`` and ``d`` (m) have six entries each. Joint ``slide`` (0 .. 5), if given, is prismatic with
    the link Tz(q) Rz(theta) Tx(a) Rx(alpha), ``theta`` in rad and d = 0.

    Raises :class:`DerivationError` when every elimination is singular, for example on chains with a spherical triple
    of axes, which have a simpler closed form.
    """
    length = 0.25 * float(sum(abs(x) for x in (*a, *d)))
    if not length > 0:
        raise DerivationError("six joints without any length between them are no general chain")
    rows6 = list(zip(alpha, (x / length for x in a), (x / length for x in d), strict=True))
    choices = eliminations(rows6, slide, theta)
    if not choices:
        raise DerivationError(
            "every elimination for six joints is singular on this chain: its axes have a special structure "
            "(three through one point, or more parallel ones) that the general solver cannot take"
        )
    second = [e for e in choices if e.kept_joint != choices[0].kept_joint]
    rows = tuple((*cosine_and_sine(x), y / length, z / length) for x, y, z in zip(alpha, a, d, strict=True))
    span = longest_span(rows) if slide is None else None
    return General6RTables(rows, length, (choices[0], *second[:1]), slide, cosine_and_sine(theta), span)


def longest_span(rows: Sequence[tuple[float, float, float, float]]) -> tuple[float, float, float]:
    """Bound the distance between a point of axis 1, fixed to the base, and one of axis 6, fixed to the last link.

    Points P_1 .. P_6 on the axes of six revolute joints, P_i at s_i along z of axis i, are the corners of a line whose
    sides have constant lengths, because axes i and i + 1 belong to one link:
    |P_i P_i+1|^2 = a_i^2 + (sin(alpha_i) s_i+1)^2 + (d_i + cos(alpha_i) s_i+1 - s_i)^2. Returns s_1 and s_6 of the
    shortest such line, in the units of ``rows``, and its length: a target with a longer distance P_1 P_6 is out of
    reach. Any other points would bound it too, so that a rough minimum does: the squares of the sides, weighted by
    their inverse lengths, are summed and minimized again and again.
    """
    s = [0.0] * 6

    def sides() -> list[float]:
        return [
            math.hypot(a, sine * s[i + 1], d + cosine * s[i + 1] - s[i])
            for i, (cosine, sine, a, d) in enumerate(rows[:5])
        ]

    for _ in range(SPAN_STEPS):
        weights = [1.0 / (side + SPAN_LEAST) for side in sides()]
        diagonal = [x + y + SPAN_LEAST for x, y in zip([*weights, 0.0], [0.0, *weights], strict=True)]
        right = [w * row[3] for w, row in zip(weights, rows, strict=False)] + [0.0]
        for i, (w, row) in enumerate(zip(weights, rows, strict=False)):  # tridiagonal: elimination of s_i
            right[i + 1] -= w * row[0] * row[3]
            factor = -row[0] * w / diagonal[i]
            diagonal[i + 1] += factor * row[0] * w
            right[i + 1] -= factor * right[i]
        for i in range(5, -1, -1):
            after = weights[i] * rows[i][0] * s[i + 1] if i < 5 else 0.0
            s[i] = (right[i] + after) / diagonal[i]
    s = [round(x, 6) + 0.0 for x in s]
    return s[0], s[5], round(sum(sides()) * (1.0 + BEYOND_SPAN), 6)


@cache
def tables_of(chain: KinematicChain, locked: int | None = None) -> General6RTables:
    """Compute the tables of ``chain``, a chain of six joints, or of seven of which ``locked`` (first or last) is given.

    Constant angles about the axes of revolute joints are not part of the tables; :func:`shifts` returns them.
    """
    joints, links = free_joints(chain, locked)
    alpha = [math.atan2(float(link.sa), float(link.ca)) for link in links]
    a, d = ([float(getattr(link, name)) for link in links] for name in ("a", "d"))
    slides = [k for k, joint in enumerate(joints) if not joint.revolute]
    if not slides:
        return general6r_tables([*alpha, 0.0], [*a, 0.0], [*d, 0.0])
    turns = [*_turns(links), 0.0]
    return general6r_tables([*alpha, 0.0], [*a, 0.0], [*d, 0.0], slides[0], turns[slides[0]])


def is_general(chain: KinematicChain, locked: int | None) -> bool:
    """Whether the general solver applies: six joints besides ``locked``, at most one of them prismatic.

    ``locked`` is None or the prescribed joint, the first or the last of seven.
    """
    if locked not in (None, 0, chain.n - 1) or any(joint.name.startswith("virtual") for joint in chain.joints):
        return False
    joints, _ = free_joints(chain, locked)
    return len(joints) == 6 and sum(not joint.revolute for joint in joints) <= 1


def free_joints(chain: KinematicChain, locked: int | None) -> tuple[tuple[Joint, ...], tuple[Link, ...]]:
    """The six joints of ``chain`` without the prescribed joint ``locked`` (None: all), and the links between them."""
    if locked is None:
        return chain.joints, chain.links
    return (chain.joints[1:], chain.links[1:]) if locked == 0 else (chain.joints[:-1], chain.links[:-1])


def shifts(chain: KinematicChain, locked: int | None) -> list[float]:
    """Offsets (rad or m), one per joint, which added to joint values of the elimination give those of the chain.

    Each is minus the offset of the joint and, for a revolute joint, minus the constant rotation of its link about z.
    """
    joints, links = free_joints(chain, locked)
    turns = [turn if joint.revolute else 0.0 for joint, turn in zip(joints, [*_turns(links), 0.0], strict=True)]
    return [-float(joint.offset) - turn for joint, turn in zip(joints, turns, strict=True)]


def _turns(links: Sequence[Link]) -> list[float]:
    return [math.atan2(float(link.st), float(link.ct)) for link in links]


def root_stage(chain: KinematicChain, locked: int | None = None) -> Stage:
    """The one step of the general solver that has several results: up to 16 values of the joint in its polynomial.

    The elimination keeps this joint as its unknown; all others follow from it.
    """
    kept = tables_of(chain, locked).eliminations[0].kept_joint
    return Stage(free_joints(chain, locked)[0][kept].index, "degree-16", MAX_SOLUTIONS)


def passes(tables: General6RTables, real: str) -> list[tuple[tuple[int, ...], float]]:
    """List the eliminations that the solver tries in order, each with the relative noise of its polynomial.

    First the best elimination at the target, then the best and the second-best one at poses nearby. An entry is
    ((start, direction, kept, shifted, other, motion), noise) with the fields of :class:`Elimination`; ``motion``
    numbers the small displacement to the pose nearby, 0 for the target itself. ``real`` is the type of the target:
    that of a singular configuration, rounded to float, may have no solution, and is found among roots that are not
    resolved at the noise of this rounding.
    """
    first, last = tables.eliminations[0], tables.eliminations[-1]
    attempts: list[tuple[tuple[int, ...], float]] = []
    for motion, (choice, factor) in enumerate(zip((first, first, last), NOISE_FACTORS, strict=True)):
        roles = (choice.start, choice.direction, choice.kept, choice.shifted, choice.other, motion)
        attempts.append((roles, min(NOISE * factor * shallowness(choice.depth), MOST_NOISE)))
    coarse = (attempts[0][0], NOISE_OF_FLOAT)
    return [coarse, *attempts] if real == "float" and coarse[1] > attempts[0][1] else attempts


def cosine_and_sine(angle: float) -> tuple[float, float]:
    """Cosine and sine of ``angle`` (rad), correctly rounded and so the same on every machine.

    Values that differ from an integer only by the rounding of the angle, as at pi/2, become that integer.
    """
    import mpmath

    with mpmath.workdps(50):
        c, s = float(mpmath.cos(mpmath.mpf(angle))), float(mpmath.sin(mpmath.mpf(angle)))
    return tuple(round(x) if abs(x - round(x)) < QUARTER else x for x in (c, s))  # type: ignore[return-value]
