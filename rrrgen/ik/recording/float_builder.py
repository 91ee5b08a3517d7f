"""Evaluation of a derivation, or of its recording, in floats: one path through the choices between roots at a time.

The compiler tests its equations in this way before it emits them, and the evaluation of a solver in Python
(:mod:`rrrgen.ik.interpreter`) finds its candidate solutions so. All of it is plain Python.
"""

from __future__ import annotations

from cmath import phase
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import atan2, copysign, cos, hypot, pi, sin, sqrt
from typing import Any

from rrrgen.base.small_matrices import polynomial_roots
from rrrgen.ik.geometry.chain import Joint
from rrrgen.ik.geometry.rigid_transforms import Rigid, S, Vector, dot, minus, rigid
from rrrgen.ik.recording.builder import Feasible, Label, Turn, between, users_turn
from rrrgen.ik.tolerances import BELOW_ZERO, NO_DIRECTION, SIZE_OF_NOTHING, runtime, search

TOLERANCE = {name: float(text) for name, text in runtime("double").items()}
SEARCH = search()

MULTIPLE, FREE, OUTSIDE, INEXACT, NEAR = 1, 2, 4, 8, 16
"""Flags of a solution, as in the emitted code; NEAR is an inner one: a root of this solution may be double."""


@dataclass(frozen=True)
class RootTolerances:
    """Tolerances with which the scalar equations are solved; the default ones are those of the compiler's trials.

    ``slack`` is how far below zero a discriminant may be and still count as zero; ``least`` the length below which a
    vector has no direction. ``band`` is None if the equations are those of the arm itself; if they are those of a
    similar arm of special geometry, it is the distance by which double roots are moved apart.
    """

    slack: float = BELOW_ZERO
    least: float = NO_DIRECTION
    band: float | None = None


TRIAL = RootTolerances()


class NoRoot(Exception):  # noqa: N818 - an answer, not an error
    """This path has no real solution."""


