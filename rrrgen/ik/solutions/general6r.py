"""Six joints in general, at most one of them prismatic: tables and C code of the solver for any such chain.

Up to 16 solutions, the real roots of a polynomial of degree 16 (Raghavan and Roth, 1990): see
:mod:`rrrgen.ik.solutions.elimination` for the equations, ``templates/c/ik/general6r.c.j2`` for the solver. What is
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
from rrrgen.ik.geometry.chain import Chain, Joint, Link, Matrix
from rrrgen.ik.interpreters.c_statements import CBody
from rrrgen.ik.recording.steps import Stage
from rrrgen.ik.solutions.elimination import NOISE, Elimination, eliminations, shallowness
from rrrgen.ik.solutions.trig_roots import literals, spelled, trig_roots
from rrrgen.resources import render as render_template

MAX_SOLUTIONS = 16

ASPECT = ("aspect", 0, 1)
"""The branch label of a general arm, which has no shoulder, elbow or wrist: the sign of the Jacobian's determinant. It
stays the same along a path that meets no singular configuration."""

TOLERANCES = {
    "double": {"eps": 2.220446049250313e-16, "tiny": 1e-290, "done": 1.4e-14, "accept": 9e-13, "same": 3e-6},
    "float": {"eps": 1.1920929e-07, "tiny": 1e-30, "done": 4e-6, "accept": 3e-5, "same": 1e-2},
}
"""done: a row this good is left alone; accept: a worse one is dropped (entries of the pose, lengths in mean link
lengths); same: two rows nearer than this (sum over sines and cosines) are one, since forward kinematics, quadratic in
their distance where they merge, cannot tell them apart."""

_NOISE = {"double": NOISE, "float": 4e-6}
_BOLDER = (1.0, 1e3, 1e6)  # a pass that seeks what the first one missed takes more for a double root
_NUDGE = 1e-3
_MOST_NOISE = 1e-4


@dataclass(frozen=True)
class General6RTables:
    """What the solver of one chain needs.

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
    joints, links = _free(chain, locked)
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
    joints, _ = _free(chain, locked)
    return len(joints) == 6 and sum(not joint.revolute for joint in joints) <= 1


def _free(chain: Chain, locked: int | None) -> tuple[tuple[Joint, ...], tuple[Link, ...]]:
    """The joints that are not prescribed, and the links between them."""
    if locked is None:
        return chain.joints, chain.links
    return (chain.joints[1:], chain.links[1:]) if locked == 0 else (chain.joints[:-1], chain.links[:-1])


def _turns(links: Sequence[Link]) -> list[float]:
    return [math.atan2(float(link.st), float(link.ct)) for link in links]


def branches(chain: Chain, prefix: str, locked: int | None = None) -> CBody:
    """The body of the function that lists candidates: base, tool and offsets are taken off for ``PREFIX_solve6r``."""
    joints, links = _free(chain, locked)
    turns = [turn if joint.revolute else 0.0 for joint, turn in zip(joints, [*_turns(links), 0.0], strict=True)]
    shifts = [-float(joint.offset) - turn for joint, turn in zip(joints, turns, strict=True)]
    tables = tables_of(chain, locked)
    text = render_template(
        "c/ik/general6r_branches.c.j2",
        P=prefix,
        before=literals(_inverse(chain.base)),
        after=literals(_inverse(chain.tip)),
        shifts=literals(shifts) if any(shifts) else "",
        slide=tables.slide,
        locked=locked,
        given=None if locked is None else _given(chain, locked),
    )
    return CBody(text, frozenset({"near"}))


def root_stage(chain: Chain, locked: int | None = None) -> Stage:
    """The one choice of a root: that of the joint which the elimination keeps."""
    kept = tables_of(chain, locked).eliminations[0].kept_joint
    return Stage(_free(chain, locked)[0][kept].index, "degree-16", MAX_SOLUTIONS)


def _given(chain: Chain, locked: int) -> dict[str, object]:
    """What takes a prescribed joint off: its offset, whether it slides, and the inverse of the link beside it."""
    joint, link = chain.joints[locked], chain.links[0 if locked == 0 else -1]
    offset = float(joint.offset)
    return {
        "offset": literals([offset]) if offset else "",
        "slides": not joint.revolute,
        "link": literals(_inverse(link.matrix())),
    }


