"""Estimates nuisance parameters of recordings together with the model, with their part in the covariance.

A fit of a sample finds which of the parameters asked for the torques determine, and their values to within the noise.
The recordings are then corrected by them; their derivatives stand as further columns beside the regressor of all rows,
so that the last Gauss-Newton steps, and the covariance, are those of model and nuisance parameters together.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.base.tables import text_table
from rrrgen.base.yamltext.suggestions import did_you_mean
from rrrgen.lab.data.mapping import LogMapping
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.data.reconstruction import Reconstruction
from rrrgen.lab.data.repair import Repairs
from rrrgen.lab.data.uniform_stream import Part
from rrrgen.lab.estimate.regression import Estimate, correlated_covariance, least_squares, weighted_least_squares
from rrrgen.lab.estimate.tsqr import JointFactors
from rrrgen.lab.identify.diagnosis.causes import Wording
from rrrgen.lab.identify.diagnosis.hypotheses import MOST_SAMPLES, POSSIBLE, Comparison
from rrrgen.lab.identify.diagnosis.report import wording
from rrrgen.lab.identify.diagnosis.trial_fits import AllTerms, Sample, joined_samples, sample_of
from rrrgen.lab.identify.factoring import FittedRows, factor_recordings
from rrrgen.lab.identify.held_out_data import Split
from rrrgen.lab.identify.nuisances import ALL, UNIT, Influence, NuisanceFit, SampledMotion, Term
from rrrgen.lab.identify.observations import KnownTorque, Observations, Recording, RowMaker
from rrrgen.lab.identify.regressor import FullRegressor, Parametrisation, standstill

CHOICES = ("zeros", "gains", "delay", "delays", "tilt", "drift")
LARGEST_STD = {"zero": math.radians(20.0), "gain": 0.3, "delay": 0.1, "tilt": math.radians(20.0)}
"""Prior standard deviations (rad, factor, s); a parameter that the torques tell no better is left out if the others
explain the torques as well without it."""
LARGEST_SHIFT_STD = 0.1  # m, of the zero of a prismatic joint
SIGNIFICANT = 2.0  # standard deviations from zero from which on there is something to write
PASSES = 4  # steps over all rows, from the values of the sample
SETTLED = 0.05  # step in standard deviations at which they end


def parse_choices(texts: Sequence[str]) -> tuple[str, ...]:
    """The groups of nuisance parameters named in comma-separated ``texts``, in the order of :data:`CHOICES`.

    Raises :class:`InputError` for other words, and for the delay of all joints beside that of each.
    """
    words = [word.strip() for text in texts for word in text.split(",")]
    for word in words:
        if word not in CHOICES:
            hint = " ".join(filter(None, (did_you_mean(word, CHOICES), f"there are {', '.join(CHOICES)}")))
            raise InputError(f"nothing called '{word}' can be estimated beside the model; {hint}")
    if {"delay", "delays"} <= set(words):
        raise InputError("'delay' is one for all joints, 'delays' one for each: estimate one of the two")
    return tuple(choice for choice in CHOICES if choice in words)


@dataclass(frozen=True, eq=False)
class CorrectedRecording:
    """A recording whose zeros (n,), torque gains (n,) and delays (n,), s, are put right."""

    recording: Recording
    zeros: Array
    gains: Array
    delays: Array

    @property
    def period(self) -> float:
        """Sampling period, s."""
        return self.recording.period

    @property
    def joints(self) -> tuple[str, ...]:
        """Joint names."""
        return self.recording.joints

    @property
    def span(self) -> tuple[float, float]:
        """Start and duration, s."""
        return self.recording.span

    @property
    def repairs(self) -> Repairs:
        """The faults found in the recording and how they were repaired."""
        return self.recording.repairs

    @property
    def mapping(self) -> LogMapping | None:
        """The mapping with these corrections, to which those that a diagnosis finds are added."""
        given: LogMapping | None = getattr(self.recording, "mapping", None)
        if given is None:
            return None
        joints = []
        for joint, zero, gain, delay in zip(given.joints, self.zeros, self.gains, self.delays, strict=True):
            torque = joint.torque
            if torque is not None:
                torque = replace(
                    torque, gain=torque.gain / gain, factor=torque.factor / gain, delay=torque.delay + float(delay)
                )
            joints.append(replace(joint, zero=joint.zero + float(zero), torque=torque))
        return replace(given, joints=tuple(joints))

    def parts(self) -> Iterator[Part]:
        """Iterate over the uninterrupted stretches, corrected."""
        for part in self.recording.parts():
            late = part.late - self.delays / self.period if self.delays.any() else part.late
            yield replace(self._correct_part(part), late=late)

    def samples(self) -> Iterator[Part]:
        """Iterate over all samples, corrected but for delays."""
        return (self._correct_part(part) for part in self.recording.samples())

    def _correct_part(self, part: Part) -> Part:
        return replace(part, q=part.q + self.zeros, tau=None if part.tau is None else part.tau / self.gains)

    def __len__(self) -> int:
        return len(self.recording)


@dataclass(frozen=True, eq=False)
class Columns:
    """Columns of nuisance parameters beside those of a regressor, along a motion: derivatives at the fit.

    ``theta`` (p,) are the parameters of ``regressor``; the recording begins at ``start`` and lasts ``duration``, s.
    """

    regressor: FullRegressor
    terms: tuple[Term, ...]
    theta: Array
    start: float = 0.0
    duration: float = 1.0

    def __call__(self, motion: Reconstruction, W: Array) -> Array:
        """The columns (N, n, k) at the N samples of a ``motion`` with the regressor W (N, n, p)."""
        torque = W @ self.theta
        rate = np.gradient(torque, motion.t, axis=0) if len(torque) > 1 else np.zeros_like(torque)
        at = SampledMotion(motion.q, motion.dq, motion.ddq, rate, (motion.t - self.start) / self.duration - 0.5)
        return Influence(self.regressor.model).columns(self.terms, at, torque, self.theta[: self._rigid])

    @property
    def _rigid(self) -> int:
        return len(self.regressor.model.base_parameter_names)

    def torque(self, motion: Reconstruction | Sample, values: Array) -> Array:
        """Torque (N, n) of tilt and drift with ``values`` (k,) along a motion."""
        at = SampledMotion(motion.q, motion.dq, motion.ddq, motion.dq, (motion.t - self.start) / self.duration - 0.5)
        given = np.where([term.is_linear for term in self.terms], values, 0.0)
        columns = Influence(self.regressor.model).columns(self.terms, at, motion.dq, self.theta[: self._rigid])
        return np.asarray(columns @ given)


@dataclass(frozen=True, eq=False)
class Corrections:
    """Nuisance parameters with ``values`` (k,), SI, whose derivatives are ``columns``; a gain is a logarithm.

    ``known`` is a torque that was known before, and subtracted from the measured one.
    """

    columns: Columns
    values: Array
    known: KnownTorque | None = None

    @property
    def terms(self) -> tuple[Term, ...]:
        """The nuisance parameters."""
        return self.columns.terms

    def recordings(self, recordings: Sequence[Recording]) -> list[Recording]:
        """The ``recordings`` with zeros, gains and delays put right."""
        return [correct_recording(recording, self.terms, self.values) for recording in recordings]

    def torque(self, motion: Reconstruction) -> Array:
        """Torque (N, n) along a motion that is no part of the model: of tilt, drift, and what was known before."""
        torque = self.columns.torque(motion, self.values)
        return torque if self.known is None else torque + self.known(motion)

    def gravity(self) -> list[float] | None:
        """Gravity (3,), m/s^2, in the frame of the tilted base; None if no tilt was estimated."""
        tilt = {term.place: float(v) for term, v in zip(self.terms, self.values, strict=True) if term.kind == "tilt"}
        influence = Influence(self.columns.regressor.model)
        return influence.tilted_gravity([tilt.get(0, 0.0), tilt.get(1, 0.0)]) if tilt else None


@dataclass(frozen=True, eq=False)
class Nuisances:
    """Nuisance parameters estimated with a model: ``corrections``, and deviations ``std`` (k,) of their values.

    ``error`` is the relative torque error of the fitted rows with all of them, ``without`` (k,) that with one at zero;
    ``remedies`` (k,) say what to write. ``refused`` are sentences on those that the torques do not tell. ``fitted`` are
    all fitted rows, with the columns of nuisance parameters. ``joints`` are the joint names.
    """

    corrections: Corrections
    std: Array
    refused: tuple[str, ...]
    error: float
    without: Array
    remedies: tuple[str, ...]
    fitted: FittedRows
    joints: tuple[str, ...]

    @property
    def terms(self) -> tuple[Term, ...]:
        """The nuisance parameters."""
        return self.corrections.terms

    @property
    def values(self) -> Array:
        """Their values (k,), SI; a gain is the logarithm of a factor."""
        return self.corrections.values

    def covariances(
        self, estimate: Estimate, chosen: Parametrisation, lags: int, limit: float | None = None
    ) -> tuple[Array, Array]:
        """Covariances (r + k, r + k) of the identifiable and the nuisance parameters, fitted together.

        First for white residuals, then for residuals correlated over ``lags`` rows, the same for 0. ``estimate`` is
        that of the identifiable parameters alone, whose weights are used; ``limit`` is that of a robust estimate.
        """
        joint = _joint_estimate(_factors(self.fitted), chosen, self.terms, estimate)
        if not lags:
            return joint.covariance, joint.covariance
        T, known = _beside(chosen, len(self.terms))
        return joint.covariance, correlated_covariance(self.fitted, joint, lags, lambda x: T @ x + known, T, limit)

    def lines(self, width: int | None = None) -> list[str]:
        """The parameters as a table folded to ``width`` characters, what to write, and what was left out."""
        spec = self.corrections.columns.regressor.model.spec
        rows = [("estimated with the model", "value", "std", "error at zero")]
        for term, value, std, without in zip(self.terms, self.values, self.std, self.without, strict=True):
            rows.append((name_of(term, self.joints), *text_of(term, value, std, spec), f"{100 * without:.3g} %"))
        matters = np.square(self.without) > (1.0 + POSSIBLE) * self.error**2
        remedies = zip(self.remedies, matters & (np.abs(self.values) > SIGNIFICANT * self.std), strict=True)
        significant = [line for line, differs in remedies if differs]
        return [
            *text_table(rows, width, indent="", right=(1, 2, 3)),
            f"error at zero: relative torque error without this one; with all of them it is {100 * self.error:.3g} %",
            *(f"write: {line}" for line in dict.fromkeys(significant)),
            *(f"not estimated: {sentence}" for sentence in self.refused),
        ]

    def to_json(self) -> dict[str, Any]:
        """The parameters in SI, a gain as the logarithm of its factor, and what was left out, as plain data."""
        columns = zip(self.terms, self.values, self.std, self.without, self.remedies, strict=True)
        return {
            "relative_error": self.error,
            "parameters": [
                {
                    "name": name_of(term, self.joints),
                    "kind": term.kind,
                    "value": float(value),
                    "std": float(std),
                    "relative_error_at_zero": float(without),
                    "write": line,
                }
                for term, value, std, without, line in columns
            ],
            "not_estimated": list(self.refused),
        }


def correct_recording(recording: Recording, terms: Sequence[Term], values: Array) -> Recording:
    """The ``recording`` with the zeros, gains and delays among ``terms`` put right; itself if there are none."""
    n = len(recording.joints)
    zeros, gains, delays = np.zeros(n), np.ones(n), np.zeros(n)
    for (kind, place), value in zip(terms, values, strict=True):
        j: Any = slice(None) if place == ALL else place
        if kind == "zero":
            zeros[j] += value
        elif kind == "gain":
            gains[j] *= np.exp(value)
        elif kind == "delay":
            delays[j] += value
    if not (zeros.any() or delays.any() or np.any(gains != 1.0)):
        return recording
    return CorrectedRecording(recording, zeros, gains, delays)


def _beside(chosen: Parametrisation, k: int) -> tuple[Array, Array]:
    """Map (p + k, r + k) and constant part (p + k,) from identifiable and k nuisance parameters to all columns."""
    p, r = chosen.T.shape
    T = np.zeros((p + k, r + k))
    T[:p, :r], T[p:, r:] = chosen.T, np.eye(k)
    return T, np.append(chosen.known, np.zeros(k))


def _factors(fitted: FittedRows) -> JointFactors:
    return factor_recordings(fitted.observations, fitted.split).fit


def _joint_estimate(
    factors: JointFactors, chosen: Parametrisation, terms: Sequence[Term], like: Estimate | None = None
) -> Estimate:
    """Least squares for the identifiable and the nuisance parameters together; weights are those of ``like``."""
    reduced = factors.substitute(*_beside(chosen, len(terms)))
    names = (*chosen.structure.names, *(f"{kind} {place}" for kind, place in terms))
    return weighted_least_squares(reduced, names) if like is None else least_squares(reduced, names, like.weights)


# ------------------------------------------------------------------------------------------------------------------
# What the torques determine, and starting values, from a sample
# ------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Start:
    """Terms that the torques determine with their first ``values``; ``refused`` says why others are left out."""

    fit: NuisanceFit
    values: dict[Term, float]
    refused: tuple[str, ...]

    def corrections(
        self, regressor: FullRegressor, recordings: Sequence[Recording], known: KnownTorque | None = None
    ) -> Corrections:
        """The corrections by these values; the parameters of ``regressor`` are those of the sample's fit."""
        begin, duration = recordings[0].span
        x, _ = self.fit.fit_model(list(self.values), self.values)
        theta = self.fit.T @ x + self.fit.known
        columns = Columns(regressor, tuple(self.values), theta, begin, duration or 1.0)
        return Corrections(columns, np.array(list(self.values.values())), known)


