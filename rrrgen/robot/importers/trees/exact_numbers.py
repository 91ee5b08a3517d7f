"""Arithmetic with 60 digits for imported geometry, and conversion of the results to exact numbers.

Geometry is computed with 60 digits, so that a rounded value at the end is as exact as the decimals of the file, and
what is equal in the file is equal to 1e-40 after any number of transforms.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import mpmath
import numpy as np
import sympy as sp
from numpy.typing import NDArray

Array = NDArray[Any]
"""Arrays of 60-digit numbers."""

HIGH: Any = mpmath.MPContext()
HIGH.dps = 60

EQUAL = HIGH.mpf(10) ** -40
STEPS = 12  # an exact angle is a multiple of pi / STEPS, 15 degrees
SHORT = 15  # most decimals of a number that is taken as exact
LONG = 25  # decimals to which any other number is rounded
NOISE = HIGH.mpf(10) ** -12  # m, rad; rounding errors of exporters that compute with doubles are smaller
_POINT_FIRST = re.compile(r"(?<![0-9])\.")


def number(value: Any) -> Any:
    """Convert text or an exact number to a 60-digit number; a double is read as the decimal that it prints."""
    if isinstance(value, float):
        value = repr(float(value))
    if isinstance(value, sp.Expr):
        return HIGH.mpf(str(sp.N(value, HIGH.dps)))
    if isinstance(value, str):
        value = _POINT_FIRST.sub("0.", value, count=1)  # mpmath finds no digit in ".0"
    return HIGH.mpf(value)


def vector(values: Sequence[Any] | Array) -> Array:
    """A vector (3,) of 60-digit numbers."""
    return np.array([number(value) for value in values], dtype=object)


def identity(size: int = 4) -> Array:
    """The unit matrix (size, size)."""
    return np.array([[number(int(i == k)) for k in range(size)] for i in range(size)], dtype=object)


def transform(R: Array, p: Sequence[Any]) -> Array:
    """The homogeneous matrix (4, 4) with rotation ``R`` (3, 3) and translation ``p`` (3,)."""
    T = identity()
    T[:3, :3], T[:3, 3] = R, vector(p)
    return T


def inverse(T: Array) -> Array:
    """The inverse of a homogeneous matrix (4, 4)."""
    R = T[:3, :3].T
    return transform(R, list(-(R @ T[:3, 3])))


def rotation(axis: Sequence[Any] | Array, angle: Any) -> Array:
    """The rotation (3, 3) by ``angle`` (rad) about the unit vector ``axis``, by Rodrigues' formula."""
    k, angle = vector(axis), exact_multiple(angle, EQUAL)
    c, s = _cos_sin(angle)
    K = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]], dtype=object)
    return np.asarray(c * identity(3) + s * K + (1 - c) * np.outer(k, k))


def _cos_sin(angle: Any) -> tuple[Any, Any]:
    """Cosine and sine of ``angle`` (rad); one that differs from zero by rounding only becomes exactly 0."""
    c, s = HIGH.cos(angle), HIGH.sin(angle)
    return (c if abs(c) > EQUAL else number(0)), (s if abs(s) > EQUAL else number(0))


def roll_pitch_yaw(roll: Any, pitch: Any, yaw: Any) -> Array:
    """The rotation matrix (3, 3) of roll, pitch and yaw angles (rad), ``Rz(yaw) Ry(pitch) Rx(roll)``."""
    return rotation((0, 0, 1), yaw) @ rotation((0, 1, 0), pitch) @ rotation((1, 0, 0), roll)


def norm(v: Array) -> Any:
    """Length of a vector."""
    return HIGH.sqrt(sum(x * x for x in v))


def cross(u: Array, v: Array) -> Array:
    """The vector product (3,)."""
    return np.array([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]], dtype=object)


def exact_multiple(angle: Any, tolerance: Any) -> Any:
    """The multiple of pi/12 within ``tolerance`` (rad) of ``angle``; ``angle`` itself if there is none."""
    step = HIGH.pi / STEPS
    nearest = HIGH.nint(angle / step) * step
    return nearest if abs(angle - nearest) <= tolerance else angle


def exact_angle(angle: Any) -> sp.Expr:
    """Convert ``angle`` (rad) to a multiple of pi or a short decimal if it is one; otherwise round to 25 decimals."""
    steps = int(HIGH.nint(angle * STEPS / HIGH.pi))
    if abs(angle - steps * HIGH.pi / STEPS) <= EQUAL:
        return sp.Rational(steps, STEPS) * sp.pi
    return decimal(angle)


def exact_length(length: Any) -> sp.Expr:
    """Convert ``length`` to a short decimal, or one times sqrt(2), sqrt(3) or sqrt(6); else round to 25 decimals."""
    for root in (1, 2, 3, 6):
        short = _round_to_decimals(length / HIGH.sqrt(root), SHORT)
        if abs(number(short) * HIGH.sqrt(root) - length) <= EQUAL:
            return short * sp.sqrt(root)
    return decimal(length)


def decimal(value: Any) -> sp.Rational:
    """Convert ``value`` to an exact rational: a short decimal if it is one, otherwise rounded to 25 decimals."""
    short = _round_to_decimals(value, SHORT)
    return short if abs(number(short) - value) <= EQUAL else _round_to_decimals(value, LONG)


def _round_to_decimals(value: Any, digits: int) -> sp.Rational:
    return sp.Rational(int(HIGH.nint(value * HIGH.mpf(10) ** digits)), 10**digits)


def without_noise(value: Any) -> Any:
    """Remove rounding errors from a number of a file: round to nine decimals if that changes it by at most 1e-12.

    Otherwise ``value`` is returned as it is.
    """
    short = number(_round_to_decimals(value, 9))
    return short if abs(short - value) <= NOISE else value


def exact_rotation(R: Array) -> tuple[sp.Expr, ...]:
    """Convert a rotation matrix to nine exact entries, row by row; 0, 1/2, sqrt(2)/2, ... where they equal those."""
    return tuple(exact_length(entry) for entry in R.ravel())
