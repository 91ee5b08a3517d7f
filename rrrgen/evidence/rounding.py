"""Proven bounds of the rounding errors of a straight-line program over a box of inputs.

The subject is the difference between a program evaluated in floating point, as the emitted C does it, and the same
program in exact arithmetic, at the same floating-point inputs. Everything that rounds is inside: arithmetic, the
decimal constants, the sum of angles in front of a sine, and the kernel of sine and cosine.

Method: the mean-value form over the roundings. Node i computes ``v_i = op(its operands) + e_i`` with a local error
``|e_i| <= r_i``. As functions of the vector e, the outputs are smooth; the program in floating point is the point of
the actual errors, exact arithmetic is e = 0. By the mean value theorem along the line between the two points

    |error of an output| <= sum_i max |d output / d e_i| r_i ,

where the maximum is over all points of that line, hence over all values that the nodes take while every error stays
within its bound. So the ranges of all nodes are enclosed *with the local errors inside* and the derivatives, from
reverse mode, are enclosed over the same ranges: there is no second-order remainder. An error that is zero is a point
of the same line, so a product that a compiler contracts with a sum to one fused operation, in all places that use it
or in those that stand in one expression with it, is covered.

Local errors: half a unit in the last place of the largest magnitude of the exact result of the operation; nothing for
inputs, their signs, changes of sign, products with powers of two and ``x + x``; for a constant the exact distance from
its literal; for sine and cosine the proven bound of the kernel; and the smallest normal number wherever a product or
quotient may underflow, which also covers processors that flush subnormal results to zero.

Four rules tighten plain intervals, which lose a factor sqrt(2) in every rotation. Let c, s be values within k of the
cosine and the sine of one angle, and ``rho = 1 + sqrt(2) k``; N(x, y, ..) is the Euclidean norm.

1. Rotation. ``|c A + s B| <= rho N(A, B)``. Proof: Cauchy-Schwarz, ``|c A + s B| <= N(c, s) N(A, B)``, and ``N(c, s)
   <= N(cos, sin) + N(c - cos, s - sin) <= 1 + sqrt(2) k``. Sums are flattened first: the errors of the two products
   and of the sums inside add to the right side, by the triangle inequality.
2. Norms pass through rotations. ``N(c A + s B, c B - s A, rest) <= max(1, rho) N(A, B, rest)``. Proof: the first two
   elements are a matrix R = [[c, s], [-s, c]] times (A, B) with ``R' R = (c^2 + s^2) 1``, so R stretches by N(c, s)
   <= rho; the block matrix diag(R, 1) stretches by max(N(c, s), 1). Without the second element the norm is smaller
   still, since leaving out elements lowers a norm. With errors and further terms, Minkowski's inequality ``N(x + y)
   <= N(x) + N(y)`` splits them off. ``N(c A, s A, rest) <= max(1, rho) N(A, rest)`` likewise, as ``N(c A, s A) = |A|
   N(c, s)``; and ``N(c A, s A E, rest) <= rho^(m + 1) N(A, rest)`` for a product E of m sines and cosines, since
   ``|E| <= (1 + k)^m <= rho^m``. These are columns of rotation matrices.
3. Scalar products. ``|a b + c d + ..| <= N(a, c, ..) N(b, d, ..)``, and with d and b in each other's place where that
   is smaller. Proof: Cauchy-Schwarz; the signs do not matter. The products of a longer sum are grouped, each group by
   itself. A product of two sums likewise: ``|a b| <= N(a, b)^2 / 2``, as ``(|a| - |b|)^2 >= 0``.
4. Rotations by twice an angle, as factoring leaves them: ``2 c (c A + s B) - A = C A + S B`` and ``2 s (c A + s B) -
   B = S A - C B`` with ``C = 2 c^2 - 1`` or ``1 - 2 s^2`` and ``S = 2 c s``. Rules 1 and 2 hold with ``rho_2 = 1 +
   2 (rho^2 + 1) (rho^2 - 1)`` for rho. Proof: ``C^2 + S^2 = 1 + 4 v^2 (c^2 + s^2 - 1)`` for v = c or s, hence ``N(C, S)
   <= 1 + 2 rho^2 (rho^2 - 1)``. Two rows with C from c and from s are N(C, S) times an orthogonal matrix but for one
   element, in which they differ by ``2 |c^2 + s^2 - 1| <= 2 (rho^2 - 1)``.

Products of products are multiplied out before the rules look for sines and cosines, ``c (s A) = s (c A)``: the rounding
of an inner product is split off with the factors behind it. Sums of sums are flattened, and terms that cancel are left
out; what remains are the roundings of the sums inside.

Each rule gives an enclosure of its own, which is intersected with that of interval arithmetic. All arithmetic of the
analysis is rounded outwards: to the next floating-point number after every operation, with a margin where several
operations of one formula are rounded together. The box is split along the angles into equal parts, all of which are
evaluated as one batch.

In reverse mode the derivatives of an output by its many nodes lose what they have in common: where two sums are
multiplied, such as in the third axis of a frame, which is the cross product of the other two, they are multiplied out.
Therefore the derivatives ``v_i' = d v_i / dt`` along the line, at whose point t every error is t times its actual
value, are bounded in forward mode too, and the smaller bound of an output counts, also for what the program computes
from it. Programs of many nodes and outputs are bounded in forward mode alone. A rotation ``v = c A + s B + e`` has
``v' = (c A' + s B') + (A c' + B s') + e'``, and the rules apply:

1. ``|c A' + s B'| <= rho N(A', B')`` and ``|A c' + B s'| <= N(A, B) N(c', s')``, by Cauchy-Schwarz.
2. For the two rows of a rotation ``N(v', w') <= rho N(A', B') + N(A, B) N(c', s') + N(e', f')``, since the second terms
   are ``N(A c' + B s', B c' - A s') = N(A, B) N(c', s')``; e' and f' are what is left, by Minkowski's inequality.
   A factor E adds ``|s A E'| <= rho |A| |E'|`` to the right side.
3. ``|(a b + c d + ..)'| <= N(a, c, ..) N(b', d', ..) + N(b, d, ..) N(a', c', ..)``, with d and b in each other's place
   likewise, and ``|(a b)'| <= N(a, b) N(a', b')``.
4. As 1 and 2, with rho_2 for rho and ``5 rho N(c', s')`` for N(c', s'). Proof: with ``C' = 4 c c'`` or ``-4 s s'`` and
   ``S' = 2 (c' s + c s')`` one row, or two with the same C, add ``N(A, B) N(C', S')`` as before, and ``C'^2 + S'^2 <=
   (16 + 4) rho^2 N(c', s')^2``; for C of both kinds the Frobenius norm bounds it, ``C_1'^2 + C_2'^2 + 2 S'^2 <=
   (16 + 8) rho^2 N(c', s')^2``.

The roundings of the two products of a row are together at most ``u |c A| + u |s B| <= u rho N(A, B)``, and those of the
two sums of a rotation ``u N(c A + s B, c B - s A)``, which is half of what each of them may be by itself. Errors of
further roundings inside a product count with their factors and with the derivatives of these.

Magnitudes, minima and maxima, and values that are limited to a range, are continuous, so that the mean value theorem
holds with any slope between those of their branches. They are recognised where they stand as a choice: ``x > y ? x :
y``, the same with a range around it, and ``|x| > y ? y sgn(x) : x`` for ``y >= 0``. A comparison that is the same over
the whole part of the box takes one branch. Any other choice may come out otherwise than in exact arithmetic, which no
error of its operands bounds: the outputs behind it are *conditional*, their bound is that of the program in which the
choices are fixed, for both branches, and holds where the comparisons come out as in exact arithmetic.

The error of ``tanh`` and ``exp`` of the C library is assumed to be at most :data:`LIBRARY_UNITS` in the last place; the
C standard states none.

No bound is given for a program with a divisor or square root whose range contains zero, near which the error grows
without limit; the reason is returned instead.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rrrgen.emit.c.language import ERROR_BOUND, RANGE
from rrrgen.program import Builder, Op, Port, Program, Value
from rrrgen.program.differentiation import is_zero
from rrrgen.program.program import Node, reachable, with_results

Array = NDArray[np.float64]
Interval = tuple[Array, Array]
Box = Mapping[str, tuple[Sequence[float], Sequence[float]]]
"""Lower and upper bounds of the elements of every input port, by its name."""


@dataclass(frozen=True)
class Precision:
    """A floating-point format: unit roundoff, smallest normal number, absolute error and range of the sine kernel."""

    name: str
    roundoff: float
    smallest: float
    kernel_error: float
    kernel_range: float

    def literal(self, value: Fraction | int) -> Fraction:
        """The exact value of the emitted literal of a constant: the nearest double, in float rounded once more."""
        nearest = float(value)
        return Fraction(nearest if self.name == "double" else float(np.float32(nearest)))


DOUBLE = Precision("double", 2.0**-53, 2.0**-1022, ERROR_BOUND["double"], float(RANGE["double"]))
FLOAT = Precision("float", 2.0**-24, 2.0**-126, ERROR_BOUND["float"], float(RANGE["float"]))
PRECISIONS = (DOUBLE, FLOAT)

_ROUNDOFF = np.array([[precision.roundoff] for precision in PRECISIONS])
_SMALLEST = np.array([[precision.smallest] for precision in PRECISIONS])

RHO = math.nextafter(1.0 + math.sqrt(2.0) * 1.001 * FLOAT.kernel_error, 2.0)
"""Bound of N(c, s) for computed sines and cosines, of the coarser precision; see rule 1."""

_MARGIN = 1.0 + 2.0**-48  # covers the roundings of a formula of at most 2^4 operations on positive numbers
_SUM_MARGIN = 1.0 + 2.0**-46  # the same for at most 2^7 - 1 operations, such as the sums of :data:`_MOST_TERMS`
_TINY = 1e-150  # magnitudes below it vanish when squared
_SINE_ERROR = 2.0**-48  # of NumPy's sine and cosine, which are accurate to some units in the last place of 1
_BUDGET = 4e6  # nodes times parts of the box: some seconds, and some hundred MB, for the largest function
_LARGE = 3e4  # nodes from which on the box stays whole: finding the rotations takes longer than the arithmetic
_MOST_REVERSED = 1e5  # nodes times outputs for which reverse mode is used: of more it takes longest, and gains least
_MOST_PARTS = 8  # of one angle; more gained less than a tenth on the bundled arms
_MOST_TERMS = 24  # of a flattened sum
_MOST_FACTORS = 6  # of a product that is multiplied out
_MOST_PRODUCTS = 8  # of a sum of products that is bounded as the scalar product of two vectors


LIBRARY_UNITS = 4
"""Units in the last place that tanh and exp of the C library are assumed to keep; GNU's states at most 2."""


