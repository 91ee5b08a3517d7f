"""The ten standard inertial parameters of a link: their order, and conversion from and to the links of a robot file.

``phi = (m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz)``: mass (kg), first moments (kg m) and inertia tensor (kg m^2,
``Ixy = -integral of x y dm``) about the origin of the link frame, in its axes. The order is stated only here; the
references of :mod:`rrrgen.verify` repeat it on purpose, because they share no code with the compiler.
"""

from __future__ import annotations

from collections.abc import Iterable

import sympy as sp

from rrrgen.robot.spec import LinkSpec

STANDARD = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
"""Names of the standard parameters of one link, in their order."""


def standard_names(n: int) -> tuple[str, ...]:
    """Names of the 10 n standard parameters of n links: ``m1, mx1, ..., Izz1, m2, ...``."""
    return tuple(f"{name}{link + 1}" for link in range(n) for name in STANDARD)


def standard_parameters(link: LinkSpec) -> tuple[sp.Rational, ...]:
    """The exact standard parameters (10,) of a link, in the order of :data:`STANDARD`."""
    Ixx, Iyy, Izz, Ixy, Ixz, Iyz = link.inertia_about_origin()
    mx, my, mz = (link.mass * c for c in link.com)
    return (link.mass, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz)


def link_of(phi: Iterable[float]) -> LinkSpec:
    """Make the link with the standard parameters ``phi`` (10,), mass > 0; doubles are converted to exact decimals."""
    exact = [sp.Rational(repr(float(value))) for value in phi]
    m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz = exact
    com = tuple(sp.Rational(repr(float(first) / float(m))) for first in (mx, my, mz))
    return LinkSpec(m, (com[0], com[1], com[2]), (Ixx, Iyy, Izz, Ixy, Ixz, Iyz), about="origin", products="tensor")
