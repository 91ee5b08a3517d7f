"""Compares what may be wrong with a recording or a robot file by the torques that each repair explains.

A *hypothesis* is a small set of nuisance parameters nu beside the parameters beta of the model,

    tau_j(t + d_j) = k_j Y_j(q + delta, dq, ddq; g + gamma) beta + s (a_j dq_j + b_j sgn dq_j) + more columns,

with encoder zeros delta, torque gains k, delays d, the tilt gamma of gravity against the base, and friction that drifts
with s, the time from -1/2 to 1/2. They enter by their derivatives at the present fit, so that every step is linear
least squares in beta and nu together (Gauss-Newton on the separable problem; Golub and Pereyra 1973); drift, tilt and
missing columns are linear as they stand.

Hypotheses are compared by the weighted squares of the torque errors in blocks of time that were left out of the fit.
Residuals of real arms are correlated, so that neither F tests nor information criteria hold; differences between
blocks of two seconds nearly do.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal, NamedTuple

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.estimate.regression import correlated_covariance, least_squares
from rrrgen.lab.estimate.statistics import correlation_lags, residual_whiteness
from rrrgen.lab.estimate.tsqr import Rows, factor_rows
from rrrgen.lab.identify.diagnosis.causes import Cause, Wording
from rrrgen.lab.identify.diagnosis.trial_fits import FLOOR, AllTerms, Sample, fit_products, solve_normal_equations

POSSIBLE, NAMED = 0.05, 0.10
"""Share of the held-out squares that a repair must explain. Of 74 sound sets, none reached 0.046 with t above 2."""
AHEAD = 2.0  # block mean over its standard error, of a gain or of the lead over another hypothesis
AT_ONCE = 0.5  # a hypothesis that keeps this share of its gain after another repair is a second fault, no rival of it
FOLDS = 5
BLOCK = 2.0  # s
FEWEST_BLOCKS = 15  # in shorter recordings the blocks are shorter
MOST_INSTANTS = 4000  # times joints
LEAST = 1e-4  # effect of a nuisance parameter on the torques, relative, below which nothing can determine it
SCREENED = 0.02  # gain of one linear step, from which on a hypothesis is fitted until it converges
WORTH = 0.005  # relative torque error below which nothing needs an explanation
STEPS, HALVINGS, SETTLED = 8, 4, 1e-4
GRID = 15.0 * np.pi / 180.0  # one of 30 degrees missed the zero of a real arm
BEST_OF_GRID = 3
LARGE = 0.1  # relative torque error of a joint, from which on zeros are sought all around the circle
MOST = 4  # largest number of faults in one recording
STEP = 1e-4  # rad (m) of the central differences

Kind = Literal["zero", "gain", "delay", "tilt", "viscous drift", "Coulomb drift", "column"]
ALL = -1  # place of a delay that all joints share


class Term(NamedTuple):
    """A nuisance parameter: its ``kind``, and the joint, axis or regressor column ``place`` that it belongs to."""

    kind: Kind
    place: int

    @property
    def is_linear(self) -> bool:
        """Whether the torques are linear in the parameter itself."""
        return self.kind not in ("zero", "gain", "delay")


MISSING = {
    "friction": ("friction", {"fv": "viscous", "fc": "coulomb"}, "friction"),
    "offset": ("friction", {"off": "offset"}, "a constant torque (offset)"),
    "inertia": ("drive", {"Ia": "inertia"}, "the drive inertia"),
}
"""Section and keys of the robot file for terms that it does not state, and what they are."""

UNIT: dict[Kind, float] = {"delay": 0.01}
"""A common size of a parameter, in SI, where that is not 1."""


@dataclass(frozen=True)
class Hypothesis:
    """Something that may be wrong: its nuisance parameters ``terms``; ``subject`` and ``joint`` for the wording."""

    subject: str
    joint: int
    terms: tuple[Term, ...]

    def is_part_of(self, other: Hypothesis) -> bool:
        """Whether the other hypothesis has all these parameters, and more."""
        return set(self.terms) < set(other.terms)


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a hypothesis explains: its fitted ``values``, and the held-out squares ``errors`` (B,) of every block.

    ``before`` (B,) are those without it; ``squares`` (B,) the weighted squares of the torques themselves.
    """

    hypothesis: Hypothesis
    values: dict[Term, float]
    errors: Array
    before: Array
    squares: Array

    @property
    def gain(self) -> float:
        """Share of the held-out squares that is explained."""
        return float(np.sum(self.before - self.errors) / max(float(np.sum(self.before)), np.finfo(float).tiny))

    @property
    def t(self) -> float:
        """Mean gain of a block over its standard error."""
        return t_of_blocks(self.before - self.errors)

    def lead(self, other: Outcome) -> float:
        """Mean lead over ``other`` of a block over its standard error."""
        return t_of_blocks(other.errors - self.errors)

    def relative_errors(self) -> tuple[float, float]:
        """Relative held-out torque errors without and with the hypothesis, joints weighted by their residuals."""
        total = max(float(np.sum(self.squares)), np.finfo(float).tiny)
        before, after = (max(0.0, float(np.sum(x))) / total for x in (self.before, self.errors))
        return float(np.sqrt(before)), float(np.sqrt(after))


