"""Parameters that a motion does not excite or hardly determines, in words; and constraints by known parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError, InputError
from rrrgen.base.yamltext.suggestions import did_you_mean
from rrrgen.lab.estimate.linear import scale_columns
from rrrgen.lab.estimate.regression import Estimate, weighted_least_squares
from rrrgen.lab.estimate.tsqr import NO_COLUMN, JointFactors
from rrrgen.robot.spec import STANDARD, standard_names

# ------------------------------------------------------------------------------------------------------------------
# Essential parameters: the smallest set that explains the torques as well as all parameters do, within the noise.
#
# Parameters are left out one at a time, the one with the largest relative standard deviation first (Khalil and
# Dombre, Modeling, Identification and Control of Robots, ch. 12), as long as the fit does not suffer: an F test
# compares every reduced model with the full one.
# ------------------------------------------------------------------------------------------------------------------

LARGEST_SPREAD = 30.0  # ratio of largest to smallest relative standard deviation at which the reduction ends
SIGNIFICANCE = 0.05

Estimator = Callable[[JointFactors, Sequence[str]], Estimate]


@dataclass(frozen=True)
class Essential:
    """Essential parameters: the ``estimate`` of the reduced model and how it was reached.

    ``kept`` are the indices of the remaining parameters, ``dropped`` the names of the others in the order of removal,
    ``stopped_by`` the reason why the reduction ended, in words.
    """

    estimate: Estimate
    kept: tuple[int, ...]
    dropped: tuple[str, ...]
    stopped_by: str


def essential_parameters(
    factors: JointFactors,
    names: Sequence[str],
    estimator: Estimator = weighted_least_squares,
    spread: float = LARGEST_SPREAD,
    significance: float = SIGNIFICANCE,
    samples_per_independent: float = 1.0,
) -> Essential:
    """Reduce the parameters of ``factors``; ``estimator(factors, names)`` estimates each reduced model.

    Stops when the relative standard deviations lie within ``spread`` of each other, or when leaving out one more would
    raise the weighted residual significantly (F test at ``significance``, with the number of samples divided by
    ``samples_per_independent`` to allow for correlated residuals).
    """
    if not 0.0 < significance < 1.0 or samples_per_independent < 1.0:
        raise InputError("the significance must lie between 0 and 1, and samples per independent one be 1 or more")
    from scipy.stats import f as fisher

    full = estimator(factors, names)
    weights = full.weights
    reference = float(np.sum(factors.residual_squares(full.x) * weights**2))
    independent = float(np.sum(factors.counts)) / samples_per_independent
    freedom = max(1.0, independent - full.rank)
    kept, estimate, dropped = list(range(len(names))), full, []
    stopped = "one parameter is left"
    while len(kept) > 1:
        relative = estimate.relative_std
        if np.max(relative) <= spread * np.min(relative):
            stopped = f"relative standard deviations within a factor of {spread:g}"
            break
        worst = int(np.argmax(relative))
        fewer = kept[:worst] + kept[worst + 1 :]
        selected = factors.select_columns(fewer)
        reduced = estimator(selected, [names[i] for i in fewer])
        squares = float(np.sum(selected.residual_squares(reduced.x) * weights**2))
        rise = (squares - reference) / samples_per_independent / (len(names) - len(fewer))
        if reference > 0 and rise / (reference / samples_per_independent / freedom) > fisher.isf(
            significance, len(names) - len(fewer), freedom
        ):
            stopped = f"leaving out {names[kept[worst]]} would be significant"
            break
        dropped.append(names[kept[worst]])
        kept, estimate = fewer, reduced
    return Essential(estimate, tuple(kept), tuple(dropped), stopped)


# ------------------------------------------------------------------------------------------------------------------
# Structural identifiability: rank of the regressor over all motions, and the identifiable combinations of parameters.
#
# The rank is determined from random motions, by the singular values of columns scaled to unit length, with a
# tolerance relative to the largest. It must agree with the number of columns that do not depend linearly on earlier
# columns.
# ------------------------------------------------------------------------------------------------------------------

RELATIVE_TOLERANCE = 1e-9
"""Lies between the smallest true singular values of a scaled random regressor (1e-3 and above) and round-off (1e-15).
"""


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


DRAWS = 50
"""Largest number of times that states are drawn to find positions that closed loops can take."""


def _possible_motion(
    n: int, samples: int, seed: int, possible: Callable[[Array], NDArray[np.bool_]]
) -> tuple[Array, Array, Array]:
    """Random states as :func:`random_motion` draws them, ``samples`` or more, at ``possible`` positions."""
    kept = random_motion(n, 0, seed)
    for k in range(DRAWS):
        drawn = random_motion(n, 2 * samples, seed + k)
        inside = possible(drawn[0])
        q, dq, ddq = (np.concatenate([states, new[inside]]) for states, new in zip(kept, drawn, strict=True))
        kept = q, dq, ddq
        if len(q) >= samples:
            return kept
    raise DerivationError(f"closed loops can be assembled at {len(kept[0])} of {DRAWS * 2 * samples} random positions")


def structure_of(
    regressor: Callable[[Array, Array, Array], Array],
    names: Sequence[str],
    n: int,
    seed: int = 0,
    tolerance: float = RELATIVE_TOLERANCE,
    possible: Callable[[Array], NDArray[np.bool_]] | None = None,
) -> Structure:
    """Find the identifiable combinations of the parameters of ``regressor(q, dq, ddq)`` from random states of n joints.

    ``names`` are those of the columns, ``seed`` that of the random states, ``tolerance`` the relative one of the rank.
    ``possible(q)`` is a mask (N,) of the positions that a robot with closed loops can take, all if None.
    Raises :class:`DerivationError` if the rank is not clear-cut, or too few positions are possible.
    """
    samples = 3 * (1 + len(names) // n) + 50
    motion = random_motion(n, samples, seed) if possible is None else _possible_motion(n, samples, seed, possible)
    W = regressor(*motion).reshape(-1, len(names))
    return structure_of_matrix(W, names, tolerance)


def structure_of_matrix(
    W: Array,
    names: Sequence[str],
    tolerance: float = RELATIVE_TOLERANCE,
    reason: str = "the robot may be nearly degenerate (nearly parallel axes?)",
) -> Structure:
    """Find the identifiable combinations of the parameters of a sampled regressor ``W`` (rows, p).

    Of dependent columns the first ones are kept. Raises :class:`DerivationError`, with the probable ``reason``, if the
    rank is not clear-cut.
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
            f"the relative tolerance {tolerance:g}; {reason}"
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