_EXACT = (Op.NEG, Op.SIGN, Op.ABS, Op.MIN, Op.SELECT, Op.NONFINITE)
"""Operations whose result needs no rounding."""

_ROUNDED = (Op.ADD, Op.SUB, Op.MUL, Op.DIV, Op.SQRT)
"""Operations whose exact result is rounded to nearest."""


class NoBoundError(Exception):
    """No bound can be proven; the message is the reason."""


@dataclass(frozen=True)
class RoundingBounds:
    """Proven absolute error bounds: ``double[k]`` and ``single[k]`` hold one number per element of output k.

    ``parts`` is the number of equal parts into which every angle's range was split at first. ``conditional[k]``
    says whether the bounds of output k hold only where comparisons come out as in exact arithmetic, ``library`` whether
    they assume an accuracy of the C library.
    """

    double: tuple[tuple[float, ...], ...]
    single: tuple[tuple[float, ...], ...]
    parts: int
    conditional: tuple[bool, ...]
    library: bool


def rounding_bounds(program: Program, box: Box, budget: float = _BUDGET) -> RoundingBounds:
    """Bound the rounding error of every output element of ``program`` for all inputs in ``box``.

    ``box`` holds lower and upper bounds per input port; ``budget`` limits the work, nodes times parts of the box.
    Raises NoBoundError with the reason where no bound can be proven.
    """
    analysis = _Analysis(program, box)
    finer = analysis.parts_within(budget, len(program.nodes))
    analysis.require_bounds_of_divisors(finer)
    parts = analysis.affordable_parts(budget)
    double, single = analysis.bounds(parts, finer)
    library = any(node.op is Op.TANH or node.op is Op.EXP for node in program.nodes)
    return RoundingBounds(double, single, parts, analysis.conditional(), library)


def enclosures(program: Program, box: Box, budget: float = _BUDGET) -> list[list[tuple[float, float]]]:
    """Lower and upper bounds of every output element of ``program`` for all inputs in ``box``, computed in float too.

    ``budget`` limits the work as for :func:`rounding_bounds`. Raises NoBoundError where there is no bound.
    """
    analysis = _Analysis(program, box)
    bounds = analysis.enclosures(analysis.affordable_parts(budget))
    return [[bounds[index] for index in row] for row in program.results]


# ------------------------------------------------------------------------------------------------------------------
# Interval arithmetic on batches, rounded outwards.
# ------------------------------------------------------------------------------------------------------------------


def _down(x: Array) -> Array:
    return np.nextafter(x, -np.inf)


def _up(x: Array) -> Array:
    return np.nextafter(x, np.inf)


def _widen(x: Interval, radius: Array | float) -> Interval:
    return _down(x[0] - radius), _up(x[1] + radius)


def _sum(x: Interval, y: Interval) -> Interval:
    return _down(x[0] + y[0]), _up(x[1] + y[1])


def _difference(x: Interval, y: Interval) -> Interval:
    return _down(x[0] - y[1]), _up(x[1] - y[0])


def _product(x: Interval, y: Interval) -> Interval:
    if x is y:
        return _square(x)
    a, b, c, d = x[0] * y[0], x[0] * y[1], x[1] * y[0], x[1] * y[1]
    low = np.minimum(np.minimum(a, b), np.minimum(c, d))
    high = np.maximum(np.maximum(a, b), np.maximum(c, d))
    return _down(low), _up(high)


def _square(x: Interval) -> Interval:
    magnitude = _magnitude(x)
    least = np.where((x[0] <= 0.0) & (x[1] >= 0.0), 0.0, np.minimum(np.abs(x[0]), np.abs(x[1])))
    return np.maximum(_down(least * least), 0.0), _up(magnitude * magnitude)


def _quotient(x: Interval, y: Interval) -> Interval:
    if np.any((y[0] <= 0.0) & (y[1] >= 0.0)):
        raise NoBoundError("a divisor whose range contains zero, near which the error grows without limit")
    return _product(x, (_down(1.0 / y[1]), _up(1.0 / y[0])))


def _root(x: Interval) -> Interval:
    if np.any(x[0] <= 0.0):
        raise NoBoundError("a square root of a number whose range contains zero, near which the error grows")
    return _down(np.sqrt(x[0])), _up(np.sqrt(x[1]))


def _magnitude(x: Interval) -> Array:
    return np.maximum(np.abs(x[0]), np.abs(x[1]))


def _intersection(x: Interval, y: Interval) -> Interval:
    return np.maximum(x[0], y[0]), np.minimum(x[1], y[1])


def _sine(x: Interval, quarter: float) -> Interval:
    """The range of sin(x + quarter): quarter is 0 for the sine, pi/2 for the cosine."""
    low, high = x
    f = np.sin if quarter == 0.0 else np.cos
    first, last = f(low), f(high)
    slack = 1e-9 + 1e-12 * np.maximum(np.abs(low), np.abs(high))  # an extremum that is only near counts as inside

    def crosses(phase: float) -> NDArray[np.bool_]:
        shift = phase - quarter
        period = 2.0 * np.pi
        inside: NDArray[np.bool_] = np.ceil((low - slack - shift) / period) <= np.floor((high + slack - shift) / period)
        return inside

    top = np.where(crosses(np.pi / 2.0), 1.0, np.minimum(np.maximum(first, last) + _SINE_ERROR, 1.0))
    bottom = np.where(crosses(-np.pi / 2.0), -1.0, np.maximum(np.minimum(first, last) - _SINE_ERROR, -1.0))
    return bottom, top


def _increasing(x: Interval, function: Callable[[Array], Array]) -> Interval:
    """The range of tanh or exp, which NumPy computes to some units in the last place."""
    low, high = function(x[0]), function(x[1])
    return low - np.abs(low) * _SINE_ERROR - _TINY, high + np.abs(high) * _SINE_ERROR + _TINY


def _hull(x: Interval, y: Interval) -> Interval:
    return np.minimum(x[0], y[0]), np.maximum(x[1], y[1])


def _hypot(sizes: Sequence[Array | float]) -> Array | float:
    """The Euclidean norm of one or two numbers."""
    return sizes[0] if len(sizes) == 1 else np.hypot(sizes[0], sizes[1])


def _stretch(multiple: int) -> float:
    """Bound of the norm of a rotation by an angle, or by twice the angle; see rules 1 and 4."""
    return RHO if multiple == 1 else 1.0 + 2.0 * (RHO**2 + 1.0) * (RHO**2 - 1.0) * _MARGIN


def _join(first: _Vectors, second: _Vectors, turned: bool) -> _Vectors:
    """Two scalar products as one; ``turned``: with the vectors of the second in each other's place."""
    (a, b), (c, d) = first, second[:: -1 if turned else 1]
    return a + c, b + d


def _half_unit(magnitude: Array, roundoff: float) -> Array:
    """The largest error of rounding a number of at most this magnitude to nearest."""
    exponent = np.frexp(magnitude)[1]
    return np.where(magnitude > 0.0, np.ldexp(roundoff, exponent - 1), 0.0)


# ------------------------------------------------------------------------------------------------------------------
# Enclosures of all nodes, with the four rules.
# ------------------------------------------------------------------------------------------------------------------


class _Extremum(NamedTuple):
    """The smaller (``least``) or larger of two nodes, each with its sign."""

    least: bool
    first: tuple[int, int]
    second: tuple[int, int]


class _Choice(NamedTuple):
    """What is known of a choice over a batch of boxes.

    ``enclosure`` is its range. ``decided``: its comparison comes out the same in all of the boxes; ``continuous``: its
    branches are equal where it switches. Either keeps rounding from changing the result by more than its operands.
    ``followed`` are the nodes of the branches that it takes.
    """

    enclosure: Interval
    decided: bool
    continuous: bool
    followed: set[int]


TWO = -1
"""Stands in products for the factor 2."""

Factors = tuple[int, ...]
"""Nodes that are multiplied with each other, and :data:`TWO`; () stands for 1."""

_Lost = tuple[tuple[Factors, int], ...]
"""Local errors of nodes, each with factors that it is multiplied with."""


class _Factored(NamedTuple):
    """A node as ``sign`` times the product of ``factors``, up to the roundings ``lost`` inside."""

    sign: int
    factors: Factors
    lost: _Lost


class _Turned(NamedTuple):
    """A product as ``factor``, the sine or cosine (``kind``) of ``angle``, times ``rest``.

    For ``multiple`` 2 it is that of twice the angle, of which ``factor`` is the sine or cosine.
    """

    angle: int
    kind: Op
    factor: int
    rest: Factors
    multiple: int = 1


