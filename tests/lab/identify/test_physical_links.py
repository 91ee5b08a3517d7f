"""Physical links: the pseudo-inertia of point masses."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rrrgen.derive.parameters.physical_links import pseudo_inertia
from rrrgen.lab.identify.consistency import parameters_of

pytest.importorskip("cvxpy", reason="cvxpy and CLARABEL solve the semidefinite program")


@given(st.integers(0, 10**6))
def test_pseudo_inertia_of_point_masses(seed):
    """``J = sum m [r; 1] [r; 1]'``: positive semidefinite, and back again."""
    rng = np.random.default_rng(seed)
    m, r = rng.uniform(0.1, 2, 6), rng.normal(size=(6, 3))
    h = np.column_stack([r, np.ones(6)])
    J = np.einsum("k,ki,kj->ij", m, h, h)
    S = sum(mk * ((rk @ rk) * np.eye(3) - np.outer(rk, rk)) for mk, rk in zip(m, r, strict=True))
    phi = np.array([m.sum(), *(m @ r), S[0, 0], S[0, 1], S[1, 1], S[0, 2], S[1, 2], S[2, 2]])
    np.testing.assert_allclose(pseudo_inertia(phi), J, atol=1e-12)
    np.testing.assert_allclose(parameters_of(J), phi, atol=1e-12)
