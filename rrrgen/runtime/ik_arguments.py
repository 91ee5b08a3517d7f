"""Argument checking of the inverse kinematics: option bits for the C code, arrays of real numbers, or a clear error."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

LIMITS, NEAREST, RESIDUAL = 1, 2, 4
"""Option bits of the emitted functions, as in the emitted header: respect limits, sort by distance, keep residual."""

SORTS = ("branch", "nearest")


def options(limits: Any, sort: Any = "branch", residual: Any = False) -> int:
    """Option bits of a call of the C code, from its keyword arguments.

    Raises TypeError unless ``limits`` and ``residual`` are booleans, ValueError for an unknown order ``sort``.
    """
    if not isinstance(sort, str) or sort not in SORTS:
        raise ValueError(f"sort must be {' or '.join(map(repr, SORTS))}, not {sort!r}")
    bits = LIMITS * flag("limits", limits) + RESIDUAL * flag("residual", residual)
    return bits + NEAREST * (sort == "nearest")


def flag(name: str, value: Any) -> bool:
    """``value`` as a bool. Raises TypeError for anything else, such as a number passed by mistake."""
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(f"{name} must be True or False, not {value!r}")
    return bool(value)


def real_array(name: str, value: Any) -> NDArray[np.float64]:
    """``value`` as float64. Raises TypeError for complex, boolean, text, object or masked arrays."""
    if isinstance(value, np.ma.MaskedArray):
        raise TypeError(f"{name} is a masked array; its mask would be lost. Fill it first")
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise ValueError(f"{name} is no rectangular array of numbers: {error}") from None
    if array.dtype.kind not in "iuf":
        raise TypeError(f"{name} must hold real numbers, not {array.dtype}")
    return array.astype(np.float64, copy=False)


def real_number(name: str, value: Any) -> float:
    """``value`` as one float. Raises TypeError unless it is a single real number."""
    array = real_array(name, value)
    if array.shape != ():
        raise TypeError(f"{name} must be one number, not an array of shape {array.shape}")
    return float(array)