class _RotatedTerm(NamedTuple):
    """The term ``node`` of a sum, as ``sign`` times a sine or cosine times other factors.

    ``lost`` are the roundings inside it.
    """

    sign: int
    node: int
    turned: _Turned
    lost: _Lost


class _Terms(NamedTuple):
    """A sum as ``terms`` with their coefficients, the sums ``inner`` in it, and the terms with cosine and with sine.

    ``pairs`` has an entry for every angle of which both functions occur. ``merged``: terms cancel or occur twice.
    ``vectors`` are ways to read the products among the terms as scalar products.
    """

    terms: list[tuple[int, int]]
    inner: list[int]
    pairs: list[tuple[list[_RotatedTerm], list[_RotatedTerm]]]
    vectors: list[_ScalarProducts]
    merged: bool = False


_Vectors = tuple[tuple[Factors, ...], tuple[Factors, ...]]
"""Two vectors whose scalar product is taken."""


class _ScalarProducts(NamedTuple):
    """The terms ``products`` of a sum as the scalar products of pairs of vectors."""

    vectors: list[_Vectors]
    products: list[int]


class _Rotation(NamedTuple):
    """The sum ``node`` as a term with the cosine and one with the sine of an angle, and further terms ``rest``.

    ``inner`` are the sums inside it; the further terms have their coefficients.
    """

    parts: tuple[_RotatedTerm, _RotatedTerm]
    node: int
    inner: list[int]
    rest: list[tuple[int, int]]

    @property
    def multiple(self) -> int:
        """1 for a rotation by the angle itself, 2 by twice the angle."""
        return self.parts[0].turned.multiple

    @property
    def pair(self) -> tuple[Factors, Factors]:
        """What is multiplied with the cosine, and with the sine."""
        return self.parts[0].turned.rest, self.parts[1].turned.rest

    def is_orthogonal_to(self, other: _Rotation) -> bool:
        """Whether both are rows (a c, b s) and (d s, e c) on the same pair, whose products cancel."""
        angles = [(rotation.parts[0].turned.angle, rotation.multiple) for rotation in (self, other)]
        if angles[0] != angles[1] or self.pair != other.pair[::-1]:
            return False
        (a, b), (e, d) = ([part.sign for part in rotation.parts] for rotation in (self, other))
        return a * d == -b * e


class _Reduction(NamedTuple):
    """One step of rule 2, which bounds the norm of several terms by the norm of fewer or simpler ones, ``members``.

    Either one or two of the terms are rows of a rotation, ``rotations``, and the pair that is rotated takes their
    place. Or two are the sine and the cosine of one angle times the same product, ``turned``, which takes their place;
    then ``lost`` are the roundings inside both, and ``extra`` the sines and cosines that one of them has besides.
    """

    members: list[Factors]
    rotations: tuple[_Rotation, ...] = ()
    turned: tuple[_Turned, ...] = ()
    lost: tuple[_Lost, ...] = ()
    extra: Factors = ()

    @property
    def stretch(self) -> float:
        """Bound of the norm of the former terms over that of ``members``, without roundings and further terms."""
        return _stretch(self.rotations[0].multiple) if self.rotations else float(RHO ** (1 + len(self.extra)))


