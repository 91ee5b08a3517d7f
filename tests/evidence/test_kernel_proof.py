"""The error bound of the sine and cosine kernel: proven where Gappa and Sollya are installed, never contradicted."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from rrrgen.emit.c.language import ERROR_BOUND, RANGE
from rrrgen.evidence import kernel_proof
from rrrgen.evidence.kernel_proof import UnprovenError, check_reduction, prove, tools_missing
from rrrgen.evidence.rounding import DOUBLE, FLOAT
from rrrgen.evidence.sampling import has_wide_format, kernel

needs_tools = pytest.mark.skipif(bool(tools_missing()), reason=f"needs {' and '.join(tools_missing())}")


@needs_tools
@pytest.mark.parametrize("real", ["double", "float"])
def test_the_bound_is_proven(real):
    proof = prove(real)
    assert proof.worst <= ERROR_BOUND[real]
    assert proof.worst >= 0.9 * ERROR_BOUND[real]  # the stated bound is not far above what is proven


@needs_tools
def test_a_wrong_coefficient_is_far_from_the_sine(monkeypatch):
    changed = ("-1.6666666666663e-1", *kernel_proof.SINE["double"][1:])
    monkeypatch.setitem(kernel_proof.SINE, "double", changed)
    sine, cosine = kernel_proof._sollya(kernel_proof.scripts("double")["polynomials.sollya"])
    assert sine > 1e-14 > cosine


@needs_tools
def test_a_bound_below_the_proven_one_is_refused(monkeypatch):
    monkeypatch.setitem(kernel_proof.ERROR_BOUND, "float", 1.0e-7)
    with pytest.raises(UnprovenError, match="exceeds"):
        prove("float")


@pytest.mark.parametrize("real", ["double", "float"])
def test_a_longer_first_part_of_half_pi_is_not_exact(real, monkeypatch):
    check_reduction(real)
    parts = kernel_proof.HALF_PI[real]
    monkeypatch.setitem(kernel_proof.HALF_PI, real, ("1.57079632679489661923", *parts[1:]))
    with pytest.raises(UnprovenError, match="not exact"):
        check_reduction(real)


@pytest.mark.parametrize("precision", [DOUBLE, FLOAT], ids=["double", "float"])
def test_no_angle_contradicts_the_bound(precision):
    """Random angles, and those next to odd multiples of pi/4, where the reduction is worst."""
    if not has_wide_format(precision):
        pytest.skip("long double is not wider than double on this machine")
    kind, wide = (np.float64, np.longdouble) if precision is DOUBLE else (np.float32, np.float64)
    rng = np.random.default_rng(0)
    reach = float(Fraction(RANGE[precision.name]))
    quarter = (2.0 * rng.integers(-int(reach / 1.6), int(reach / 1.6), 100_000) + 1.0) * (np.pi / 4.0)
    x = np.concatenate([rng.uniform(-reach, reach, 200_000), rng.uniform(-4, 4, 200_000), quarter]).astype(kind)
    x = x[np.abs(x) <= reach]
    sine, cosine = kernel(x, precision)
    assert float(np.abs(sine - np.sin(x.astype(wide))).max()) <= precision.kernel_error
    assert float(np.abs(cosine - np.cos(x.astype(wide))).max()) <= precision.kernel_error
