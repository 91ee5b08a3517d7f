"""The rows of a table in one form for both conventions, against the products that the conventions are defined by."""

from dataclasses import replace

import numpy as np
import pytest

from rrrgen.robot.file import load_spec
from rrrgen.robot.model.canonical_frames import NO_TWIST, dh_rows


def screw(axis: int, angle: float, length: float) -> np.ndarray:
    """A turn about x (0) or z (2) and a shift along it."""
    i, k = (axis + 1) % 3, (axis + 2) % 3
    T = np.eye(4)
    T[[i, k], [i, k]] = np.cos(angle)
    T[i, k], T[k, i], T[axis, 3] = -np.sin(angle), np.sin(angle), length
    return T


@pytest.mark.parametrize("name", ["rrr", "panda", "stanford"])
@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_rows_are_the_products_of_their_convention(name, convention):
    spec = replace(load_spec(name), convention=convention)
    rows = dh_rows(spec, nominal=True)
    assert [row.revolute for row in rows] == [joint.is_revolute for joint in spec.joints]
    for row, (_, alpha, a, d, theta) in zip(rows, spec.dh_table(), strict=True):
        x, z = screw(0, alpha, a), screw(2, theta, d)
        before, behind = (screw(0, float(t.alpha), float(t.a)) for t in (row.before, row.behind))
        product = before @ screw(2, float(row.theta), float(row.d)) @ behind
        np.testing.assert_allclose(product, z @ x if convention == "standard" else x @ z, atol=1e-15)
        assert NO_TWIST in (row.before, row.behind)


def test_named_parameters_stay_symbols():
    spec = load_spec("rrr")
    symbols = {str(symbol) for row in dh_rows(spec) for entry in (row.d, *row.behind) for symbol in entry.free_symbols}
    assert symbols == set(spec.parameters) & symbols != set()
    assert all(entry.is_number for row in dh_rows(spec, nominal=True) for entry in (row.d, *row.behind))