class _Ranges:
    """Enclosures of nodes over a batch of boxes: those of a program, with local errors, and derivatives behind them.

    ``errors[i]`` is the bound of the local error of node i in the coarser precision, which the enclosure includes.
    """

    def __init__(self, program_size: int | None = None) -> None:
        self._program_size = program_size
        self.nodes: list[Node] = []
        self.ranges: list[Interval] = []
        self.errors: list[Array | float] = []
        self._magnitudes: list[Array] = []
        self._norms: dict[tuple[Factors, ...], Array] = {}
        self._sizes: dict[Factors, Array | float] = {}
        self._readings: dict[Factors, tuple[_Factored, list[_Rotation], list[_Turned]]] = {}
        self._products: dict[int, _Factored] = {}
        self.readings: dict[int, list[_Terms]] = {}

    def magnitude(self, index: int) -> Array:
        """The largest magnitude of a node in every box."""
        return np.array([2.0]) if index == TWO else self._magnitudes[index]

    def exact(self, node: Node) -> Interval:
        """The enclosure of ``node``, the next one, without its own local error."""
        op, args = node.op, node.args
        x = self.ranges[args[0]]
        if op is Op.ADD:
            return self._of_sum(node, _sum(x, self.ranges[args[1]]))
        if op is Op.SUB:
            return self._of_sum(node, _difference(x, self.ranges[args[1]]))
        if op is Op.MUL:
            return self._of_product(node, _product(x, self.ranges[args[1]]))
        if op is Op.NEG:
            return -x[1], -x[0]
        if op is Op.DIV:
            return _quotient(x, self.ranges[args[1]])
        if op is Op.SQRT:
            return _root(x)
        if op is Op.SIGN:
            return np.sign(x[0]), np.sign(x[1])
        if op is Op.ABS:
            return np.maximum(np.maximum(x[0], -x[1]), 0.0), _magnitude(x)
        if op is Op.MIN:
            y = self.ranges[args[1]]
            return np.minimum(x[0], y[0]), np.minimum(x[1], y[1])
        if op is Op.SELECT:
            return self.choice(node).enclosure
        if op is Op.NONFINITE:  # the range of its operand is finite
            return np.array([0.0]), np.array([0.0])
        if op is Op.TANH:
            low, high = _increasing(x, np.tanh)
            return np.maximum(low, -1.0), np.minimum(high, 1.0)
        if op is Op.EXP:
            low, high = _increasing(x, np.exp)
            return np.maximum(low, 0.0), high
        if op is Op.SIN:
            return _sine(x, 0.0)
        if op is Op.COS:
            return _sine(x, np.pi / 2.0)
        raise NoBoundError(f"the operation {op.value}")

    def append(self, node: Node, enclosure: Interval, error: Array | float = 0.0) -> None:
        """Add the next node with its enclosure, local error included."""
        self.nodes.append(node)
        self.ranges.append(enclosure)
        self.errors.append(error)
        self._magnitudes.append(_magnitude(enclosure))

    # -- choices -----------------------------------------------------------------------------------------------

    def choice(self, node: Node) -> _Choice:
        """What is known about the choice ``node``, the next one: whether it is decided or continuous, and its range."""
        condition, x, y = (self.ranges[arg] for arg in node.args)
        positive, otherwise = condition[0] > 0.0, condition[1] <= 0.0
        low, high = _hull(x, y)
        followed = set(node.args[1:])
        decided = bool(np.all(positive | otherwise))
        if decided and np.all(positive):
            followed = {node.args[1]}
        elif decided and np.all(otherwise):
            followed = {node.args[2]}
        continuous = None if decided else self._extremum(node)
        if continuous is not None:
            least, x, y = continuous.least, self._of(continuous.first), self._of(continuous.second)
            low, high = ((np.minimum if least else np.maximum)(a, b) for a, b in zip(x, y, strict=True))
        elif not decided and (limit := self._limit_of_magnitude(node)) is not None:
            bound = self.ranges[limit][1]
            low, high = np.maximum(low, -bound), np.minimum(high, bound)
            continuous, followed = _Extremum(True, (1, limit), (1, node.args[2])), {limit, node.args[2]}
        low = np.where(positive, x[0], np.where(otherwise, y[0], low)) if continuous is None else low
        high = np.where(positive, x[1], np.where(otherwise, y[1], high)) if continuous is None else high
        return _Choice((low, high), decided, continuous is not None, followed)

    def _of(self, signed: tuple[int, int]) -> Interval:
        """The range of a node with its sign; sign 0 stands for zero."""
        sign, index = signed
        if sign == 0:
            return np.array([0.0]), np.array([0.0])
        low, high = self.ranges[index]
        return (low, high) if sign > 0 else (-high, -low)

    def _split_sign(self, index: int) -> tuple[int, int]:
        """The node behind changes of sign, with its sign: (0, 0) for zero."""
        sign = 1
        while self.nodes[index].op is Op.NEG:
            sign, index = -sign, self.nodes[index].args[0]
        if self.nodes[index].op is Op.CONST and self.nodes[index].number == 0:
            return 0, 0
        return sign, index

    def _comparisons(self, condition: int) -> list[tuple[tuple[int, int], tuple[int, int]]]:
        """The ways to read ``condition > 0`` as ``p > m``: nodes p and m with their signs."""
        sign, index = self._split_sign(condition)
        if sign == 0:
            return []
        node = self.nodes[index]
        ways = [((sign, index), (0, 0))]
        if node.op is Op.ADD or node.op is Op.SUB:
            (s, a), (t, b) = map(self._split_sign, node.args)
            s, t = s * sign, t * sign * (1 if node.op is Op.ADD else -1)
            ways += [((s, a), (-t, b)), ((t, b), (-s, a))]
        return ways

    def _extremum(self, node: Node) -> _Extremum | None:
        """Recognise a choice ``p > m ? x : y`` that computes a minimum or maximum; None if it computes something else.

        These are ``p > m ? m : p``, the same with the branches exchanged, and a value limited from both sides:
        ``p > m ? m : max(p, l)`` with ``l <= m`` is ``min(m, max(p, l))``: where p = m both branches are m. Likewise
        ``p > m ? p : min(m, u)`` with ``u >= p`` is ``max(p, min(m, u))``.
        """
        x, y = map(self._split_sign, node.args[1:])
        for p, m in self._comparisons(node.args[0]):
            if (x, y) in ((p, m), (m, p)):
                return _Extremum(x == m, x, y)
            inner = self._extremum(self.nodes[y[1]]) if y[0] == 1 and self.nodes[y[1]].op is Op.SELECT else None
            if inner is None or x not in (p, m):
                continue
            least, limited = x == m, p if x == m else m
            if inner.least != least and limited in (inner.first, inner.second):
                other = inner.second if inner.first == limited else inner.first
                lower, upper = (other, x) if least else (x, other)
                if np.all(self._of(lower)[1] <= self._of(upper)[0]):
                    return _Extremum(least, x, y)
        return None

    def _limit_of_magnitude(self, node: Node) -> int | None:
        """The node L of a choice ``|t| > L ? L sgn(t) : t`` with L >= 0; None if it is another one."""
        (s, product), (sign, t) = map(self._split_sign, node.args[1:])
        if self.nodes[product].op is not Op.MUL:
            return None
        for (_, p), (of_limit, limit) in self._comparisons(node.args[0]):
            if self.nodes[p].op is not Op.ABS or of_limit != 1 or self._split_sign(self.nodes[p].args[0])[1] != t:
                continue
            for a, b in (self.nodes[product].args, self.nodes[product].args[::-1]):
                if a == limit and self.nodes[b].op is Op.SIGN and np.all(self.ranges[limit][0] >= 0.0):
                    of_sign, again = self._split_sign(self.nodes[b].args[0])
                    if again == t and s * of_sign == sign:
                        return limit
        return None

    # -- structure ---------------------------------------------------------------------------------------------

    def product(self, index: int) -> _Factored:
        """The node ``index`` with products of products multiplied out and changes of sign taken off."""
        if index not in self._products:
            self._products[index] = self._multiplied_out(index)
        return self._products[index]

    def _multiplied_out(self, index: int) -> _Factored:
        node = self.nodes[index]
        if node.op is Op.NEG:
            inner = self.product(node.args[0])
            return inner._replace(sign=-inner.sign)
        if (half := self._half(node)) is not None:
            inner = self.product(half)
            if len(inner.factors) < _MOST_FACTORS and TWO not in inner.factors:
                twice = [((TWO, *weights), place) for weights, place in inner.lost]
                return _Factored(inner.sign, (TWO, *inner.factors), (((), index), *twice))
        if node.op is not Op.MUL:
            return _Factored(1, (index,), ())
        x, y = (self.product(arg) for arg in node.args)
        factors = tuple(sorted((*x.factors, *y.factors)))
        if len(factors) > _MOST_FACTORS:
            return _Factored(1, (index,), ())
        # with x = x' + e_x and y = y' + e_y: x y = x' y' + x' e_y + y e_x
        of_x = [((*weights, node.args[1]), inner) for weights, inner in x.lost]
        of_y = [((*weights, *x.factors), inner) for weights, inner in y.lost]
        return _Factored(x.sign * y.sign, factors, (((), index), *of_x, *of_y))

    def _half(self, node: Node) -> int | None:
        """The operand x of ``x + x`` or ``2 x``; None for another node."""
        if node.op is Op.ADD and node.args[0] == node.args[1]:
            return node.args[0]
        if node.op is Op.MUL:
            for factor, other in (node.args, node.args[::-1]):
                if self.nodes[factor].op is Op.CONST and self.nodes[factor].number == 2:
                    return other
        return None

    def trigonometric_readings(self, factors: Factors) -> list[_Turned]:
        """The ways to read a product as sine or cosine times other factors."""
        ways = []
        for factor in dict.fromkeys(factors):
            if factor == TWO:
                continue
            node = self.nodes[factor]
            if node.op is Op.SIN or node.op is Op.COS:
                place = factors.index(factor)
                ways.append(_Turned(node.args[0], node.op, factor, factors[:place] + factors[place + 1 :]))
        return ways

    def _taken_apart(self, node: Node) -> list[_Terms]:
        """The sum ``node`` taken apart, into terms that are no sums unless these are too many."""
        by_twice = self._by_twice_the_angle(node)
        net: dict[int, int] = {}
        inner: list[int] = []
        count = 0
        stack = self._signed_operands(node)
        while stack:
            sign, index = stack.pop()
            below = self.nodes[index]
            if below.op is Op.ADD or below.op is Op.SUB:
                inner.append(index)
                stack += [(sign * other, arg) for other, arg in self._signed_operands(below)]
            elif below.op is Op.NEG:
                stack.append((-sign, below.args[0]))
            else:
                net[index] = net.get(index, 0) + sign
                count += 1
            if count + len(stack) > _MOST_TERMS:
                return by_twice
        terms = [(coefficient, index) for index, coefficient in net.items() if coefficient]
        by_angle: dict[int, tuple[list[_RotatedTerm], list[_RotatedTerm]]] = {}
        for coefficient, index in terms:
            product = self.product(index)
            sign = product.sign if coefficient > 0 else -product.sign
            read = self.trigonometric_readings(product.factors)
            angles = [turned.angle for turned in read]
            for turned in read:
                if angles.count(turned.angle) == 1:
                    part = _RotatedTerm(sign, index, turned, product.lost)
                    group = by_angle.setdefault(turned.angle, ([], []))[turned.kind is Op.SIN]
                    group += [part] * abs(coefficient)
        pairs = [(cosines, sines) for cosines, sines in by_angle.values() if cosines and sines]
        return [_Terms(terms, inner, pairs, self._scalar_products(terms), len(terms) < count), *by_twice]

    def _signed_operands(self, node: Node) -> list[tuple[int, int]]:
        """The two operands of a sum or difference with their signs."""
        return [(1, node.args[0]), (1 if node.op is Op.ADD else -1, node.args[1])]

    def _by_twice_the_angle(self, node: Node) -> list[_Terms]:
        """Rule 4: the readings of a sum as ``2 c (c A + s B) - A`` or ``2 s (c A + s B) - B``."""
        readings = []
        operands = self._signed_operands(node)
        for (outer_sign, outer), (other_sign, other) in (operands, operands[::-1]):
            product, subtracted = self.product(outer), self.product(other)
            if product.factors[0] != TWO or len(product.factors) != 3:
                continue
            for turned in self.trigonometric_readings(product.factors[1:]):
                for rotation in self.rotations(turned.rest[0]):
                    if rotation.rest or (rotation.parts[0].turned.angle, rotation.multiple) != (turned.angle, 1):
                        continue
                    cosine, sine = rotation.parts
                    behind, beside, flip = (cosine, sine, 1) if turned.kind is Op.COS else (sine, cosine, -1)
                    sign = outer_sign * product.sign
                    if behind.turned.rest != subtracted.factors or sign * behind.sign != -other_sign * subtracted.sign:
                        continue
                    inside = [((), turned.rest[0]), *(((), k) for k in rotation.inner), *behind.lost, *beside.lost]
                    twice = tuple(((TWO, turned.factor, *weights), k) for weights, k in inside)
                    of_cosine = _Turned(turned.angle, Op.COS, cosine.turned.factor, behind.turned.rest, 2)
                    of_sine = _Turned(turned.angle, Op.SIN, sine.turned.factor, beside.turned.rest, 2)
                    in_cosine = _RotatedTerm(sign * behind.sign * flip, outer, of_cosine, product.lost + twice)
                    in_sine = _RotatedTerm(sign * beside.sign, other, of_sine, subtracted.lost)
                    readings.append(_Terms(operands, [], [([in_cosine], [in_sine])], []))
        return readings

    def rotations(self, index: int) -> list[_Rotation]:
        """The ways to read node ``index``, if it is a sum, as a rotation of two products and a rest."""
        if index == TWO or (self.nodes[index].op is not Op.ADD and self.nodes[index].op is not Op.SUB):
            return []
        rotations = []
        for taken in self.readings[index]:
            for cosines, sines in taken.pairs:
                if len(cosines) == len(sines) == 1:
                    parts = cosines[0], sines[0]
                    used = [part.node for part in parts]
                    rest = [term for term in taken.terms if term[1] not in used]
                    rotations.append(_Rotation(parts, index, taken.inner, rest))
        return rotations

    def reductions(self, members: Sequence[Factors]) -> list[_Reduction]:
        """Rule 2: the ways to take one rotation off the norm of ``members`` that are worth following."""
        read, rotations, ways = zip(*map(self._readings_of, members), strict=True)

        def without(*places: int) -> list[Factors]:
            return [member for k, member in enumerate(members) if k not in places]

        for i, of_first in enumerate(rotations):
            for first in of_first:
                for j in range(i + 1, len(members)):
                    for second in rotations[j]:
                        if first.is_orthogonal_to(second):
                            return [_Reduction([*without(i, j), *first.pair], (first, second))]
        if not any(rotations) and sum(map(bool, ways)) < 2:
            return []
        pairs = []
        for i, j in combinations(range(len(members)), 2):
            for turned, again in product(ways[i], ways[j]):
                if turned.angle == again.angle and turned.kind is not again.kind:
                    fewer, more = sorted((turned.rest, again.rest), key=len)
                    extra = self._further(more, fewer)
                    if extra is not None:
                        lost = read[i].lost, read[j].lost
                        pair = _Reduction([*without(i, j), fewer], (), (turned, again), lost, extra)
                        if not extra:
                            return [pair]
                        pairs.append(pair)
        # one of a pair alone: which leads on to further pairs is not known; the last may rest on what others rest on
        single = [
            _Reduction([*without(i), *first.pair], (first,))
            for i, of_first in enumerate(rotations)
            for first in of_first[:1]
            if not first.rest
        ]
        return [*pairs[:1], *(single if len(members) == 2 else single[-1:])]

    def _readings_of(self, member: Factors) -> tuple[_Factored, list[_Rotation], list[_Turned]]:
        """A term of a norm, multiplied out if it is a single node, and its readings as a rotation and by one angle."""
        if member not in self._readings:
            single = len(member) == 1 and member[0] != TWO
            read = self.product(member[0]) if single else _Factored(1, member, ())
            rotations = self.rotations(read.factors[0]) if len(read.factors) == 1 else []
            self._readings[member] = read, rotations, self.trigonometric_readings(read.factors)
        return self._readings[member]

    def _further(self, factors: Factors, others: Factors) -> Factors | None:
        """The quotient of the product ``factors`` by the product ``others``, if it is a product of sines and cosines.

        None if ``others`` does not divide ``factors``, or leaves another factor.
        """
        left = list(factors)
        for other in others:
            if other not in left:
                return None
            left.remove(other)
        trigonometric = all(k != TWO and self.nodes[k].op in (Op.SIN, Op.COS) for k in left)
        return tuple(left) if trigonometric else None

    # -- the rules ---------------------------------------------------------------------------------------------

    def size(self, factors: Factors) -> Array | float:
        """The largest magnitude of a product."""
        if factors not in self._sizes:
            size: Array | float = 1.0
            for index in factors:
                size = size * self.magnitude(index)
            self._sizes[factors] = size * _MARGIN
        return self._sizes[factors]

    def _of_product(self, node: Node, enclosure: Interval) -> Interval:
        """Rule 3 for a product of two sums: ``|a b| <= N(a, b)^2 / 2``."""
        if not self.is_product_of_sums(node) or self._is_derivative():
            return enclosure
        a, b = node.args
        norm = self.norm(((a,), (b,)))
        bound = norm * norm / 2.0 * _MARGIN
        return _intersection(enclosure, (-bound, bound))

    def is_product_of_sums(self, node: Node) -> bool:
        """Whether ``node`` is the product of two different sums, which may be rows of one rotation."""
        sums = all(self.nodes[arg].op in (Op.ADD, Op.SUB) for arg in node.args)
        return node.op is Op.MUL and sums and node.args[0] != node.args[1]

    def _is_derivative(self) -> bool:
        """Whether the next node is one of the many derivatives, for which searching for vectors takes too long."""
        return self._program_size is not None and len(self.nodes) >= self._program_size

    def _of_sum(self, node: Node, enclosure: Interval) -> Interval:
        self.readings[len(self.nodes)] = self._taken_apart(node)
        for taken in self.readings[len(self.nodes)]:
            inner = self._error(taken.inner)
            if taken.merged:
                enclosure = _intersection(enclosure, self._of_terms(taken, (), inner))
            for cosines, sines in taken.pairs:
                enclosure = _intersection(enclosure, self._by_rotation(taken, cosines, sines))
            for reading in taken.vectors:
                radius = sum((self.norm(left) * self.norm(right) for left, right in reading.vectors), 0.0)
                radius = radius + self._error(reading.products) + inner
                enclosure = _intersection(enclosure, self._of_terms(taken, reading.products, radius))
        return enclosure

    def _scalar_products(self, terms: Sequence[tuple[int, int]]) -> list[_ScalarProducts]:
        """Rule 3: ways to read the products among the terms of a sum as scalar products. Signs do not matter.

        Two products are read both ways, as either operand of the second may stand in the vector of the first one's
        smaller operand. More are grouped where that lowers the bound, and all taken as one scalar product, of the
        smaller operands with the larger ones.
        """
        products = [index for coefficient, index in terms if abs(coefficient) == 1 and self.nodes[index].op is Op.MUL]
        if not 2 <= len(products) <= (2 if self._is_derivative() else _MOST_PRODUCTS):
            return []
        ordered = [sorted(self.nodes[k].args, key=lambda arg: float(self.magnitude(arg).max())) for k in products]
        pairs: list[_Vectors] = [(((small,),), ((large,),)) for small, large in ordered]
        if len(products) == 2:
            readings = [[_join(pairs[0], pairs[1], turned)] for turned in (False, True)]
        else:
            together = tuple(tuple((k,) for k in side) for side in zip(*ordered, strict=True))
            readings = [self._group(pairs), [(together[0], together[1])]]
        return [_ScalarProducts(reading, products) for reading in readings]

    def _group(self, groups: list[_Vectors]) -> list[_Vectors]:
        """Join scalar products two at a time, first those whose joining lowers the sum of the bounds most."""

        sizes: dict[_Vectors, float] = {}

        def size(vectors: _Vectors) -> float:
            if vectors not in sizes:
                sizes[vectors] = float((self.norm(vectors[0]) * self.norm(vectors[1])).mean())
            return sizes[vectors]

        while True:
            best, chosen = 0.0, None
            for i, j in combinations(range(len(groups)), 2):
                for turned in (False, True):
                    joined = _join(groups[i], groups[j], turned)
                    gain = size(groups[i]) + size(groups[j]) - size(joined)
                    if gain > best:
                        best, chosen = gain, (i, j, joined)
            if chosen is None:
                return groups
            groups = [group for k, group in enumerate(groups) if k not in chosen[:2]] + [chosen[2]]

    def _by_rotation(self, taken: _Terms, cosines: Sequence[_RotatedTerm], sines: Sequence[_RotatedTerm]) -> Interval:
        """Rule 1 for a flattened sum: the terms of one angle by their norm, the others by intervals."""
        bound = self.norm_of_sums(cosines, sines)
        parts = (*cosines, *sines)
        stretch = _stretch(parts[0].turned.multiple)
        radius = bound * stretch + sum(map(self._weighted_roundings, parts), 0.0) + self._error(taken.inner)
        return self._of_terms(taken, [part.node for part in parts], radius)

    def _of_terms(self, taken: _Terms, left_out: Sequence[int], radius: Array | float) -> Interval:
        """The range of a flattened sum: its terms but those ``left_out``, and a number of at most ``radius``."""
        low: Array | float = 0.0
        high: Array | float = 0.0
        size: Array | float = radius
        for coefficient, index in taken.terms:
            if index not in left_out:
                x = self.ranges[index][:: 1 if coefficient > 0 else -1]
                low, high = low + coefficient * x[0], high + coefficient * x[1]
                size = size + abs(coefficient) * self._magnitudes[index]
        slack = size * 2.0**-46  # covers the roundings of at most _MOST_TERMS additions and of the norm
        return np.asarray(low - radius - slack), np.asarray(high + radius + slack)

    def norm_of_sums(self, cosines: Sequence[_RotatedTerm], sines: Sequence[_RotatedTerm]) -> Array:
        """A bound of N(sum of what is multiplied with the cosine, sum of what is multiplied with the sine)."""
        if len(cosines) == len(sines) == 1:
            return self.norm((cosines[0].turned.rest, sines[0].turned.rest))
        groups = [sum(self.size(part.turned.rest) for part in group) for group in (cosines, sines)]
        return np.asarray(np.hypot(groups[0], groups[1])) * _MARGIN

    def _error(self, indices: Sequence[int]) -> Array | float:
        return sum((self.errors[index] for index in indices), 0.0)

    def _weighted_roundings(self, part: _RotatedTerm | _Lost) -> Array | float:
        """The roundings inside a product, weighted with its other factors."""
        lost = part.lost if isinstance(part, _RotatedTerm) else part
        return sum((self.size(weights) * self.errors[index] for weights, index in lost), 0.0)

    def norm(self, members: Sequence[Factors]) -> Array:
        """Rule 2: a bound of the Euclidean norm of several products of nodes."""
        key = tuple(sorted(members))
        if key in self._norms:
            return self._norms[key]
        bound = np.asarray(np.sqrt(sum((self.size(member) ** 2 for member in key), 0.0))) * _MARGIN + _TINY
        for reduction in self.reductions(key) if len(key) > 1 else ():
            lost = [
                sum(map(self._weighted_roundings, rotation.parts), 0.0) + self._error((rotation.node, *rotation.inner))
                for rotation in reduction.rotations
            ] or [self._weighted_roundings(roundings) for roundings in reduction.lost]
            rests = [
                sum((abs(coefficient) * self.magnitude(k) for coefficient, k in rotation.rest), 0.0)
                for rotation in reduction.rotations
            ] or [0.0]
            other = self.norm(reduction.members) * reduction.stretch + _hypot(lost) + _hypot(rests)
            bound = np.minimum(bound, other * _MARGIN)
        self._norms[key] = bound
        return bound


