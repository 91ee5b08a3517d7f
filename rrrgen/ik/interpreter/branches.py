"""Candidate solutions of every branch of the inverse kinematics: the recorded solver is run in floats.

Each run follows one path, which takes one root at every choice between several; all paths are run in turn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, copysign, cos, hypot, pi, sin, sqrt
from typing import TYPE_CHECKING

from rrrgen.ik.geometry.chain import Joint
from rrrgen.ik.geometry.rigid_transforms import Rigid, S, Vector, dot, minus, square, total
from rrrgen.ik.recording.builder import Feasible, Label, Turn, between, users_turn
from rrrgen.ik.recording.float_builder import next_script, wrapped
from rrrgen.ik.tolerances import SIZE_OF_NOTHING, runtime, search

if TYPE_CHECKING:
    from rrrgen.ik.plan import SolverPlan


# ------------------------------------------------------------------------------------------------------------------
# Solves the scalar equations of the inverse kinematics in floats: roots, with flags for double and undetermined ones.
#
# The methods and tolerances are those of the emitted C (``templates/c/ik/roots.c``).
# ------------------------------------------------------------------------------------------------------------------

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


# ------------------------------------------------------------------------------------------------------------------
# Candidate solutions of every branch of the inverse kinematics
# ------------------------------------------------------------------------------------------------------------------

VIRTUAL_END = 100


@dataclass
class Row:
    """A candidate solution of the inverse kinematics.

    ``q`` are the joint positions, rad or m, ``flags`` a sum of flag bits, ``branch`` the number of the branch, and
    ``residual`` the squared task error, negative while it is unknown.
    """

    q: list[float]
    flags: int
    branch: int
    residual: float


@dataclass(frozen=True)
class Query:
    """Input of the solver: checked target ``T``, reference configuration, and the redundancy parameter ``given``.

    ``T`` is a pose (16 numbers, row-major), a position (3 numbers, m), or a position and that of the tool (6
    numbers, m).
    """

    T: Sequence[float]
    reference: Sequence[float]
    given: float


class _NoRootError(Exception):
    """Raised if an equation has no real root, so that the present path leads to no solution."""


def candidates(plan: SolverPlan, query: Query, settings: Settings) -> tuple[list[Row], int]:
    """All candidate solutions in the order of the branches, and the latest choice (from 1) that had no real root.

    The latter tells which equation makes a target unreachable; 0 if every choice had a root.
    """
    rows: list[Row] = []
    script: list[int] = []
    stage = 0
    for _ in range(2 * plan.equations.max_solutions + 1):
        path = _Path(plan, query, settings, script)
        try:
            plan.equations.play(path)
            rows.append(path.row())
        except _NoRootError:
            stage = max(stage, path.choices + 1)
        except (ZeroDivisionError, OverflowError):
            pass  # a domain error or overflow: in C such a candidate holds a NaN and is dropped
        script = next_script(path.script, path.counts)
        if not script:
            break
    return rows, stage


class _Path:
    """Runs the recorded solver of ``plan`` along one path; ``script`` holds the index of the root for each choice."""

    def __init__(self, plan: SolverPlan, query: Query, settings: Settings, script: list[int]) -> None:
        self._plan, self._query, self._settings, self.script = plan, query, settings, script
        self._n, self._length = plan.chain.n, plan.chain.reach
        self._labels = plan.equations.leaf.labels
        self.counts: list[int] = []
        self._values: dict[int, float] = {}
        self._flags = self._branch = 0
        self._errors: list[float] = []

    @property
    def choices(self) -> int:
        """Number of choices between roots made so far."""
        return len(self.counts)

    def row(self) -> Row:
        """The candidate solution that the path leads to."""
        known = self._errors and not self._plan.snapped
        error = sum(self._errors) if known else -1.0
        return Row([self._values[j] for j in range(self._n)], self._flags, self._branch, error)

    # -- inputs and values --------------------------------------------------------------------------------------------

    def pose(self) -> Rigid:
        """The target pose of the tip in the base frame."""
        T = self._query.T
        x, y, z = ((T[4 * i], T[4 * i + 1], T[4 * i + 2]) for i in range(3))
        return Rigid((x, y, z), (T[3], T[7], T[11]))

    def point(self) -> Vector:
        """The target position of the tip in the base frame."""
        T = self._query.T
        return (T[3], T[7], T[11]) if len(T) == 16 else (T[0], T[1], T[2])

    def tool(self) -> Vector:
        """The position of the tool in the frame of the last link."""
        return (self._query.T[3], self._query.T[4], self._query.T[5])

    def name(self, hint: str, x: S) -> S:
        """Return ``x`` unchanged; only when a solver is recorded does an expression get the name ``hint``."""
        return x

    def names(self, hint: str, v: Vector) -> Vector:
        """Return ``v`` unchanged; only when a solver is recorded do its components get names."""
        return v

    def sqrt(self, x: S) -> S:
        """Square root of a quantity that is never negative, apart from round-off."""
        return sqrt(max(float(x), 0.0))

    # -- choices ------------------------------------------------------------------------------------------------------

    def _choose(self, count: int, numbers: Sequence[int] = (0, 1)) -> int:
        """Index of the root, among ``count``, that this path takes; also extends the number of the branch.

        ``numbers`` are the contributions of the roots to that number.
        """
        if count == 0:
            raise _NoRootError
        k = len(self.counts)
        self.counts.append(count)
        if len(self.script) <= k:
            self.script.append(0)
        self._branch |= numbers[self.script[k]] << self._labels[k][1]
        return self.script[k]

    def pair(self, joint: Joint, A: S, B: S, C: S, *, label: Label, unit: float, radicand: S | None = None) -> Turn:
        """Choice between both angles x with ``A cos(x) + B sin(x) = C``; returns cosine and sine of the one taken."""
        if joint.index in self._plan.equations.fixed_pairs:
            h = hypot(A, B)
            k = C / h
            found = cosine(k, (1 - k) * (1 + k) if radicand is None else radicand / (h * h), self._settings)
            a, b, (k, w) = A / h, B / h, found.values
        else:
            equation, bits = (float(A), float(B), float(C)), self._bits(joint)
            found = linear(equation, radicand, unit, self._reference(joint), bits, self._settings)
            a, b, k, w = found.values
        self._flags |= found.flags
        w *= (1, -1)[self._choose(found.count)] * label.positive
        turn = Turn(a * k - b * w, b * k + a * w)
        self._angle(joint, turn)
        return turn

    def signed_root(self, hint: str, radicand: S, *, size: S, joint: Joint, label: Label, unit: float) -> S:
        """Choice between both square roots of ``radicand``; returns the one taken."""
        found = root(float(radicand), float(size) + SIZE_OF_NOTHING * unit * unit, self._settings)
        self._flags |= found.flags
        return found.values[0] * (1, -1)[self._choose(found.count)] * label.positive

    def quartic(self, joint: Joint, k: tuple[S, S, S, S, S], *, label: Label) -> Turn:
        """Choice between up to four angles with ``k0 + k1 cos x + k2 sin x + k3 cos 2x + k4 sin 2x = 0``."""
        angles, numbers = quartic([float(x) for x in k], self._settings)
        x = angles[self._choose(len(angles), numbers)]
        self._user(joint, x)
        return Turn(cos(x), sin(x))

    def polynomial(self, joint: Joint, k: tuple[S, ...], *, label: Label, unit: float) -> S:
        """Choice between up to four displacements x with ``k0 + k1 x + k2 x^2 + ... = 0``."""
        numbers_k = [float(x) for x in k]
        if len(k) == 3:
            roots, numbers, flags = quadratic(numbers_k, unit, self._settings)
        else:
            roots, numbers = power4(numbers_k, unit, self._settings)
            flags = NEAR
        self._flags |= flags
        x = roots[self._choose(len(roots), numbers)]
        self._user(joint, x)
        return x

    # -- single answers -----------------------------------------------------------------------------------------------

    def turn(self, joint: Joint, s: S, c: S) -> Turn:
        """Cosine and sine of the unique angle ``atan2(s, c)``; of the reference angle if s and c both vanish."""
        turn = self._directed(joint, float(c), float(s))
        self._angle(joint, turn)
        return turn

    def _directed(self, joint: Joint, c: float, s: float) -> Turn:
        """Cosine and sine of the angle of the vector (``c``, ``s``); of the reference angle if both vanish."""
        found, flags = direction(c, s, self._bits(joint), self._settings)
        self._flags |= flags
        if found is None:
            x = self._reference(joint)
            found = Turn(cos(x), sin(x))
        return found

    def onto(self, joint: Joint, v: Vector, u: Vector, *, unit: float, feasible: Feasible | None = None) -> Turn:
        """Cosine and sine of the angle about z that turns ``v`` onto ``u``.

        If one of them lies along z, every angle does, and the result is that of the reference angle.
        """
        before, after = (hypot(x[0], x[1]) for x in (v, u))
        (a, b), size = between(v, u), before * after
        flags = 0
        if size <= (TOLERANCE["doubt"] * unit) ** 2:
            flags = self._bits(joint)[size <= (self._settings.least * unit) ** 2]
        self._flags |= flags
        if flags & FREE:
            x = self._reference(joint)
            x = x if feasible is None else nearest_feasible(x, feasible)
            a, b, size = cos(x), sin(x), 1.0
        turn = Turn(a / size, b / size)
        self._angle(joint, turn)
        self._errors.append(square((before - after, total(v[2], -u[2]), 0)) / (unit * unit))
        return turn

    def slide(self, joint: Joint, x: S) -> S:
        """Record ``x`` as the displacement of a prismatic joint, or as an angle that follows from others; returns x."""
        self._user(joint, float(x))
        return float(x)

    def given(self, joint: Joint) -> Turn | S:
        """Position of the joint that the caller prescribes (the redundancy parameter); of an angle, cosine and sine."""
        raw = joint.sign * self._query.given + float(joint.offset)
        if joint.index < self._n:
            self._values[joint.index] = self._query.given
        return Turn(cos(raw), sin(raw)) if joint.revolute else raw

    def wrist(
        self, joints: tuple[Joint, Joint, Joint], M: tuple[Vector, Vector, Vector], signs: tuple[int, int]
    ) -> tuple[Turn, Turn, Turn]:
        """Choice between both solutions of ``Rz(x4) Rx(e4 pi/2) Rz(x5) Rx(e5 pi/2) Rz(x6) = M`` with e = ``signs``.

        Returns cosine and sine of the three angles x4, x5, x6.
        """
        e4, e5 = signs
        c4, s4 = e5 * M[0][2], e5 * M[1][2]
        c5, s5 = -e4 * e5 * M[2][2], hypot(c4, s4)
        before = self._flags
        self._flags = 0
        c4, s4 = self._directed(joints[0], c4, s4)
        free = bool(self._flags & FREE)
        self._flags |= before
        mx = (M[0][0], M[1][0], M[2][0])
        column0, column1 = (c4 * c5, s4 * c5, e4 * s5), (e4 * e5 * s4, -e4 * e5 * c4, 0)
        c6, s6 = dot(column0, mx), dot(column1, mx)
        built = tuple(c6 * x + s6 * y for x, y in zip(column0, column1, strict=True))
        self.residual((), minus((built[0], built[1], built[2]), mx))
        g = (1, -1)[self._choose(1 if free else 2)]
        turns = (Turn(g * c4, g * s4), Turn(c5, g * s5), Turn(g * c6, g * s6))
        for joint, turn in zip(joints, turns, strict=True):
            self._angle(joint, turn)
        return turns

    def residual(self, lengths: tuple[S, ...] = (), cosines: tuple[S, ...] = ()) -> None:
        """Record quantities that vanish at a solution: a candidate is kept only if they do."""
        if lengths:
            self._errors.append(sum(x * x for x in lengths) / self._length**2)
        if cosines:
            self._errors.append(sum(x * x for x in cosines))

    # -- joints -------------------------------------------------------------------------------------------------------

    def _reference(self, joint: Joint) -> float:
        known = self._query.reference[joint.index] if joint.index < self._n else 0.0
        return joint.sign * known + float(joint.offset)

    def _bits(self, joint: Joint) -> tuple[int, int]:
        """Flag bits for a ``joint`` that may be free, and for one that is free.

        A virtual joint (one that completes an arm of fewer joints) is never free: it is kept at zero.
        """
        if joint.index >= self._n:
            return 0, FREE
        return 256 << joint.index, FREE | 257 * 256 << joint.index

    def _angle(self, joint: Joint, turn: Turn) -> None:
        c, s = users_turn(joint, turn)
        if joint.index < self._n:
            self._values[joint.index] = atan2(s + 0.0, c)  # adding 0 makes half a turn +pi also for s = -0
        elif joint.index < VIRTUAL_END:
            self._errors.append((1 - c) ** 2 + s * s)

    def _user(self, joint: Joint, raw: float) -> None:
        q = joint.sign * (raw - float(joint.offset))
        if joint.index >= self._n:
            self._errors.append(q * q)
        else:
            self._values[joint.index] = -wrapped(-q) if joint.revolute and not -pi < q <= pi else q
