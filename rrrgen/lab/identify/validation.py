"""Validation: compares the torques of an identified model with the recorded ones, joint by joint, and gives a verdict.

The model is evaluated along the reconstructed motion (Fig. 14.4, Fig. 14.13). The result states whether the recording
was held out or was used in the fit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError, option_name
from rrrgen.base.tables import text_table
from rrrgen.lab.data.preprocessing import Decimator, Processing
from rrrgen.lab.estimate.remainder import Errors, Piece, Remainder, remainder_notes, remainder_record, remainders
from rrrgen.lab.estimate.statistics import relative_error, rms
from rrrgen.lab.estimate.tsqr import Rows
from rrrgen.lab.identify.bandwidth import Tuning, reach, tune
from rrrgen.lab.identify.factoring import ScoredRows, no_rows
from rrrgen.lab.identify.friction_columns import FrictionSurface, Sliding, law_columns, stated_laws
from rrrgen.lab.identify.held_out_data import Split
from rrrgen.lab.identify.observations import Observations, Recording, RowMaker, require_torques
from rrrgen.lab.identify.scores import MAIN_LOBE, OWN, UNKNOWN, Label, Score, filter_reach, score_models
from rrrgen.robot.model.drives import friction_terms
from rrrgen.runtime.regressor_columns import drive_columns

TorqueModel = Callable[..., Array]
"""Motion (q, dq, ddq), (N, n) each, to joint torques (N, n); with an attribute ``sliding`` also the states of friction.
"""


@dataclass(frozen=True)
class Thresholds:
    """Upper limits that a model must meet to pass; None switches a criterion off.

    - ``relative_error``: ``|tau - tau_model| / |tau|`` over all joints; ``joint_relative_error``: the same per joint.
    - ``beyond_noise``: ``sqrt(max(error^2 - noise^2, 0))`` over the RMS torque per joint, for a known noise.
    - ``indefinite_share``: share of random poses with an indefinite mass matrix.
    - ``require_held_out``: the data must be known not to have been fitted.
    """

    relative_error: float | None = 0.1
    joint_relative_error: float | None = None
    beyond_noise: float | None = None
    indefinite_share: float | None = 0.0
    require_held_out: bool = False


@dataclass(frozen=True)
class JointScore:
    """Torque error at one joint: RMS torque, RMS error and largest error, N m (N), and relative error, RMS over RMS.

    ``beyond_noise`` is ``sqrt(max(error^2 - noise^2, 0))`` over the RMS torque, None if the noise is unknown;
    ``samples`` is the number of samples scored and ``share`` their share of the recording. ``relative_error_all`` is
    the relative error over the whole recording, including rest, where static friction is not determined by the motion.
    """

    joint: str
    rms_torque: float
    rms_error: float
    max_error: float
    relative_error: float
    beyond_noise: float | None
    samples: int
    share: float
    relative_error_all: float


@dataclass(frozen=True, eq=False)
class Validation:
    """Result of a validation: scores, verdict, and the torque curves ``measured`` and ``predicted`` (N, n) at ``t``.

    ``joints`` are the scores joint by joint; ``relative_error`` is that of the ``used`` (N, n) rows;
    ``indefinite_share`` is the share of random poses with an indefinite mass matrix, None if not tested. ``scores``
    also holds the errors on all rows and on unfiltered torques. ``label`` states whether the data were held out;
    ``failures`` lists the thresholds missed, empty if the model passes. ``tuning`` describes the filters, None if
    torques were compared as given; ``split`` the part of the recordings that was scored. ``left`` is what noise does
    not explain in data that were not fitted, joint by joint.
    """

    joints: tuple[JointScore, ...]
    relative_error: float
    indefinite_share: float | None
    label: Label
    failures: tuple[str, ...]
    t: Array
    measured: Array
    predicted: Array
    used: NDArray[np.bool_]
    scores: tuple[Score, ...] = ()
    tuning: Tuning | None = None
    split: Split = field(default_factory=Split)
    left: tuple[Remainder, ...] = ()

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on what is left in the torques of data that were not fitted."""
        return remainder_notes(self.left)

    @property
    def share(self) -> float:
        """Share of all rows on which ``relative_error`` was measured."""
        return float(np.mean(self.used))

    @property
    def where(self) -> str:
        """The data and rows that ``relative_error`` refers to, in words."""
        alone = ", with no row left out beside them" if self.tuning is not None else ""
        return f"{self.label}, {100 * self.share:.0f} % of the rows{alone}"

    @property
    def passed(self) -> bool:
        """Whether every threshold is met."""
        return not self.failures

    def to_json(self) -> dict[str, Any]:
        """The result without the curves, as plain data."""
        return {
            "passed": self.passed,
            "failures": list(self.failures),
            "scored_on": self.label,
            "part": None if self.split.kind == "none" else str(self.split),
            "relative_error": self.relative_error,
            "measured_on": self.where,
            "share": self.share,
            "scores": [{"measured_on": score.where, **vars(score)} for score in self.scores],
            "bandwidth": None if self.tuning is None else self.tuning.to_json(),
            "indefinite_mass_matrix_share": self.indefinite_share,
            "held_out_notes": list(self.notes),
            "held_out_remainder": remainder_record(self.left),
            "joints": [vars(score) for score in self.joints],
        }


