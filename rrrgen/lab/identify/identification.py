"""Identification of a compiled robot from recordings: parameters, their standard deviations, scores and diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError, option_name
from rrrgen.derive.functions.loops import NOT_ASSEMBLED
from rrrgen.derive.parameters.physical_links import DEFAULT_STRENGTH, Prior, default_prior
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.data.repair import Repairs
from rrrgen.lab.estimate.identifiability import (
    Direction,
    Essential,
    Structure,
    collinear,
    essential_parameters,
    unexcited_parameters,
    weak_directions,
)
from rrrgen.lab.estimate.regression import (
    HUBER,
    Estimate,
    correlated_covariance,
    least_squares,
    robust_least_squares,
    robust_rows,
    weighted_least_squares,
)
from rrrgen.lab.estimate.remainder import Remainder
from rrrgen.lab.estimate.statistics import Whiteness, correlation_lags, residual_whiteness
from rrrgen.lab.estimate.tsqr import JointFactors, Rows, factor_blocks
from rrrgen.lab.identify.bandwidth import Tuning, reach, tune
from rrrgen.lab.identify.consistency import (
    POSES,
    ConsistentEstimate,
    InconsistentEstimateError,
    KnownParameters,
    consistent_estimate,
    indefinite_share,
    mass_matrix,
    pose_limits,
)
from rrrgen.lab.identify.diagnosis.causes import Cause
from rrrgen.lab.identify.factoring import (
    Factors,
    FittedRows,
    Progress,
    ScoredRows,
    factor_recordings,
    fits_in_memory,
    rows_of_recordings,
    score,
)
from rrrgen.lab.identify.floating_base import measured_rows, on_floating_base
from rrrgen.lab.identify.friction_choice import FrictionFit, LawChoice, fit_friction
from rrrgen.lab.identify.friction_columns import with_linear_friction, without_laws
from rrrgen.lab.identify.held_out_data import Split
from rrrgen.lab.identify.nuisance_estimate import Nuisances, estimate_nuisances, start
from rrrgen.lab.identify.observations import KnownTorque, Observations, Recording, RowMaker, require_torques
from rrrgen.lab.identify.parameters import Column, DriveTerms, explained_names, identified_units
from rrrgen.lab.identify.regressor import (
    FullRegressor,
    Parametrisation,
    RigidModel,
    assembly_mask,
    hold_unexcited,
    loop_status,
    parametrise,
    standstill,
)
from rrrgen.lab.identify.rows import standing_sentences
from rrrgen.lab.identify.scores import (
    Fingerprint,
    Score,
    TorqueBand,
    conformal_band,
    fingerprint,
    left_in_rows,
    score_models,
)

# ------------------------------------------------------------------------------------------------------------------
# The estimate that is written to the robot file, with its uncertainty.
# ------------------------------------------------------------------------------------------------------------------


WEAKEST = 1e-6
"""Scaled singular value, of the largest, below which residuals count as white: a variance of its inverse squared rounds
away correlations."""


@dataclass(frozen=True)
class Delivered:
    """The estimate written to ``robot.yaml``: identifiable combinations ``x`` (r,) and their ``covariance`` (r, r).

    ``origin`` is the name of the estimate, the physically consistent one if it was computed. ``at_bound`` (r,) marks
    drive parameters that lie on their lower bound 0. ``pull`` (r,) is the difference from the unconstrained estimate in
    deviations of that: above 1, the prior decides more than the data.
    """

    origin: str
    x: Array
    covariance: Array
    at_bound: NDArray[np.bool_]
    pull: Array

    @property
    def std(self) -> Array:
        """Standard deviations (r,) of ``x``."""
        return np.asarray(np.sqrt(np.maximum(0.0, np.diag(self.covariance))))

    @classmethod
    def of(
        cls,
        estimate: Estimate,
        consistent: ConsistentEstimate | None,
        reduced: JointFactors,
        chosen: Parametrisation,
        options: Options,
        base: int,
    ) -> Delivered:
        """Choose the estimate to write: ``consistent``, or ``estimate`` if that is None; compute its covariance.

        ``reduced`` are the triangular factors of the fitted rows for x. Of all regressor columns the first ``base`` are
        those of base parameters.
        """
        if consistent is None or consistent.near is None:
            none = np.zeros(len(estimate.x))
            return cls(options.method, estimate.x, estimate.covariance, none.astype(bool), none)
        weights = None if options.method == "robust" else estimate.weights
        R = reduced.stack(weights)[:-1, :-1]
        information = R.T @ R
        scores = information @ estimate.covariance @ information
        if estimate.singular[estimate.rank - 1] < WEAKEST * estimate.singular[0]:
            # the variance of what noise alone seems to tell drowns all others in its rounding errors
            scores = estimate.variance * information
        held = chosen.held_from(base)
        moving = [k for k in range(len(chosen.known)) if k not in held]
        directions = np.zeros((len(chosen.known), consistent.near.directions.shape[1]))
        directions[moving] = consistent.near.directions
        along = chosen.contract(directions)
        # the prior is no observation, which would narrow the intervals, but an error that the data do not tell
        covariance = consistent.near.covariance(along, scores, 0.0)
        x = chosen.contract(consistent.theta)
        fixed = np.all(along == 0.0, axis=1) | ((x == 0.0) & (np.diag(covariance) <= 0.0))
        moved = np.where(fixed, 0.0, x - estimate.x)
        pull = np.divide(moved, estimate.std, out=np.zeros(len(x)), where=estimate.std > 0.0)
        return cls("physically consistent", x, covariance + np.outer(moved, moved), fixed, pull)


# ------------------------------------------------------------------------------------------------------------------
# Options of an identification.
# ------------------------------------------------------------------------------------------------------------------

Method = Literal["ordinary", "weighted", "robust"]
METHODS: tuple[Method, ...] = ("ordinary", "weighted", "robust")


@dataclass(frozen=True)
class Options:
    """Options of an identification: what to estimate, from which part of the data, and how.

    - ``method``: ordinary, weighted or robust least squares.
    - ``terms``: drive terms to estimate; those of the robot file if None.
    - ``friction``: friction laws to fit instead of those that the robot file states.
    - ``fixed``: known values of columns, ``{"fv1": 3.2}``; ``fixed_standard``: of standard parameters, ``{"my2": 0}``.
    - ``estimate``: groups of nuisance parameters to estimate with the model, of
      :data:`~rrrgen.lab.identify.nuisance_estimate.CHOICES`.
    - ``known``: a torque that is subtracted from the measured one, as a function of the motion.
    - ``split``: which part of the data is fitted; ``guard`` (s): guard band on both sides of its borders, the reach of
      the filters if None.
    - ``consistent``: also compute the physically consistent estimate, with ``prior`` (from the robot if None) of weight
      ``prior_strength``.
    - ``essential``: also reduce the model to its essential parameters.
    - ``correlated``: allow for correlated residuals in the standard deviations.
    - ``limits`` (2, n), ``poses``: range and number of the random poses at which M(q) is tested.
    - ``seed``: of all random numbers; ``jobs``, ``cluster``: processes, or a Dask scheduler, that share the work.
    """

    method: Method = "weighted"
    terms: DriveTerms | None = None
    friction: LawChoice = field(default_factory=LawChoice)
    fixed: Mapping[str, float] = field(default_factory=dict)
    fixed_standard: Mapping[str, float] = field(default_factory=dict)
    estimate: tuple[str, ...] = ()
    known: KnownTorque | None = None
    split: Split = field(default_factory=Split)
    guard: float | None = None
    consistent: bool = True
    prior: Prior | None = None
    prior_strength: float = DEFAULT_STRENGTH
    essential: bool = False
    correlated: bool = True
    limits: Array | None = None
    poses: int = POSES
    seed: int = 0
    jobs: int = 1
    cluster: str | None = None


# ------------------------------------------------------------------------------------------------------------------
# Identification of a compiled robot from recordings
# ------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Identification:
    """The result of an identification.

    - ``columns``, ``structure``: all columns of the regressor, and their identifiable combinations.
    - ``estimate``: of the identifiable combinations; ``iid_std``: its standard deviations if residuals were white;
      ``theta`` (p,): the parameters of all columns.
    - ``tuning``: the filters and how they were chosen; ``split``: fitted part of the data with its guard bands;
      ``fitted``: fingerprint of the fitted samples.
    - ``fit``, ``held_out``: scores on the fitted rows and on the held-out ones (0 rows without a split);
      ``consistent_fit``, ``consistent_held_out``: those of the physically consistent estimate ``consistent``;
      ``scores``: these and the scores on all rows and on unfiltered torques.
    - ``whiteness``: of the residuals of every joint; ``essential``: the reduced model, None if not asked for.
    - ``indefinite``: for each estimate, the share of random poses with an indefinite mass matrix.
    - ``structural_notes``, ``motion_notes``: sentences on parameters that the structure of the robot, or the recorded
      motion, leaves undetermined; ``hardly_determined``: on those that the data determine poorly; ``weak``:
      combinations that the motion hardly excites.
    - ``delivered``: the parameters of the written model, with their ``units`` and ``meanings``; ``band``: the
      uncertainty of the torques that it predicts.
    - ``friction``: the friction laws other than the linear one, None without any.
    - ``nuisances``: zeros, gains, delays, tilt and drift that were estimated with the model, None without any; all
      scores are those of recordings that are corrected by them.
    - ``swinging``: sentences on recordings whose control loop oscillates.
    - ``repairs``, ``diagnoses``: repairs of the recordings, and probable faults in them or in the robot file.
    - ``blocks``, ``held_out_blocks``, ``parametrisation``: the rows, and the map to the identifiable parameters;
      ``regressor``: that of all columns.
    """

    columns: tuple[Column, ...]
    structure: Structure
    estimate: Estimate
    iid_std: Array
    theta: Array
    tuning: Tuning
    split: Split
    fitted: Fingerprint
    scores: tuple[Score, ...]
    fit: dict[str, Any]
    held_out: dict[str, Any]
    whiteness: tuple[Whiteness, ...]
    consistent: ConsistentEstimate | None
    consistent_fit: dict[str, Any] | None
    consistent_held_out: dict[str, Any] | None
    essential: Essential | None
    indefinite: dict[str, float]
    structural_notes: tuple[str, ...]
    motion_notes: tuple[str, ...]
    weak: tuple[Direction, ...]
    delivered: Delivered
    units: tuple[str, ...]
    meanings: tuple[str, ...]
    hardly_determined: tuple[str, ...]
    band: TorqueBand = field(repr=False, compare=False)
    friction: FrictionFit | None = None
    nuisances: Nuisances | None = None
    repairs: tuple[Repairs, ...] = ()
    diagnoses: tuple[Cause, ...] = ()
    swinging: tuple[str, ...] = ()
    blocks: Iterable[Rows] = field(repr=False, compare=False, default=())
    held_out_blocks: Iterable[Rows] = field(repr=False, compare=False, default=())
    parametrisation: Parametrisation | None = field(repr=False, compare=False, default=None)
    regressor: FullRegressor | None = field(repr=False, compare=False, default=None)

    @property
    def processing(self) -> Processing:
        """The preprocessing settings of the recordings, complete with those that were chosen automatically."""
        return self.tuning.processing

    @property
    def linear_processing(self) -> Processing:
        """The same for a model with linear friction, which does not hold in slow motion."""
        return replace(self.processing, low_speed=self.processing.low_speed or self.tuning.low_speed)

    @property
    def transform(self) -> Callable[[JointFactors], JointFactors] | None:
        """Map of the triangular factors of the rows to those of the identifiable parameters."""
        return None if self.parametrisation is None else self.parametrisation.transform

    @property
    def parts(self) -> tuple[tuple[str, Iterable[Rows]], ...]:
        """The fitted and the held-out rows, as pairs of a name and blocks of rows."""
        return (("in sample", self.blocks), ("held out", self.held_out_blocks))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the identifiable combinations."""
        return self.estimate.names

    @property
    def known(self) -> dict[str, float]:
        """Base, drive and friction parameters (SI) by name that have a known value, or follow from known ones."""
        chosen = self.parametrisation
        if chosen is None:
            return {}
        held = set(range(len(self.columns))) - set(chosen.free)
        return {self.columns[i].name: float(chosen.known[i]) for i in sorted(held) if not np.any(chosen.T[i])}

    def left_in(self, joints: Sequence[str]) -> tuple[Remainder, ...]:
        """What noise does not explain in held-out torques of the written model, for each of the ``joints`` (n,)."""
        return left_in_rows(self.band.theta, self.blocks, self.held_out_blocks, joints, self.tuning)

    def correct_recordings(self, recordings: Sequence[Recording]) -> Sequence[Recording]:
        """The ``recordings`` with the estimated zeros, gains and delays put right."""
        return recordings if self.nuisances is None else self.nuisances.corrections.recordings(recordings)


