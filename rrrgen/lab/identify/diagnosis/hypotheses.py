"""Compares what may be wrong with a recording or a robot file by the torques that each repair explains.

A *hypothesis* is a small set of nuisance parameters (:mod:`rrrgen.lab.identify.nuisances`), or of terms that the robot
file does not state. Hypotheses are compared by the weighted squares of the torque errors in blocks of time that were
left out of the fit. Residuals of real arms are correlated, so that neither F tests nor information criteria hold;
differences between blocks of two seconds nearly do.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.lab.identify.diagnosis.causes import Cause, Wording
from rrrgen.lab.identify.diagnosis.trial_fits import AllTerms, Sample, solve_normal_equations
from rrrgen.lab.identify.nuisances import ALL, UNIT, NuisanceFit, Term

POSSIBLE, NAMED = 0.05, 0.10
"""Share of the held-out squares that a repair must explain.

Of 79 sound sets, one reached more than 0.046 with t above 2, by a gain of 2.2 deviations.
"""
AHEAD = 2.0  # block mean over its standard error, of a gain or of the lead over another hypothesis
AT_ONCE = 0.5  # a hypothesis that keeps this share of its gain after another repair is a second fault, no rival of it
FOLDS = 5
BLOCK = 2.0  # s
FEWEST_BLOCKS = 15  # in shorter recordings the blocks are shorter
MOST_SAMPLES = 4000  # times joints
SCREENED = 0.02  # gain of one linear step, from which on a hypothesis is fitted until it converges
WORTH = 0.005  # relative torque error below which nothing needs an explanation
LARGE = 0.1  # relative torque error of a joint, from which on every zero around the circle may be the right one
RATIOS = np.geomspace(1.0 / 400.0, 400.0, 61)  # gear ratios common to all joints from which a fit may start
BEST_OF_RATIOS = 3
OTHER_SIDE = 3.0  # median ratio beyond which data are from the other side of the gears; sound recordings have 1 to 2.4
EXPLAINED_BY_SIDES = 0.10  # largest relative torque error that may remain
UNCERTAIN_RATIO = 0.3  # standard deviation of a logarithm
DISTINCT = 3.0  # deviations from zero that a value must have: among twenty hypotheses one has two by chance
UNDETERMINED = {"zero": 0.5 * math.pi, "gain": 1.0}
"""Standard deviations (rad, of the logarithm) from which on a zero or a gain could be anything."""
MOST = 4  # largest number of faults in one recording
MISSING = {
    "friction": ("friction", {"fv": "viscous", "fc": "coulomb"}, "friction"),
    "offset": ("friction", {"off": "offset"}, "a constant torque (offset)"),
    "inertia": ("drive", {"Ia": "inertia"}, "the drive inertia"),
}
"""Section and keys of the robot file for terms that it does not state, and what they are."""


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


class Comparison(NuisanceFit):
    """Compares hypotheses on one sample of a recording; ``inside`` are the columns of ``regressor`` in the model."""

    def __init__(self, regressor: AllTerms, sample: Sample, inside: Sequence[int]) -> None:
        thinned = sample.thin(MOST_SAMPLES // sample.n)
        super().__init__(regressor.model, regressor, thinned, np.eye(len(regressor.names))[:, list(inside)])
        self.model, self.names, self.inside = regressor.model, regressor.names, list(inside)
        since = self.sample.t - self.sample.t[0]
        length = min(BLOCK, (float(since[-1]) or 1.0) / FEWEST_BLOCKS)
        block = np.unique(np.minimum(since / length, 1e6).astype(int), return_inverse=True)[1]
        self.blocks = int(block[-1]) + 1
        self.edges = [int(k) for k in np.searchsorted(block, np.arange(self.blocks + 1))]

    # -- hypotheses ----------------------------------------------------------------------------------------------

    def hypotheses(self) -> Iterator[Hypothesis]:
        """Iterate over all single hypotheses, those that this motion cannot determine included."""
        joints = range(self.n)
        revolute = [joint.is_revolute for joint in self.model.spec.joints]
        for j in joints:
            if revolute[j]:
                yield Hypothesis("zero", j, (Term("zero", j),))
        if self.n > 1:
            for j in joints:
                yield Hypothesis("gain", j, (Term("gain", j),))
                yield Hypothesis("delay", j, (Term("delay", j),))
        yield Hypothesis("delay", ALL, (Term("delay", ALL),))
        if self.influence.can_tilt and set(range(len(self.model.base_parameter_names))) <= set(self.inside):
            yield Hypothesis("tilt", ALL, (Term("tilt", 0), Term("tilt", 1)))
        drifts = [(Term("viscous drift", j), Term("Coulomb drift", j)) for j in joints]
        for j in joints:
            yield Hypothesis("drift", j, drifts[j])
        if self.n > 1:
            yield Hypothesis("drift", ALL, tuple(term for pair in drifts for term in pair))
        for j in joints:
            for subject, symbols in (("friction", ("fv", "fc")), ("offset", ("off",)), ("inertia", ("Ia",))):
                lacking = [k for k, name in enumerate(self.names) if name in {f"{s}{j + 1}" for s in symbols}]
                lacking = [k for k in lacking if k not in self.inside]
                if lacking:
                    yield Hypothesis(subject, j, tuple(Term("column", k) for k in lacking))

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

    def findings(self, among: Sequence[Hypothesis] | None = None) -> list[Finding]:
        """The hypotheses ``among`` those given that explain torques which the model alone does not, greedily.

        All by default.
        """
        accepted: list[tuple[Outcome, list[Outcome]]] = []
        values: dict[Term, float] = {}
        if np.all(self.joint_errors(values) < WORTH):
            return []
        left = list(self.hypotheses() if among is None else among)
        after: list[Outcome] = []
        while True:
            outcomes = self.outcomes(left, values)
            if accepted:
                after = outcomes
                accepted[-1] = (accepted[-1][0], self._rivals(*accepted[-1], after))
            best = self._best(outcomes, NAMED if accepted else POSSIBLE)
            while best is not None and not self._determines(best):
                outcomes = [other for other in outcomes if other is not best]
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
            left = [hypothesis for hypothesis in left if not set(hypothesis.terms) & set(best.hypothesis.terms)]
        return [Finding(best, best.gain >= NAMED and not rivals, tuple(rivals)) for best, rivals in accepted]

    def is_explained_by(self, hypothesis: Hypothesis) -> bool:
        """Whether ``hypothesis`` alone explains a part of the torques that the model does not."""
        if np.all(self.joint_errors({}) < WORTH):
            return False
        return any(outcome.gain >= POSSIBLE and outcome.t >= AHEAD for outcome in self.outcomes([hypothesis], {}))

    def _determines(self, outcome: Outcome) -> bool:
        """Whether the torques tell the parameters of a hypothesis.

        Torques of a joint whose gain falls to zero, and with it all that couples them to the others, are explained by
        terms of their own, whatever the fault is. A parameter that may as well be zero explains nothing; what does is
        its derivative as one more column of every fold, whatever it stands for.
        """
        if all(term.is_linear for term in outcome.hypothesis.terms):
            return True
        std = dict(zip(outcome.values, self.deviations(outcome.values)[0], strict=True))
        return all(
            DISTINCT * std[term] < abs(outcome.values[term]) and std[term] < UNDETERMINED.get(term.kind, math.inf)
            for term in outcome.hypothesis.terms
        )

    def _rivals(self, best: Outcome, rivals: list[Outcome], after: Sequence[Outcome]) -> list[Outcome]:
        """Those ``rivals`` that explain the same errors as the accepted hypothesis ``best``.

        A rival that explains little once ``best`` is repaired stands for the same fault. One that still explains
        :data:`AT_ONCE` of what it did is a fault of its own, and no rival. ``after`` are the outcomes beside ``best``.
        """
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
        x, sigma = self.fit_model(given, accepted)
        weights = 1.0 / sigma
        every = [*given, *dict.fromkeys(term for hypothesis in hypotheses for term in hypothesis.terms)]
        A = np.concatenate([W, self.columns(every, accepted, W, x)], axis=-1)
        p = W.shape[-1]
        G = self.products(A, tau, self.edges)
        basis = list(range(p + len(given)))
        before = self.held_out(G, weights, basis)
        squares = np.einsum("j,bj->b", weights**2, G[..., -1, -1])
        total = np.einsum("j,bjxy->xy", weights**2, G)
        determined = self.is_determined(total, basis, [UNIT.get(term.kind, 1.0) for term in every[len(given) :]])
        sound = dict(zip(every[len(given) :], determined, strict=True))
        outcomes = []
        # small errors are not worth a fit from every zero: only from those that explain more than the zero as it is
        below = math.inf if np.any(sigma > LARGE * self.size) else self.objective(sigma)
        for hypothesis in hypotheses:
            at = [p + every.index(term) for term in hypothesis.terms]
            if not all(sound[term] for term in hypothesis.terms):
                continue
            errors = self.held_out(G, weights, [*basis, *at])
            values = dict(accepted) | dict.fromkeys(hypothesis.terms, 0.0)
            outcome = Outcome(hypothesis, values, errors, before, squares)
            nonlinear = not all(term.is_linear for term in hypothesis.terms)
            starts = [values] if nonlinear and outcome.gain >= SCREENED else []
            if hypothesis.subject == "zero":
                starts += [
                    values | {hypothesis.terms[0]: zero} for zero in self.zeros(hypothesis.terms[0], values, below)
                ]
            if starts:
                fits = [self.fit_terms(list(values), start) for start in starts]
                values = min(fits, key=lambda fit: self.objective(self.fit_model(list(fit), fit)[1]))
                outcome = Outcome(hypothesis, values, self.errors_at(values, weights), before, squares)
            elif not nonlinear and outcome.gain >= SCREENED:
                outcome = Outcome(hypothesis, self.fit_terms(list(values), values), errors, before, squares)
            outcomes.append(outcome)
        return outcomes

    def errors_at(self, values: Mapping[Term, float], weights: Array) -> Array:
        """Held-out squares (B,) with the nuisance parameters at ``values``, refitted linearly in each fold."""
        W, tau = self.regressor_at(values)
        x, _ = self.fit_model(list(values), values)
        A = np.concatenate([W, self.columns(list(values), values, W, x)], axis=-1)
        return self.held_out(self.products(A, tau, self.edges), weights)

    # -- gear sides ------------------------------------------------------------------------------------------------

    def gear_sides(self, words: Wording) -> tuple[Cause, Array] | None:
        """The cause that data were recorded at the other side of the gears, and the errors (n,) with it put right.

        None if no ratios, far from 1 in the median, explain the torques, or if the motors of the mapping are coupled.
        """
        mapping = words.mapping
        stated = np.ones(self.n)
        if mapping is not None:
            self.fixed_points = np.array([joint.zero for joint in mapping.joints])
            if mapping.transmission is not None:
                stated = np.diag(mapping.transmission)
                if not np.array_equal(np.diag(stated), mapping.transmission):
                    return None
        terms = [Term("ratio", j) for j in range(self.n)]
        levels = []
        for ratio in RATIOS:
            common = dict.fromkeys(terms, math.log(ratio))
            levels.append((self.objective(self.fit_model(terms, common)[1]), ratio))
        fits = []
        for _, ratio in sorted(levels)[:BEST_OF_RATIOS]:
            values = self.fit_terms(terms, dict.fromkeys(terms, math.log(ratio)))
            fits.append(self.fit_terms(terms, values))
        best = min(fits, key=lambda fit: self.objective(self.fit_model(terms, fit)[1]))
        errors = self.joint_errors(best)
        ratios = np.exp([best[term] for term in terms])
        median = float(np.median(ratios))
        left = self.counts * self.size**2
        error = float(np.sqrt(left @ errors**2 / np.sum(left)))
        if 1.0 / OTHER_SIDE <= median <= OTHER_SIDE or error > EXPLAINED_BY_SIDES:
            return None
        std = self.deviations(best)[0]
        cause = words.gear_sides(
            stated * ratios, [float(s) if s < UNCERTAIN_RATIO else None for s in std], median > 1.0
        )
        size = ", ".join(
            f"{r:.4g}" + (f" +- {r * s:.2g}" if s < UNCERTAIN_RATIO else " (undetermined)")
            for r, s in zip(ratios, std, strict=True)
        )
        evidence = f"with motions {size} times smaller and torques as much larger, {100 * error:.2g} % is left"
        return cause.because(evidence), errors

    # -- the result in words ---------------------------------------------------------------------------------------

    def cause(self, finding: Finding, words: Wording) -> Cause:
        """A finding in words, with its value and deviation, the errors before and after, and the rivals."""
        outcome = finding.outcome
        std, theta = self.deviations(outcome.values)
        places = {term: k for k, term in enumerate(outcome.values)}
        value = {term: outcome.values[term] for term in outcome.hypothesis.terms}
        deviation = {term: float(std[places[term]]) for term in value}
        what, sizes = self._wording(outcome.hypothesis, value, deviation, theta, words)
        before, after = outcome.relative_errors()
        evidence = [*sizes, f"the held-out torque error falls from {100 * before:.3g} to {100 * after:.3g} %"]
        if finding.rivals:
            others = (self._wording(r.hypothesis, r.values, {}, theta, words)[0].cause for r in finding.rivals)
            evidence.append(f"not excluded instead: {'; '.join(dict.fromkeys(others))}")
        return replace(what, evidence=tuple(evidence), possible=not finding.named)

    def _wording(
        self,
        hypothesis: Hypothesis,
        value: Mapping[Term, float],
        deviation: Mapping[Term, float],
        theta: Array,
        words: Wording,
    ) -> tuple[Cause, list[str]]:
        """The cause of a hypothesis, and the value of its parameters in words."""
        terms, joint = hypothesis.terms, hypothesis.joint
        first, std = value[terms[0]], deviation.get(terms[0], 0.0)
        whose = None if joint == ALL else joint
        if hypothesis.subject == "zero":
            off = f"the positions are {math.degrees(first):.3g} +- {math.degrees(std):.2g} deg too small"
            return words.zero(joint, first), [off]
        if hypothesis.subject == "gain":
            factor = math.exp(first)
            off = f"the torques are {factor:.4g} +- {factor * std:.2g} times those that fit the other joints"
            return words.gain(joint, factor), [off]
        if hypothesis.subject == "delay":
            return words.delay(whose, first), [f"by {1e3 * abs(first):.3g} +- {1e3 * std:.2g} ms"]
        if hypothesis.subject == "tilt":
            angle = math.degrees(math.hypot(*(value[term] for term in terms)))
            spread = math.degrees(max(deviation.get(term, 0.0) for term in terms))
            return words.tilt(self.influence.tilted_gravity([value[term] for term in terms])), [
                f"by {angle:.3g} +- {spread:.2g} deg"
            ]
        if hypothesis.subject == "drift":
            changes = []
            for term in terms:
                symbol = "fv" if term.kind == "viscous drift" else "fc"
                name = f"{symbol}{term.place + 1}"
                size = abs(theta[self.names.index(name)]) if name in self.names else 0.0
                share = f" ({100 * value[term] / size:+.2g} %)" if size > 0.0 else ""
                changes.append(f"{name} by {value[term]:+.3g} +- {deviation.get(term, 0.0):.2g}{share}")
            return words.drift(whose), [f"from beginning to end {', '.join(changes)}"]
        section, keys, what = MISSING[hypothesis.subject]
        values = ", ".join(f"{self.names[term.place]} = {value[term]:.3g}" for term in terms)
        lacking = [keys[self.names[term.place].rstrip("0123456789")] for term in terms]
        return words.missing(joint, section, lacking, what), [f"with {values}"]
