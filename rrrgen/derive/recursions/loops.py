"""Closed loops of dyads: cosines and sines of the passive links, and their rates, in one kind of scalar.

A dyad is two bars between points that are known without them, with the vector d from the first to the second. With
r, s the bars as vectors of lengths A, B, and ``d_perp`` the vector d turned by a quarter turn, ``r + s = d`` gives

    m = (A^2 - B^2 + d.d)/2,   h = assembly sqrt(A^2 d.d - m^2),   r = (m d + h d_perp)/d.d,   s = d - r,

and ``r x s = -h``: the sine of the angle between the bars is -h/(A B). Rates of the angles of the bars follow from the
derivative of the closure, with the further reciprocal 1/h. Where the sine is zero, at a dead point, no rate exists;
below :data:`SMALLEST_SINE` that sine is used instead, so that values stay finite, and a status tells
(:data:`DEAD_POINT`).

A passive prismatic joint takes the place of a bar: one across its unit vector e, which the displacement l moves. If e
is known without the bar r, as that of the slider of a crank, ``r + l e = d`` gives

    y = e x d,   x = e.r = -assembly sqrt(A^2 - y^2),   l = e.d - x,   sine |x|/A.

If e turns with the bar, as in a cylinder between two pins, the bar is ``u + l e`` in its own frame, of length |d|, and

    x = u.e + l = assembly sqrt(d.d - (e x u)^2),   sine |x|/|d|.

In both, assembly +1 is the larger one of the two displacements, and the determinant of the rates is x up to its sign.

Loops that are no dyads are solved by Newton's method, all together (:class:`NewtonLoops`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from typing import Any

import sympy as sp

from rrrgen.derive.recursions.linear_algebra import is_number
from rrrgen.robot.model.loops import Closure, Form, Segment

DEAD_POINT = Fraction(1, 1000)
"""Sine of the angle between the two bars of a dyad below which the status reports a dead point: rates of the passive
links grow with its reciprocal, and their relative errors with its square."""

SMALLEST_SINE = Fraction(1, 1000000)
"""Sine that takes the place of smaller ones, also where the loop cannot be assembled."""

Plane = tuple[Any, Any]
"""A vector in the plane of a loop."""

PlaneTrig = Callable[[Form, sp.Expr], Plane]
"""(linear form in x, constant angle) -> (cosine, sine) of the angle that they add up to."""


@dataclass(frozen=True)
class Arithmetic:
    """What a dyad needs beyond ``+ - *`` and division in one kind of scalar.

    ``constant`` converts exact constants, ``root(x)`` is a square root, ``at_least(x, y)`` the larger of both.
    """

    constant: Callable[[sp.Expr], Any]
    root: Callable[[Any], Any]
    at_least: Callable[[Any, Any], Any]


@dataclass(frozen=True)
class _Vector:
    """A segment at one configuration: the ``vector``, and ``along``, its derivative by the displacement in it."""

    segment: Segment
    vector: Plane
    along: Plane


class Dyad:
    """One solved loop: ``angles`` are cosine and sine of coordinates, ``slides`` the displacement of a prismatic one.

    ``discriminant`` is the number under the root, negative where the loop cannot be assembled; divided by ``whole`` it
    is the square of the sine between the bars. ``margin`` is what it exceeds that at the limit of dead points by.
    """

    def __init__(self, closure: Closure, trig: PlaneTrig, slide: Callable[[Form], Any], use: Arithmetic) -> None:
        self.closure, self._use = closure, use
        bars = [
            [_evaluate_segment(_without(s, k), trig, slide, use) for s in closure.segments if s.turning[k] == 1]
            for k in closure.coordinates
        ]
        known = [
            _evaluate_segment(one, trig, slide, use)
            for one in closure.segments
            if all(one.turning[k] == 0 for k in closure.coordinates)
        ]
        x, y = _sum(one.vector for one in known)
        self._vectors = known
        self.slides: dict[int, Any] = {}
        if closure.slider is None:
            h = self._between_bars(bars, (-x, -y))
        else:
            turned = next(k for k in closure.coordinates if k != closure.slider)
            bar = bars[closure.coordinates.index(turned)]
            if any(one.segment.slide[closure.slider] for one in bar):
                h = self._along_the_bar(turned, closure.slider, bar, (-x, -y))
            else:
                h = self._beside_the_bar(turned, closure.slider, bar, (-x, -y))
        self._per_h = _reciprocal(h)
        for k, rest in zip(closure.coordinates, bars, strict=True):
            self._vectors += [_turn_with_bar(one, self.angles[k], k) for one in rest]

    def _between_bars(self, bars: Sequence[Sequence[_Vector]], d: Plane) -> Any:
        """Solve for the angles of two ``bars`` between points with the distance ``d``, and return h."""
        use, closure = self._use, self.closure
        lengths = [_sum(one.vector for one in rest) for rest in bars]
        squares = [_dot(v, v) for v in lengths]
        distance = _dot(d, d)
        m = (squares[0] - squares[1] + distance) * Fraction(1, 2)
        self.whole = whole = squares[0] * squares[1]
        self.discriminant = squares[0] * distance - m * m
        self.margin = self.discriminant - whole * (DEAD_POINT * DEAD_POINT)
        least = SMALLEST_SINE * SMALLEST_SINE
        h = use.root(use.at_least(self.discriminant, whole * least))
        h = h if closure.assembly > 0 else -h
        per_distance = _reciprocal(use.at_least(distance, squares[0] * least))
        along, across = m * per_distance, h * per_distance
        r = _rotate(along, across, d)
        s = d[0] - r[0], d[1] - r[1]
        self._columns = r, s
        self.angles = {
            k: _angle(v, bar, square)
            for k, v, bar, square in zip(closure.coordinates, lengths, self._columns, squares, strict=True)
        }
        return h

    def _beside_the_bar(self, k: int, slider: int, bar: Sequence[_Vector], d: Plane) -> Any:
        """Solve for the angle ``k`` of a ``bar`` and the displacement ``slider`` of one of its ends; returns h."""
        use, place = self._use, self._place_of_slide(self._vectors)
        e, length = self._vectors[place].along, _sum(one.vector for one in bar)
        square, y = _dot(length, length), _cross(e, d)
        self.whole, self.discriminant = square, square - y * y
        self.margin = self.discriminant - square * (DEAD_POINT * DEAD_POINT)
        x = use.root(use.at_least(self.discriminant, square * (SMALLEST_SINE * SMALLEST_SINE)))
        x = -x if self.closure.assembly > 0 else x
        moved, r = _dot(e, d) - x, _rotate(x, y, e)
        self.slides, self.angles = {slider: moved}, {k: _angle(length, r, square)}
        self._vectors[place] = replace(self._vectors[place], vector=_scale(moved, e))
        return self._with_columns(k, r, e, x)

    def _along_the_bar(self, k: int, slider: int, bar: list[_Vector], d: Plane) -> Any:
        """Solve for the angle ``k`` of a ``bar`` and the displacement ``slider`` that changes its length; returns h."""
        use, place = self._use, self._place_of_slide(bar)
        e, u = bar[place].along, _sum(one.vector for one in bar)
        across, distance = _cross(e, u), _dot(d, d)
        scale = _sum_of_squares(self._vectors, use)
        least = SMALLEST_SINE * SMALLEST_SINE
        self.whole = whole = use.at_least(distance, scale * least)
        self.discriminant = distance - across * across
        # a cylinder without length has no rates either, whatever the angle between its axis and d
        self.margin = self.discriminant - use.at_least(distance, scale) * (DEAD_POINT * DEAD_POINT)
        x = use.root(use.at_least(self.discriminant, whole * least))
        x = x if self.closure.assembly > 0 else -x
        moved = x - _dot(e, u)
        self.slides, self.angles = {slider: moved}, {k: _angle(_rotate(x, across, e), d, whole)}
        bar[place] = replace(bar[place], vector=_scale(moved, e))
        return self._with_columns(k, d, _rotate(*self.angles[k], e), x)

    def _place_of_slide(self, vectors: Sequence[_Vector]) -> int:
        """The number of the vector that the passive prismatic joint moves."""
        slider = self.closure.slider
        assert slider is not None
        return next(i for i, one in enumerate(vectors) if one.segment.slide[slider])

    def _with_columns(self, k: int, r: Plane, e: Plane, x: Any) -> Any:
        """Set the motion of the pin by the rates of angle ``k`` of the bar ``r`` and of the slide along ``e``.

        ``x`` is ``r.e``. Returns h.
        """
        slid = e[1], _minus(e[0])
        self._columns = (r, slid) if self.closure.coordinates[0] == k else (slid, r)
        return x if self.closure.coordinates[0] == k else -x

    def rates(self, moved: Plane) -> tuple[Any, Any]:
        """The rates of both coordinates at which the velocity (2,) of the pin from other motion vanishes.

        ``moved`` is that velocity turned back by a quarter turn: for a vector v that turns at unit rate, v itself.
        """
        r, s = self._columns
        return _cross(moved, s) * self._per_h, _cross(r, moved) * self._per_h

    def by(self, k: int) -> Plane:
        """The velocity of the pin for a unit rate of coordinate ``k``, turned back by a quarter turn."""
        return _pin_velocity(self._vectors, k, self._use)

    def second(self, one: Sequence[Any], other: Sequence[Any]) -> Plane:
        """The acceleration of the pin that is bilinear in two rates of x, turned back by a quarter turn.

        For equal rates it is the acceleration for zero second derivatives of x.
        """
        return _pin_acceleration(self._vectors, one, other, self._use)


class SolvedLoops:
    """All loops of a robot at the positions ``q`` (n,), in the order in which they depend on each other.

    ``trig`` gives cosine and sine of angles that are linear forms in the coordinates. ``W`` (coordinates - n, n) are
    the derivatives of the coordinates behind q by q. ``positions`` (coordinates,) are q and the displacements of
    passive prismatic joints; that of an angle is 0, since loops give cosine and sine only.
    """

    def __init__(
        self,
        closures: Sequence[Closure],
        q: Sequence[Any],
        trig: Callable[[SolvedLoops, Form, sp.Expr], Plane],
        use: Arithmetic,
    ) -> None:
        self.n, self._use = len(q), use
        self.dyads: list[Dyad] = []
        self.angles: dict[int, Plane] = {}
        coordinates = self.n + 2 * len(closures)
        columns: list[list[Any]] = [[0] * coordinates for _ in q]
        self.positions = [*q, *[0] * (2 * len(closures))]
        slide = partial(linear, values=self.positions, constant=use.constant)
        for closure in closures:
            dyad = Dyad(closure, partial(trig, self), slide, use)
            for j, column in enumerate(columns):
                self._follow(dyad, column, dyad.by(j))
            self.dyads.append(dyad)
            self.angles |= dyad.angles
            for k, displacement in dyad.slides.items():
                self.positions[k] = displacement
        self.W = [[column[k] for column in columns] for k in range(self.n, coordinates)]

    def _follow(self, dyad: Dyad, column: list[Any], moved: Plane) -> None:
        """Set the rates of one dyad in ``column`` (coordinates,), in which those of the loops before it stand.

        ``moved`` is the motion of its pin without these (:meth:`Dyad.rates`).
        """
        for k in range(self.n, len(column)):
            moved = _plus(moved, _scale(column[k], dyad.by(k)))
        for k, rate in zip(dyad.closure.coordinates, dyad.rates(moved), strict=True):
            column[k] = rate

    def rates(self, dq: Sequence[Any]) -> list[Any]:
        """The rates (coordinates,) of x from those of q (n,)."""
        return [*dq, *(_dot_known(row, dq) for row in self.W)]

    def second(self, one: Sequence[Any], other: Sequence[Any]) -> list[Any]:
        """The second derivatives (coordinates,) of x that are bilinear in two rates of q, (n,) each."""
        derivatives: list[Any] = [0] * (self.n + len(self.W))
        if not any(all(is_number(rate, 0) for rate in rates) for rates in (one, other)):
            both = self.rates(one), self.rates(other)
            for dyad in self.dyads:
                self._follow(dyad, derivatives, dyad.second(*both))
        return derivatives

    def forces(self, forces: Sequence[Any]) -> list[Any]:
        """The generalized forces on q (n,) from those on the coordinates x."""
        passive = forces[self.n :]
        return [force + _dot_known([row[j] for row in self.W], passive) for j, force in enumerate(forces[: self.n])]


class NewtonLoops(SolvedLoops):
    """All loops of a robot at ``positions`` (n + p,) of its drives and its passive joints, which close them.

    The gaps (2 loops,) of all pins in their planes are zero there, and their Jacobian by the passive joints gives the
    rates. It is factorized by plane rotations, which need no choice of a pivot. ``sine`` is its determinant, divided by
    the lengths of its columns: that of the angle between two bars, and for more passive joints the volume that unit
    vectors along the columns span. Its sign changes where the robot passes a dead point. ``scale`` (m^2) is the sum of
    the squared lengths in the loops.
    """

    def __init__(
        self,
        closures: Sequence[Closure],
        positions: Sequence[Any],
        n: int,
        trig: PlaneTrig,
        use: Arithmetic,
    ) -> None:
        self.n, self._use, self.positions = n, use, list(positions)
        self.dyads, self.angles = [], {}
        slide = partial(linear, values=self.positions, constant=use.constant)
        self._loops = [[_evaluate_segment(one, trig, slide, use) for one in closure.segments] for closure in closures]
        self.scale = _sum_of_squares([one for vectors in self._loops for one in vectors], use)
        columns = [self._pin_velocities(k) for k in range(len(self.positions))]
        sizes = [self.scale if self._turns(k) else 1 for k in range(n, len(self.positions))]
        self._matrix = _Rotated(columns[n:], [size * (SMALLEST_SINE * SMALLEST_SINE) for size in sizes], use)
        self.sine = self._matrix.relative_determinant
        solved = [self._matrix.solve([_minus(v) for v in column]) for column in columns[:n]]
        self.W = [[column[k] for column in solved] for k in range(len(columns) - n)]

    @property
    def gaps(self) -> list[Any]:
        """The gaps (2 loops,) of the pins, m."""
        return [v for vectors in self._loops for v in _sum(one.vector for one in vectors)]

    def step(self) -> list[Any]:
        """The positions (p,) of the passive joints after a step of Newton's method."""
        turned = [v for x, y in zip(self.gaps[::2], self.gaps[1::2], strict=True) for v in (y, _minus(x))]
        return [x - dx for x, dx in zip(self.positions[self.n :], self._matrix.solve(turned), strict=True)]

    def second(self, one: Sequence[Any], other: Sequence[Any]) -> list[Any]:
        """The second derivatives (coordinates,) of x that are bilinear in two rates of q, (n,) each."""
        if any(all(is_number(rate, 0) for rate in rates) for rates in (one, other)):
            return [0] * len(self.positions)
        both = self.rates(one), self.rates(other)
        moved = [v for vectors in self._loops for v in _pin_acceleration(vectors, *both, self._use)]
        return [*[0] * self.n, *self._matrix.solve([_minus(v) for v in moved])]

    def _turns(self, k: int) -> bool:
        return any(one.segment.turning[k] != 0 for vectors in self._loops for one in vectors)

    def _pin_velocities(self, k: int) -> list[Any]:
        """The velocities (2 loops,) of the pins for a unit rate of coordinate ``k``, turned back by a quarter turn."""
        return [v for vectors in self._loops for v in _pin_velocity(vectors, k, self._use)]