# ------------------------------------------------------------------------------------------------------------------
# Errors carried forward.
# ------------------------------------------------------------------------------------------------------------------


class _Carried:
    """Bounds of the derivatives of all nodes along the line of errors, by forward mode, with the four rules.

    ``sizes[i]``, of shape (precisions, boxes), bounds ``|d v_i / dt|`` where all local errors are t times their actual
    values. ``local[i]`` bounds the local error of node i, and ``known`` has bounds of some nodes from elsewhere.
    """

    def __init__(self, ranges: _Ranges, local: Sequence[Array], known: Mapping[int, Array]) -> None:
        self.ranges = ranges
        self.local = local
        self.sizes: list[Array] = []
        self._norms: dict[tuple[Factors, ...], Array] = {}
        for index, node in enumerate(ranges.nodes[: len(local)]):  # those behind are derivatives of reverse mode
            size = (self._of_operation(node) + local[index]) * _SUM_MARGIN
            if node.op is Op.ADD or node.op is Op.SUB:
                size = self._of_sum(index, size)
            elif node.op is Op.MUL:
                size = self._of_product_of_sums(index, size)
            if index in known:
                size = np.minimum(size, known[index])
            self.sizes.append(size)

    def _of_operation(self, node: Node) -> Array | float:
        """The derivative of an operation by those of its operands, without its local error."""
        op, args, _ = node
        if op in (Op.INPUT, Op.CONST, Op.SIGN, Op.NONFINITE):
            return 0.0
        first = self.sizes[args[0]]
        magnitude = self.ranges.magnitude
        if op is Op.ADD or op is Op.SUB:
            return first + self.sizes[args[1]]
        if op is Op.MUL:
            return np.asarray(magnitude(args[0]) * self.sizes[args[1]] + magnitude(args[1]) * first)
        if op is Op.DIV:
            least = np.min(np.abs(self.ranges.ranges[args[1]]), axis=0)
            return np.asarray((first + magnitude(args[0]) / least * self.sizes[args[1]]) / least * _SUM_MARGIN)
        if op is Op.SQRT:
            return first / (2.0 * np.sqrt(self.ranges.ranges[args[0]][0])) * _SUM_MARGIN
        if op is Op.MIN:
            return np.maximum(first, self.sizes[args[1]])
        if op is Op.SELECT:  # of a choice that turns over, any slope between those of its branches
            low, high = self.ranges.ranges[args[0]]
            x, y = self.sizes[args[1]], self.sizes[args[2]]
            return np.where(low > 0.0, x, np.where(high <= 0.0, y, np.maximum(x, y)))
        if op is Op.EXP:
            return np.exp(magnitude(args[0])) * (1.0 + _SINE_ERROR) * first
        return first  # the slope of sine, cosine, tanh, magnitude and change of sign is at most 1

    def _of_product_of_sums(self, index: int, size: Array) -> Array:
        """Rule 3 for a product of two sums: ``|a db + b da| <= N(a, b) N(da, db)``."""
        if not self.ranges.is_product_of_sums(self.ranges.nodes[index]):
            return size
        a, b = self.ranges.nodes[index].args
        pair = (a,), (b,)
        return np.minimum(size, (self.ranges.norm(pair) * self.norm(pair) + self.local[index]) * _SUM_MARGIN)

    def _of_sum(self, index: int, size: Array) -> Array:
        for taken in self.ranges.readings[index]:
            if taken.merged:
                size = np.minimum(size, self._of_terms(index, taken, (), 0.0))
            for cosines, sines in taken.pairs:
                size = np.minimum(size, self._by_rotation(index, taken, cosines, sines))
            for reading in taken.vectors:
                size = np.minimum(size, self._by_scalar_products(index, taken, reading))
        return size

    def _by_rotation(
        self, index: int, taken: _Terms, cosines: Sequence[_RotatedTerm], sines: Sequence[_RotatedTerm]
    ) -> Array:
        """Rule 1: ``|c dA + s dB| <= rho N(dA, dB)``, and ``|A dc + B ds| <= N(A, B) N(dc, ds)``."""
        if len(cosines) == len(sines) == 1:
            bound = self.norm((cosines[0].turned.rest, sines[0].turned.rest))
        else:
            groups = [sum(self._of_product(part.turned.rest) for part in group) for group in (cosines, sines)]
            bound = np.hypot(groups[0], groups[1])
        parts = (*cosines, *sines)
        size = bound * _stretch(parts[0].turned.multiple)
        size = size + self._of_trigonometry(parts) * self.ranges.norm_of_sums(cosines, sines)
        size = size + self._of_products(parts, self.ranges.norm_of_sums(cosines, sines))
        return self._of_terms(index, taken, [part.node for part in parts], size)

    def _of_terms(self, index: int, taken: _Terms, left_out: Sequence[int], size: Array | float) -> Array:
        """The derivative of a flattened sum: of its terms but those ``left_out``, and ``size`` for these."""
        for k in (index, *taken.inner):
            size = size + self.local[k]
        for coefficient, k in taken.terms:
            if k not in left_out:
                size = size + abs(coefficient) * self.sizes[k]
        return np.asarray(size * _SUM_MARGIN)

    def _of_trigonometry(self, parts: Sequence[_RotatedTerm | _Turned]) -> Array:
        """A bound of N(dc, ds) for sine and cosine of one angle, times 5 for twice the angle, by rule 4."""
        read = [part.turned if isinstance(part, _RotatedTerm) else part for part in parts]
        slope = math.sqrt(2.0) if read[0].multiple == 1 else 5.0 * math.sqrt(2.0) * RHO
        sizes = [self.sizes[turned.factor] for turned in read]
        return np.asarray(slope * np.max(np.broadcast_arrays(*sizes), axis=0) * _SUM_MARGIN)

    def _of_products(self, parts: Sequence[_RotatedTerm], norm: Array) -> Array:
        """The roundings of the products of one rotation, also those inside them.

        Those of the outer products are at most ``u |c A| + u |s B| <= u rho N(A, B)`` together, up to what the
        roundings inside add to them. The products of a rotation by twice the angle are others.
        """
        outer: Array | float = 0.0
        inner: Array | float = 0.0
        underflow: Array | float = 0.0
        for part in parts:
            for weights, k in part.lost:
                if weights:
                    inner = inner + self._weighted_error(weights, k)
                else:
                    outer = outer + self.local[k]
                    underflow = underflow + _SMALLEST
        if parts[0].turned.multiple == 1:
            outer = np.minimum(outer, _ROUNDOFF * (norm * RHO + inner) + underflow)
        return np.asarray(outer + inner) * _SUM_MARGIN

    def _by_scalar_products(self, index: int, taken: _Terms, reading: _ScalarProducts) -> Array:
        """Rule 3 on both halves of ``a db + c dd + b da + d dc``."""
        of = self.ranges.norm
        size: Array | float = 0.0
        for left, right in reading.vectors:
            size = size + of(left) * self.norm(right) + of(right) * self.norm(left)
        for k in reading.products:
            size = size + self.local[k]
        return self._of_terms(index, taken, reading.products, size)

    def _of_product(self, factors: Factors) -> Array | float:
        """The derivative of a product of nodes."""
        size: Array | float = 0.0
        for place, factor in enumerate(factors):
            if factor != TWO:
                size = size + self.ranges.size(factors[:place] + factors[place + 1 :]) * self.sizes[factor]
        return size * _SUM_MARGIN

    def norm(self, members: Sequence[Factors]) -> Array:
        """Rule 2: a bound of the Euclidean norm of the derivatives of several products of nodes."""
        key = tuple(sorted(members))
        if key in self._norms:
            return self._norms[key]
        squares = sum((self._of_product(member) ** 2 for member in key), np.zeros((len(PRECISIONS), 1)))
        bound = np.sqrt(squares) * _SUM_MARGIN + _TINY
        for reduction in self.ranges.reductions(key) if len(key) > 1 else ():
            extra = self._of_pair(reduction) if reduction.turned else self._of_rotations(reduction.rotations)
            bound = np.minimum(bound, (self.norm(reduction.members) * reduction.stretch + extra) * _SUM_MARGIN)
        self._norms[key] = bound
        return bound

    def _of_rotations(self, rotations: Sequence[_Rotation]) -> Array:
        """What is added to the norm of A, B by their rotation: errors of sine and cosine, roundings, further terms.

        ``N(A dc + B ds, B dc - A ds) = N(A, B) N(dc, ds)``; the roundings of the sums, where nothing else is added, are
        at most u times the norm of the sums.
        """
        norm = self.ranges.norm(rotations[0].pair)
        products = _hypot([self._of_products(rotation.parts, norm) for rotation in rotations])
        sums = _hypot([sum((self.local[k] for k in (rotation.node, *rotation.inner)), 0.0) for rotation in rotations])
        if not any(rotation.inner or rotation.rest for rotation in rotations):
            sums = np.minimum(sums, _ROUNDOFF * (norm * _stretch(rotations[0].multiple) + products))
        rests = _hypot(
            [sum((abs(coefficient) * self.sizes[k] for coefficient, k in rotation.rest), 0.0) for rotation in rotations]
        )
        return np.asarray(self._of_trigonometry(rotations[0].parts) * norm + products + sums + rests)

    def _of_pair(self, reduction: _Reduction) -> Array:
        """What is added to ``|dA|`` by ``N(A dc, A ds)``, by further factors and by the roundings of both products."""
        common = reduction.members[-1]
        size = self.ranges.size(common)
        nothing = np.zeros((len(PRECISIONS), 1))
        outer = _hypot([sum((self.local[k] for weights, k in lost if not weights), nothing) for lost in reduction.lost])
        inner = _hypot(
            [
                sum((self._weighted_error(*rounding) for rounding in lost if rounding[0]), nothing)
                for lost in reduction.lost
            ]
        )
        together = _ROUNDOFF * (size * reduction.stretch + inner) + 2.0 * _SMALLEST
        further = size * self._of_product(reduction.extra) * RHO if reduction.extra else 0.0
        trigonometry = self._of_trigonometry(reduction.turned) * RHO ** len(reduction.extra)
        return np.asarray(trigonometry * size + further + np.minimum(outer, together) + inner)

    def _weighted_error(self, weights: Factors, index: int) -> Array:
        """A local error times the factors behind it, along the whole line."""
        return np.asarray((self.ranges.size(weights) + self._of_product(weights)) * self.local[index])


