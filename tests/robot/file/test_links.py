"""Inertia of links: principal moments, thin bodies, and what is physical, exactly."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from rrrgen.robot.file import LinkSpec, bundled_names, load_spec
from rrrgen.robot.file.links import is_positive_semidefinite, physical_fault, principal_moments

WITHOUT_LINKS = ("ur3e", "ur5e", "xarm6", "piper")
"""Arms whose makers publish no inertias."""
"""Arms with small offsets in the maker's own data, of which a file is warned."""


def pseudo_inertia(link: LinkSpec) -> np.ndarray:
    """(14.9), from the tensor about the origin."""
    xx, yy, zz, xy, xz, yz = (float(value) for value in link.inertia_about_origin())
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    m, com = float(link.mass), np.array([float(value) for value in link.com])
    J = np.zeros((4, 4))
    J[:3, :3] = np.trace(tensor) / 2 * np.eye(3) - tensor
    J[:3, 3] = J[3, :3] = m * com
    J[3, 3] = m
    return J


@pytest.mark.parametrize("name", bundled_names())
def test_every_pseudo_inertia_is_positive_definite(name: str) -> None:
    links = load_spec(name).links
    assert (links is None) == (name in WITHOUT_LINKS)
    for link in links or ():
        assert np.linalg.eigvalsh(pseudo_inertia(link))[0] > 0


@pytest.mark.parametrize("seed", range(20))
def test_principal_moments_and_physical_consistency_against_eigenvalues(seed: int) -> None:
    random = np.random.default_rng(seed)
    A = random.normal(size=(3, 3))
    tensor = A + A.T + 2 * random.integers(0, 3) * np.eye(3)
    entries = [sp.Rational(float(tensor[i, j])) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    eigenvalues = np.linalg.eigvalsh(tensor)
    assert np.allclose(principal_moments(entries), eigenvalues, rtol=0, atol=1e-12 * np.abs(eigenvalues).max())
    com = tuple(sp.Rational(float(value)) for value in random.normal(size=3))
    link = LinkSpec(sp.Rational(3, 2), com, tuple(entries), "com")
    assert (physical_fault(link) == "") == (np.linalg.eigvalsh(pseudo_inertia(link))[0] > 0)
    shifted = LinkSpec(link.mass, link.com, link.inertia_about_origin(), "origin")
    assert (physical_fault(link) == "") == (physical_fault(shifted) == "")


def test_thin_bodies_are_physical() -> None:
    zero = (sp.S.Zero,) * 3
    plate = (sp.Rational(1, 3), sp.Rational(2, 3), sp.S.One, *zero)
    rod = (sp.S.Zero, sp.S.One, sp.S.One, *zero)
    point = (sp.S.Zero,) * 6
    for inertia in (plate, rod, point):
        assert physical_fault(LinkSpec(sp.S.One, zero, inertia, "com")) == ""
    assert physical_fault(LinkSpec(sp.S.Zero, zero, point, "com")) == ""


@pytest.mark.parametrize(("matrix", "expected"), [
    ([[1, 2], [2, 4]], True), ([[1, 2], [2, 3]], False), ([[0, 0], [0, 1]], True), ([[0, 1], [1, 5]], False),
    ([[0, 0], [0, 0]], True), ([[-1]], False), ([[2, 1, 0], [1, 2, 1], [0, 1, 2]], True),
])  # fmt: skip
def test_exact_semidefiniteness(matrix: list[list[int]], expected: bool) -> None:
    assert is_positive_semidefinite([[sp.Integer(value) for value in row] for row in matrix]) is expected