class _Rotated:
    """A square matrix of ``columns``, brought to triangular form by plane rotations of its rows.

    ``least``, one for each column, replaces smaller squares of the diagonal, so that solutions stay finite where the
    matrix is singular.
    """

    def __init__(self, columns: Sequence[Sequence[Any]], least: Sequence[Any], use: Arithmetic) -> None:
        self._size = len(columns)
        A = [list(row) for row in zip(*columns, strict=True)]
        squares = [_total(v * v for v in column if not is_number(v, 0)) for column in columns]
        self._turns: list[tuple[int, int, Any, Any]] = []
        for k in range(self._size):
            for i in range(k + 1, self._size):
                if is_number(A[i][k], 0):
                    continue
                x, y = A[k][k], A[i][k]
                per_length = _reciprocal(use.root(use.at_least(x * x + y * y, least[k])))
                c, s = x * per_length, y * per_length
                self._turns.append((k, i, c, s))
                for j in range(k, self._size):
                    A[k][j], A[i][j] = _rotate_pair(c, s, A[k][j], A[i][j])
                A[i][k] = 0
        self._upper = A
        diagonal = [A[k][k] for k in range(self._size)]
        self._reciprocals = [d * _reciprocal(use.at_least(d * d, v)) for d, v in zip(diagonal, least, strict=True)]
        product, whole = diagonal[0], use.at_least(squares[0], least[0])
        for d, square, v in zip(diagonal[1:], squares[1:], least[1:], strict=True):
            product, whole = product * d, whole * use.at_least(square, v)
        self.relative_determinant = product * _reciprocal(use.root(whole))

    def solve(self, right: Sequence[Any]) -> list[Any]:
        """The solution of the linear equations with the right-hand side ``right``."""
        y = list(right)
        for k, i, c, s in self._turns:
            y[k], y[i] = _rotate_pair(c, s, y[k], y[i])
        for k in reversed(range(self._size)):
            for j in range(k + 1, self._size):
                if not is_number(self._upper[k][j], 0) and not is_number(y[j], 0):
                    y[k] = y[k] - self._upper[k][j] * y[j]
            y[k] = 0 if is_number(y[k], 0) else y[k] * self._reciprocals[k]
        return y


