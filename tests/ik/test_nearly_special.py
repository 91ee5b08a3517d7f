"""Geometry off a special case by 1e-12 ... 1e-3: both sides of every threshold find the same solutions."""

from functools import cache

import numpy as np
import pytest

from ik.checks import configurations, sample
from ik.robots import ROWS, make
from rrrgen.ik.classify import plan
from rrrgen.ik.tolerances import SPECIAL

OFFSETS = (1e-12, 1e-10, 2e-9, 1e-7, 2e-6, 1e-4, 1e-3)

COLUMN = {"alpha": 1, "a": 2, "d": 3, "theta": 4}


def moved(name, parameters, offset) -> list:
    """The table of ``name`` with each of ``parameters`` (e.g. ``"alpha2"``) off by ``offset``."""
    rows = [list(row) for row in ROWS[name]]
    for parameter in parameters:
        rows[int(parameter[-1]) - 1][COLUMN[parameter[:-1]]] += offset
    return [tuple(row) for row in rows]


CASES = [
    ("rrr", ("a1",)),
    ("rrr", ("alpha1",)),
    ("rrr", ("alpha2",)),
    ("rrr", ("a1", "alpha2")),
    ("puma", ("a1", "alpha1")),
    ("irb6640", ("alpha1", "alpha2")),
    ("stanford", ("alpha2",)),
]


@cache
def special_counts(name) -> np.ndarray:
    """Numbers of solutions of the special arm itself for the same configurations."""
    return sample(name, ROWS[name], N=400).batch.counts


EVERY_SECOND = [(*case, offset) for k, case in enumerate(CASES) for offset in OFFSETS[k % 2 :: 2]]
"""Neighbours among the cases differ in the offsets that they take, so that every threshold has both its sides."""


@pytest.mark.parametrize(
    ("name", "parameters", "offset"),
    [pytest.param(*case, marks=[pytest.mark.sweep] * (k % 2)) for k, case in enumerate(EVERY_SECOND)],
)
def test_both_sides_of_a_threshold(name, parameters, offset):
    rows = moved(name, parameters, offset)
    result = sample(name, rows, N=400)
    result.assert_right()
    # the number of solutions is that of the special arm but for poses within about sqrt(offset) of a singular one
    differing = np.mean(result.batch.counts != special_counts(name))
    assert differing <= 4 * np.sqrt(offset) + 0.01


def test_threshold_decides_which_equations_are_used():
    """A quartic next to two quadratics: below SPECIAL the quadratics alone, then both, far away the quartic alone."""
    for offset, snapped, helped in ((SPECIAL / 10, True, False), (1e-5, False, True), (0.1, False, False)):
        found = plan(make("arm", moved("rrr", ("a1", "alpha2"), offset)))
        assert found.family == "position"
        assert found.snapped == snapped
        assert (found.companion is not None) == helped
        assert not found.incomplete
    # equations that stay quadratic need no help: the wrist's angles may be anything
    for offset in (1e-10, 1e-5, 0.1):
        found = plan(make("arm", moved("puma", ("alpha4",), offset)))
        assert (found.family, found.snapped, found.companion) == ("spherical", False, None)


@pytest.mark.parametrize("digits", [4, 7, 16])
def test_rounded_right_angles(digits):
    """A table in decimals: 1.5708 is off by 3.7e-6, 1.5707963 by 2.7e-8, 1.5707963267948966 not at all."""
    rows = [(kind, round(alpha, digits), a, d, theta) for kind, alpha, a, d, theta in ROWS["puma"]]
    result = sample("puma", rows, q=configurations(ROWS["puma"], 300, 4))
    result.assert_right()
    assert result.solver.plan.family == "spherical"