def score_torques(
    t: Array,
    measured: Array,
    predicted: Array,
    *,
    joints: Sequence[str],
    used: NDArray[np.bool_] | None = None,
    noise: Sequence[float] | None = None,
    label: Label = UNKNOWN,
    indefinite: float | None = None,
    thresholds: Thresholds | None = None,
) -> Validation:
    """Score ``predicted`` torques against ``measured`` ones, (N, n) each, at the times ``t`` (N,).

    ``joints`` are the n joint names; ``used`` (N, n) is False for samples to leave out, such as invalid torques or a
    joint near rest; ``noise`` (n,) is the standard deviation of the measured torque; ``label`` states the origin of the
    data; ``indefinite`` is the share of poses with an indefinite mass matrix. Raises InputError if shapes differ or no
    sample is left at a joint.
    """
    tau, model = np.asarray(measured, dtype=float), np.asarray(predicted, dtype=float)
    use = np.ones(tau.shape, bool) if used is None else np.asarray(used, dtype=bool)
    if model.shape != tau.shape or use.shape != tau.shape:
        raise InputError(f"validation: torques of shape {tau.shape} against a model's {model.shape}")
    idle = [name for name, column in zip(joints, use.T, strict=True) if not column.any()]
    if idle:
        raise InputError(f"validation: no sample is left to score joint {', '.join(idle)}")
    scores = tuple(
        _joint_score(name, tau[:, i], model[:, i], use[:, i], None if noise is None else noise[i])
        for i, name in enumerate(joints)
    )
    total = relative_error(tau[use], model[use])
    failures = _failures(thresholds if thresholds is not None else Thresholds(), scores, total, indefinite, label)
    return Validation(scores, total, indefinite, label, failures, np.asarray(t), tau, model, use)


def validate(torque_model: TorqueModel, motion: Any, measured: Array, **options: Any) -> Validation:
    """Score ``torque_model`` along a known ``motion`` (t, q, dq, ddq) against ``measured`` torques (N, n).

    ``options`` are the keyword arguments of :func:`score_torques`.
    """
    return score_torques(motion.t, measured, torque_model(motion.q, motion.dq, motion.ddq), **options)