def _rotate_pair(c: Any, s: Any, x: Any, y: Any) -> tuple[Any, Any]:
    """A plane rotation of two numbers, without products with the number 0."""
    if is_number(x, 0):
        return (0, 0) if is_number(y, 0) else (s * y, c * y)
    return (c * x, -(s * x)) if is_number(y, 0) else (c * x + s * y, c * y - s * x)


def _total(values: Any) -> Any:
    total: Any = 0
    for value in values:
        total = total + value
    return total


def _pin_velocity(vectors: Sequence[_Vector], k: int, use: Arithmetic) -> Plane:
    """The velocity of a pin, the end of a sum of ``vectors``, for a unit rate of coordinate ``k``.

    It is rotated by minus 90 degrees in the plane of the loop: of a vector v that turns, ``v`` instead of ``z x v``.
    """
    total: Plane = (0, 0)
    for one in vectors:
        total = _plus(total, _scale(use.constant(one.segment.turning[k]), one.vector))
        x, y = _scale(use.constant(one.segment.slide[k]), one.along)
        total = _plus(total, (y, _minus(x)))
    return total


def _pin_acceleration(vectors: Sequence[_Vector], one: Sequence[Any], other: Sequence[Any], use: Arithmetic) -> Plane:
    """The part of the acceleration of a pin that is bilinear in two rates of x, rotated like :func:`_pin_velocity`.

    For equal rates it is the acceleration for zero second derivatives of x.
    """
    total: Plane = (0, 0)
    for vector in vectors:
        W, V = (linear(vector.segment.turning, rates, use.constant) for rates in (one, other))
        slide, other_slide = (linear(vector.segment.slide, rates, use.constant) for rates in (one, other))
        # its acceleration -W V v + (W other_slide + V slide) z x e, turned back by a quarter turn
        x, y = _scale(W * V, vector.vector)
        total = _plus(total, (_minus(y), x))
        total = _plus(total, _scale(W * other_slide + V * slide, vector.along))
    return total