def identify(
    model: RigidModel,
    recordings: Sequence[Recording],
    processing: Processing,
    options: Options | None = None,
    *,
    checkpoint: Path | None = None,
    digest: str = "",
    progress: Progress | None = None,
) -> Identification:
    """Estimate the base parameters and drive terms of ``model`` from ``recordings``.

    ``processing`` holds the preprocessing settings; those left None are chosen from the bandwidth of the motion.
    ``checkpoint`` is a file from which an interrupted run is resumed if its ``digest``, of recordings and settings,
    agrees. ``progress(done, total, message)`` is called as the work proceeds. Raises :class:`InputError` for
    recordings or options that cannot be used, :class:`~rrrgen.base.errors.DerivationError` if the data determine
    nothing.
    """
    options = options or Options()
    tell: Progress = progress or (lambda done, total, message: None)
    for recording in recordings:
        if len(recording.joints) != model.n:
            raise InputError(f"a recording of {len(recording.joints)} joints for a robot with {model.n}")
    check_loops(model, recordings)
    require_torques(recordings)
    tuning = tune(processing, recordings, options.split)
    rows = measured_rows(recordings) if on_floating_base(recordings) else None
    if options.split.kind != "none":
        guard = reach(tuning) if options.guard is None else options.guard
        options = replace(options, split=options.split.with_guard(guard))
    first, given, measured = None, options, recordings
    if options.estimate:
        tell(0, 0, "nuisance parameters of a sample")
        plain = FullRegressor(model, _linear_terms(model, options))
        fixed = {name: value for name, value in options.fixed.items() if name in plain.names}
        whole = parametrise(plain, fixed, options.fixed_standard, options.seed)
        first = start(plain, whole, recordings, tuning.processing, options.estimate, options.split)
        corrections = first.corrections(plain, recordings, options.known)
        recordings, options = corrections.recordings(recordings), replace(options, known=corrections.torque)
    regressor, tuning, friction = _with_friction(model, recordings, tuning, options, tell)
    chosen = parametrise(regressor, options.fixed, options.fixed_standard, options.seed, rows)
    tell(0, 0, f"{chosen.structure.rank} identifiable parameters")
    nuisances = None
    if first is not None:
        tell(0, 0, "nuisance parameters")
        corrections = replace(corrections, columns=replace(corrections.columns, regressor=regressor))
        nuisances = estimate_nuisances(first, corrections, chosen, measured, tuning.processing, options.split)
        corrections = nuisances.corrections
        recordings, options = corrections.recordings(measured), replace(given, known=corrections.torque)
    width = len(regressor.columns)
    slow, around = standstill(regressor, tuning.processing, tuning.period)
    sliding = regressor.sliding
    maker = RowMaker(regressor, tuning.processing, width, options.known, sliding, slow, around=around)
    observations = Observations(tuple(recordings), maker)
    blocks: Iterable[Rows]
    held_out: Iterable[Rows] = []
    if fits_in_memory(observations):
        factors, blocks, held_out = rows_of_recordings(observations, options.split, progress)
    else:
        blocks = FittedRows(observations, options.split)
        held_out = ScoredRows(observations, options.split)
        factors = factor_recordings(
            observations,
            options.split,
            jobs=options.jobs,
            cluster=options.cluster,
            checkpoint=checkpoint,
            digest=digest,
            progress=progress,
        )
    if int(np.sum(factors.fit.counts)) == 0:
        if options.split.kind == "none":
            raise InputError("no row is left to fit: check the lowest speed")
        raise InputError(
            f"no row is left to fit ({options.split}): choose another {option_name('split')} or a smaller "
            f"{option_name('guard')}, and check the lowest speed"
        )
    if options.split.kind == "first" and int(np.sum(factors.score.counts)) == 0:
        raise InputError(
            f"no row is held out ({options.split}): choose another {option_name('split')}, or a smaller "
            f"{option_name('guard')}"
        )
    if options.split.kind == "blocks" and int(np.sum(factors.score.counts)) == 0:
        longest = max(recording.span[1] for recording in recordings)
        raise InputError(
            f"no row is held out: between blocks of {options.split.value:g} s there is none in recordings of "
            f"{longest:.3g} s; make the blocks shorter"
        )
    restricted = options.fixed, options.fixed_standard, options.seed, rows

    def result(bodies: bool) -> Identification:
        held = hold_unexcited(chosen, regressor, factors.fit, *restricted, bodies=bodies)
        return _Run(
            model, regressor, held, recordings, tuning, options, factors, blocks, held_out, tell, nuisances
        ).result()

    try:
        identification = result(bodies=True)
    except InconsistentEstimateError:  # no body may have what the recording tells and what the robot file says
        identification = result(bodies=False)
    return replace(identification, repairs=tuple(recording.repairs for recording in recordings), friction=friction)