class FloatBuilder:
    """Builder that evaluates one path of a derivation for one target.

    ``T`` is the target pose (3 x 4 or 4 x 4), ``reference`` the joint values where the target leaves a joint free,
    ``script`` the index of the root taken at each choice, ``redundancy`` the prescribed joint value, ``tool`` the
    position of the tool in the frame of the last link, for solvers that have it as an input. ``fixed`` are indices of
    joints that no target leaves free, because constants of the robot determine them.

    After a run, ``values`` holds the user's joint values by joint index, ``counts`` the number of roots at each choice,
    ``numbers`` what the root taken there contributes to the number of the branch, and ``flags`` the flags of the
    solution; ``free`` are the indices of joints that the target does not determine, ``doubtful`` those that it may
    leave undetermined but for its rounding. ``lengths`` (m) and ``ratios`` vanish at a solution. ``failed`` is the
    number, from 1, of the choice without a real root, 0 where the path leads to a candidate.
    """

    def __init__(
        self,
        T: Any,
        reference: Sequence[float],
        script: list[int],
        *,
        redundancy: float = 0.0,
        tool: Vector = (0.0, 0.0, 0.0),
        settings: RootTolerances = TRIAL,
        fixed: frozenset[int] = frozenset(),
    ) -> None:
        self._tool, self._settings, self._fixed = tool, settings, fixed
        self.T, self.reference, self.script, self.redundancy = T, reference, script, redundancy
        self.counts: list[int] = []
        self.numbers: list[int] = []
        self.values: dict[int, float] = {}
        self.flags = self.failed = 0
        self.doubtful: set[int] = set()
        self.free: set[int] = set()
        self.lengths: list[float] = []
        self.ratios: list[float] = []

    # -- inputs and values --------------------------------------------------------------------------------------------

    def pose(self) -> Rigid:
        """The target pose."""
        return rigid(tuple(tuple(float(x) for x in row) for row in self.T[:3]))

    def point(self) -> Vector:
        """The target position."""
        return (float(self.T[0][3]), float(self.T[1][3]), float(self.T[2][3]))

    def tool(self) -> Vector:
        """The position of the tool in the frame of the last link."""
        return self._tool

    def name(self, hint: str, x: S) -> S:
        """Return ``x``; floats need no name."""
        return x

    def names(self, hint: str, v: Vector) -> Vector:
        """Return ``v``; floats need no name."""
        return v

    def sqrt(self, x: S) -> S:
        """The square root; round-off below zero counts as zero."""
        return sqrt(max(float(x), 0.0))

    # -- choices ------------------------------------------------------------------------------------------------------

    def pair(self, joint: Joint, A: S, B: S, C: S, *, label: Label, unit: float, radicand: S | None = None) -> Turn:
        """Solve ``A cos(x) + B sin(x) = C``; of the two angles the one that ``script`` selects.

        With k = C / h and h = sqrt(A^2 + B^2) they are ``cos(x) = (A k -+ B w) / h``, ``sin(x) = (B k +- A w) / h``
        for w = sqrt(1 - k^2).
        """
        a, b, h = float(A), float(B), hypot(A, B)
        if self._is_free(joint, h, unit):
            self._choose(int(self._settings.slack * unit * unit >= C * C))
            return self._turn(joint, self._reference_turn(joint))
        k = C / h
        better = None if radicand is None else float(radicand) / (h * h)
        count, w = self._root((1.0 - k) * (1.0 + k) if better is None or better < 0.0 else better, 1.0)
        k = copysign(1.0, k) if count == 1 else k
        w *= (1, -1)[self._choose(count)] * label.positive
        return self._turn(joint, Turn((a * k - b * w) / h, (b * k + a * w) / h))

    def signed_root(self, hint: str, radicand: S, *, size: S, joint: Joint, label: Label, unit: float) -> S:
        """The square root of ``radicand`` with the sign that ``script`` selects."""
        count, w = self._root(float(radicand), float(size) + SIZE_OF_NOTHING * unit * unit)
        return w * (1, -1)[self._choose(count)] * label.positive

    def quartic(self, joint: Joint, k: tuple[S, S, S, S, S], *, label: Label) -> Turn:
        """Solve ``k0 + k1 cos x + k2 sin x + k3 cos 2x + k4 sin 2x = 0``; the root that ``script`` selects.

        The angles are those of the roots z = exp(i x) of a complex quartic that lie on the unit circle.
        """
        size = sum(map(abs, k))
        k0, kc, ks, k2c, k2s = (float(x) / size for x in k) if size > 0.0 else (1.0, 0.0, 0.0, 0.0, 0.0)
        ends, middle = complex(k2c, k2s) / 2, complex(kc, ks) / 2
        z = polynomial_roots([ends.conjugate(), middle.conjugate(), k0, middle, ends])
        close = TOLERANCE["circle"] + self._settings.slack**2
        starts = [phase(root) for root in z if root != 0 and (abs(root) ** 2 - 1) ** 2 <= close]

        def value(x: float) -> float:
            return k0 + kc * cos(x) + ks * sin(x) + k2c * cos(2 * x) + k2s * sin(2 * x)

        def slope(x: float) -> float:
            return -kc * sin(x) + ks * cos(x) - 2 * k2c * sin(2 * x) + 2 * k2s * cos(2 * x)

        angles = sorted(wrap(_polish_root(x, value, slope)) for x in starts)
        x = angles[self._choose(len(angles), _numbers(map(slope, angles)))]
        self._slide(joint, x)
        return Turn(cos(x), sin(x))

    def polynomial(self, joint: Joint, k: tuple[S, ...], *, label: Label, unit: float) -> S:
        """Solve ``k0 + k1 x + k2 x^2 + ... = 0`` for a displacement; the root that ``script`` selects."""
        c = [float(x) for x in k]
        if len(c) == 2:
            return self.slide(joint, -c[0] / c[1])
        roots, numbers = self._quadratic(c, unit) if len(c) == 3 else self._power4(c, unit)
        x = roots[self._choose(len(roots), numbers)]
        self._slide(joint, x)
        return x

    def _quadratic(self, k: Sequence[float], unit: float) -> tuple[list[float], list[int]]:
        """Real roots of ``k0 + k1 x + k2 x^2``, the larger first, with their branch numbers."""
        k0, k1, k2 = k
        if abs(k2) * unit <= TOLERANCE["eps"] * abs(k1):
            return ([-k0 / k1], [0 if k1 > 0.0 else 1]) if k1 else ([], [])
        count, w = self._root(k1 * k1 - 4.0 * k0 * k2, k1 * k1 + abs(4.0 * k0 * k2))
        if count < 2:
            return [-0.5 * k1 / k2] * count, [0] * count
        half = -0.5 * (k1 + copysign(w, k1))  # no cancellation: the other root follows from the product of both
        return sorted((half / k2, k0 / half), reverse=True), [0, 1]

    def _power4(self, k: Sequence[float], unit: float) -> tuple[list[float], list[int]]:
        """Real roots of a polynomial of degree four, ascending, with their branch numbers.

        ``unit`` is the typical size of a root, m, in which tolerances and the roots y = x / unit are measured.
        """
        size = sum(abs(x) * unit**i for i, x in enumerate(k))
        c = [x * unit**i / size for i, x in enumerate(k)] if size > 0.0 else [1.0]
        close = TOLERANCE["circle"] + self._settings.slack**2
        starts = [z.real for z in polynomial_roots(c[::-1]) if z.imag**2 <= close * (1.0 + abs(z) ** 2)]

        def value(y: float) -> float:
            return sum(x * y**i for i, x in enumerate(c))

        def slope(y: float) -> float:
            return sum(i * x * y ** (i - 1) for i, x in enumerate(c) if i)

        roots = sorted(_polish_root(y, value, slope) for y in starts)
        self.flags |= NEAR
        return [y * unit for y in roots], _numbers(map(slope, roots))

    def _root(self, w2: float, size: float) -> tuple[int, float]:
        """Solve ``w^2 = w2``: (2, w) for two roots +-w, (1, 0) at a double root, (0, 0) where there is none.

        ``size`` is the magnitude of the terms that w2 was summed from, to which its tolerance is relative.
        """
        slack, band = self._settings.slack, self._settings.band
        if band is not None and w2 <= TOLERANCE["band"] * size:
            self.flags |= NEAR
            if -slack * size <= w2 < band * size:
                w2 = band * size
        if w2 > 0.0:
            self.flags |= NEAR if w2 <= TOLERANCE["merge"] * size else 0
            return 2, sqrt(w2)
        self.flags |= MULTIPLE
        return int(w2 >= -slack * size), 0.0

    def _choose(self, count: int, numbers: Sequence[int] = (0, 1)) -> int:
        """Index of the root, among ``count``, that this path takes.

        ``numbers`` are what the roots contribute to the number of the branch.
        """
        if count == 0:
            self.failed = len(self.counts) + 1
            raise NoRoot
        self.counts.append(count)
        if len(self.counts) > len(self.script):
            self.script.append(0)
        taken = self.script[len(self.counts) - 1]
        self.numbers.append(numbers[taken])
        return taken

    # -- single answers -----------------------------------------------------------------------------------------------

    def turn(self, joint: Joint, s: S, c: S) -> Turn:
        """The angle ``atan2(s, c)``; the joint's value in ``reference`` where both vanish."""
        size = hypot(c, s)
        free = self._is_free(joint, size)
        return self._turn(joint, self._reference_turn(joint) if free else Turn(c / size, s / size))

    def onto(self, joint: Joint, v: Vector, u: Vector, *, unit: float, feasible: Feasible | None = None) -> Turn:
        """The angle about z that turns ``v`` onto ``u``; the value in ``reference`` where one of them lies along z."""
        before, after = hypot(v[0], v[1]), hypot(u[0], u[1])
        (c, s), size = between(v, u), before * after
        self.ratios += [(before - after) / unit, (v[2] - u[2]) / unit]
        if self._is_free(joint, sqrt(size), unit):
            return self._turn(joint, self._reference_turn(joint, feasible))
        return self._turn(joint, Turn(c / size, s / size))

    def slide(self, joint: Joint, x: S) -> S:
        """Set ``joint`` to the value ``x``: a displacement, or an angle that follows from others."""
        self._slide(joint, float(x))
        return float(x)

    def redundancy_parameter(self, joint: Joint) -> Turn | S:
        """The value of the prescribed joint, from ``redundancy``."""
        raw = joint.sign * self.redundancy + float(joint.offset)
        self.values[joint.index] = self.redundancy
        return Turn(cos(raw), sin(raw)) if joint.revolute else raw

    def wrist(
        self, joints: tuple[Joint, Joint, Joint], M: tuple[Vector, Vector, Vector], signs: tuple[int, int]
    ) -> tuple[Turn, Turn, Turn]:
        """Solve ``Rz(x4) Rx(e4 pi/2) Rz(x5) Rx(e5 pi/2) Rz(x6) = M`` with (e4, e5) = ``signs``.

        Returns the one of the two solutions that ``script`` selects.
        """
        e4, e5 = signs
        c4, s4, c5 = e5 * M[0][2], e5 * M[1][2], -e4 * e5 * M[2][2]
        s5 = hypot(c4, s4)
        free = self._is_free(joints[0], s5)
        c4, s4 = self._reference_turn(joints[0]) if free else (c4 / s5, s4 / s5)
        mx = (M[0][0], M[1][0], M[2][0])
        column0, column1 = (c4 * c5, s4 * c5, e4 * s5), (e4 * e5 * s4, -e4 * e5 * c4, 0.0)
        c6, s6 = dot(column0, mx), dot(column1, mx)
        self.residual((), minus(tuple(c6 * x + s6 * y for x, y in zip(column0, column1, strict=True)), mx))
        g = (1, -1)[self._choose(1 if free else 2)]
        turns = (Turn(g * c4, g * s4), Turn(c5, g * s5), Turn(g * c6, g * s6))
        for joint, turn in zip(joints, turns, strict=True):
            self._turn(joint, turn)
        return turns

    def residual(self, lengths: tuple[S, ...] = (), cosines: tuple[S, ...] = ()) -> None:
        """Record quantities that vanish at a solution, for :attr:`lengths` and :attr:`ratios`."""
        self.lengths += map(float, lengths)
        self.ratios += map(float, cosines)

    # -- joints -------------------------------------------------------------------------------------------------------

    def _is_free(self, joint: Joint, size: float, unit: float = 1.0) -> bool:
        """Whether a vector of the length ``size`` has no direction, so that ``joint``, which would turn it, is free.

        ``unit`` is the natural size of the vector.
        """
        if joint.index in self._fixed or not size <= TOLERANCE["doubt"] * unit:
            return False
        self.doubtful.add(joint.index)
        if size > self._settings.least * unit:
            return False
        self.free.add(joint.index)
        self.flags |= FREE
        return True

    def _reference_turn(self, joint: Joint, feasible: Feasible | None = None) -> Turn:
        """Cosine and sine of the joint's reference, or of the nearest ``feasible`` angle if that is given."""
        known = self.reference[joint.index] if joint.index < len(self.reference) else 0.0
        x = joint.sign * known + float(joint.offset)
        x = x if feasible is None else _nearest_feasible(x, feasible)
        return Turn(cos(x), sin(x))

    def _turn(self, joint: Joint, turn: Turn) -> Turn:
        """Set ``joint`` to the raw angle ``turn``, and return it."""
        c, s = users_turn(joint, turn)
        self.values[joint.index] = atan2(s + 0.0, c)  # adding 0 makes half a turn +pi also for s = -0
        return turn

    def _slide(self, joint: Joint, raw: float) -> None:
        q = joint.sign * (raw - float(joint.offset))
        self.values[joint.index] = wrap(q) if joint.revolute else q