def _dot_known(weights: Sequence[Any], values: Sequence[Any]) -> Any:
    """The scalar product, without multiplications by the numbers 0."""
    total: Any = 0
    for weight, value in zip(weights, values, strict=True):
        if not is_number(weight, 0) and not is_number(value, 0):
            total = total + weight * value
    return total


def linear(form: Form, values: Sequence[Any], constant: Callable[[sp.Expr], Any]) -> Any:
    """The linear ``form`` of ``values``, without multiplications by 0 and 1."""
    total: Any = 0
    for factor, value in zip(form, values, strict=True):
        if factor != 0 and not is_number(value, 0):
            total = total + (value if factor == 1 else -value if factor == -1 else constant(factor) * value)
    return total


def _without(one: Segment, k: int) -> Segment:
    """The segment in the frame of the bar whose coordinate is ``k``."""
    return replace(one, turning=tuple(sp.S.Zero if j == k else v for j, v in enumerate(one.turning)))


def _evaluate_segment(one: Segment, trig: PlaneTrig, slide: Callable[[Form], Any], use: Arithmetic) -> _Vector:
    c, s = trig(one.turning, one.angle)
    place = use.constant(one.place[0]), use.constant(one.place[1])
    direction = use.constant(one.direction[0]), use.constant(one.direction[1])
    if any(one.direction):
        place = _plus(place, _scale(slide(one.slide), direction))
    if one.sign < 0:
        place, direction = (_minus(place[0]), _minus(place[1])), (_minus(direction[0]), _minus(direction[1]))
    return _Vector(one, _rotate(c, s, place), _rotate(c, s, direction))