def check_loops(model: RigidModel, recordings: Sequence[Recording]) -> None:
    """Raise :class:`InputError` for recorded positions at which closed loops of ``model`` cannot be assembled."""
    status = loop_status(model)
    if status is None:
        return
    for recording in recordings:
        for part in recording.parts():
            opened = np.flatnonzero(status(part.q) == NOT_ASSEMBLED.code)
            if len(opened):
                raise InputError(
                    f"closed loops cannot be assembled at {len(opened)} of {len(part)} recorded positions, first at t "
                    f"= {part.t[opened[0]]:.6g} s: check zeros, signs and units of the joints, and the lengths in the "
                    "robot file"
                )


def refit(
    identification: Identification,
    recordings: Sequence[Recording],
    options: Options,
    blocks: Sequence[Rows],
    held_out: Sequence[Rows],
    friction: FrictionFit | None,
    progress: Progress | None = None,
) -> Identification:
    """Repeat the ``identification`` with other rows for the same parameters, such as those of a simulated loop.

    ``blocks`` are the rows to fit, ``held_out`` those to score only, ``friction`` the laws with changed shapes.
    """
    regressor, chosen = identification.regressor, identification.parametrisation
    assert regressor is not None and chosen is not None  # noqa: PT018
    if friction is not None:
        regressor = replace(regressor, surfaces=friction.surfaces)
    factors = Factors(factor_blocks(blocks), factor_blocks(held_out))
    settings = replace(options, split=identification.split)
    tell: Progress = progress or (lambda done, total, message: None)
    run = _Run(
        regressor.model, regressor, chosen, recordings, identification.tuning, settings, factors, blocks, held_out, tell
    )
    return replace(
        run.result(),
        repairs=identification.repairs,
        friction=friction,
        diagnoses=identification.diagnoses,
        swinging=identification.swinging,
    )