def validate_recordings(
    torque_model: TorqueModel,
    recordings: Sequence[Recording],
    processing: Processing,
    *,
    noise: Sequence[float] | None = None,
    split: Split | None = None,
    guard: float | None = None,
    **options: Any,
) -> Validation:
    """Score ``torque_model`` on recordings that are preprocessed exactly as for identification.

    The motion is reconstructed, and the torque of the model passes the same decimation filter as the measured one.
    Samples below the lowest speed or with an invalid torque are left out, together with their neighbours within the
    main lobe of the filter. Settings that ``processing`` leaves None are chosen from the bandwidth of these recordings.
    ``noise`` (n,) is the standard deviation of the *recorded* torque, from which that of the filtered torque follows.
    With a ``split``, only the part that it holds out is scored, at ``guard`` s from its borders (the reach of the
    filters if None). ``options`` are the other keyword arguments of :func:`score_torques`.
    """

    def as_column(*motion: Array) -> Array:
        return np.asarray(torque_model(*motion))[..., None]

    sliding = getattr(torque_model, "sliding", None)

    require_torques(recordings)
    tuning = tune(processing, recordings)
    chosen = tuning.processing
    split = split or Split()
    if split.kind != "none":
        split = split.with_guard(reach(tuning) if guard is None else guard)
    observations = Observations(tuple(recordings), RowMaker(as_column, chosen, 1, sliding=sliding))
    blocks = list(observations if split.kind == "none" else ScoredRows(observations, split))
    if not blocks:
        raise no_rows(observations)
    held_out = split.kind != "none"
    used = _undisturbed_samples(blocks, chosen.decimate or 1)
    idle = [name for name, column in zip(recordings[0].joints, used.T, strict=True) if not column.any()]
    if held_out and idle:
        raise InputError(
            f"no sample of {', '.join(idle)} is left to score ({split}): choose another {option_name('split')}, or a "
            f"smaller {option_name('guard')}"
        )
    left = None if noise is None else [value * noise_gain(chosen.decimate or 1) for value in noise]
    result = score_torques(
        np.concatenate([rows.t for rows in blocks]),
        np.concatenate([rows.tau for rows in blocks]),
        np.concatenate([rows.W[..., 0] for rows in blocks]),
        used=used,
        joints=recordings[0].joints,
        noise=left,
        **options,
    )
    labels = ("the part left out of the scores", result.label) if held_out else (result.label, "held out")
    scores = score_models(("model",), as_column, recordings, tuning, split, labels=labels, sliding=sliding)
    scores = tuple(score for score in scores if score.data == result.label)
    remaining: tuple[Remainder, ...] = ()
    if result.label != OWN:
        errors = np.where(result.used, result.measured - result.predicted, np.nan)
        piece = Piece(result.t, result.measured, errors, np.concatenate([rows.segment for rows in blocks]))
        remaining = remainders(Errors.of([piece], filter_reach(tuning)), None, recordings[0].joints)
    return replace(result, tuning=tuning, scores=scores, split=split, left=remaining)


def _undisturbed_samples(blocks: Sequence[Rows], decimate: int) -> NDArray[np.bool_]:
    """Mask (N, n) of the samples in use whose neighbours within the main lobe of the filter are in use too."""
    use = np.concatenate([rows.use for rows in blocks])
    segment = np.concatenate([rows.segment for rows in blocks])
    kept = use.copy()
    for shift in range(1, 1 + (MAIN_LOBE if decimate > 1 else 0)):
        together = (segment[shift:] == segment[:-shift])[:, None]
        kept[shift:] &= use[:-shift] | ~together
        kept[:-shift] &= use[shift:] | ~together
    return kept