def candidates(choices: Sequence[str], regressor: FullRegressor, free: Sequence[int], several: bool) -> list[Term]:
    """The terms of the groups ``choices``; ``free`` are the columns without a known value.

    Raises :class:`InputError` for a group that the robot or the recordings cannot have: tilt without gravity, drift
    without friction, or over ``several`` recordings.
    """
    n = regressor.model.n
    terms: list[Term] = []
    for choice in choices:
        if choice == "zeros":
            terms += [Term("zero", j) for j in range(n)]
        elif choice == "gains":
            terms += [Term("gain", j) for j in (*range(1, n), 0)]  # of dependent ones the last is held: the first joint
        elif choice == "delay":
            terms.append(Term("delay", ALL))
        elif choice == "delays":
            terms += [Term("delay", j) for j in range(n)]
        elif choice == "tilt":
            if not Influence(regressor.model).can_tilt:
                raise InputError("the tilt of the base cannot be estimated: the robot file states no gravity")
            terms += [Term("tilt", 0), Term("tilt", 1)]
        elif choice == "drift":
            if several:
                raise InputError("drift is estimated along one recording, not over several: leave 'drift' away")
            columns = [regressor.columns[k] for k in free]
            for j in range(n):
                kinds = {column.kind for column in columns if column.direction and column.direction[j]}
                terms += [Term("viscous drift", j)] if kinds & {"viscous", "law"} else []
                terms += [Term("Coulomb drift", j)] if kinds & {"coulomb", "law"} else []
            if not any("drift" in term.kind for term in terms):
                raise InputError("drift is that of friction, and no joint of the robot file states any")
    return terms


