"""The parameters to estimate: identifiable combinations of the columns after known parameters are fixed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.lab.estimate.identifiability import Restriction, fix_standard
from rrrgen.lab.estimate.structure import Structure, structure_of
from rrrgen.lab.estimate.tsqr import JointFactors
from rrrgen.lab.identify.full_regressor import FullRegressor


@dataclass(frozen=True)
class Parametrisation:
    """Map between the identifiable parameters x (r,) and the parameters theta (p,) of all columns.

    ``theta = T x + known`` with T (p, r), and ``x = G theta[free]`` with G from ``structure``, which also names x;
    ``free`` are the columns without a known value.
    """

    structure: Structure
    T: Array
    known: Array
    free: tuple[int, ...]

    def transform(self, factors: JointFactors) -> JointFactors:
        """Convert triangular factors of the rows for the parameters theta to those for the parameters x."""
        return factors.mapped(self.T, self.known)

    def expand(self, x: Array) -> Array:
        """The parameters theta (p,) of all columns for identifiable parameters ``x`` (r,)."""
        return np.asarray(self.T @ x + self.known)

    def contract(self, theta: Array) -> Array:
        """Identifiable parameters x (r,) of ``theta`` (p,); a matrix (p, k) is mapped column by column."""
        return np.asarray(self.structure.G @ theta[list(self.free)])


def parametrise(
    regressor: FullRegressor, fixed: Mapping[str, float], fixed_standard: Mapping[str, float], seed: int = 0
) -> Parametrisation:
    """Find the identifiable parameters of ``regressor`` after known parameters are fixed.

    ``fixed`` maps column names to known values, ``fixed_standard`` standard parameters; ``seed`` is that of the random
    motions from which the rank is taken. Raises :class:`InputError` for a name that does not exist or a column that
    already follows from the fixed standard parameters.
    """
    names = regressor.names
    unknown = [name for name in fixed if name not in names]
    if unknown:
        raise InputError(f"no parameter '{unknown[0]}'; there are {', '.join(names)}")
    b = len(regressor.model.base_parameter_names)
    rigid = (
        fix_standard(np.asarray(regressor.model.base_projection), fixed_standard)
        if fixed_standard
        else Restriction(tuple(range(b)), np.eye(b), np.zeros(b))
    )
    p = len(names)
    T = np.zeros((p, len(rigid.kept) + p - b))
    T[:b, : len(rigid.kept)] = rigid.B
    T[b:, len(rigid.kept) :] = np.eye(p - b)
    z_names = [names[i] for i in rigid.kept] + list(names[b:])
    known = np.concatenate([rigid.beta_0, np.zeros(p - b)])
    free = []
    for i, name in enumerate(z_names):
        if name in fixed:
            known = known + T[:, i] * fixed[name]
        else:
            free.append(i)
    for name in fixed:
        if name not in z_names:
            raise InputError(
                f"'{name}' follows from the standard parameters that are fixed; it cannot be fixed as well"
            )
    T = T[:, free]
    columns = [*rigid.kept, *range(b, p)]

    moved = sum(surface.has_state for surface in regressor.surfaces)

    def restricted(q: Array, dq: Array, ddq: Array) -> Array:
        # away from steady sliding, where bristles do not move and their damping has no effect
        s = np.random.default_rng(seed).uniform(-1, 1, (len(q), moved))
        return np.asarray(regressor(q, dq, ddq, s if moved else None) @ T)

    structure = structure_of(restricted, [z_names[i] for i in free], regressor.model.n, seed)
    return Parametrisation(structure, T[:, list(structure.kept)], known, tuple(columns[i] for i in free))
