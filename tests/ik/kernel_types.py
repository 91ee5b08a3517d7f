"""Types of the arguments of kernels."""

from __future__ import annotations

import ctypes

import numpy as np

REAL, INT, UNSIGNED = ctypes.c_double, ctypes.c_int, ctypes.c_uint
RNG = np.random.default_rng