def start(
    regressor: FullRegressor,
    chosen: Parametrisation,
    recordings: Sequence[Recording],
    processing: Processing,
    choices: Sequence[str],
    split: Split,
) -> Start:
    """Find which of the nuisance parameters the fitted rows determine, and their values, on a sample of these rows.

    Raises :class:`InputError` if there are no rows, or none of the parameters is determined.
    """
    model, joints = regressor.model, recordings[0].joints
    sample = _fitted_sample(recordings, processing, split)
    fit = NuisanceFit(model, regressor, sample.thin(MOST_SAMPLES // sample.n), chosen.T, chosen.known)
    wanted = candidates(choices, regressor, chosen.free, len(recordings) > 1)
    coupled = _coupled_joints(recordings)
    refused = [
        f"{name_of(term, joints)}: the mapping file couples its motor with others, whose torques it mixes"
        for term in wanted
        if term.kind in ("gain", "delay") and term.place in coupled
    ]
    wanted = [term for term in wanted if term.kind not in ("gain", "delay") or term.place not in coupled]
    first = _first_values(model, regressor, sample, wanted)
    values = {term: first.get(term, 0.0) for term in wanted}
    while values:
        kept, sentences = _select_determined(fit, list(values), values, joints)
        refused += sentences
        values = fit.fit_terms(kept, values)
        std = fit.deviations(values)[0] if values else np.zeros(0)
        excess = [s / _largest(term, model.spec) for s, term in zip(std, values, strict=True)]
        over = [k for k, share in enumerate(excess) if share > 1.0]
        # of parameters that the torques tell together only, the one that the diagnosis names is wrong more probably
        over.sort(key=lambda k: (list(values)[k] in first, -excess[k]))
        worst = next((k for k in over if _dispensable(fit, values, list(values)[k])), None)
        if worst is not None:
            term = list(values)[worst]
            shown = text_of(term, 0.0, float(std[worst]), model.spec)[1]
            size = f"{100 * std[worst]:.0f} %" if term.kind == "gain" else shown
            refused.append(f"{name_of(term, joints)}: left out, since its deviation would be {size}")
        else:
            weak = doubtful(fit, values, model.spec)
            if weak is None:
                break
            term, explained = weak
            value = text_of(term, values[term], 0.0, model.spec)[0]
            refused.append(
                f"{name_of(term, joints)}: left out, since {value} would explain "
                f"{100 * explained:.1f} % of the squared torque errors that are left; so large a value takes "
                f"{100 * POSSIBLE:.0f} %"
            )
        del values[term]
    if not values:
        raise InputError(f"nothing of {', '.join(choices)} can be estimated with the model: " + "; ".join(refused))
    return Start(fit, values, tuple(refused))


def _fitted_sample(recordings: Sequence[Recording], processing: Processing, split: Split) -> Sample:
    """Sample of the fitted rows of all recordings, one after the other in time."""
    samples: list[Sample] = []
    for recording in recordings:
        sample = sample_of(recording, processing)
        if sample is not None:
            samples.append(replace(sample, use=sample.use & split.is_fitted(sample.t, *recording.span)[:, None]))
    if not samples or not any(sample.use.any() for sample in samples):
        raise InputError("no recording has torques from which nuisance parameters could be estimated")
    return joined_samples(samples)


def _first_values(model: Any, regressor: FullRegressor, sample: Sample, wanted: Sequence[Term]) -> Mapping[Term, float]:
    """Values of those of the ``wanted`` terms that the diagnosis finds, which searches zeros all around the circle."""
    names = {column.name for column in regressor.columns}
    every = AllTerms(model, tuple(regressor.columns))
    inside = [k for k, name in enumerate(every.names) if name in names]
    comparison = Comparison(every, sample, inside)
    findings = comparison.findings(
        [hypothesis for hypothesis in comparison.hypotheses() if set(hypothesis.terms) <= set(wanted)]
    )
    return findings[-1].outcome.values if findings else {}


def _select_determined(
    fit: NuisanceFit, terms: Sequence[Term], values: Mapping[Term, float], joints: Sequence[str]
) -> tuple[list[Term], list[str]]:
    """Terms that stand out of the space of the model and of those before them, and why the others do not."""
    W, tau = fit.regressor_at(values)
    x, sigma = fit.fit_model(terms, values)
    A = np.concatenate([W, fit.columns(terms, values, W, x)], axis=-1)
    G = np.tensordot(1.0 / sigma**2, fit.products(A, tau), 1)
    basis, kept, refused = list(range(W.shape[-1])), [], []
    for k, term in enumerate(terms, start=W.shape[-1]):
        at = [*basis, k, len(G) - 1]
        if fit.is_determined(G[np.ix_(at, at)], range(len(basis)), [UNIT.get(term.kind, 1.0)])[0]:
            basis.append(k)
            kept.append(term)
        else:
            alone = fit.is_determined(G[np.ix_([k, len(G) - 1], [k, len(G) - 1])], [], [UNIT.get(term.kind, 1.0)])[0]
            refused.append(f"{name_of(term, joints)}: {_reason(term, alone)}")
    return kept, refused


def _reason(term: Term, has_effect: bool) -> str:
    if term.kind == "gain" and has_effect:
        return (
            "held at 1, since masses and friction can take up one common factor of all torques; "
            "`rrrgen experiment drive-gains` finds it with a known load"
        )
    return "the parameters of the model can take it up" if has_effect else "it changes no torque of this motion"


def _dispensable(fit: NuisanceFit, values: Mapping[Term, float], term: Term) -> bool:
    """Whether the others, fitted again without ``term``, explain the torques as well, to what a cause must explain.

    A deviation alone does not tell: where residuals are slow it is large, also that of a factor of two without which
    nothing fits.
    """
    rest = fit.fit_terms([other for other in values if other != term], values)
    return _error(fit, values) ** 2 > (1.0 - POSSIBLE) * _error(fit, rest) ** 2


def doubtful(fit: NuisanceFit, values: Mapping[Term, float], spec: Any) -> tuple[Term, float] | None:
    """The term beyond what its prior allows that explains least, below what a cause must explain; None without one.

    A zero of a few degrees is an ordinary fault, and its prior deviation is :data:`LARGEST_STD`. A value beyond it is
    a mistake that the diagnosis would have to call possible: errors of the model alone make some for a few per cent.
    """
    large = [term for term, value in values.items() if abs(value) > _largest(term, spec)]
    if not large:
        return None
    left = _error(fit, values) ** 2
    shares = {}
    for term in large:
        rest = {other: value for other, value in values.items() if other != term}
        shares[term] = max(0.0, 1.0 - left / max(_error(fit, rest) ** 2, np.finfo(float).tiny))
    least = min(shares, key=lambda term: shares[term])
    return (least, shares[least]) if shares[least] < POSSIBLE else None


def _coupled_joints(recordings: Sequence[Recording]) -> set[int]:
    """The joints whose recorded torques are mixed with those of others by the transmission of a mapping file."""
    joints: set[int] = set()
    for recording in recordings:
        mapping: LogMapping | None = getattr(recording, "mapping", None)
        if mapping is not None and mapping.transmission is not None:
            N = mapping.transmission
            mixed: NDArray[np.bool_] = (N != 0.0) & ~np.eye(len(N), dtype=bool)
            joints |= {int(j) for j in np.flatnonzero(mixed.any(axis=0) | mixed.any(axis=1))}
    return joints


def _largest(term: Term, spec: Any) -> float:
    """Standard deviation above which a term is left out."""
    if term.kind == "zero" and not spec.joints[term.place].is_revolute:
        return LARGEST_SHIFT_STD
    return LARGEST_STD.get(term.kind, math.inf)


# ------------------------------------------------------------------------------------------------------------------
# The estimate from all rows
# ------------------------------------------------------------------------------------------------------------------


def estimate_nuisances(
    first: Start,
    corrections: Corrections,
    chosen: Parametrisation,
    recordings: Sequence[Recording],
    processing: Processing,
    split: Split,
) -> Nuisances:
    """Estimate the nuisance parameters of ``first`` from all fitted rows, together with those of the model.

    ``corrections`` are those by the first values, with the regressor of the rows.
    """
    regressor, terms = corrections.columns.regressor, corrections.terms

    def rows(at: Corrections, beside: Columns | None) -> FittedRows:
        width = len(regressor.columns) + len(terms)
        slow, around = standstill(regressor, processing, max(recording.period for recording in recordings))
        maker = RowMaker(regressor, processing, width, at.torque, regressor.sliding, slow, beside, around)
        return FittedRows(Observations(tuple(at.recordings(recordings)), maker), split)

    def with_theta(at: Corrections, x: Array) -> Corrections:
        return replace(at, columns=replace(at.columns, theta=chosen.expand(x)))

    alone = weighted_least_squares(chosen.transform(_factors(rows(corrections, None))), chosen.structure.names)
    corrections, std = with_theta(corrections, alone.x), alone.x
    for _ in range(PASSES):
        joint = _joint_estimate(_factors(rows(corrections, corrections.columns)), chosen, terms)
        r = chosen.structure.rank
        step, std = joint.x[r:], joint.std[r:]
        corrections = with_theta(replace(corrections, values=corrections.values + step), joint.x[:r])
        if np.all(np.abs(step) <= SETTLED * std):
            break
    fit, values = first.fit, dict(zip(terms, corrections.values.tolist(), strict=True))
    # the sample is not filtered as the rows are: it tells the rise of the squares alone
    rest = [_error(fit, {term: value for term, value in values.items() if term != left}) for left in terms]
    rise = np.maximum(np.square(rest) - _error(fit, values) ** 2, 0.0)
    error = joint.relative_error
    fitted = rows(corrections, corrections.columns)
    words = [wording(regressor.model.spec, recording) for recording in recordings]
    lines = tuple(
        "; ".join(dict.fromkeys(_remedy(term, value, corrections, recording_words) for recording_words in words))
        for term, value in values.items()
    )
    joints = tuple(recordings[0].joints)
    return Nuisances(corrections, std, first.refused, error, np.sqrt(error**2 + rise), lines, fitted, joints)


def _error(fit: NuisanceFit, values: Mapping[Term, float]) -> float:
    """Relative torque error of a sample at given ``values`` of the nuisance parameters, joints as they are."""
    weights = fit.counts * fit.size**2
    return float(np.sqrt(weights @ fit.joint_errors(values) ** 2 / np.sum(weights)))


# ------------------------------------------------------------------------------------------------------------------
# In words
# ------------------------------------------------------------------------------------------------------------------

NAMES = {"viscous drift": "drift of fv", "Coulomb drift": "drift of fc"}


def name_of(term: Term, joints: Sequence[str]) -> str:
    """A nuisance parameter in words, such as ``zero of q2``."""
    if term.kind == "tilt":
        return f"tilt towards {'the first' if term.place == 0 else 'the second'} horizontal axis"
    if term.place == ALL:
        return "delay of all joints"
    return f"{NAMES.get(term.kind, term.kind)} of {joints[term.place]}"


def text_of(term: Term, value: float, std: float, spec: Any) -> tuple[str, str]:
    """Value and deviation of a nuisance parameter as text with unit; a gain as a factor."""
    revolute = spec.joints[max(term.place, 0)].is_revolute
    if term.kind == "gain":
        return f"{math.exp(value):.4g}", f"{math.exp(value) * std:.2g}"
    if term.kind == "tilt" or (term.kind == "zero" and revolute):
        return f"{math.degrees(value):.4g} deg", f"{math.degrees(std):.2g} deg"
    if term.kind == "delay":
        return f"{1e3 * value:.4g} ms", f"{1e3 * std:.2g} ms"
    torque = "N m" if revolute else "N"
    unit = {"zero": "m", "viscous drift": f"{torque} s/{'rad' if revolute else 'm'}"}.get(term.kind, torque)
    return f"{value:.4g} {unit}", f"{std:.2g} {unit}"


def _remedy(term: Term, value: float, corrections: Corrections, words: Wording) -> str:
    """What to write into the mapping or robot file for a nuisance parameter."""
    if term.kind == "zero":
        return words.zero(term.place, value).remedy
    if term.kind == "gain":
        return words.gain(term.place, math.exp(value)).remedy
    if term.kind == "delay":
        return words.delay(None if term.place == ALL else term.place, value).remedy
    if term.kind == "tilt":
        return words.tilt(corrections.gravity() or ()).remedy
    return words.drift(term.place).remedy