def _polish_root(x: float, value: Callable[[float], float], slope: Callable[[float], float]) -> float:
    """The root ``x`` of a function after two Newton steps, which are short and stop where the slope vanishes."""
    for _ in range(2):
        d = slope(x)
        step = value(x) * d / (d * d + TOLERANCE["eps"])
        x -= min(max(step, -SEARCH["newton"]), SEARCH["newton"])
    return x


def _numbers(slopes: Iterator[float]) -> list[int]:
    """Branch numbers of the roots of a quartic: by the sign of the ``slopes`` at the roots, then by their order.

    These numbers stay the same along a path on which no two roots meet.
    """
    seen = {True: 0, False: 0}
    numbers = []
    for d in slopes:
        numbers.append(2 * (seen[d > 0.0] & 1) + (not d > 0.0))
        seen[d > 0.0] += 1
    return numbers


def _nearest_feasible(reference: float, bounds: Feasible) -> float:
    """The feasible angle nearest to ``reference``; the reference itself if no angle is feasible."""
    mean, a, b, lower, upper = bounds
    h, now = hypot(a, b), mean + a * cos(reference) + b * sin(reference)
    if lower <= now <= upper or not h > 0.0:
        return reference
    ends = []
    for k in ((limit - mean) / h for limit in (lower, upper)):
        if k * k <= 1.0:
            e = atan2(sqrt((1.0 - k) * (1.0 + k)), k)
            ends += [wrap(atan2(b, a) + side - reference) for side in (e, -e)]
    return reference + min(ends, key=abs, default=0.0)