# ------------------------------------------------------------------------------------------------------------------
# The mean-value form.
# ------------------------------------------------------------------------------------------------------------------


class _Sweep(NamedTuple):
    """Derivatives of one output by the values of nodes: ``numbers``, and ``places`` of the nodes that compute them."""

    numbers: dict[int, int | Fraction]
    places: dict[int, int]


class _Derivatives(NamedTuple):
    """The nodes that compute derivatives, numbered behind those of the program, and the derivatives of each output."""

    nodes: list[Node]
    sweeps: dict[int, _Sweep]


class _Analysis:
    """The rounding analysis of one program over one box."""

    def __init__(self, program: Program, box: Box) -> None:
        self.program = program
        self.nodes = program.nodes
        self._given = box
        self.box = self._input_bounds(box)
        self.rounds = self._roundings()
        self.angles = sorted({node.args[0] for node in self.nodes if node.op is Op.SIN or node.op is Op.COS})
        self._in_angles = set(reachable(self.nodes, self.angles))
        self._check_angles()
        self._of_rounded_angles = [
            index
            for index, node in reversed(list(enumerate(self.nodes)))
            if node.op in (Op.SIN, Op.COS) and self.rounds[node.args[0]]
        ]
        self.outputs = [index for row in program.results for index in row]
        self.followed: dict[int, set[int]] = {}  # of the choices: the nodes that they take in some part of the box
        self.undecided: set[int] = set()  # choices and signs that rounding may turn over

    def _input_bounds(self, box: Box) -> dict[int, tuple[float, float]]:
        """The bounds of every input node. Raises NoBoundError for an input without a range."""
        bounds = {}
        for index, node in enumerate(self.nodes):
            if node.op is Op.INPUT:
                port, element = node.place
                name = self.program.inputs[port].name
                if name not in box:
                    raise NoBoundError(f"the input {name} has no range")
                bounds[index] = (float(box[name][0][element]), float(box[name][1][element]))
        return bounds

    def _roundings(self) -> list[bool]:
        """Whether a node, or one that it depends on, rounds."""
        rounds: list[bool] = []
        for node in self.nodes:
            if node.op is Op.INPUT:
                rounds.append(False)
            elif node.op is Op.CONST:
                rounds.append(any(p.literal(node.number) != node.number for p in PRECISIONS))
            else:
                rounds.append(
                    node.op is not Op.NONFINITE and (node.op not in _EXACT or any(rounds[a] for a in node.args))
                )
        return rounds

    def _check_angles(self) -> None:
        allowed = (Op.INPUT, Op.CONST, Op.ADD, Op.SUB, Op.NEG, Op.MUL)
        for index in self._in_angles:
            node = self.nodes[index]
            linear = node.op is not Op.MUL or any(self.nodes[arg].op is Op.CONST for arg in node.args)
            if node.op not in allowed or not linear:
                raise NoBoundError("the sine of an expression that is not linear in the inputs")

    # -- derivatives -------------------------------------------------------------------------------------------

    @cached_property
    def derivatives(self) -> _Derivatives:
        """Reverse mode from every output; of no output for programs of many nodes and outputs.

        The values of the program's nodes are inputs of the recording, so that nothing is simplified by an identity that
        holds only without rounding. One recording holds all outputs, which have many nodes in common.
        """
        size = len(self.nodes)
        if size * len(set(self.outputs)) > _MOST_REVERSED:
            return _Derivatives([], {})
        builder = Builder()
        values = builder.input(Port("v", (size,)))
        recorded = {output: self._adjoints(builder, values, output) for output in self.outputs}
        places = {
            output: {
                index: adjoint.index for index, adjoint in adjoints.items() if not isinstance(adjoint, (int, Fraction))
            }
            for output, adjoints in recorded.items()
        }
        moved: dict[int, int] = {}
        nodes: list[Node] = []
        for old in reachable(builder.nodes, (place for of_output in places.values() for place in of_output.values())):
            node = builder.nodes[old]
            if node.op is Op.INPUT:
                moved[old] = node.place[1]
            else:
                moved[old] = size + len(nodes)
                nodes.append(Node(node.op, tuple(moved[arg] for arg in node.args), node.value))
        sweeps = {
            output: _Sweep(
                {index: adjoint for index, adjoint in adjoints.items() if isinstance(adjoint, (int, Fraction))},
                {index: moved[place] for index, place in places[output].items()},
            )
            for output, adjoints in recorded.items()
        }
        return _Derivatives(nodes, sweeps)

    def _adjoints(self, builder: Builder, value: Sequence[Value], output: int) -> dict[int, Value]:
        """The derivatives of node ``output`` by the nodes of the program with these values, recorded in ``builder``.

        Those that are zero are left out. Derivatives do not pass through sines and cosines.
        """
        adjoints: dict[int, Value] = {output: 1}
        order = reachable(self.nodes, [output])

        def give(index: int, amount: Value) -> None:
            if self.rounds[index] and not is_zero(amount):
                adjoints[index] = builder.add(adjoints[index], amount) if index in adjoints else amount

        for index in reversed(order):
            if index not in adjoints:
                continue
            adjoint, node = adjoints[index], self.nodes[index]
            if node.op is Op.ADD:
                give(node.args[0], adjoint)
                give(node.args[1], adjoint)
            elif node.op is Op.SUB:
                give(node.args[0], adjoint)
                give(node.args[1], builder.neg(adjoint))
            elif node.op is Op.NEG:
                give(node.args[0], builder.neg(adjoint))
            elif node.op is Op.MUL:
                a, b = node.args
                give(a, builder.mul(self._value(value, b), adjoint))
                give(b, builder.mul(self._value(value, a), adjoint))
            elif node.op is Op.DIV:
                a, b = node.args
                share = builder.div(adjoint, self._value(value, b))
                give(a, share)
                give(b, builder.neg(builder.mul(share, builder.div(self._value(value, a), self._value(value, b)))))
            elif node.op is Op.SQRT:
                give(node.args[0], builder.div(adjoint, builder.mul(2, builder.sqrt(value[node.args[0]]))))
            elif node.op is Op.ABS:
                give(node.args[0], builder.mul(builder.sign(value[node.args[0]]), adjoint))
            elif node.op is Op.MIN:
                a, b = node.args
                first = builder.sub(self._value(value, b), self._value(value, a))
                give(a, builder.select(first, adjoint, 0))
                give(b, builder.select(first, 0, adjoint))
            elif node.op is Op.SELECT:
                condition, a, b = node.args
                give(a, builder.select(value[condition], adjoint, 0))
                give(b, builder.select(value[condition], 0, adjoint))
            elif node.op is Op.TANH:
                slope = builder.tanh(value[node.args[0]])
                give(node.args[0], builder.mul(builder.sub(1, builder.mul(slope, slope)), adjoint))
            elif node.op is Op.EXP:
                give(node.args[0], builder.mul(builder.exp(value[node.args[0]]), adjoint))
        return adjoints

    def _value(self, values: Sequence[Value], index: int) -> Value:
        """The value of a node in a derivative: a number for a constant that every precision represents."""
        node = self.nodes[index]
        return node.number if node.op is Op.CONST and not self.rounds[index] else values[index]

    # -- parts of the box --------------------------------------------------------------------------------------

    def split_inputs(self) -> list[int]:
        """The inputs whose sine or cosine is taken, also as part of a sum."""
        return [index for index in sorted(self._in_angles) if self.nodes[index].op is Op.INPUT]

    def affordable_parts(self, budget: float) -> int:
        """The largest number of parts per angle for which the work stays within ``budget``."""
        if self.parts_within(budget, len(self.nodes)) == 1:
            return 1
        work = len(self.nodes) + len(self.derivatives.nodes)
        return 1 if work > _LARGE else self.parts_within(budget, work)

    def parts_within(self, budget: float, work: int) -> int:
        """The largest number of parts per angle for which ``work`` per box stays within ``budget``."""
        split = self.split_inputs()
        if not split:
            return 1
        return max(1, min(_MOST_PARTS, int((budget / work) ** (1.0 / len(split)))))

    def _boxes(self, parts: int) -> dict[int, Interval]:
        """Bounds of every input over all boxes: those of angles split, shape (boxes,), the others shape (1,)."""
        split = self.split_inputs()
        edges = {}
        for index in split:
            low, high = self.box[index]
            grid = np.linspace(low, high, parts + 1)
            edges[index] = grid
        chosen = np.array(list(product(range(parts), repeat=len(split))), dtype=int).reshape(parts ** len(split), -1)
        boxes: dict[int, Interval] = {}
        for index, (low, high) in self.box.items():
            if index in edges:
                k = chosen[:, split.index(index)]
                boxes[index] = edges[index][k], edges[index][k + 1]
            else:
                boxes[index] = np.array([low]), np.array([high])
        return boxes

    # -- evaluation --------------------------------------------------------------------------------------------

    def bounds(self, parts: int, finer: int) -> tuple[tuple[tuple[float, ...], ...], tuple[tuple[float, ...], ...]]:
        """The bounds per output element in both precisions, with every angle split into ``parts``.

        Forward mode alone, which takes one sweep for all outputs, is also evaluated with ``finer`` parts.
        """
        totals = self._largest(parts, by_reverse_mode=True)
        if finer > parts:
            carried = self._largest(finer, by_reverse_mode=False)
            totals = {index: np.minimum(total, carried[index]) for index, total in totals.items()}
        results = [
            tuple(tuple(float(totals[index][k]) for index in row) for row in self.program.results)
            for k in range(len(PRECISIONS))
        ]
        return results[0], results[1]

    def _largest(self, parts: int, by_reverse_mode: bool) -> dict[int, Array]:
        """The largest bounds over all boxes of every output element, in both precisions, shape (precisions,)."""
        ranges, errors = self._enclose_nodes(self._boxes(parts))
        local = [np.stack([np.atleast_1d(radius) for radius in np.broadcast_arrays(*error)]) for error in errors]
        known = self._by_reverse_mode(ranges, local) if by_reverse_mode else {}
        carried = _Carried(ranges, local, known)
        return {index: np.max(carried.sizes[index], axis=1) for index in self.outputs}

    def enclosures(self, parts: int) -> dict[int, tuple[float, float]]:
        """The bounds of the nodes that are outputs, local errors included, with every angle split into ``parts``."""
        ranges, _ = self._enclose_nodes(self._boxes(parts))
        return {
            index: (float(np.min(ranges.ranges[index][0])), float(np.max(ranges.ranges[index][1])))
            for index in self.outputs
        }

    def require_bounds_of_divisors(self, parts: int) -> None:
        """Raise NoBoundError if a divisor or root may be zero although every angle is split into ``parts``.

        The nodes that these depend on are few beside those of the derivatives, which need not be recorded then.
        """
        divisors = [node.args[1] for node in self.nodes if node.op is Op.DIV]
        squares = [node.args[0] for node in self.nodes if node.op is Op.SQRT]
        if divisors or squares:
            alone = _Analysis(with_results(self.program, [divisors, squares]), self._given)
            ranges = alone._enclose_nodes(alone._boxes(parts))[0].ranges
            for index in alone.program.results[0]:
                _quotient(ranges[index], ranges[index])
            for index in alone.program.results[1]:
                _root(ranges[index])

    def _enclose_nodes(self, boxes: Mapping[int, Interval]) -> tuple[_Ranges, list[tuple[Array | float, ...]]]:
        """The enclosures of all nodes, and the bounds of their local errors in both precisions."""
        ranges = _Ranges(len(self.nodes))
        errors: list[tuple[Array | float, ...]] = []
        for index, node in enumerate(self.nodes):
            if node.op is Op.INPUT:
                ranges.append(node, boxes[index])
                errors.append((0.0, 0.0))
                continue
            if node.op is Op.CONST:
                enclosure, local = _constant(node.number)
                ranges.append(node, enclosure)
                errors.append(local)
                continue
            if node.op is Op.SELECT:
                choice = self._note_choice(index, node, ranges)
                # the difference of two numbers that is compared may be flushed to zero
                radius: tuple[Array | float, ...] = tuple(p.smallest * choice.continuous for p in PRECISIONS)
                errors.append(radius)
                ranges.append(node, _widen(choice.enclosure, radius[-1]) if choice.continuous else choice.enclosure)
                continue
            exact = ranges.exact(node)
            if node.op is Op.SIGN and self.rounds[index] and np.any(exact[0] != exact[1]):
                self.undecided.add(index)
            radius = self._local_errors(node, exact, ranges)
            enclosure = _widen(exact, radius[-1]) if node.op not in _EXACT else exact
            if node.op in _ROUNDED:
                enclosure, radius = self._with_its_sign(exact, enclosure, radius)
            errors.append(radius)
            ranges.append(node, enclosure, radius[-1])
        return ranges, errors

    def _with_its_sign(
        self, exact: Interval, enclosure: Interval, radius: tuple[Array | float, ...]
    ) -> tuple[Interval, tuple[Array | float, ...]]:
        """Enclosure and local errors of an operation whose exact result is not zero, as its rounded one is then not.

        The local error is then a share d of the exact result, ``v = op(..) (1 + d)`` with ``|d| <= u``, and d instead
        of e goes from 0 to its actual value.
        """
        lost = ((exact[0] > 0.0) & (enclosure[0] <= 0.0)) | ((exact[1] < 0.0) & (enclosure[1] >= 0.0))
        if not np.any(lost):
            return enclosure, radius
        share, least = 2.0 * FLOAT.roundoff, FLOAT.smallest
        low = np.where(exact[0] > 0.0, exact[0] * (1.0 - share), exact[0] * (1.0 + share)) - least
        high = np.where(exact[1] < 0.0, exact[1] * (1.0 - share), exact[1] * (1.0 + share)) + least
        size = _magnitude(exact) * _MARGIN
        errors = tuple(
            np.where(lost, precision.roundoff * size + precision.smallest, local_error)
            for precision, local_error in zip(PRECISIONS, radius, strict=True)
        )
        return (np.where(lost, _down(low), enclosure[0]), np.where(lost, _up(high), enclosure[1])), errors

    def _note_choice(self, index: int, node: Node, ranges: _Ranges) -> _Choice:
        """What is known about a choice; notes which nodes it takes, and whether rounding may turn it over."""
        choice = ranges.choice(node)
        self.followed.setdefault(index, set()).update(choice.followed)
        if not choice.decided and not choice.continuous and self.rounds[node.args[0]]:
            self.undecided.add(index)
        return choice

    def conditional(self) -> tuple[bool, ...]:
        """For every output whether a comparison that rounding may turn over lies behind it; known after the bounds."""
        flags = []
        for row in self.program.results:
            waiting, seen = list(row), set(row)
            while waiting:
                index = waiting.pop()
                new = self.followed.get(index, set(self.nodes[index].args)) - seen
                waiting += new
                seen |= new
            flags.append(not seen.isdisjoint(self.undecided))
        return tuple(flags)

    def _local_errors(self, node: Node, exact: Interval, ranges: _Ranges) -> tuple[Array | float, ...]:
        """Bounds of the local error of an operation, in the order of :data:`PRECISIONS`."""
        if node.op in _EXACT:
            return (0.0,) * len(PRECISIONS)
        if node.op is Op.SIN or node.op is Op.COS:
            reach = float(np.max(ranges.magnitude(node.args[0])))
            for precision in PRECISIONS:
                if reach > precision.kernel_range:
                    raise NoBoundError(f"an angle beyond {precision.kernel_range:g} rad, where the C library is called")
            return tuple(precision.kernel_error for precision in PRECISIONS)
        magnitude = _magnitude(exact)
        if not np.all(np.isfinite(magnitude)) or float(np.max(magnitude)) > 1e30:
            raise NoBoundError("a value that may overflow a float")
        if node.op is Op.TANH or node.op is Op.EXP:
            return tuple(
                2 * LIBRARY_UNITS * _half_unit(magnitude, precision.roundoff) + precision.smallest
                for precision in PRECISIONS
            )
        underflow = node.op is Op.MUL or node.op is Op.DIV
        if node.op is Op.ADD and node.args[0] == node.args[1]:
            return tuple(precision.smallest for precision in PRECISIONS)
        if node.op is Op.MUL and any(
            self.nodes[arg].op is Op.CONST and _is_power_of_two(self.nodes[arg].number) for arg in node.args
        ):
            return tuple(precision.smallest for precision in PRECISIONS)
        return tuple(
            _half_unit(magnitude, precision.roundoff) + (precision.smallest if underflow else 0.0)
            for precision in PRECISIONS
        )

    def _by_reverse_mode(self, ranges: _Ranges, local: Sequence[Array]) -> dict[int, Array]:
        """Enclose the derivatives; the bounds of every output element in both precisions, (precisions, boxes)."""
        for node in self.derivatives.nodes:
            ranges.append(node, _constant(node.number)[0] if node.op is Op.CONST else ranges.exact(node))
        return {output: self._error_of(sweep, ranges, local) for output, sweep in self.derivatives.sweeps.items()}

    def _error_of(self, sweep: _Sweep, ranges: _Ranges, local: Sequence[Array]) -> Array:
        """The bounds of one output element in both precisions, shape (precisions, boxes)."""
        numbers, places = sweep
        total = np.zeros((len(PRECISIONS), 1))
        through_angles = self._through_angles(numbers, places, ranges)
        for index in {*numbers, *places, *through_angles}:
            size_of: Array | float = 0.0
            if index in numbers:
                size_of = abs(float(numbers[index])) * _MARGIN
            elif index in places:
                size_of = ranges.magnitude(places[index])
            size_of = size_of + through_angles.get(index, 0.0)
            total = total + size_of * local[index]
        grown = 1.0 + 4.0 * len(self.nodes) * 2.0**-52  # each term and each addition is rounded once
        return np.asarray(total * grown)

    def _through_angles(
        self, numbers: Mapping[int, int | Fraction], places: Mapping[int, int], ranges: _Ranges
    ) -> dict[int, Array | float]:
        """Bounds of the derivatives that reach nodes of rounded angles through sines and cosines.

        With derivatives x by the sine and y by the cosine of an angle, ``|x cos - y sin| <= N(x, y)`` (Cauchy-Schwarz).
        """
        reached: dict[int, Array | float] = {}
        for index in self._of_rounded_angles:
            angle = self.nodes[index].args[0]
            if index in numbers:
                amount: Array | float = abs(float(numbers[index])) * _MARGIN
            elif index in places:
                amount = ranges.magnitude(places[index])
            else:
                continue
            reached[angle] = np.hypot(reached[angle], amount) * _MARGIN if angle in reached else amount
        for index in sorted(self._in_angles, reverse=True) if reached else ():
            if index not in reached:
                continue
            node = self.nodes[index]
            for arg, other in zip(node.args, reversed(node.args), strict=True):
                if self.rounds[arg]:
                    factor: Array | float = ranges.magnitude(other) if node.op is Op.MUL else 1.0
                    reached[arg] = (reached.get(arg, 0.0) + reached[index] * factor) * _MARGIN
        return reached


def _constant(value: Fraction | int) -> tuple[Interval, tuple[float, ...]]:
    """The enclosure of a constant and of its literals, and the distances of the literals from it."""
    literals = [precision.literal(value) for precision in PRECISIONS]
    errors = tuple(
        math.nextafter(float(abs(literal - value)), math.inf) if literal != value else 0.0 for literal in literals
    )
    numbers = [float(value), *map(float, literals)]
    exact = all(literal == value for literal in literals)
    low, high = min(numbers), max(numbers)
    if not exact:
        low, high = math.nextafter(low, -math.inf), math.nextafter(high, math.inf)
    return (np.array([low]), np.array([high])), errors


def _is_power_of_two(value: Fraction | int) -> bool:
    size = abs(Fraction(value))
    return size != 0 and all(part & (part - 1) == 0 for part in (size.numerator, size.denominator))