def noise_gain(decimate: int) -> float:
    """Standard deviation of unit white noise after the decimation filter of factor ``decimate``."""
    filtered = Decimator(decimate)
    middle = filtered.memory
    taps = filtered(np.eye(2 * middle + 1))[middle // decimate]
    return float(np.linalg.norm(taps))


def _joint_score(
    joint: str, measured: Array, predicted: Array, use: NDArray[np.bool_], noise: float | None
) -> JointScore:
    known = np.isfinite(measured) & np.isfinite(predicted)
    tau, difference = measured[use], measured[use] - predicted[use]
    size, error = float(rms(tau)), float(rms(difference))
    beyond = None if noise is None else float(np.sqrt(max(error**2 - noise**2, 0.0))) / max(size, 1e-300)
    return JointScore(
        joint=joint,
        rms_torque=size,
        rms_error=error,
        max_error=float(np.abs(difference).max()),
        relative_error=relative_error(measured[use], predicted[use]),
        beyond_noise=beyond,
        samples=int(tau.size),
        share=tau.size / measured.size,
        relative_error_all=relative_error(measured[known], predicted[known]) if known.any() else float("nan"),
    )


def _failures(
    asked: Thresholds, scores: Sequence[JointScore], total: float, share: float | None, label: Label
) -> tuple[str, ...]:
    failures = []
    if asked.relative_error is not None and not total <= asked.relative_error:
        failures.append(f"relative error {100 * total:.3g} % exceeds {100 * asked.relative_error:.3g} %")
    for score in scores:
        if asked.joint_relative_error is not None and not score.relative_error <= asked.joint_relative_error:
            allowed = 100 * asked.joint_relative_error
            failures.append(f"{score.joint}: relative error {100 * score.relative_error:.3g} % exceeds {allowed:.3g} %")
        if (
            asked.beyond_noise is not None
            and score.beyond_noise is not None
            and score.beyond_noise > asked.beyond_noise
        ):
            allowed = 100 * asked.beyond_noise
            failures.append(
                f"{score.joint}: error beyond noise {100 * score.beyond_noise:.3g} % exceeds {allowed:.3g} %"
            )
    if asked.indefinite_share is not None and share is not None and share > asked.indefinite_share:
        failures.append(f"M(q) is indefinite at {100 * share:.3g} % of random poses")
    if asked.require_held_out and label != "held-out data":
        failures.append(f"the model is scored on {label}")
    return tuple(failures)


def column_model(regressor: Callable[[Array, Array, Array], Array], theta: Array) -> TorqueModel:
    """Torque model ``tau = W(q, dq, ddq) theta`` from a regressor and the parameters ``theta`` (p,) of its columns."""

    def torque(q: Array, dq: Array, ddq: Array) -> Array:
        return np.asarray(regressor(q, dq, ddq) @ theta)

    return torque


@dataclass(frozen=True, eq=False)
class RobotTorque:
    """Torque model of a compiled robot as its file describes it: inverse dynamics plus friction.

    Friction is computed from regressor columns of ``terms`` and ``surfaces`` with the parameters ``values``. In them
    the sign of a speed near zero is zero, so that round-off of a reconstructed speed causes no friction. Laws with
    a state are evaluated in steady sliding when no state is given.
    """

    model: Any
    terms: tuple[Any, ...]
    surfaces: tuple[FrictionSurface, ...]
    values: Array

    @property
    def sliding(self) -> Sliding | None:
        """The object that computes the states of the friction laws along a motion; None if no law has a state."""
        return Sliding.of(self.surfaces)

    def __call__(self, q: Array, dq: Array, ddq: Array, s: Array | None = None) -> Array:
        """Joint torques (N, n), N m (N), at N times; ``q``, ``dq``, ``ddq`` are (N, n), in rad (m) and seconds.

        ``s`` (N, m) are the directions (-1 to 1) of the m friction laws with a state, None for steady sliding.
        """
        speeds = np.asarray(dq, dtype=float)
        drives = drive_columns(self.terms, speeds, np.asarray(ddq, dtype=float))
        torque = self.model.inverse_dynamics(q, dq, ddq)
        columns = np.concatenate([drives, law_columns(self.surfaces, speeds, s, torque)], axis=-1)
        return np.asarray(torque + columns @ self.values)


def robot_model(model: Any) -> RobotTorque:
    """Build the torque model of a compiled robot, with links, drives and friction of its file."""
    terms = friction_terms(model.spec)
    values = [term.value for term in terms]
    stated = stated_laws(model.spec)
    for surface, law in stated:
        values += surface.definition.split(law.values)[0]
    return RobotTorque(model, terms, tuple(surface for surface, _ in stated), np.array(values, dtype=float))


def joint_scores(result: Validation, units: Sequence[str], width: int | None = None) -> list[str]:
    """Lines of a table with one row per joint: RMS torque and error in ``units`` (n,), relative errors, samples scored.

    It is folded to lines of ``width`` characters; None: lines of any length.
    """
    noisy = any(score.beyond_noise is not None for score in result.joints)
    beyond = ("beyond noise",) if noisy else ()
    rows = [("joint", "RMS torque", "RMS error", "relative error", *beyond, "error, all rows", "samples", "share")]
    for score, unit in zip(result.joints, units, strict=True):
        excess = "-" if score.beyond_noise is None else f"{100 * score.beyond_noise:.4g} %"
        rows.append(
            (
                score.joint,
                f"{score.rms_torque:.4g} {unit}",
                f"{score.rms_error:.4g} {unit}",
                f"{100 * score.relative_error:.4g} %",
                *((excess,) if noisy else ()),
                f"{100 * score.relative_error_all:.4g} %",
                str(score.samples),
                f"{100 * score.share:.3g} %",
            )
        )
    return text_table(rows, width, indent="", right=range(1, len(rows[0])))


def plot_torques(result: Validation, units: Sequence[str] | None = None) -> Any:
    """Figure of applied and modelled torque of every joint over time, with the residual below (Fig. 14.13).

    ``units`` (n,) are those of the torques, N m by default.
    """
    from rrrgen.lab.identify.figures import TorqueCurves, plot_torque_curves

    known = list(units or ["N m"] * len(result.joints))
    titles = [
        f"{score.joint}: error {score.rms_error:.3g} {unit} RMS, {100 * score.relative_error:.2f} % "
        f"on {100 * score.share:.0f} % of the samples"
        for score, unit in zip(result.joints, known, strict=True)
    ]
    curves = TorqueCurves(result.t, result.measured, result.predicted, result.used)
    return plot_torque_curves(curves, [score.joint for score in result.joints], known, titles)