def _linear_terms(model: RigidModel, options: Options) -> DriveTerms:
    """The drive terms to estimate, with linear friction where the robot file states another law."""
    return with_linear_friction(options.terms or DriveTerms.of_spec(model.spec), model.spec)


def _with_friction(
    model: RigidModel, recordings: Sequence[Recording], tuning: Tuning, options: Options, tell: Progress
) -> tuple[FullRegressor, Tuning, FrictionFit | None]:
    """Build the regressor with the requested friction laws, their shape parameters fitted to the training data.

    Nonlinear laws also describe slow motion, so the returned tuning then keeps samples at low speed.
    """
    terms = _linear_terms(model, options)
    slow = tuning.processing.low_speed
    every = replace(tuning, processing=replace(tuning.processing, low_speed=()), low_speed=slow)
    fit = fit_friction(
        model,
        recordings,
        every.processing,
        terms,
        options.friction,
        options.split,
        options.known,
        lambda message: tell(0, 0, message),
    )
    if fit is None:
        return FullRegressor(model, terms), tuning, None
    return FullRegressor(model, without_laws(terms, fit.surfaces), fit.surfaces, fit.load), every, fit


class _Run:
    """Computes all estimates and scores from the triangular factors of the rows."""

    def __init__(
        self,
        model: RigidModel,
        regressor: FullRegressor,
        chosen: Parametrisation,
        recordings: Sequence[Recording],
        tuning: Tuning,
        options: Options,
        factors: Factors,
        blocks: Iterable[Rows],
        held_out: Iterable[Rows],
        tell: Progress,
        nuisances: Nuisances | None = None,
    ) -> None:
        self.model, self.regressor, self.chosen = model, regressor, chosen
        self.recordings, self.tuning = recordings, tuning
        self.options, self.factors, self.tell = options, factors, tell
        self.blocks, self.held_out, self.nuisances = blocks, held_out, nuisances

    def result(self) -> Identification:
        options, chosen = self.options, self.chosen
        reduced = chosen.transform(self.factors.fit).without_round_off()
        estimate = self.least_squares_estimate(reduced)
        theta = chosen.expand(estimate.x)
        iid_std = estimate.std
        self.tell(0, 0, "statistics of the residuals")
        white = residual_whiteness(self.blocks, theta) if options.correlated else ()
        robust = options.method == "robust"
        limit, nuisances = HUBER if robust else None, self.nuisances
        lags = 0
        if options.correlated and estimate.relative_error > 1e-9:
            lags = max(correlation_lags(w) for w in white)
        if nuisances is not None:
            r = chosen.structure.rank
            plain, covariance = nuisances.covariances(estimate, chosen, lags, limit)
            iid_std = np.sqrt(np.maximum(np.diag(plain)[:r], 0.0))
            estimate = replace(estimate, covariance=covariance[:r, :r])
            nuisances = replace(nuisances, std=np.sqrt(np.maximum(np.diag(covariance)[r:], 0.0)))
        elif lags:
            covariance = correlated_covariance(self.blocks, estimate, lags, chosen.expand, chosen.T, limit)
            estimate = replace(estimate, covariance=covariance)
        rows = robust_rows(self.blocks, theta, estimate) if robust else None
        consistent = self.consistent_estimate(estimate, rows) if options.consistent else None
        essential = None
        if options.essential:
            self.tell(0, 0, "essential parameters")
            inflation = max((w.inflation for w in white), default=1.0)
            essential = essential_parameters(reduced, chosen.structure.names, samples_per_independent=inflation)
        factors = reduced if rows is None else chosen.transform(rows)
        delivered = Delivered.of(estimate, consistent, factors, chosen, options, len(self.model.base_projection))
        final = theta if consistent is None else consistent.theta
        scatter = np.array(score(self.factors.fit, final)["joint_rms"])
        band = TorqueBand.of(final, chosen.T, delivered.covariance, scatter)
        if isinstance(self.blocks, list) and estimate.relative_error > 1e-9:  # in memory: the rows are read once more
            band = conformal_band(band, self.blocks, estimate, chosen, options.seed)
        return Identification(
            columns=self.regressor.columns,
            structure=chosen.structure,
            estimate=estimate,
            iid_std=iid_std,
            theta=theta,
            tuning=self.tuning,
            split=options.split,
            fitted=fingerprint(self.recordings, options.split),
            scores=self.scores(theta, consistent),
            fit=score(self.factors.fit, theta),
            held_out=score(self.factors.score, theta),
            whiteness=white,
            consistent=consistent,
            consistent_fit=None if consistent is None else score(self.factors.fit, consistent.theta),
            consistent_held_out=None if consistent is None else score(self.factors.score, consistent.theta),
            essential=essential,
            indefinite=self.indefinite(theta, consistent),
            structural_notes=chosen.structure.in_words(),
            delivered=delivered,
            band=band,
            units=identified_units(chosen.structure, self.regressor.columns, chosen.free, self.model),
            meanings=explained_names(chosen.structure.names, self.regressor.columns, self.model),
            hardly_determined=collinear(reduced, estimate),
            motion_notes=(
                *standing_sentences(self.standing),
                *chosen.notes,
                *unexcited_parameters(reduced, chosen.structure.names, estimate.weights),
            ),
            weak=weak_directions(reduced, chosen.structure.names, estimate.weights),
            blocks=self.blocks,
            held_out_blocks=self.held_out,
            parametrisation=chosen,
            regressor=self.regressor,
            nuisances=nuisances,
        )

    @property
    def standing(self) -> tuple[str, ...]:
        """Names of the joints of which no row is left: they stand, or are never as fast as rows have to be."""
        if on_floating_base(self.recordings):  # whose wrench stands for torques that may be missing
            return ()
        counts = zip(self.recordings[0].joints, self.factors.fit.counts, strict=True)
        return tuple(joint for joint, count in counts if count == 0)

    def least_squares_estimate(self, reduced: JointFactors) -> Estimate:
        names = self.chosen.structure.names
        self.tell(0, 0, f"{self.options.method} least squares")
        if self.options.method == "ordinary":
            return least_squares(reduced, names)
        weighted = weighted_least_squares(reduced, names)
        if self.options.method == "weighted":
            return weighted
        if self.options.method != "robust":
            raise InputError(f"unknown method '{self.options.method}'; there are {', '.join(METHODS)}")
        chosen = self.chosen
        return robust_least_squares(
            lambda: self.blocks, names, weighted, transform=chosen.transform, expand=chosen.expand
        )

    def consistent_estimate(self, estimate: Estimate, robust: JointFactors | None = None) -> ConsistentEstimate:
        """Physically consistent estimate from the rows and weights of ``estimate``, or from the ``robust`` rows."""
        self.tell(0, 0, "physically consistent estimate")
        options, fit = self.options, self.factors.fit
        columns = self.regressor.columns
        b, known = len(self.model.base_parameter_names), np.zeros(len(columns))
        held = list(self.chosen.held_from(b))
        known[held] = self.chosen.known[held]
        free = [i for i in range(len(columns)) if i not in held]
        kept = {column.name: float(value) for column, value in zip(columns, self.chosen.known, strict=True)}
        bodies = {name: kept[name] for name in self.chosen.unexcited} | dict(options.fixed)
        rms = float(np.sqrt(np.sum(fit.torque_squares) / np.sum(fit.counts)))
        prior = options.prior or default_prior(self.model.spec, rms, options.prior_strength)
        T = np.eye(len(columns))[:, free]
        optimum = consistent_estimate(
            self.model,
            (fit if robust is None else robust).substitute(T, known),
            [columns[i] for i in free],
            estimate.weights if robust is None else np.ones(self.model.n),
            prior,
            reference=estimate,
            known=KnownParameters.of(self.model, bodies, options.fixed_standard),
            scored=None if robust is None else fit.substitute(T, known),
        )
        theta, names = T @ optimum.theta + known, self.regressor.names
        drives = {name: float(value) for name, value in zip(names[b:], theta[b:], strict=True)}
        return replace(optimum, theta=theta, names=names, drives=drives)

    def scores(self, theta: Array, consistent: ConsistentEstimate | None) -> tuple[Score, ...]:
        """Scores of every estimate on fitted rows, on all rows and on unfiltered torques, in sample and held out."""
        self.tell(0, 0, "scores on all samples")
        estimates = {self.options.method: theta} | ({} if consistent is None else {"consistent": consistent.theta})
        stacked = np.column_stack(list(estimates.values()))

        def torques(q: Array, dq: Array, ddq: Array, s: Array | None = None) -> Array:
            return np.asarray(self.regressor(q, dq, ddq, s) @ stacked)

        return score_models(
            tuple(estimates),
            torques,
            self.recordings,
            self.tuning,
            self.options.split,
            known=self.options.known,
            columns=len(self.regressor.columns),
            sliding=self.regressor.sliding,
        )

    def indefinite(self, theta: Array, consistent: ConsistentEstimate | None) -> dict[str, float]:
        """Share of random poses at which M(q) is indefinite, for each estimate."""
        self.tell(0, 0, "mass matrix at random poses")
        given = self.options.limits
        limits = pose_limits(self.model.spec, self.model.n) if given is None else given
        estimates = {self.options.method: theta} | ({} if consistent is None else {"consistent": consistent.theta})
        shares: dict[str, float] = {}
        for name, values in estimates.items():
            mass = partial(mass_matrix, self.model, self.regressor.columns, values)
            drawn = limits[0], limits[1], self.options.poses, self.options.seed
            shares[name], _ = indefinite_share(mass, *drawn, assembly_mask(self.model))
        return shares
