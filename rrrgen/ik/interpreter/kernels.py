"""Solves the scalar equations of the inverse kinematics in floats: roots, with flags for double and undetermined ones.

The methods and tolerances are those of the emitted C (``templates/c/ik/roots.c``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, copysign, cos, hypot, sin, sqrt

from rrrgen.ik.recording.builder import Feasible, Turn
from rrrgen.ik.tolerances import runtime, search

TOLERANCE = {name: float(text) for name, text in runtime("double").items()}
SEARCH = search()

MULTIPLE, FREE, OUTSIDE, INEXACT, NEAR = 1, 2, 4, 8, 16
"""Flags of a row; NEAR is an inner one: a root of this row may be double."""


@dataclass(frozen=True)
class Settings:
    """Tolerances with which the scalar equations are solved.

    ``slack`` is how far below zero a discriminant may be and still count as zero; ``least`` the length below which a
    vector has no direction. ``band`` is None if the equations are those of the arm itself; if they are those of a
    similar arm of special geometry, it is the distance by which double roots are moved apart.
    """

    slack: float
    least: float
    band: float | None = None


@dataclass(frozen=True)
class Roots:
    """Roots of one equation: their number ``count``, the ``values`` from which they follow, and ``flags``."""

    count: int
    values: tuple[float, ...]
    flags: int


def root(w2: float, size: float, settings: Settings) -> Roots:
    """Solve ``w^2 = w2``: two roots +-w, one (zero) at a double root, or none.

    ``size`` is the magnitude of the terms that w2 was summed from, to which its tolerance is relative.
    """
    flags = 0
    if settings.band is not None and w2 <= TOLERANCE["band"] * size:
        flags = NEAR
        if -settings.slack * size <= w2 < settings.band * size:
            w2 = settings.band * size
    if w2 > 0.0:
        return Roots(2, (sqrt(w2),), flags | (NEAR if w2 <= TOLERANCE["merge"] * size else 0))
    return Roots(int(w2 >= -settings.slack * size), (0.0,), flags | MULTIPLE)


def cosine(k: float, w2: float, settings: Settings) -> Roots:
    """Solve cos(e) = k, for ``w2`` = 1 - k^2; returns k and w = sin(e) >= 0.

    At a double root (w = 0) k becomes the nearer of -1 and 1.
    """
    found = root(w2, 1.0, settings)
    return Roots(found.count, (copysign(1.0, k) if found.count == 1 else k, *found.values), found.flags)


def linear(
    equation: tuple[float, float, float],
    better: float | None,
    unit: float,
    reference: float,
    bits: tuple[int, int],
    settings: Settings,
) -> Roots:
    """Solve ``a cos(x) + b sin(x) = k`` for the angle x.

    Returns four numbers a, b, k, w that give both solutions: ``cos(x) = a k -+ b w``, ``sin(x) = b k +- a w``. If every
    x is a solution, x = ``reference``. ``bits`` are the flags to set if a and b nearly vanish, and if they do.
    """
    a, b, k = equation
    h2, flags = a * a + b * b, 0
    if h2 <= (TOLERANCE["doubt"] * unit) ** 2:
        flags = bits[0]
        if h2 <= (settings.least * unit) ** 2:
            solved = k * k <= settings.slack * unit * unit
            return Roots(int(solved), (cos(reference), sin(reference), 1.0, 0.0), flags | bits[1])
    found = root(h2 - k * k if better is None or better < 0.0 else better, h2, settings)
    k = (copysign(sqrt(h2), k) if found.count == 1 else k) / h2
    return Roots(found.count, (a, b, k, found.values[0] / h2), flags | found.flags)


def direction(c: float, s: float, bits: tuple[int, int], settings: Settings) -> tuple[Turn | None, int]:
    """Normalize the vector (``c``, ``s``) to length 1; None if it is too short. Also returns flags.

    ``bits`` are the flags to set if the vector nearly vanishes, and if it does.
    """
    h = hypot(c, s)
    if h <= TOLERANCE["doubt"] and h <= settings.least:
        return None, bits[1]
    return Turn(c / h, s / h), 0 if h > TOLERANCE["doubt"] else bits[0]


def quadratic(k: Sequence[float], unit: float, settings: Settings) -> tuple[list[float], list[int], int]:
    """Real roots of ``k0 + k1 x + k2 x^2``, the larger first, with their branch numbers, and flags.

    ``unit`` is the typical size of x, to which tolerances are relative.
    """
    k0, k1, k2 = k
    if abs(k2) * unit <= TOLERANCE["eps"] * abs(k1):
        return ([-k0 / k1], [0 if k1 > 0.0 else 1], 0) if k1 else ([], [], 0)
    found = root(k1 * k1 - 4.0 * k0 * k2, k1 * k1 + abs(4.0 * k0 * k2), settings)
    if found.count < 2:
        return [-0.5 * k1 / k2] * found.count, [0] * found.count, found.flags
    w = found.values[0]
    total = -0.5 * (k1 + (-w if k1 < 0.0 else w))
    pair = (total / k2, k0 / total)
    return [max(pair), min(pair)], [0, 1], found.flags


def quartic(k: Sequence[float], settings: Settings) -> tuple[list[float], list[int]]:
    """The angles with k0 + k1 cos x + k2 sin x + k3 cos 2x + k4 sin 2x = 0, ascending, with their branch numbers."""
    import numpy as np

    size = sum(map(abs, k))
    if not size > 0.0:
        return [], []
    k0, k1, k2, k3, k4 = (x / size for x in k)
    ends, middle = complex(k3, k4) / 2, complex(k1, k2) / 2
    z = np.roots([ends.conjugate(), middle.conjugate(), k0, middle, ends])
    close = TOLERANCE["circle"] + settings.slack**2
    angles = []
    for x in (float(np.angle(each)) for each in z if abs(each) > 0 and (abs(each) ** 2 - 1) ** 2 <= close):
        for _ in range(2):
            f = k0 + k1 * cos(x) + k2 * sin(x) + k3 * cos(2 * x) + k4 * sin(2 * x)
            d = _slope(k1, k2, k3, k4, x)
            x -= min(max(f * d / (d * d + TOLERANCE["eps"]), -SEARCH["newton"]), SEARCH["newton"])
        angles.append(atan2(sin(x), cos(x)))
    angles.sort()
    return angles, _numbered([_slope(k1, k2, k3, k4, x) for x in angles])


def _slope(k1: float, k2: float, k3: float, k4: float, x: float) -> float:
    return -k1 * sin(x) + k2 * cos(x) - 2 * k3 * sin(2 * x) + 2 * k4 * cos(2 * x)


def power4(k: Sequence[float], unit: float, settings: Settings) -> tuple[list[float], list[int]]:
    """Real roots of a polynomial of degree four, ascending, with their branch numbers.

    ``unit`` is the typical size of a root, m, to which tolerances are relative.
    """
    import numpy as np

    scaled = np.array([x * unit**i for i, x in enumerate(k)])
    size = float(np.abs(scaled).sum())
    if not size > 0.0:
        return [], []
    p = np.polynomial.Polynomial(scaled / size)
    slope, close = p.deriv(), TOLERANCE["circle"] + settings.slack**2
    real = []
    for z in map(complex, p.roots()):
        y = z.real
        if z.imag**2 > close * (1.0 + abs(z) ** 2):
            continue
        for _ in range(2):
            f, d = float(p(y)), float(slope(y))
            y -= min(max(f * d / (d * d + TOLERANCE["eps"]), -SEARCH["newton"]), SEARCH["newton"])
        real.append(y)
    real.sort()
    return [y * unit for y in real], _numbered([float(slope(y)) for y in real])


def _numbered(slopes: list[float]) -> list[int]:
    """Branch numbers of the roots of a quartic: by the sign of the ``slopes`` at the roots, then by their order.

    These numbers stay the same along a path on which no two roots meet.
    """
    rising = falling = 0
    numbers = []
    for d in slopes:
        if d > 0.0:
            numbers.append(2 * (rising & 1))
            rising += 1
        else:
            numbers.append(2 * (falling & 1) + 1)
            falling += 1
    return numbers


def nearest_feasible(reference: float, bounds: Feasible) -> float:
    """The feasible angle nearest to ``reference``; the reference itself if no angle is feasible."""
    mean, a, b, lower, upper = bounds
    h, now = hypot(a, b), mean + a * cos(reference) + b * sin(reference)
    if lower <= now <= upper or not h > 0.0:
        return reference
    best, away = reference, 10.0
    for limit in (lower, upper):
        k = (limit - mean) / h
        e = atan2(sqrt(max(1.0 - k * k, 0.0)), k)
        for side in (e, -e):
            x = atan2(b, a) + side - reference
            x = atan2(sin(x), cos(x))
            if k * k <= 1.0 and abs(x) < away:
                best, away = reference + x, abs(x)
    return best