def paths(run: Callable[[FloatBuilder], None], make: Callable[[list[int]], FloatBuilder]) -> Iterator[FloatBuilder]:
    """Evaluate every path of a derivation; yields its builder, also where a choice had no root (``failed``).

    ``run`` plays the derivation on a builder, ``make`` creates a builder for a list of root indices. A path that ends
    in a division by zero or an overflow is left out: in the emitted code such a candidate holds a NaN and is dropped.
    """
    script: list[int] = []
    while True:
        builder = make(script)
        try:
            with suppress(NoRoot):
                run(builder)
            yield builder
        except (ZeroDivisionError, OverflowError):
            pass
        script = next_script(builder.script, builder.counts)
        if not script:
            return


def every_branch(run: Callable[[FloatBuilder], None], make: Callable[[list[int]], FloatBuilder]) -> list[list[float]]:
    """The joint values of every branch of a derivation, not yet compared with the target; arguments as of `paths`."""
    return [[path.values[j] for j in sorted(path.values)] for path in paths(run, make) if not path.failed]


def next_script(script: Sequence[int], counts: Sequence[int]) -> list[int]:
    """The indices of the roots on the branch after that of ``script``, which had ``counts`` roots at its choices.

    The last choice changes first; later choices take their first root. Empty after the last branch.
    """
    following = list(script[: len(counts)])
    while following and following[-1] + 1 >= counts[len(following) - 1]:
        following.pop()
    if following:
        following[-1] += 1
    return following


def wrap(x: float, period: float = 2 * pi) -> float:
    """``x`` moved by whole periods into (-period / 2, period / 2]; a period of 0 is none."""
    half = 0.5 * period
    return x if not period or -half < x <= half else half - (half - x) % period
