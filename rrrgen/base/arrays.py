"""The type of numerical arrays, and arrays made from what a caller gives."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

Array = NDArray[np.floating[Any]]


def real_array(name: str, value: Any, dtype: DTypeLike = np.float64) -> NDArray[Any]:
    """``value`` as an array of ``dtype``. Raises TypeError for complex, boolean, text, object or masked arrays."""
    if isinstance(value, np.ma.MaskedArray):
        raise TypeError(f"{name} is a masked array; its mask would be lost. Fill it first")
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise ValueError(f"{name} is no rectangular array of numbers: {error}") from None
    if array.dtype.kind not in "iuf":
        raise TypeError(f"{name} must hold real numbers, not {array.dtype}")
    return array.astype(dtype, copy=False)
