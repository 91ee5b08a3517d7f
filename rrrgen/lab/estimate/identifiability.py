"""Parameters that a motion does not excite or hardly determines, in words; and constraints by known parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.base.yamltext.suggest import did_you_mean
from rrrgen.lab.estimate.regression import Estimate
from rrrgen.lab.estimate.structure import combination, structure_of_matrix
from rrrgen.lab.estimate.tsqr import JointFactors
from rrrgen.robot.model.inertial_parameters import STANDARD, standard_names

WEAK = 1e-4
"""Scaled singular values below this share of the largest belong to directions that the motion hardly excites."""
SMALL_PART = 0.1  # parameters below this share of the largest weight of a direction are not named
NOT_EXCITED = 1e-10
INDEX = 30.0  # condition index above which Belsley, Kuh and Welsch call a dependence moderate to strong
HALF = 0.5  # a direction is described by the parameters with this share of their variance or this weight in it
MOST_NAMED = 5


@dataclass(frozen=True)
class Direction:
    """A weakly excited combination of parameters, with a ``sentence`` about it for the user.

    ``weights`` (p,) are its coefficients for regressor columns scaled to unit length; ``excitation`` is its singular
    value divided by the largest one.
    """

    sentence: str
    weights: Array
    excitation: float


def unexcited(factors: JointFactors, names: Sequence[str], weights: Array | None = None) -> tuple[str, ...]:
    """One sentence for every structurally identifiable parameter that this motion does not determine.

    ``factors`` are those of the fitted rows, ``weights`` (n,) those of the joints.
    """
    p = factors.parameters
    R = factors.stacked(weights)[:p, :p]
    found = structure_of_matrix(R, names, NOT_EXCITED)
    sentences = []
    for j in found.dependent:
        partners = [found.names[i] for i in range(found.rank) if found.G[i, j] != 0.0]
        if partners:
            groups = " and ".join(f"'{group}'" for group in partners)
            sentences.append(f"this motion determines {names[j]} only within {groups}")
        else:
            sentences.append(f"this motion does not excite {names[j]} at all")
    return tuple(sentences)


def weak_directions(
    factors: JointFactors, names: Sequence[str], weights: Array | None = None, limit: float = WEAK
) -> tuple[Direction, ...]:
    """Combinations of parameters that the motion hardly excites, weakest first.

    These are right singular vectors of the regressor with columns of unit length whose singular value is below
    ``limit`` times the largest.
    """
    p = factors.parameters
    R = factors.stacked(weights)[:p, :p]
    size = np.linalg.norm(R, axis=0)
    size[size == 0.0] = 1.0
    _, s, Vt = np.linalg.svd(R / size)
    found = []
    for value, row in zip(s[::-1], Vt[::-1], strict=True):
        if s[0] == 0.0 or value >= limit * s[0]:
            break
        # weights of the parameters themselves, the largest of them 1
        v = row / size
        v = v / v[np.argmax(np.abs(v))]
        named = np.where(np.abs(row) >= SMALL_PART * np.max(np.abs(row)), v, 0.0)
        share = float(value / s[0])
        sentence = f"{combination(names, named, 3)} is hardly excited (singular value {share:.1e} of the largest)"
        found.append(Direction(sentence, row, share))
    return tuple(found)


def collinear(factors: JointFactors, estimate: Estimate) -> tuple[str, ...]:
    """Sentences on combinations of parameters that the data hardly determine, worst first.

    Collinearity diagnosis by condition indices and variance decomposition (Belsley, Kuh and Welsch 1980), columns
    scaled to unit length: each direction whose singular value is INDEX times smaller than the largest is reported with
    the parameters that owe most of their variance to it.
    """
    p = factors.parameters
    R = factors.stacked(estimate.weights)[:p, :p]
    size = np.linalg.norm(R, axis=0)
    size[size == 0.0] = 1.0
    _, s, Vt = np.linalg.svd(R / size)
    if s[0] == 0.0:
        return ()
    inverse = np.divide(1.0, s, out=np.zeros(len(s)), where=s > NOT_EXCITED * s[0])
    parts = (Vt * inverse[:, None]) ** 2
    shares = parts / np.maximum(np.sum(parts, axis=0), np.finfo(float).tiny)
    found: list[str] = []
    for k in range(len(s) - 1, -1, -1):
        if s[k] * INDEX > s[0] or len(found) == MOST_NAMED:
            break
        named = (shares[k] > HALF) | (np.abs(Vt[k]) > HALF)
        weights = np.where(named if named.any() else True, Vt[k] / size, 0.0)
        weights = weights / weights[np.argmax(np.abs(weights))]
        value = float(weights @ estimate.x)
        std = float(np.sqrt(np.maximum(0.0, weights @ estimate.covariance @ weights)))
        words = combination(estimate.names, weights, 3)
        told = f"condition index {s[0] / s[k]:.3g}" if inverse[k] > 0.0 else "not excited"
        found.append(f"{words} = {value:.3g} +- {std:.2g} is hardly determined ({told})")
    return tuple(found)


@dataclass(frozen=True)
class Restriction:
    """Constraint on the base parameters from known standard parameters: ``beta = B z + beta_0``.

    z (r,) are the base parameters with indices ``kept``; B (b, r) and beta_0 (b,) give all others.
    """

    kept: tuple[int, ...]
    B: Array
    beta_0: Array

    @property
    def fixed(self) -> tuple[int, ...]:
        """Indices of the base parameters that are fully known, because no free parameter enters them."""
        return tuple(int(i) for i in np.flatnonzero(~np.any(self.B, axis=1)))


def fix_standard(projection: Array, known: Mapping[str, float]) -> Restriction:
    """Constraint that known standard parameters, such as ``{"my2": 0.0}``, impose on ``beta = K phi``.

    ``projection`` is K (b, 10n). For example, links 2 and 3 balanced in y, ``my2 = my3 = 0``, make two of the 15 base
    parameters of the example robot RRR zero. Raises :class:`InputError` for a name that is not a standard parameter.
    """
    names = standard_names(projection.shape[1] // len(STANDARD))
    phi = np.zeros(len(names))
    free = np.ones(len(names), bool)
    for name, value in known.items():
        if name not in names:
            raise InputError(
                f"no standard parameter '{name}'; {did_you_mean(name, names)} they are m1, mx1, ..., Izz1, m2, ..."
            )
        phi[names.index(name)], free[names.index(name)] = value, False
    beta_0 = projection @ phi
    rows = [f"{i}" for i in range(len(projection))]
    found = structure_of_matrix(projection[:, free].T, rows) if free.any() else None
    if found is None or found.rank == 0:
        return Restriction((), np.zeros((len(projection), 0)), beta_0)
    # rows of K over the free parameters are combinations of the kept rows: beta - beta_0 = B (beta - beta_0)[kept]
    B = found.G.T
    return Restriction(found.kept, B, beta_0 - B @ beta_0[list(found.kept)])
