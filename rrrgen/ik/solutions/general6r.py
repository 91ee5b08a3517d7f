"""Six joints in general, at most one of them prismatic: tables of the solver for any such chain.

Up to 16 solutions, the real roots of a polynomial of degree 16 (Raghavan and Roth, 1990): see
:mod:`rrrgen.ik.solutions.elimination` for the equations, ``templates/c/ik/general6r.c`` for the solver. What is
special here:

* the polynomial is a trigonometric one, found from 17 values of a determinant; nothing lies at infinity;
* where roots crowd together in its noise, that stretch of the circle is magnified (a Moebius map of the circle keeps
  the degree) and sampled again, relative to itself;
* the compiler chooses the labelling of the joints; a second choice and poses nearby rescue what the first one leaves in
  doubt: a root without a row of its own, or an odd number of rows;
* rows are polished on the pose, so that their error is that of forward kinematics.

Seven joints whose first or last one is prescribed are such a chain, whose base or tool moves with that joint.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from rrrgen.errors import DerivationError
from rrrgen.ik.geometry.chain import Chain, Joint, Link
from rrrgen.ik.recording.steps import Stage
from rrrgen.ik.solutions.elimination import Elimination, eliminations, shallowness
from rrrgen.ik.tolerances import LEAST_NOISE, MOST_NOISE, NOISE, NOISE_FACTORS, QUARTER

MAX_SOLUTIONS = 16

ASPECT = ("aspect", 0, 1)
"""The branch label of a general arm, which has no shoulder, elbow or wrist: the sign of the Jacobian's determinant. It
stays the same along a path that meets no singular configuration."""


@dataclass(frozen=True)
class General6RTables:
    """The chain of six joints in the form that the elimination reads, and the eliminations to use.

    ``rows`` of (cos alpha, sin alpha, a, d) with lengths in units of ``length`` (m), and the eliminations to use, best
    first (one or two). Joint ``slide`` (0 .. 5) is prismatic; ``turn`` is the cosine and sine of its constant angle.
    """

    rows: tuple[tuple[float, float, float, float], ...]
    length: float
    eliminations: tuple[Elimination, ...]
    slide: int | None = None
    turn: tuple[float, float] = (1.0, 0.0)


def general6r_tables(
    alpha: Sequence[float], a: Sequence[float], d: Sequence[float], slide: int | None = None, theta: float = 0.0
) -> General6RTables:
    """Tables for the chain Rz(q1) Tz(d1) Tx(a1) Rx(alpha1) .. Rz(q6) Tz(d6) Tx(a6) Rx(alpha6), in rad and m.

    Joint ``slide`` (0 .. 5) slides instead: Tz(q) Rz(theta) Tx(a) Rx(alpha), d = 0.

    Raises :class:`DerivationError` when every elimination is singular, as on chains with a spherical triple of axes,
    which are solved in simpler ways.
    """
    length = 0.25 * float(sum(abs(x) for x in (*a, *d)))
    if not length > 0:
        raise DerivationError("six joints without any length between them are no general chain")
    rows6 = np.array([alpha, [x / length for x in a], [x / length for x in d]], dtype=float).T
    choices = eliminations(rows6, slide, theta)
    if not choices:
        raise DerivationError(
            "every elimination for six joints is singular on this chain: its axes have a special structure "
            "(three through one point, or more parallel ones) that the general solver cannot take"
        )
    second = [e for e in choices if e.kept_joint != choices[0].kept_joint]
    rows = tuple((*_turn(x), y / length, z / length) for x, y, z in zip(alpha, a, d, strict=True))
    return General6RTables(rows, length, (choices[0], *second[:1]), slide, _turn(theta))


@cache
def tables_of(chain: Chain, locked: int | None = None) -> General6RTables:
    """:func:`general6r_tables` of the six joints that are not ``locked`` (the first or last of seven).

    Angles about the axes of revolute joints are left to the caller.
    """
    joints, links = free_joints(chain, locked)
    alpha = [math.atan2(float(link.sa), float(link.ca)) for link in links]
    a, d = ([float(getattr(link, name)) for link in links] for name in ("a", "d"))
    slides = [k for k, joint in enumerate(joints) if not joint.revolute]
    if not slides:
        return general6r_tables([*alpha, 0.0], [*a, 0.0], [*d, 0.0])
    turns = [*_turns(links), 0.0]
    return general6r_tables([*alpha, 0.0], [*a, 0.0], [*d, 0.0], slides[0], turns[slides[0]])


def is_general(chain: Chain, locked: int | None) -> bool:
    """Whether six joints, one of them sliding at most, are left beside ``locked``, the first or the last of seven."""
    if locked not in (None, 0, chain.n - 1) or any(joint.name.startswith("virtual") for joint in chain.joints):
        return False
    joints, _ = free_joints(chain, locked)
    return len(joints) == 6 and sum(not joint.revolute for joint in joints) <= 1


def free_joints(chain: Chain, locked: int | None) -> tuple[tuple[Joint, ...], tuple[Link, ...]]:
    """The joints that are not prescribed, and the links between them."""
    if locked is None:
        return chain.joints, chain.links
    return (chain.joints[1:], chain.links[1:]) if locked == 0 else (chain.joints[:-1], chain.links[:-1])


def shifts(chain: Chain, locked: int | None) -> list[float]:
    """What is added to the values of the six joints as the elimination counts them: offsets and turns of links off."""
    joints, links = free_joints(chain, locked)
    turns = [turn if joint.revolute else 0.0 for joint, turn in zip(joints, [*_turns(links), 0.0], strict=True)]
    return [-float(joint.offset) - turn for joint, turn in zip(joints, turns, strict=True)]


def _turns(links: Sequence[Link]) -> list[float]:
    return [math.atan2(float(link.st), float(link.ct)) for link in links]


def root_stage(chain: Chain, locked: int | None = None) -> Stage:
    """The one choice of a root: that of the joint which the elimination keeps."""
    kept = tables_of(chain, locked).eliminations[0].kept_joint
    return Stage(free_joints(chain, locked)[0][kept].index, "degree-16", MAX_SOLUTIONS)


def passes(tables: General6RTables, real: str) -> list[tuple[tuple[int, ...], float]]:
    """The eliminations to try in order, each as its roles and motion with the noise of its polynomial.

    The best choice, then at poses nearby the best one and the next one. Roles and motion are: first joint, direction,
    which of joints 3, 4, 5 (0, 1, 2) is kept, shifted and other, and the number of the motion to the pose nearby.
    """
    first, last = tables.eliminations[0], tables.eliminations[-1]
    found: list[tuple[tuple[int, ...], float]] = []
    for motion, (choice, factor) in enumerate(zip((first, first, last), NOISE_FACTORS, strict=True)):
        roles = (choice.start, choice.direction, choice.kept, choice.shifted, choice.other, motion)
        noise = min(NOISE * factor * shallowness(choice.depth), MOST_NOISE)
        found.append((roles, max(LEAST_NOISE[real], noise)))
    return found


def _turn(angle: float) -> tuple[float, float]:
    """Cosine and sine, correctly rounded: the same on every machine; 0 what is zero but for rounding of the angle."""
    import mpmath

    with mpmath.workdps(50):
        c, s = float(mpmath.cos(mpmath.mpf(angle))), float(mpmath.sin(mpmath.mpf(angle)))
    return tuple(round(x) if abs(x - round(x)) < QUARTER else x for x in (c, s))  # type: ignore[return-value]
