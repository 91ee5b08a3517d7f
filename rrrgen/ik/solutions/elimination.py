"""Choose the best variable elimination for a general chain of six joints, by numerical tests on sample poses.

The eliminations are those of M. Raghavan and B. Roth (1990). The closed loop of the arm is
``Z1 E1 Z2 E2 .. Z6 E6 = 1``: Zi is the rotation about z by joint i, and the Ei are transforms that do not depend on the
joints, one of which contains the target pose. The numbering may begin at any joint and run in either direction, which
gives 12 labellings.

1. The line of axis 6, with point p and direction l, is described by 15 features
   (1, p, p.p, l, p x l, p.l, (p.p) l - 2 (p.l) p). A rigid transform acts on them linearly.
2. The features computed through joints 5, 4, 3 equal those computed from the other side, through joints 1 and 2. Six
   linear combinations of these 14 equations (the first feature is constant) do not contain joints 1 and 2. They are
   linear in (1, cos, sin) of each of joints 3, 4, 5.
3. One of joints 3, 4, 5 is kept as the unknown. The half-angle tangents of the other two are eliminated: the six
   equations, and the same six times one of the tangents, make a 12 x 12 matrix that is singular at a solution. Its
   determinant is a trigonometric polynomial of degree 8 in the kept angle, with up to 16 roots.

There are 36 choices: 12 labellings times three joints to keep. Which ones are usable depends on the chain; on
industrial arms most of the determinants vanish identically.

One joint may be prismatic. Its displacement x enters the features through 1, x, x^2, like the half-angle tangent of a
revolute joint. It must be one of joints 3, 4, 5 and is eliminated as a half-angle tangent would be; the kept joint is
revolute. A labelling for which the determinant then has a degree above 8 is rejected.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace
from math import cos, hypot, log10, pi, prod, sin, sqrt
from operator import mul, sub
from random import Random

from rrrgen.base.cache import compiler_hash, digest, keep, recall
from rrrgen.base.errors import StorageError
from rrrgen.ik.geometry.chain import IDENTITY, Link, Matrix, inverse, multiply, shift_along_z, turn_about_z
from rrrgen.ik.tolerances import NOISE, SHALLOW, SPURIOUS, USABLE

POSES = 20  # number of random sample poses on which an elimination is scored
FEW = 5  # of them show whether it is usable at all: most are not
MOST = FEW // 2 + 1  # of these decide their median
SAMPLES = 25  # values of the 12 x 12 determinant: a polynomial of degree <= 12 (25 coefficients) passes through them
WAVES = [(cos(2 * pi * k / SAMPLES), sin(2 * pi * k / SAMPLES)) for k in range(SAMPLES)]

Column = list[float]
"""The 15 features of a line, or the coefficients of one monomial in them."""

HalfAngles = list[list[list[float]]]
"""Six equations for the factors 1, cos and sin of the kept angle: 3 x 6 x 9, the last index of x^i y^j is 3 i + j."""

LINE: Column = [1.0, 0, 0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 0, 0, 0]
"""The z axis: its point is 0 and its direction z."""

PLANAR = (1, 5, 8, 12)
"""The x components of the pairs of features that a rotation about z rotates; it does not change the other features."""


@dataclass(frozen=True)
class Elimination:
    """One variable elimination: a labelling of the loop, the roles of its joints 3, 4, 5, and how accurate it is.

    Labelling: the loop is numbered from joint ``start`` (0 .. 5) in the sense of ``direction`` (+1 or -1).
    Roles, each 0, 1 or 2 for joints 3, 4 and 5 of the labelling: ``kept`` is the unknown of the polynomial; the
    half-angle tangents of ``shifted`` and ``other`` are eliminated, and the equations are also multiplied by that of
    ``shifted``. A prismatic joint is always ``other``.
    Quality: ``score`` is the number of decimal digits lost in a root; ``depth`` is log10 of the size of the determinant
    relative to the product of the norms of its rows; ``pure`` says that the polynomial has degree 8 up to rounding. On
    nearly special geometries a small remainder of higher degree is left, and roots close to each other are lost.
    """

    start: int
    direction: int
    kept: int
    shifted: int
    other: int
    score: float
    depth: float
    pure: bool

    @property
    def kept_joint(self) -> int:
        """Index in the chain (0 .. 5) of the joint whose angle is the root of the polynomial."""
        return (self.start + self.direction * (2 + self.kept)) % 6


def eliminations(table: Sequence[Sequence[float]], slide: int | None = None, turn: float = 0.0) -> list[Elimination]:
    """Find the usable eliminations of a chain, best first; what was found before comes from the user's cache.

    ``table`` is the DH table, six rows of alpha (rad), a, d, with lengths scaled to the order of one. Joint ``slide``
    (0 .. 5), if any, is prismatic; ``turn`` (rad) is its constant angle theta, and its d is zero.
    """
    chain = repr(([[float(x) for x in row] for row in table], slide, float(turn)))
    name = f"{digest(chain, compiler_hash())[:32]}.eliminations"
    with contextlib.suppress(StorageError):  # a cache that others may write to is not read
        if (known := recall(name)) is not None:
            return [Elimination(*values) for values in json.loads(known)]
    choices = _search(table, slide, turn)
    with contextlib.suppress(OSError, StorageError):  # the cache is optional: it may be full or read-only
        keep(name, json.dumps([astuple(choice) for choice in choices]).encode())
    return choices


def _search(table: Sequence[Sequence[float]], slide: int | None, turn: float) -> list[Elimination]:
    """Score all eliminations of a chain on sample poses, which takes about two seconds; see :func:`eliminations`."""
    rows = [(cos(alpha), sin(alpha), float(a), float(d)) for alpha, a, d in table]
    links = constant_links(rows, slide, (cos(turn), sin(turn)))
    # The seed is fixed: the choice, and with it the emitted code, is the same on every machine. Targets are made from
    # joint angles, so that one root of every sample, the kept angle among them, is known.
    draw = Random(6)
    samples = [[draw.uniform(-pi, pi) for _ in range(6)] for _ in range(POSES)]
    loops = [[*links[:5], multiply(links[5], inverse(_pose(links, q, slide)))] for q in samples]
    choices = []
    for start in range(6):
        for direction in (1, -1):
            order = numbering(start, direction)
            place = None if slide is None else order.index(slide) - 2
            if place is not None and not 0 <= place <= 2:
                continue
            equations = [pencil(relabel_transforms(loop, start, direction), place) for loop in loops]
            for kept in range(3):
                shifted, other = (kept + 1) % 3, (kept + 2) % 3
                if place == kept:
                    continue
                if place == shifted:
                    shifted, other = other, shifted
                angles = [direction * q[order[2 + kept]] for q in samples]
                roles, slides = (kept, shifted, other), place is not None
                marks: list[_Mark] = []
                for pose, (coefficients, angle) in enumerate(zip(equations, angles, strict=True)):
                    if (pose == MOST and _hopeless(marks)) or (pose == FEW and not _usable(marks)):
                        break
                    marks.append(_mark(in_half_angles(coefficients, roles, slides=slides), angle))
                if not _usable(marks):
                    continue
                score, depth, pure = _judge(marks)
                if score < USABLE:
                    choices.append(Elimination(start, direction, kept, shifted, other, score, depth, pure))
    choices = [e for e in choices if e.pure] or choices
    return sorted(choices, key=lambda e: (e.score, e.start, e.direction, e.kept))


def numbering(start: int, direction: int) -> list[int]:
    """The joints of the chain (0 .. 5) in the order in which a labelling of the closed loop numbers them.

    It begins at the joint ``start`` and runs towards the tip (``direction`` +1) or the base (-1).
    """
    return [(start + direction * k) % 6 for k in range(6)]


def relabel_transforms(loop: Sequence[Matrix], start: int, direction: int) -> list[Matrix]:
    """The transforms E1 .. E6 of a labelling.

    ``loop`` are those of the chain itself, E1 .. E6 from its first joint on. With ``direction`` -1 the labelling runs
    backwards, and its joints turn by minus their angles.
    """
    order = numbering(start, direction)
    return [loop[i] if direction > 0 else inverse(loop[(i - 1) % 6]) for i in order]


def constant_links(rows: Sequence[Sequence[float]], slide: int | None, turn: tuple[float, float]) -> list[Matrix]:
    """The constant transforms behind the joints of a chain.

    ``rows`` is the DH table, six rows of cos alpha, sin alpha, a, d. Joint ``slide``, if any, is prismatic; ``turn``
    is the cosine and sine of its theta, and its d is zero.
    """
    links = [Link(d, a, ca, sa) for ca, sa, a, d in rows]
    if slide is not None:
        c, s = turn
        links[slide] = replace(links[slide], ct=c, st=s)
    return [link.matrix() for link in links]


def _pose(links: Sequence[Matrix], q: Sequence[float], slide: int | None) -> Matrix:
    """Pose of the last frame at the joint values ``q``."""
    pose = IDENTITY
    for k, (link, x) in enumerate(zip(links, q, strict=True)):
        pose = multiply(shift_along_z(pose, x) if k == slide else turn_about_z(pose, cos(x), sin(x)), link)
    return pose


@dataclass(frozen=True)
class _Mark:
    """What the determinant of an elimination shows at one pose.

    ``depth``: its size relative to the product of the norms of its rows. Relative to the sum of its coefficients:
    ``spurious``, the largest one above degree 8; ``value`` and ``slope`` at the true kept angle.
    """

    depth: float
    spurious: float
    value: float
    slope: float


def _mark(h: HalfAngles, angle: float) -> _Mark:
    """Look at the equations ``h`` of one pose, whose kept angle is known: ``angle``, rad."""
    values, size = _determinants(h)
    # The discrete Fourier transform of the samples are the coefficients c[0] .. c[12] of the trigonometric polynomial.
    # Twelve rows of degree 1 would make degree 12. In powers of the tangent of half the kept angle the determinant has
    # the factor (1 + x^2)^4 (Raghavan and Roth), so that above degree 8 only rounding is left if the elimination suits
    # the chain.
    c = [
        complex(
            sum(v * WAVES[j * k % SAMPLES][0] for j, v in enumerate(values)) / SAMPLES,
            -sum(v * WAVES[j * k % SAMPLES][1] for j, v in enumerate(values)) / SAMPLES,
        )
        for k in range(SAMPLES // 2 + 1)
    ]
    level = abs(c[0]) + 2.0 * sum(map(abs, c[1:9])) + 1e-300
    waves = [c[k] * complex(cos(k * angle), sin(k * angle)) for k in range(9)]
    value = abs(c[0].real + 2.0 * sum(wave.real for wave in waves[1:]))
    slope = abs(2.0 * sum(k * wave.imag for k, wave in enumerate(waves)))
    return _Mark(level / size if size else 0.0, max(map(abs, c[9:])) / level, value / level, slope / level)


def _remainder(marks: Sequence[_Mark]) -> float:
    return max(_quantile([mark.spurious for mark in marks], 0.5), _quantile([mark.value for mark in marks], 0.5))


def _usable(marks: Sequence[_Mark]) -> bool:
    """Whether the polynomial has degree 8 and the true angles as roots, as far as rounding shows."""
    return _remainder(marks) < SPURIOUS and _quantile([mark.depth for mark in marks], 0.5) > 0


def _hopeless(marks: Sequence[_Mark]) -> bool:
    """Whether :func:`_usable` says no of these marks with any others beside them, as long as these are the majority."""
    least = max(min(mark.spurious for mark in marks), min(mark.value for mark in marks))
    return least >= SPURIOUS or max(mark.depth for mark in marks) <= 0


def _judge(marks: Sequence[_Mark]) -> tuple[float, float, bool]:
    """Score a usable elimination: digits lost in a root, log10 of the size of the determinant, whether the degree is 8.

    The digits lost are the 0.9 quantile over the poses. Both numbers are rounded, so that rounding errors of a machine
    do not change the choice.
    """
    depth = _quantile([mark.depth for mark in marks], 0.5)
    lost = _quantile([-log10(mark.slope + 1e-300) for mark in marks], 0.9) + max(0.0, 0.75 * log10(SHALLOW / depth))
    digits = round(log10(depth), 1)
    return round(lost, 2), digits, _remainder(marks) < NOISE * shallowness(digits)


def _quantile(values: Sequence[float], share: float) -> float:
    """The value below which a ``share`` of ``values`` lies, interpolated linearly between two of them."""
    ordered, place = sorted(values), share * (len(values) - 1)
    k = min(int(place), len(values) - 2)
    return ordered[k] + (place - k) * (ordered[k + 1] - ordered[k])


def _determinants(h: HalfAngles) -> tuple[list[float], float]:
    """Determinants of the 12 x 12 matrix at :data:`SAMPLES` kept angles; the largest product of the norms of its rows.

    The matrix holds the six equations times 1 and times the half-angle tangent x of the shifted joint, in blocks
    [M0 M1 M2 0; 0 M0 M1 M2] for the powers of x. Its first and last three columns are in six rows each.
    """
    values, size = [], 0.0
    for c, s in WAVES:
        m = [[x + c * y + s * z for x, y, z in zip(*rows, strict=True)] for rows in zip(*h, strict=True)]
        size = max(size, prod(hypot(*row) for row in m) ** 2)
        # The corner blocks have three columns in six rows each. They are eliminated first; a 6 x 6 determinant is left,
        # with less than half the operations of a 12 x 12 one.
        outer, upper = _pivots(m, 3)
        inner, lower = _pivots([row[6:] + row[:6] for row in m], 3)
        last, _ = _pivots(upper + lower, 6)
        values.append(outer * inner * last)
    return values, size


def _pivots(rows: list[list[float]], columns: int) -> tuple[float, list[list[float]]]:
    """Eliminate the first ``columns`` of a matrix; returns the product of the pivots, and what is left of the matrix.

    The product has the sign of the exchanges of rows. Exchanging the block columns of the 12 x 12 matrix, as its caller
    does, multiplies every determinant by the same sign.
    """
    product = 1.0
    for _ in range(columns):
        sizes = [abs(row[0]) for row in rows]
        best = sizes.index(max(sizes))
        pivot, *top = rows[best]
        below = rows[1:]
        if best:
            below[best - 1] = rows[0]
            product = -product
        product *= pivot
        rows = []
        for first, *rest in below:
            factor = first / pivot if pivot else 0.0
            rows.append(list(map(sub, rest, map(factor.__mul__, top))))  # x - factor y; most of the search is here
    return product, rows


def in_half_angles(equations: Sequence[Sequence[float]], roles: Sequence[int], *, slides: bool) -> HalfAngles:
    """Write the six ``equations`` of :func:`pencil` in powers of the half-angle tangents x, y of the eliminated joints.

    ``roles`` says which of joints 3, 4, 5 (0, 1, 2) are kept, shifted (x) and other (y); with ``slides`` the other one
    is prismatic, and y its displacement.
    """
    kept, shifted, other = (9 // 3**role for role in roles)
    h: HalfAngles = [[], [], []]
    for equation in equations:
        for k in range(3):
            parts = []
            for i in range(3):
                at = kept * k + shifted * i
                one, c, s = equation[at], equation[at + other], equation[at + 2 * other]
                # 1, cos, sin times 1 + y^2 -> powers of y = tan(angle/2)
                parts.append((one, c, s) if slides else (one + c, 2.0 * s, one - c))
            one, c, s = parts
            row = [x + y for x, y in zip(one, c, strict=True)]
            row += [2.0 * x for x in s]
            row += [x - y for x, y in zip(one, c, strict=True)]
            h[k].append(row)
    return h


def shallowness(depth: float) -> float:
    """Factor by which the noise of the polynomial grows where its determinant is small.

    It is max(1, SHALLOW / 10^depth)^0.75, with ``depth`` as in :class:`Elimination`.
    """
    return float(max(1.0, SHALLOW / 10**depth) ** 0.75)


def pencil(e: Sequence[Matrix], slide: int | None) -> list[list[float]]:
    """Coefficients of the six equations without joints 1 and 2: 27 numbers each.

    Entry 9 i + 3 j + k belongs to the monomials i, j and k of (1, cos, sin) of joints 3, 4 and 5, or of (1, x, x^2) for
    the prismatic one of them, joint 3 + ``slide``.
    """
    near = [transform_features(e[4], LINE)]
    for joint, transform in ((2, e[3]), (1, e[2]), (0, e[1])):
        parts = [part for f in near for part in (shift_features(f) if joint == slide else rotate_features(f, 1.0))]
        near = [transform_features(transform, part) for part in parts]
    back = inverse(e[0])
    first = [transform_features(back, part) for part in rotate_features(transform_features(inverse(e[5]), LINE), -1.0)]
    # The other side is a sum over the products of (1, cos, sin) of joints 1 and 2. Its constant part joins that of the
    # near side; the other eight span what is to vanish, and 14 - 8 directions are perpendicular to them.
    constant, *turning = [part for f in first for part in rotate_features(f, -1.0)]
    near[0] = [x - y for x, y in zip(near[0], constant, strict=True)]
    order = [near[9 * k + 3 * j + i][1:] for i in range(3) for j in range(3) for k in range(3)]
    rest = _complement([f[1:] for f in turning])
    return [[sum(map(mul, y, f)) for f in order] for y in rest]


def _complement(columns: Sequence[Column]) -> list[Column]:
    """Orthonormal vectors perpendicular to ``columns`` and as many as that leaves, by Householder reflections."""
    size, left, mirrors = len(columns[0]), [list(column) for column in columns], []
    for k in range(len(columns)):
        mirror = [0.0] * k + left[k][k:]
        length = sqrt(sum(map(mul, mirror, mirror)))
        if length == 0.0:
            continue
        mirror[k] += -length if mirror[k] < 0.0 else length
        factor = sqrt(2.0 / sum(map(mul, mirror, mirror)))
        mirrors.append([factor * x for x in mirror])
        left[k + 1 :] = [_reflect(mirrors[-1], column) for column in left[k + 1 :]]
    rest = [[float(i == k) for i in range(size)] for k in range(len(columns), size)]
    for mirror in reversed(mirrors):
        rest = [_reflect(mirror, column) for column in rest]
    return rest


def _reflect(mirror: Column, column: Column) -> Column:
    along = sum(map(mul, mirror, column))
    return [x - along * y for x, y in zip(column, mirror, strict=True)]


def rotate_features(f: Column, sense: float) -> tuple[Column, Column, Column]:
    """Rotate features about z by sense times an unknown angle: coefficients of 1, cos and sin of that angle."""
    one, c, s = list(f), [0.0] * 15, [0.0] * 15
    for x in PLANAR:
        one[x] = one[x + 1] = 0.0
        c[x], c[x + 1] = f[x], f[x + 1]
        s[x], s[x + 1] = -sense * f[x + 1], sense * f[x]
    return one, c, s


def shift_features(f: Column) -> tuple[Column, Column, Column]:
    """Shift features along z by an unknown displacement x: coefficients of 1, x and x^2."""
    linear, square = [0.0] * 15, [0.0] * 15
    linear[3], linear[4], square[4] = f[0], 2.0 * f[3], f[0]
    linear[8], linear[9], linear[11] = -f[6], f[5], f[7]
    linear[12], linear[13], linear[14] = 2.0 * f[9], -2.0 * f[8], -2.0 * f[11]
    square[12], square[13], square[14] = f[5], f[6], -f[7]
    return list(f), linear, square


def transform_features(e: Matrix, f: Column) -> Column:
    """The features of a line that the rigid transform ``e`` moves, on which it acts linearly."""
    (r0, r1, r2, x), (r3, r4, r5, y), (r6, r7, r8, z) = e
    point, axis, moment, rest = (
        (r0 * a + r1 * b + r2 * c, r3 * a + r4 * b + r5 * c, r6 * a + r7 * b + r8 * c)
        for a, b, c in (f[1:4], f[5:8], f[8:11], f[12:])
    )
    t, squared = (x, y, z), x * x + y * y + z * z
    along = sum(map(mul, t, axis)) + f[11]
    across, over = ((y * v[2] - z * v[1], z * v[0] - x * v[2], x * v[1] - y * v[0]) for v in (axis, moment))
    return [
        f[0],
        *(point[i] + t[i] * f[0] for i in range(3)),
        f[4] + squared * f[0] + 2.0 * sum(map(mul, t, point)),
        *axis,
        *(moment[i] + across[i] for i in range(3)),
        along,
        *(rest[i] + squared * axis[i] - 2.0 * (over[i] + along * t[i]) for i in range(3)),
    ]