# ------------------------------------------------------------------------------------------------------------------
# Parameters that a motion does not excite or hardly determines, in words
# ------------------------------------------------------------------------------------------------------------------

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


def unexcited_parameters(factors: JointFactors, names: Sequence[str], weights: Array | None = None) -> tuple[str, ...]:
    """One sentence for every structurally identifiable parameter that this motion does not determine.

    ``factors`` are those of the fitted rows, ``weights`` (n,) those of the joints. Raises :class:`DerivationError` if
    the motion is so poor that rounding decides which they are.
    """
    p = factors.parameters
    R = factors.stack(weights)[:p, :p]
    reason = "the recordings may be too short, or joints hardly move in them: record longer, livelier motions"
    structure = structure_of_matrix(R, names, NOT_EXCITED, reason)
    sentences = []
    for j in structure.dependent:
        partners = [structure.names[i] for i in range(structure.rank) if structure.G[i, j] != 0.0]
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
    R = factors.stack(weights)[:p, :p]
    B, size = scale_columns(R)
    _, s, Vt = np.linalg.svd(B)
    directions = []
    for value, row in zip(s[::-1], Vt[::-1], strict=True):
        if s[0] == 0.0 or value >= limit * s[0]:
            break
        # weights of the parameters themselves, the largest of them 1
        v = row / size
        v = v / v[np.argmax(np.abs(v))]
        named = np.where(np.abs(row) >= SMALL_PART * np.max(np.abs(row)), v, 0.0)
        share = float(value / s[0])
        sentence = f"{combination(names, named, 3)} is hardly excited (singular value {share:.1e} of the largest)"
        directions.append(Direction(sentence, row, share))
    return tuple(directions)


def collinear(factors: JointFactors, estimate: Estimate) -> tuple[str, ...]:
    """Sentences on combinations of parameters that the data hardly determine, worst first.

    Collinearity diagnosis by condition indices and variance decomposition (Belsley, Kuh and Welsch 1980), columns
    scaled to unit length: each direction whose singular value is INDEX times smaller than the largest is reported with
    the parameters that owe most of their variance to it.
    """
    p = factors.parameters
    R = factors.stack(estimate.weights)[:p, :p]
    B, size = scale_columns(R)
    _, s, Vt = np.linalg.svd(B)
    if s[0] == 0.0:
        return ()
    inverse = np.divide(1.0, s, out=np.zeros(len(s)), where=s > NOT_EXCITED * s[0])
    parts = (Vt * inverse[:, None]) ** 2
    shares = parts / np.maximum(np.sum(parts, axis=0), np.finfo(float).tiny)
    sentences: list[str] = []
    for k in range(len(s) - 1, -1, -1):
        if s[k] * INDEX > s[0] or len(sentences) == MOST_NAMED:
            break
        named = (shares[k] > HALF) | (np.abs(Vt[k]) > HALF)
        weights = np.where(named if named.any() else True, Vt[k] / size, 0.0)
        weights = weights / weights[np.argmax(np.abs(weights))]
        value = float(weights @ estimate.x)
        std = float(np.sqrt(np.maximum(0.0, weights @ estimate.covariance @ weights)))
        words = combination(estimate.names, weights, 3)
        reason = f"condition index {s[0] / s[k]:.3g}" if inverse[k] > 0.0 else "not excited"
        sentences.append(f"{words} = {value:.3g} +- {std:.2g} is hardly determined ({reason})")
    return tuple(sentences)


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
    structure = structure_of_matrix(projection[:, free].T, rows) if free.any() else None
    if structure is None or structure.rank == 0:
        return Restriction((), np.zeros((len(projection), 0)), beta_0)
    # rows of K over the free parameters are combinations of the kept rows: beta - beta_0 = B (beta - beta_0)[kept]
    B = structure.G.T
    return Restriction(structure.kept, B, beta_0 - B @ beta_0[list(structure.kept)])
