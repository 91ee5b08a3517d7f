"""Closed loops in exact numbers: the vectors that close each loop, and coordinates in which they are simple.

A loop lies in a plane across the axes of its revolute joints. The tree of rows leads from a common link to the pin in
two ways; the difference of both ways, a sum of vectors that turn with the links, is zero in this plane:

    sum over the segments of sign Rz(turning . x + angle) (place + (slide . x) direction) = 0.

The coordinates x are the positions q of the driven joints and two coordinates of every loop. That of a passive revolute
row is the angle of its link in the plane, without the constant angles of the table, not the angle at its joint: a
dyad has cosine and sine of that angle in closed form, and its rate needs no differences. That of a prismatic row is its
displacement.

Of the two passive rows of a loop, one at least is revolute.

Loops that are solved by Newton's method are no dyads, and their coordinates are the displacements of all passive rows.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import sympy as sp

from rrrgen.base.errors import DerivationError
from rrrgen.robot.model.exact_transforms import IDENTITY, JointModel, RigidTransform, normal_form
from rrrgen.robot.spec import LoopSpec, RobotSpec

Form = tuple[sp.Expr, ...]
"""The factors of a linear form in the coordinates x."""

SAME_LENGTH = 1e-9
"""Relative difference below which two sides of a loop count as equal."""


class LoopError(DerivationError):
    """The loop called ``name`` cannot be solved; ``hint`` says what to do."""

    def __init__(self, name: str, message: str, hint: str) -> None:
        super().__init__(f"loop '{name}': {message}; {hint}")
        self.name, self.message, self.hint = name, message, hint


class ParallelogramError(LoopError):
    """A loop is a parallelogram, whose passive rows follow the drives.

    ``follows`` gives for each passive row its factors (n,) of q and a constant, rad; None for a loop on another one, or
    with four equal sides, of which each may be opposite to two.
    """

    def __init__(self, name: str, follows: dict[int, tuple[Form, sp.Expr]] | None) -> None:
        hint = "drop the loop and let its passive rows follow the driven ones: follows: {crank: 1, arm: -1}"
        super().__init__(name, "it is a parallelogram, whose opposite sides are equal", hint)
        self.follows = follows


@dataclass(frozen=True)
class Segment:
    """One vector of a closure: ``sign Rz(turning . x + angle) (place + (slide . x) direction)``.

    ``angle`` in rad, ``place`` (2,) in m, ``direction`` (2,) of unit length or zero.
    """

    sign: int
    turning: Form
    angle: sp.Expr
    place: tuple[sp.Expr, sp.Expr]
    slide: Form
    direction: tuple[sp.Expr, sp.Expr]


@dataclass(frozen=True)
class Closure:
    """A loop as its ``segments``, whose sum is zero, and the numbers in x of its two ``coordinates``.

    ``slider`` is the one that is the displacement of a prismatic row, None if both are angles. ``assembly`` is +1 where
    the pin between the two passive links lies left of the line from the outer pin of the first to that of the second,
    seen against the axis of the plane, and with a slider where that is the larger of the two displacements at which the
    loop closes; otherwise -1.
    """

    name: str
    coordinates: tuple[int, int]
    assembly: int
    segments: tuple[Segment, ...]
    slider: int | None = None


@dataclass(frozen=True)
class _Orientation:
    """The orientation ``Rz(turning . x + angle) C`` of a link in the plane of a loop."""

    turning: Form
    angle: sp.Expr
    C: sp.ImmutableMatrix


class LoopGeometry:
    """The loops of ``spec``, whose canonical frames are ``joints`` and ``link_frames``.

    ``closures`` are the loops, each behind those that its known links depend on. ``coupling`` (links, coordinates) maps
    the coordinates x to the displacements of all joints. Raises LoopError for a loop that is no planar dyad.
    """

    def __init__(self, spec: RobotSpec, joints: Sequence[JointModel], link_frames: Sequence[RigidTransform]) -> None:
        assert spec.mechanism is not None
        self._spec, self._joints, self._link_frames = spec, joints, link_frames
        self._mechanism = spec.mechanism
        self._width = spec.n + len(self._mechanism.passive)
        self._known: dict[int, Form | None] = {}
        self._base = RigidTransform(
            sp.ImmutableMatrix(3, 3, list(spec.base.rotation)), sp.ImmutableMatrix(list(spec.base.translation))
        )
        closures = [self._closure(k) for k in range(len(self._mechanism.loops))]
        self.coupling = tuple(self._displacement(i) for i in range(len(joints)))
        self.closures = tuple(closures) if spec.newton else self._in_order(closures)

    # -- displacements over the coordinates --------------------------------------------------------------------------

    def _unit(self, k: int) -> Form:
        return tuple(sp.Integer(j == k) for j in range(self._width))

    def _displacement(self, i: int) -> Form:
        """The displacement of joint i as a linear form in x."""
        if i not in self._known:
            self._known[i] = None
            passive = self._mechanism.passive
            total: Form = (sp.S.Zero,) * self._width
            for k, factor in enumerate(self._mechanism.matrix[i]):
                if factor == 0:
                    continue
                j = k - self._spec.n
                if j < 0:
                    total = _plus(total, self._unit(k), factor)
                elif passive[j] == i:
                    total = _plus(total, self._of_passive(j), sp.S.One)
                else:  # a row that follows a passive one
                    passive_factor = self._mechanism.matrix[passive[j]][k]
                    total = _plus(total, self._displacement(passive[j]), factor * passive_factor)
            self._known[i] = total
        displacement = self._known[i]
        if displacement is None:
            loop = self._mechanism.loops[0]
            raise LoopError(loop.name, "its links depend on each other through the rows that follow them", _ORDER)
        return displacement

    def _of_passive(self, j: int) -> Form:
        """The displacement of passive row number j: its angle in the plane minus that of the link before it.

        That of a prismatic row is its coordinate, and with Newton's method that of every row.
        """
        row, k = self._mechanism.passive[j], self._spec.n + j
        if self._spec.newton:
            return tuple(v * self._mechanism.matrix[row][k] for v in self._unit(k))
        if not self._joints[row].revolute:
            return self._unit(k)
        facing, before = self._carrier(self._mechanism.loops[j // 2], self._mechanism.passive[j])
        return _plus(tuple(facing * v for v in self._unit(self._spec.n + j)), before.turning, sp.Integer(-facing))

    def _carrier(self, loop: LoopSpec, row: int) -> tuple[int, _Orientation]:
        """The sense of the axis of a passive ``row`` across the plane of its loop, and the link that carries it."""
        branch = self._branch_of(loop, row)
        before = self._orientation(loop, branch[: branch.index(row)])
        return self._facing(loop, before.C * self._joints[row].before.R, row), before

    def _branch_of(self, loop: LoopSpec, row: int) -> tuple[int, ...]:
        """The rows from the common link to that pinned link which the passive ``row`` moves."""
        branches, _ = self._branches(loop)
        branch = next((rows for rows in branches if row in rows), None)
        if branch is None:
            name = self._joints[row].name
            hint = "pin links that the passive rows move, one behind the other or one on each side"
            raise LoopError(loop.name, f"'{name}' does not move one of the pinned links against the other", hint)
        return branch

    # -- the plane of a loop -----------------------------------------------------------------------------------------

    def _branches(self, loop: LoopSpec) -> tuple[tuple[tuple[int, ...], tuple[int, ...]], int]:
        """The rows from the link that both ways have in common (excluded) to both pinned links, and that link."""
        first, second = (self._mechanism.path(row) if row >= 0 else () for row, _ in loop.pins)
        common = 0
        while common < min(len(first), len(second)) and first[common] == second[common]:
            common += 1
        return (first[common:], second[common:]), first[common - 1] if common else -1

    def _start(self, loop: LoopSpec) -> _Orientation:
        """The orientation of the common link: that of its block of parallel axes where these are across the plane.

        Otherwise the plane is turned with the first revolute row behind it.
        """
        branches, root = self._branches(loop)
        zero: Form = (sp.S.Zero,) * self._width
        for branch in branches:
            G = IDENTITY
            for i in branch:
                G = sp.ImmutableMatrix((G * self._joints[i].before.R).applyfunc(_exact))
                if not self._joints[i].revolute:
                    continue
                if root >= 0 and G[:, 2] == IDENTITY[:, 2]:
                    return self._in_block(root)
                return _Orientation(zero, sp.S.Zero, sp.ImmutableMatrix(G.T))
        raise LoopError(loop.name, "it has no revolute row", "a loop turns about at least one axis")

    def _in_block(self, root: int) -> _Orientation:
        """The orientation of link ``root`` in the block of parallel axes that it belongs to."""
        turning, angle, i = (sp.S.Zero,) * self._width, sp.S.Zero, root
        while True:
            joint = self._joints[i]
            if joint.revolute:
                turning, angle = _plus(turning, self._displacement(i), sp.S.One), angle + joint.theta
            if not joint.parallel:
                return _Orientation(turning, angle, IDENTITY)
            i = joint.parent

    def _facing(self, loop: LoopSpec, C: sp.MatrixBase, row: int) -> int:
        """The sense of the axis of revolute joint ``row``, +1 or -1, across the plane; ``C`` is its orientation."""
        axis = [_exact(v) for v in C[:, 2]]
        if axis[:2] != [0, 0] or axis[2] not in (1, -1):
            hint = "the axes of all its revolute rows are parallel"
            raise LoopError(loop.name, f"the axis of '{self._joints[row].name}' is not across its plane", hint)
        return int(axis[2])

    def _orientation(self, loop: LoopSpec, rows: Sequence[int]) -> _Orientation:
        """The orientation of the link behind ``rows``, which begin at the common link."""
        at = self._start(loop)
        for i in rows:
            at = self._orientation_behind(loop, at, i)
        return at

    def _orientation_behind(self, loop: LoopSpec, at: _Orientation, i: int) -> _Orientation:
        joint = self._joints[i]
        C = sp.ImmutableMatrix((at.C * joint.before.R).applyfunc(_exact))
        if not joint.revolute:
            return replace(at, C=C)
        facing = self._facing(loop, C, i)
        turning = _plus(at.turning, self._displacement(i), sp.Integer(facing))
        return _Orientation(turning, at.angle + facing * joint.theta, C)

    # -- closures ----------------------------------------------------------------------------------------------------

    def _closure(self, k: int) -> Closure:
        loop = self._mechanism.loops[k]
        branches, _ = self._branches(loop)
        side, slider = (0, None) if self._spec.newton else self._side(k)
        segments: list[Segment] = []
        for sign, branch, (row, point) in zip((1, -1), branches, loop.pins, strict=True):
            at = self._start(loop)
            for i in branch:
                segments += self._way(loop, sign, at, i)
                at = self._orientation_behind(loop, at, i)
            frame = self._link_frames[row] if row >= 0 else self._base
            segments.append(self._segment(sign, at, at.C * (frame.R * sp.Matrix(point) + frame.p)))
        coordinates = (self._spec.n + 2 * k, self._spec.n + 2 * k + 1)
        closure = Closure(loop.name, coordinates, side * loop.assembly, tuple(_merge_segments(segments)), slider)
        if self._spec.newton:
            for row in loop.passive:
                self._branch_of(loop, row)
            return closure
        _check_dyad(closure)
        _refuse_locked(closure)
        sides = _opposite_sides(self._spec, closure)
        if sides is not None:
            raise ParallelogramError(loop.name, self._followers(loop, closure, sides))
        _refuse_isosceles(self._spec, closure)
        return closure

    def _followers(
        self, loop: LoopSpec, closure: Closure, sides: dict[int, tuple[Form, sp.Expr]]
    ) -> dict[int, tuple[Form, sp.Expr]] | None:
        """The rows of a parallelogram as :class:`ParallelogramError` has them.

        ``sides`` holds for both coordinates of ``closure`` the form and the constant that it equals; empty if unknown.
        """
        followers: dict[int, tuple[Form, sp.Expr]] = {}
        for coordinate, row in zip(closure.coordinates, loop.passive, strict=True):
            facing, before = self._carrier(loop, row)
            form, constant = (sp.S.Zero,) * self._width, sp.S.Zero
            turned = [*(-facing * v for v in before.turning)]
            turned[coordinate] += facing
            for k, factor in enumerate(turned):
                if factor != 0:
                    side_form, offset = sides.get(k, (self._unit(k), sp.S.Zero))
                    form, constant = _plus(form, side_form, factor), constant + factor * offset
            if not sides or any(form[self._spec.n :]):
                return None
            followers[row] = form[: self._spec.n], _exact(constant)
        return followers

    def _side(self, k: int) -> tuple[int, int | None]:
        """Check the passive rows of loop number ``k``.

        Returns the sense, +1 or -1, in which its file counts the assembly, and the coordinate of a prismatic row.
        """
        loop = self._mechanism.loops[k]
        sliding = [j for j, row in enumerate(loop.passive) if not self._joints[row].revolute]
        if len(sliding) == 2:
            names = " and ".join(f"'{self._joints[row].name}'" for row in loop.passive)
            hint = "one of them turns; the pin lets the other one slide"
            raise LoopError(loop.name, f"the passive rows {names} are prismatic", hint)
        carriers = [self._carrier(loop, row) for row in loop.passive if self._joints[row].revolute]
        if not sliding:
            return carriers[0][0], None
        row, coordinate = loop.passive[sliding[0]], self._spec.n + 2 * k + sliding[0]
        branch = self._branch_of(loop, row)
        before = self._orientation(loop, branch[: branch.index(row)])
        if all(_exact(v) == 0 for v in (before.C * self._joints[row].before.R)[:2, 2]):
            hint = "a passive prismatic row slides in the plane"
            raise LoopError(loop.name, f"the axis of '{self._joints[row].name}' is across its plane", hint)
        return int(self._mechanism.matrix[row][coordinate]), coordinate

    def _way(self, loop: LoopSpec, sign: int, at: _Orientation, i: int) -> list[Segment]:
        """The segments from the link oriented ``at`` to the origin of joint ``i`` on it."""
        joint = self._joints[i]
        segments = [self._segment(sign, at, at.C * joint.before.p)]
        if not joint.revolute:
            x, y, z = (_exact(v) for v in (at.C * joint.before.R)[:, 2])
            if z != 0 and (x, y) != (0, 0):
                hint = "a prismatic row slides in the plane or across it"
                raise LoopError(loop.name, f"the axis of '{joint.name}' is inclined to its plane", hint)
            segments.append(Segment(sign, at.turning, at.angle, (sp.S.Zero, sp.S.Zero), self._displacement(i), (x, y)))
        return segments

    def _segment(self, sign: int, at: _Orientation, vector: sp.MatrixBase) -> Segment:
        zero = sp.S.Zero
        x, y, _ = (_exact(v) for v in vector)  # an offset along the axis of the pin does not matter
        return Segment(sign, at.turning, at.angle, (x, y), (zero,) * self._width, (zero, zero))

    def _in_order(self, closures: Sequence[Closure]) -> tuple[Closure, ...]:
        """The ``closures``, each behind those whose coordinates occur in it."""
        waiting, known, ordered = list(closures), set(range(self._spec.n)), list[Closure]()
        while waiting:
            ready = next((c for c in waiting if coordinates_of(c) <= known | {*c.coordinates}), None)
            if ready is None:
                raise LoopError(waiting[0].name, f"it and {waiting[-1].name} need each other", _ORDER)
            waiting.remove(ready)
            known |= {*ready.coordinates}
            ordered.append(ready)
        return tuple(ordered)


_ORDER = (
    "loops are solved one after the other, each from joints whose positions are known; solve: newton, with a start "
    "instead of assembly, solves all together"
)


def coordinates_of(closure: Closure) -> set[int]:
    """The numbers of all coordinates that occur in ``closure``."""
    forms = [form for s in closure.segments for form in (s.turning, s.slide)]
    return {k for form in forms for k, factor in enumerate(form) if factor != 0}


def _exact(expression: sp.Expr) -> sp.Expr:
    """The normal form of ``expression``: a rational number where it is one.

    Sines of angles that are held back do not commute, and so do not cancel; freed they do. Other entries keep the held
    form, by which the derivation knows the same sine elsewhere.
    """
    held = normal_form(expression)
    if held.is_commutative:
        return held
    freed = normal_form(expression.doit())
    return freed if freed.is_Rational else held


def _plus(x: Form, y: Form, factor: sp.Expr) -> Form:
    return tuple(a + factor * b for a, b in zip(x, y, strict=True))


def _merge_segments(segments: Sequence[Segment]) -> list[Segment]:
    """The ``segments`` without zero ones; constant vectors that turn by equal angles are added."""
    sums: dict[tuple[Form, sp.Expr], Segment] = {}
    slides = []
    for one in segments:
        if any(one.direction):
            slides.append(one)
            continue
        x, y = (one.sign * v for v in one.place)
        key = one.turning, one.angle
        if key in sums:
            x, y = (normal_form(u + v) for u, v in zip((x, y), sums[key].place, strict=True))
        sums[key] = replace(one, sign=1, place=(x, y))
    return [one for one in sums.values() if one.place != (0, 0)] + [one for one in slides if any(one.slide)]


def _check_dyad(closure: Closure) -> None:
    """Raise LoopError unless the two passive links are bars between points that are known without them."""
    a, b = closure.coordinates
    bars, slides = [False, False], 0
    for one in closure.segments:
        turned, moved = (one.turning[a], one.turning[b]), (one.slide[a], one.slide[b])
        only = any(moved) and any(v != 0 for k, v in enumerate(one.slide) if k not in (a, b))
        if turned not in ((0, 0), (1, 0), (0, 1)) or moved not in ((0, 0), (1, 0), (0, 1)) or only:
            raise LoopError(closure.name, "a row that follows a passive one lies inside it", _ORDER)
        slides += sum(moved)
        bars = [bar or one.turning[k] == 1 or k == closure.slider for bar, k in zip(bars, (a, b), strict=True)]
    if slides > 1:
        raise LoopError(closure.name, "a row that follows a passive one lies inside it", _ORDER)
    if not all(bars):
        hint = "both passive links are bars between their joint and the pin, or the joint of the other one"
        raise LoopError(closure.name, "a passive link has no length in it", hint)


def _refuse_locked(closure: Closure) -> None:
    """Raise LoopError for a loop that no drive moves, whose passive links are then fixed to each other.

    The vectors on each bar, and those from the one bar to the other, are then rigid: none slides by a drive, and all
    turn by the same angle. Across the direction of a slider, that direction belongs to them too.
    """
    a, b = closure.coordinates
    groups: dict[tuple[bool, bool], set[Form]] = {}
    for one in closure.segments:
        if any(v != 0 for k, v in enumerate(one.slide) if k not in (a, b)):
            return
        groups.setdefault((one.turning[a] == 1, one.turning[b] == 1), set()).add(one.turning)
    if all(len(turning) == 1 for turning in groups.values()):
        hint = "drop the loop and let its passive rows follow: follows: {}, with the angles and lengths that they keep"
        raise LoopError(closure.name, "no drive moves its passive links against each other", hint)


def _number(spec: RobotSpec, value: sp.Expr) -> float:
    return float(spec.nominal(value).doit())  # doit: angles whose cosines have no short form are held back


def _side_lengths(spec: RobotSpec, segments: Sequence[Segment]) -> dict[Form, complex]:
    """The vectors (m, at nominal parameters) of ``segments`` without slides, added where they turn by one angle."""
    sides: dict[Form, complex] = {}
    for one in segments:
        turned = complex(*(_number(spec, v) for v in one.place)) * cmath.rect(1, _number(spec, one.angle))
        sides[one.turning] = sides.get(one.turning, 0) + one.sign * turned
    return sides


def _refuse_isosceles(spec: RobotSpec, closure: Closure) -> None:
    """Raise LoopError for a bar as long as the crank whose pivot lies on the axis of its slider.

    The number under the root is then a square, as that of a parallelogram.
    """
    slide = next((s for s in closure.segments if closure.slider is not None and s.slide[closure.slider] != 0), None)
    turned = next((k for k in closure.coordinates if k != closure.slider), 0)
    if slide is None or slide.turning[turned] != 0 or any(any(s.direction) for s in closure.segments if s is not slide):
        return
    bars = _side_lengths(spec, [s for s in closure.segments if s.turning[turned] == 1])
    sides = _side_lengths(spec, [s for s in closure.segments if s.turning[turned] == 0 and s is not slide])
    if len(bars) != 1:
        return
    bar = abs(next(iter(bars.values())))
    direction = complex(*(_number(spec, v) for v in slide.direction)) * cmath.rect(1, _number(spec, slide.angle))
    beside = (sides.pop(slide.turning, 0j) * direction.conjugate()).imag
    cranks = [abs(v) for v in sides.values() if abs(v) > SAME_LENGTH * bar]
    if len(cranks) == 1 and math.isclose(cranks[0], bar, rel_tol=SAME_LENGTH) and abs(beside) < SAME_LENGTH * bar:
        hint = "its passive rows stand still or move as 2 cos of the crank's angle; make a length differ by 1e-6 m"
        raise LoopError(closure.name, "its bar is as long as the crank, whose pivot is on the axis of the slider", hint)


def _opposite_sides(spec: RobotSpec, closure: Closure) -> dict[int, tuple[Form, sp.Expr]] | None:
    """The sides opposite to both bars of a parallelogram, by coordinate: the form and the constant that this equals.

    None for other loops, and empty for a rhombus and bars that drives turn. The square root of its equation is rational
    in a parallelogram, so that its sign has no meaning of its own, and the base parameters of both ways to assemble it
    differ.
    """
    a, b = closure.coordinates
    if any(any(one.direction) for one in closure.segments):
        return None
    sides = _side_lengths(spec, closure.segments)
    bars = {k: [(form, v) for form, v in sides.items() if form[k] == 1] for k in (a, b)}
    known = [(form, v) for form, v in sides.items() if form[a] == 0 and form[b] == 0]
    lengths = sorted(sum(abs(v) for _, v in bar_sides) for bar_sides in bars.values())
    opposite = sorted(abs(v) for _, v in known)
    pairs = zip(lengths, opposite, strict=False)
    if len(sides) != 4 or len(known) != 2 or not all(math.isclose(*pair, rel_tol=SAME_LENGTH) for pair in pairs):
        return None
    if math.isclose(*opposite, rel_tol=SAME_LENGTH) or any(sum(v != 0 for v in bars[k][0][0]) != 1 for k in (a, b)):
        return {}
    opposite_sides = {}
    for k in (a, b):
        _, bar = bars[k][0]
        form, side = min(known, key=lambda candidate: abs(abs(candidate[1]) - abs(bar)))
        opposite_sides[k] = form, _exact_angle(cmath.phase(-side / bar))
    return opposite_sides


def _exact_angle(angle: float) -> sp.Expr:
    """An angle, rad: a multiple of half a degree where it is one, or a decimal that half a turn may stand beside."""
    halves = math.degrees(angle) * 2
    if abs(halves - round(halves)) < 1e-9:
        return sp.Rational(round(halves), 360) * sp.pi
    for half in (0, 1, -1):
        decimal = f"{angle - half * math.pi:.6f}"
        if abs(float(decimal) + half * math.pi - angle) < 1e-12:
            return sp.Rational(decimal) + half * sp.pi
    return sp.Rational(repr(angle))


def with_parallelograms_followed(spec: RobotSpec, error: ParallelogramError) -> RobotSpec:
    """``spec`` without the loop of ``error``: its passive rows follow the drives as ``error.follows`` says."""
    mechanism, n = spec.mechanism, spec.n
    assert mechanism is not None
    assert error.follows is not None
    k = next(i for i, loop in enumerate(mechanism.loops) if loop.name == error.name)
    columns = n + 2 * k, n + 2 * k + 1
    rows, matrix = [], []
    for row, factors in zip(mechanism.rows, mechanism.matrix, strict=True):
        form, constant = (*factors[:n], *(sp.S.Zero for _ in factors[n:])), sp.S.Zero
        for j, factor in enumerate(factors):
            if j in columns and factor != 0:
                passive = mechanism.passive[j - n]
                passive_form, offset = error.follows[passive]
                weight = factor * mechanism.matrix[passive][j]  # +1 for the passive row itself, whatever its sign
                form = tuple(
                    x + weight * y for x, y in zip(form, (*passive_form, *(0 for _ in factors[n:])), strict=True)
                )
                constant += weight * offset
            elif j >= n:
                form = (*form[:j], factor, *form[j + 1 :])
        rows.append(replace(row, theta=normal_form(row.theta + constant)) if constant != 0 else row)
        matrix.append(tuple(v for j, v in enumerate(form) if j not in columns))
    loops = tuple(loop for loop in mechanism.loops if loop.name != error.name)
    return replace(spec, mechanism=replace(mechanism, rows=tuple(rows), matrix=tuple(matrix), loops=loops))