def t_of_blocks(differences: Array) -> float:
    """Mean of ``differences`` (B,) over its standard error; 0 if they are all alike."""
    spread = float(np.std(differences, ddof=1)) / np.sqrt(len(differences)) if len(differences) > 1 else 0.0
    return float(np.mean(differences)) / spread if spread > 0.0 else 0.0


@dataclass(frozen=True, eq=False)
class Finding:
    """An accepted hypothesis: its ``outcome``, whether it is ``named`` or only possible, and rivals not excluded."""

    outcome: Outcome
    named: bool
    rivals: tuple[Outcome, ...]


class Comparison:
    """Compares hypotheses on one sample of a recording; ``inside`` are the columns of ``regressor`` in the model."""

    def __init__(self, regressor: AllTerms, sample: Sample, inside: Sequence[int]) -> None:
        self.regressor, self.inside = regressor, list(inside)
        self.sample = sample.thinned(MOST_INSTANTS // sample.n)
        n = sample.n
        duration = float(np.ptp(self.sample.t)) or 1.0
        self.time = (self.sample.t - self.sample.t[0]) / duration - 0.5
        length = min(BLOCK, duration / FEWEST_BLOCKS)
        number = np.minimum((self.sample.t - self.sample.t[0]) / length, 1e6).astype(int)
        self.block = np.unique(number, return_inverse=True)[1]
        self.blocks = int(self.block[-1]) + 1
        counts = np.sum(self.sample.use, axis=0)
        self.counts = np.maximum(1, counts)
        self.size = np.sqrt(np.sum(np.where(self.sample.use, self.sample.tau, 0.0) ** 2, axis=0) / self.counts)
        self.size = np.maximum(self.size, 1e-3 * max(float(np.max(self.size)), np.finfo(float).tiny))
        self.n = n

    # -- hypotheses ----------------------------------------------------------------------------------------------

    def hypotheses(self) -> Iterator[Hypothesis]:
        """Iterate over all single hypotheses, those that this motion cannot determine included."""
        joints = range(self.n)
        revolute = [joint.is_revolute for joint in self.regressor.model.spec.joints]
        for j in joints:
            if revolute[j]:
                yield Hypothesis("zero", j, (Term("zero", j),))
        if self.n > 1:
            for j in joints:
                yield Hypothesis("gain", j, (Term("gain", j),))
                yield Hypothesis("delay", j, (Term("delay", j),))
        yield Hypothesis("delay", ALL, (Term("delay", ALL),))
        if self._frames is not None:
            yield Hypothesis("tilt", ALL, (Term("tilt", 0), Term("tilt", 1)))
        drifts = [(Term("viscous drift", j), Term("Coulomb drift", j)) for j in joints]
        for j in joints:
            yield Hypothesis("drift", j, drifts[j])
        if self.n > 1:
            yield Hypothesis("drift", ALL, tuple(term for pair in drifts for term in pair))
        for j in joints:
            for subject, symbols in (("friction", ("fv", "fc")), ("offset", ("off",)), ("inertia", ("Ia",))):
                lacking = [k for k, name in enumerate(self.regressor.names) if name in {f"{s}{j + 1}" for s in symbols}]
                lacking = [k for k in lacking if k not in self.inside]
                if lacking:
                    yield Hypothesis(subject, j, tuple(Term("column", k) for k in lacking))

    # -- the least-squares problem at given values of the nuisance parameters --------------------------------------

    def regressor_at(self, values: Mapping[Term, float]) -> tuple[Array, Array]:
        """Regressor W (N, n, p) of the model and torques (N, n) at ``values`` of zeros, gains and delays."""
        sample = self.sample
        W = np.asarray(self.regressor(self._positions(values), sample.dq, sample.ddq))[..., self.inside]
        return W * self._gains(values), self._torque(values)

    def _positions(self, values: Mapping[Term, float]) -> Array:
        zeros = np.array([values.get(Term("zero", j), 0.0) for j in range(self.n)])
        return np.asarray(self.sample.q + zeros)

    def _gains(self, values: Mapping[Term, float]) -> Array:
        return np.asarray(np.exp([values.get(Term("gain", j), 0.0) for j in range(self.n)]))[:, None]

    def _torque(self, values: Mapping[Term, float]) -> Array:
        delays = np.array([values.get(Term("delay", j), 0.0) for j in range(self.n)])
        delays += values.get(Term("delay", ALL), 0.0)
        return self.sample.later(delays) if delays.any() else self.sample.tau

    def columns(self, terms: Sequence[Term], values: Mapping[Term, float], W: Array, beta: Array) -> Array:
        """Derivatives (N, n, len(terms)) of the torques by nuisance parameters, at ``values`` and model ``beta``."""
        sample = self.sample
        q = self._positions(values)
        found = np.zeros((*sample.q.shape, len(terms)))
        for k, term in enumerate(terms):
            j = slice(None) if term.place == ALL else term.place
            if term.kind == "zero":
                move = STEP * np.eye(self.n)[term.place]
                ahead, behind = (
                    self.regressor(x, sample.dq, sample.ddq)[..., self.inside] for x in (q + move, q - move)
                )
                found[..., k] = (ahead - behind) @ beta / (2.0 * STEP) * self._gains(values)[:, 0]
            elif term.kind == "gain":
                found[:, j, k] = (W @ beta)[:, j]
            elif term.kind == "delay":
                found[:, j, k] = -sample.torque_rate[:, j]
            elif term.kind == "tilt":
                found[..., k] = self._gravity(term.place, q, beta) * self._gains(values)[:, 0]
            elif term.kind == "viscous drift":
                found[:, j, k] = self.time * sample.dq[:, j]
            elif term.kind == "Coulomb drift":
                found[:, j, k] = self.time * np.sign(sample.dq[:, j])
            else:
                found[..., k] = self._everything[..., term.place]
        return found

    @cached_property
    def _everything(self) -> Array:
        return self.regressor(self.sample.q, self.sample.dq, self.sample.ddq)

    @cached_property
    def _frames(self) -> Any:
        """The function that gives the frames of all links, for tilt; None for a model that has none."""
        model = self.regressor.model
        frames = getattr(model, "link_frames", None)
        spec = model.spec
        whole = set(range(len(model.base_parameter_names))) <= set(self.inside)  # else they are no links' parameters
        upright = any(float(v) != 0.0 for v in getattr(spec, "gravity", (0.0,)))
        return frames if frames is not None and upright and whole else None

    def _gravity(self, axis: int, q: Array, beta: Array) -> Array:
        """Change (N, n) of the gravity torques where gravity turns by 1 rad towards the axis x (0) or y (1).

        The torques are the derivatives of ``-sum_l (m_l p_l + R_l h_l) . a`` with mass and first moments of standard
        parameters of least norm that have the base parameters ``beta``, by central differences.
        """
        K = np.asarray(self.regressor.model.base_projection)
        b = len(K)
        phi = (np.linalg.pinv(K) @ beta[[self.inside.index(k) for k in range(b)]]).reshape(-1, 10)
        a = self._across(axis)
        found = np.zeros_like(q)
        for j in range(self.n):
            move = STEP * np.eye(self.n)[j]
            ahead, behind = (self._energy(x, phi, a) for x in (q + move, q - move))
            found[:, j] = (ahead - behind) / (2.0 * STEP)
        return found

    def _across(self, axis: int) -> Array:
        """Change of gravity (3,), m/s^2, where it turns by 1 rad towards one of the two axes most across it."""
        g = np.array([float(v) for v in self.regressor.model.spec.gravity])
        size = float(np.linalg.norm(g))
        across = np.eye(3)[np.sort(np.argsort(np.abs(g), kind="stable")[:2])[axis]]
        return np.asarray(size * across - (across @ g) * g / size)

    def _energy(self, q: Array, phi: Array, a: Array) -> Array:
        """Potential energy (N,) of links with standard parameters ``phi`` (n, 10) in the gravity ``a`` (3,)."""
        T = np.asarray(self._frames(q))
        moments = T[..., :3, 3] * phi[:, 0, None] + np.einsum("nlab,lb->nla", T[..., :3, :3], phi[:, 1:4])
        return np.asarray(-np.sum(moments, axis=1) @ a)

    # -- fits ------------------------------------------------------------------------------------------------------

    def products(self, A: Array, tau: Array, blocks: bool = False) -> Array:
        """Products ``[A tau]' [A tau]`` of the rows of every joint: (n, m+1, m+1), or (B, n, m+1, m+1) of blocks."""
        rows = np.concatenate([A, tau[..., None]], axis=-1) * self.sample.use[..., None]
        if not blocks:
            return np.stack([rows[:, j].T @ rows[:, j] for j in range(self.n)])
        edges = np.searchsorted(self.block, np.arange(self.blocks + 1))
        return np.stack(
            [
                np.stack([rows[low:high, j].T @ rows[low:high, j] for j in range(self.n)])
                for low, high in pairwise(edges)
            ]
        )

    def solve(self, G: Array) -> tuple[Array, Array]:
        """Parameters (m,) and residual deviations (n,) from products ``G`` (n, m+1, m+1); weights are iterated."""
        x, _, squares = fit_products(G, self.counts, self.size)
        return x, np.maximum(np.sqrt(squares / self.counts), FLOOR * self.size)

    def joint_errors(self, values: Mapping[Term, float]) -> Array:
        """Relative torque errors (n,) of the fit at ``values`` of the nuisance parameters."""
        return np.asarray(self._fitted(list(values), values)[1] / self.size)

    def objective(self, sigma: Array) -> float:
        """Minus the logarithm of the likelihood, up to a constant: ``sum N_j ln sigma_j``."""
        return float(self.counts @ np.log(sigma))

    def converged(self, terms: Sequence[Term], start: Mapping[Term, float]) -> dict[Term, float]:
        """Values of the nuisance ``terms`` that fit best, from ``start``, by Gauss-Newton with halved steps."""
        values = {term: start.get(term, 0.0) for term in terms}
        x, sigma = self._fitted(terms, values)
        best = self.objective(sigma)
        for _ in range(STEPS):
            step = self._step(terms, values, x)
            linear = {term: value for term, value in step.items() if term.is_linear}
            moves = {term: value for term, value in step.items() if not term.is_linear}
            values |= linear
            if not moves:
                break
            for _ in range(HALVINGS):
                tried = values | {term: values[term] + move for term, move in moves.items()}
                x_tried, sigma = self._fitted(terms, tried)
                if self.objective(sigma) < best:
                    break
                moves = {term: 0.5 * move for term, move in moves.items()}
            else:
                break
            improved = best - self.objective(sigma)
            values, x, best = tried, x_tried, self.objective(sigma)
            if improved < SETTLED * float(np.sum(self.counts)):
                break
        return values

    def _fitted(self, terms: Sequence[Term], values: Mapping[Term, float]) -> tuple[Array, Array]:
        """Model parameters (p,) and residual deviations (n,) at ``values``, with the linear terms free."""
        W, tau = self.regressor_at(values)
        x, sigma = self.solve(self.products(W, tau))
        linear = [term for term in terms if term.is_linear]
        if linear:
            A = np.concatenate([W, self.columns(linear, values, W, x)], axis=-1)
            x, sigma = self.solve(self.products(A, tau))
        return x[: W.shape[-1]], sigma

    def _step(self, terms: Sequence[Term], values: Mapping[Term, float], beta: Array) -> dict[Term, float]:
        W, tau = self.regressor_at(values)
        A = np.concatenate([W, self.columns(terms, values, W, beta)], axis=-1)
        x, _ = self.solve(self.products(A, tau))
        return dict(zip(terms, (float(v) for v in x[W.shape[-1] :]), strict=True))

    # -- comparison ------------------------------------------------------------------------------------------------

    def held_out(self, G: Array, weights: Array, kept: Sequence[int] | None = None) -> Array:
        """Held-out weighted squares (B,) of every block from block products ``G``; ``kept`` are the columns used.

        The folds are interleaved blocks: block b belongs to fold b modulo FOLDS.
        """
        if kept is not None:
            index = [*kept, G.shape[-1] - 1]
            G = G[:, :, index][..., index]
        weighted = np.einsum("j,bjxy->bxy", weights**2, G)
        total = np.sum(weighted, axis=0)
        errors = np.empty(self.blocks)
        for fold in range(FOLDS):
            out = np.arange(self.blocks) % FOLDS == fold
            training = total - np.sum(weighted[out], axis=0)
            x, _ = solve_normal_equations(training[:-1, :-1], training[:-1, -1])
            c = np.append(-x, 1.0)
            errors[out] = np.einsum("a,bac,c->b", c, weighted[out], c)
        return np.maximum(errors, 0.0)

    def findings(self) -> list[Finding]:
        """The hypotheses that explain torques which the model alone does not, one after the other, greedily."""
        accepted: list[tuple[Outcome, list[Outcome]]] = []
        values: dict[Term, float] = {}
        if np.all(self.joint_errors(values) < WORTH):
            return []
        left = list(self.hypotheses())
        after: list[Outcome] = []
        while True:
            outcomes = self.outcomes(left, values)
            if accepted:
                after = outcomes
                accepted[-1] = (accepted[-1][0], self._rivals(*accepted[-1], after))
            best = self._best(outcomes, NAMED if accepted else POSSIBLE)
            if best is None or len(accepted) == MOST:
                break
            rivals = [
                other
                for other in outcomes
                if other is not best
                and other.gain >= POSSIBLE
                and other.t >= AHEAD
                and not set(other.hypothesis.terms) & set(best.hypothesis.terms)
                and best.lead(other) < AHEAD
            ]
            accepted.append((best, rivals))
            values = best.values
            left = [each for each in left if not set(each.terms) & set(best.hypothesis.terms)]
        return [Finding(best, best.gain >= NAMED and not rivals, tuple(rivals)) for best, rivals in accepted]

    def _rivals(self, best: Outcome, rivals: list[Outcome], after: Sequence[Outcome]) -> list[Outcome]:
        """The ``rivals`` of an accepted hypothesis that explain little once it is repaired; others are faults too."""
        later = {outcome.hypothesis: float(np.sum(outcome.before - outcome.errors)) for outcome in after}
        return [
            rival
            for rival in rivals
            if later.get(rival.hypothesis, 0.0) < AT_ONCE * float(np.sum(rival.before - rival.errors))
        ]

    def _best(self, outcomes: Sequence[Outcome], least: float) -> Outcome | None:
        """The hypothesis with the largest gain, of at least ``least``; a part of it where the whole is not ahead."""
        good = [outcome for outcome in outcomes if outcome.gain >= least and outcome.t >= AHEAD]
        if not good:
            return None
        best = max(good, key=lambda outcome: outcome.gain)
        parts = [part for part in good if part.hypothesis.is_part_of(best.hypothesis) and best.lead(part) < AHEAD]
        return max(parts, key=lambda outcome: outcome.gain) if parts else best

    def outcomes(self, hypotheses: Sequence[Hypothesis], accepted: Mapping[Term, float]) -> list[Outcome]:
        """What each of ``hypotheses`` explains beside the ``accepted`` values of terms, for those that matter."""
        given = list(accepted)
        W, tau = self.regressor_at(accepted)
        beta, sigma = self._fitted(given, accepted)
        weights = 1.0 / sigma
        every = [*given, *dict.fromkeys(term for each in hypotheses for term in each.terms)]
        A = np.concatenate([W, self.columns(every, accepted, W, beta)], axis=-1)
        p = W.shape[-1]
        G = self.products(A, tau, blocks=True)
        own = list(range(p + len(given)))
        before = self.held_out(G, weights, own)
        squares = np.einsum("j,bj->b", weights**2, G[..., -1, -1])
        sound = self._determined(G, weights, own, [UNIT.get(term.kind, 1.0) for term in every])
        found = []
        around = bool(np.any(sigma > LARGE * self.size))
        for each in hypotheses:
            at = [p + every.index(term) for term in each.terms]
            if not all(sound[k] for k in at):
                continue
            errors = self.held_out(G, weights, [*own, *at])
            values = dict(accepted) | dict.fromkeys(each.terms, 0.0)
            outcome = Outcome(each, values, errors, before, squares)
            nonlinear = not all(term.is_linear for term in each.terms)
            starts = [values] if nonlinear and outcome.gain >= SCREENED else []
            if each.subject == "zero" and around:
                starts += [values | {each.terms[0]: zero} for zero in self._zeros(each.terms[0], values)]
            if starts:
                fits = [self.converged(list(values), start) for start in starts]
                values = min(fits, key=lambda fit: self.objective(self._fitted(list(fit), fit)[1]))
                outcome = Outcome(each, values, self.errors_at(values, weights), before, squares)
            elif not nonlinear and outcome.gain >= SCREENED:
                outcome = Outcome(each, self.converged(list(values), values), errors, before, squares)
            found.append(outcome)
        return found

    def errors_at(self, values: Mapping[Term, float], weights: Array) -> Array:
        """Held-out squares (B,) with the nuisance parameters at ``values``, refitted linearly in each fold."""
        W, tau = self.regressor_at(values)
        beta, _ = self._fitted(list(values), values)
        A = np.concatenate([W, self.columns(list(values), values, W, beta)], axis=-1)
        return self.held_out(self.products(A, tau, blocks=True), weights)

    def _determined(self, G: Array, weights: Array, own: list[int], units: Sequence[float]) -> dict[int, bool]:
        """Which columns stand out of the space of the model's own by more than LEAST of the torques, in their unit.

        The torques are the measure, not the column itself: the zero of a first joint with a vertical axis is a column
        of rounding errors, which no other column explains.
        """
        total = np.einsum("j,bjxy->xy", weights**2, G)
        torque = max(float(total[-1, -1]), np.finfo(float).tiny)
        _, inverse = solve_normal_equations(total[np.ix_(own, own)], total[own, -1])
        first = len(own)
        found = {}
        for k in range(G.shape[-1] - 1):
            unit = units[k - (G.shape[-1] - 1 - len(units))] if k >= G.shape[-1] - 1 - len(units) else 1.0
            left = total[k, k] - total[k, own] @ inverse @ total[own, k] if k >= first else torque
            found[k] = bool(left * unit**2 > LEAST**2 * torque)
        return found

    def _zeros(self, term: Term, values: Mapping[Term, float]) -> list[float]:
        """The zeros on a grid around the circle from which a fit may start: those that explain most."""
        grid = np.arange(GRID, 2.0 * np.pi - 0.5 * GRID, GRID)
        levels = []
        for zero in grid:
            W, tau = self.regressor_at({**values, term: float(zero)})
            levels.append(self.objective(self.solve(self.products(W, tau))[1]))
        at = np.argsort(levels)[:BEST_OF_GRID]
        return [float((grid[k] + np.pi) % (2.0 * np.pi) - np.pi) for k in at]

    # -- the result in words ---------------------------------------------------------------------------------------

    def deviations(self, values: Mapping[Term, float]) -> tuple[Array, Array]:
        """Standard deviations (k,) of the nuisance parameters ``values``, fitted with the model; and the latter (p,).

        Residuals are taken as correlated in time, as those of the estimate of the robot.
        """
        terms = list(values)
        W, tau = self.regressor_at(values)
        beta, sigma = self._fitted(terms, values)
        A = np.concatenate([W, self.columns(terms, values, W, beta)], axis=-1)
        rows = Rows(self.sample.t, A, tau, self.sample.use, self.sample.stretch)
        names = [str(k) for k in range(A.shape[-1])]
        estimate = least_squares(factor_rows(rows), names, 1.0 / sigma)
        lags = max(correlation_lags(white) for white in residual_whiteness([rows], estimate.x))
        unit = np.eye(len(names))
        covariance = correlated_covariance([rows], estimate, lags, lambda x: x, unit)
        std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        return std[W.shape[-1] :], beta

    def cause(self, finding: Finding, words: Wording) -> Cause:
        """A finding in words, with its value and deviation, the errors before and after, and the rivals."""
        outcome = finding.outcome
        std, beta = self.deviations(outcome.values)
        places = {term: k for k, term in enumerate(outcome.values)}
        value = {term: outcome.values[term] for term in outcome.hypothesis.terms}
        deviation = {term: float(std[places[term]]) for term in value}
        what, told = self._wording(outcome.hypothesis, value, deviation, beta, words)
        before, after = outcome.relative_errors()
        evidence = [*told, f"the held-out torque error falls from {100 * before:.3g} to {100 * after:.3g} %"]
        if finding.rivals:
            others = (self._wording(r.hypothesis, r.values, {}, beta, words)[0].cause for r in finding.rivals)
            evidence.append(f"not excluded instead: {'; '.join(dict.fromkeys(others))}")
        return replace(what, evidence=tuple(evidence), possible=not finding.named)

    def _wording(
        self,
        hypothesis: Hypothesis,
        value: Mapping[Term, float],
        deviation: Mapping[Term, float],
        beta: Array,
        words: Wording,
    ) -> tuple[Cause, list[str]]:
        """The cause of a hypothesis, and the value of its parameters in words."""
        terms, joint = hypothesis.terms, hypothesis.joint
        first, std = value[terms[0]], deviation.get(terms[0], 0.0)
        whose = None if joint == ALL else joint
        if hypothesis.subject == "zero":
            told = f"the positions are {math.degrees(first):.3g} +- {math.degrees(std):.2g} deg too small"
            return words.zero(joint, first), [told]
        if hypothesis.subject == "gain":
            factor = math.exp(first)
            told = f"the torques are {factor:.4g} +- {factor * std:.2g} times those that fit the other joints"
            return words.gain(joint, factor), [told]
        if hypothesis.subject == "delay":
            return words.delay(whose, first), [f"by {1e3 * abs(first):.3g} +- {1e3 * std:.2g} ms"]
        if hypothesis.subject == "tilt":
            angle = math.degrees(math.hypot(*(value[term] for term in terms)))
            spread = math.degrees(max(deviation.get(term, 0.0) for term in terms))
            return words.tilt(self.tilted([value[term] for term in terms])), [f"by {angle:.3g} +- {spread:.2g} deg"]
        if hypothesis.subject == "drift":
            names = [self.regressor.names[k] for k in self.inside]
            changes = []
            for term in terms:
                symbol = "fv" if term.kind == "viscous drift" else "fc"
                name = f"{symbol}{term.place + 1}"
                size = abs(beta[names.index(name)]) if name in names else 0.0
                share = f" ({100 * value[term] / size:+.2g} %)" if size > 0.0 else ""
                changes.append(f"{name} by {value[term]:+.3g} +- {deviation.get(term, 0.0):.2g}{share}")
            return words.drift(whose), [f"from beginning to end {', '.join(changes)}"]
        section, keys, what = MISSING[hypothesis.subject]
        values = ", ".join(f"{self.regressor.names[term.place]} = {value[term]:.3g}" for term in terms)
        lacking = [keys[self.regressor.names[term.place].rstrip("0123456789")] for term in terms]
        return words.missing(joint, section, lacking, what), [f"with {values}"]

    def tilted(self, angles: Sequence[float]) -> list[float]:
        """Gravity (3,), m/s^2, in the frame of the base, tilted by two ``angles``, rad."""
        g = np.array([float(v) for v in self.regressor.model.spec.gravity])
        return [float(v) for v in g + sum(angle * self._across(axis) for axis, angle in enumerate(angles))]