def _inverse(matrix: Matrix) -> list[float]:
    """The inverse of a rigid transform as 12 numbers, rows of 3x4."""
    R = [[float(matrix[j][i]) for j in range(3)] for i in range(3)]
    t = [float(matrix[i][3]) for i in range(3)]
    return [x + 0.0 for row in R for x in (*row, -sum(r * y for r, y in zip(row, t, strict=True)))]


def render(tables: General6RTables, prefix: str, real: str = "double", *, shorthand: bool = False) -> str:
    """C text with ``static int PREFIX_solve6r(const REAL T[16], REAL q[][6], int mult[])``, PREFIX_6R_MAX rows.

    ``T`` is the row-major pose of the product of :func:`general6r_tables`; rows of ``q`` are angles in (-pi, pi],
    displacements in m, ``mult`` is 1, or 2 for a double solution. C99 and C++, needs ``<math.h>`` only. ``real`` is
    ``"double"`` or ``"float"``; with ``shorthand`` the words of :data:`~rrrgen.ik.solutions.trig_roots.WORDS` are
    left for the caller to replace.
    """
    passes = _passes(tables)
    noise = [max(_NOISE[real], x) for _, x in passes]
    text = trig_roots(prefix, 8, real, shorthand=True) + "\n"
    text += render_template(
        "c/ik/general6r.c.j2",
        p=prefix,
        tol=TOLERANCES[real],
        length=tables.length,
        dh=[literals(row) for row in tables.rows],
        passes=[row for row, _ in passes],
        noise=literals(noise),
        nudge=[literals(row) for row in _nudges()],
        odd=literals([0.28, -0.96, 0, 0.96, 0.28, 0, 0, 0, 1, 0, 0, 0]),
        form=literals([-0.5, 1, 1, 1, -0.5, 1, 1, 1, -2, -2, -2, 2, 1, 1, 1]),
        wave=[literals(row) for row in _wave(17)],
        slide=tables.slide,
        turn=literals(tables.turn),
    )
    return text if shorthand else spelled(text, real)


def _passes(tables: General6RTables) -> list[tuple[tuple[int, ...], float]]:
    """Rows of the table of passes with their noise: the best choice, the best and the next one at poses nearby."""
    first, last = tables.eliminations[0], tables.eliminations[-1]
    out: list[tuple[tuple[int, ...], float]] = []
    for nudge, (choice, bolder) in enumerate(zip((first, first, last), _BOLDER, strict=True)):
        roles = (choice.start, choice.direction, choice.kept, choice.shifted, choice.other, nudge)
        out.append((roles, min(NOISE * bolder * shallowness(choice.depth), _MOST_NOISE)))
    return out


def _turn(angle: float) -> tuple[float, float]:
    """Cosine and sine, correctly rounded: the same on every machine; 0 what is zero but for rounding of the angle."""
    import mpmath

    with mpmath.workdps(50):
        c, s = float(mpmath.cos(mpmath.mpf(angle))), float(mpmath.sin(mpmath.mpf(angle)))
    return tuple(round(x) if abs(x - round(x)) < 2e-16 else x for x in (c, s))  # type: ignore[return-value]


def _wave(n: int) -> list[tuple[float, float]]:
    import mpmath

    with mpmath.workdps(50):
        turns = [2 * mpmath.pi * k / n for k in range(n)]
        return [(float(mpmath.cos(x)), float(mpmath.sin(x))) for x in turns]


def _nudges() -> list[list[float]]:
    """No motion, a small rotation (Euler-Rodrigues parameters 1, v) with a small translation, and its inverse."""
    x, y, z = (0.5 * _NUDGE * u for u in (0.48, -0.6, 0.64))
    w = 1.0 / (1.0 + x * x + y * y + z * z)
    R = [
        [(1 + x * x - y * y - z * z) * w, 2 * (x * y - z) * w, 2 * (x * z + y) * w],
        [2 * (x * y + z) * w, (1 - x * x + y * y - z * z) * w, 2 * (y * z - x) * w],
        [2 * (x * z - y) * w, 2 * (y * z + x) * w, (1 - x * x - y * y + z * z) * w],
    ]
    t = [_NUDGE * u for u in (0.6, 0.64, -0.48)]
    back = [[R[j][i] for j in range(3)] for i in range(3)]
    away = [-(back[i][0] * t[0] + back[i][1] * t[1] + back[i][2] * t[2]) for i in range(3)]
    still = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    return [still, [*R[0], *R[1], *R[2], *t], [*back[0], *back[1], *back[2], *away]]