def _turn_with_bar(one: _Vector, angle: Plane, k: int) -> _Vector:
    """The vector ``one`` of the frame of a bar, turned by the ``angle`` of the bar, coordinate ``k``."""
    turning = tuple(sp.S.One if j == k else v for j, v in enumerate(one.segment.turning))
    return _Vector(replace(one.segment, turning=turning), _rotate(*angle, one.vector), _rotate(*angle, one.along))


def _angle(bar: Plane, turned: Plane, square: Any) -> Plane:
    """Cosine and sine of the angle from ``bar`` to ``turned``, vectors of equal length with this ``square``."""
    along = _scale(_reciprocal(square), bar)
    return _dot(along, turned), _cross(along, turned)


def _reciprocal(x: Any) -> Any:
    return Fraction(1) / x if isinstance(x, int) else 1 / x  # a quotient of two numbers stays exact


def _sum_of_squares(vectors: Sequence[_Vector], use: Arithmetic) -> Any:
    """The sum of the squared constant lengths of ``vectors``, m^2; 1 if there are none, to have a scale at all."""
    squares = [use.constant(v) * use.constant(v) for one in vectors for v in one.segment.place if v != 0]
    return sum(squares[1:], squares[0]) if squares else 1


def _sum(vectors: Any) -> Plane:
    total: Plane = (0, 0)
    for vector in vectors:
        total = _plus(total, vector)
    return total


def _plus(x: Plane, y: Plane) -> Plane:
    return x[0] + y[0], x[1] + y[1]


def _scale(factor: Any, x: Plane) -> Plane:
    return (0, 0) if is_number(factor, 0) else (factor * x[0], factor * x[1])


def _minus(x: Any) -> Any:
    return 0 if is_number(x, 0) else -x


def _dot(x: Plane, y: Plane) -> Any:
    return x[0] * y[0] + x[1] * y[1]


def _cross(x: Plane, y: Plane) -> Any:
    return x[0] * y[1] - x[1] * y[0]


def _rotate(c: Any, s: Any, x: Plane) -> Plane:
    return c * x[0] - s * x[1], s * x[0] + c * x[1]
