"""Structural identifiability: rank of the regressor over all motions, and the identifiable combinations of parameters.

The rank is determined from random motions, by the singular values of columns scaled to unit length, with a tolerance
relative to the largest. It must agree with the number of columns that do not depend linearly on earlier columns.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError

RELATIVE_TOLERANCE = 1e-9
"""Lies between the smallest true singular values of a scaled random regressor (1e-3 and above) and round-off (1e-15).
"""
NO_COLUMN = 1e-12  # a column smaller than this share of the largest is round-off, for example of cos(pi/2)


@dataclass(frozen=True)
class Structure:
    """Identifiable combinations ``x = G theta`` of the parameters of a regressor: ``W = W[:, kept] G``.

    ``G`` is (r, p) for p columns and rank r; ``names`` (r) are the combinations as text, ``all_names`` (p) the
    parameters; ``singular`` are the singular values of the scaled random regressor, largest first.
    """

    all_names: tuple[str, ...]
    kept: tuple[int, ...]
    G: Array
    names: tuple[str, ...]
    singular: Array

    @property
    def rank(self) -> int:
        """Number of identifiable parameters."""
        return len(self.kept)

    @property
    def dependent(self) -> tuple[int, ...]:
        """Indices of the columns that are zero or linear combinations of the kept ones."""
        kept = set(self.kept)
        return tuple(j for j in range(len(self.all_names)) if j not in kept)

    def in_words(self) -> tuple[str, ...]:
        """One sentence for every parameter that is not identifiable on its own."""
        sentences = []
        for j in self.dependent:
            name = self.all_names[j]
            partners = [i for i in range(self.rank) if self.G[i, j] != 0.0]
            if not partners:
                sentences.append(f"{name} has no effect on any joint torque")
            else:
                groups = " and ".join(f"'{self.names[i]}'" for i in partners)
                sentences.append(f"{name} is not identifiable alone, only within {groups}")
        return tuple(sentences)


def random_motion(n: int, samples: int, seed: int) -> tuple[Array, Array, Array]:
    """Random states (q, dq, ddq), (samples, n) each: uniform within +-pi, +-3 and +-10, in rad (m) and seconds."""
    rng = np.random.default_rng(seed)
    return (
        rng.uniform(-np.pi, np.pi, (samples, n)),
        rng.uniform(-3, 3, (samples, n)),
        rng.uniform(-10, 10, (samples, n)),
    )


def structure_of(
    regressor: Callable[[Array, Array, Array], Array],
    names: Sequence[str],
    n: int,
    seed: int = 0,
    tolerance: float = RELATIVE_TOLERANCE,
) -> Structure:
    """Find the identifiable combinations of the parameters of ``regressor(q, dq, ddq)`` from random states of n joints.

    ``names`` are those of the columns, ``seed`` that of the random states, ``tolerance`` the relative one of the rank.
    Raises :class:`DerivationError` if the rank is not clear-cut.
    """
    samples = 3 * (1 + len(names) // n) + 50
    W = regressor(*random_motion(n, samples, seed)).reshape(-1, len(names))
    return structure_of_matrix(W, names, tolerance)


def structure_of_matrix(W: Array, names: Sequence[str], tolerance: float = RELATIVE_TOLERANCE) -> Structure:
    """Find the identifiable combinations of the parameters of a sampled regressor ``W`` (rows, p).

    Of dependent columns the first ones are kept. Raises :class:`DerivationError` if the rank is not clear-cut.
    """
    size = np.linalg.norm(W, axis=0)
    present = size > NO_COLUMN * float(np.max(size, initial=0.0))
    scaled = W / np.where(present, size, 1.0) * present
    singular = np.linalg.svd(scaled, compute_uv=False)
    rank = int(np.sum(singular > tolerance * singular[0])) if present.any() else 0
    kept, Q = _leading_columns(scaled, tolerance)
    if len(kept) != rank:
        raise DerivationError(
            f"the rank of the regressor is not clear-cut: {rank} singular values, but {len(kept)} columns, are above "
            f"the relative tolerance {tolerance:g}; the robot may be nearly degenerate (nearly parallel axes?)"
        )
    R = Q.T @ W[:, kept]
    G = np.linalg.solve(R, Q.T @ W) if rank else np.zeros((0, len(names)))
    # true entries are ratios of lengths or their squares; scaled entries below the tolerance are round-off
    weight = np.abs(G) * size[kept, None] / np.where(present, size, np.inf)
    G = np.where(weight > 1e3 * tolerance, G, 0.0)
    G[:, kept] = np.eye(rank)
    grouped = tuple(combination(names, row) for row in G)
    return Structure(tuple(names), tuple(kept), np.asarray(G), grouped, singular)


def combination(names: Sequence[str], weights: Array, digits: int = 6) -> str:
    """A linear combination as text, such as ``p3 + 0.5*p7 - p9``; zero weights are left out."""
    text = ""
    for name, weight in zip(names, weights, strict=True):
        if weight == 0.0:
            continue
        size = f"{abs(weight):.{digits}g}"
        inner = f"({name})" if " " in name and size != "1" else name
        term = inner if size == "1" else f"{size}*{inner}"
        text += (f" {'-' if weight < 0 else '+'} " if text else "-" if weight < 0 else "") + term
    return text or "0"


def _leading_columns(W: Array, tolerance: float) -> tuple[list[int], Array]:
    """Indices of the columns of W that are independent of those before them, and an orthonormal basis of their span.

    Gram-Schmidt with reorthogonalisation, against the kept columns only, so that a dependent column cannot affect a
    later one.
    """
    Q = np.zeros((W.shape[0], min(W.shape)))
    kept: list[int] = []
    for j in range(W.shape[1]):
        v = W[:, j].copy()
        size = float(np.linalg.norm(v))
        if size == 0.0 or len(kept) == Q.shape[1]:
            continue
        B = Q[:, : len(kept)]
        for _ in range(2):
            v -= B @ (B.T @ v)
        left = float(np.linalg.norm(v))
        if left > tolerance * size:
            Q[:, len(kept)] = v / left
            kept.append(j)
    return kept, Q[:, : len(kept)]
