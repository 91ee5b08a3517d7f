"""Estimates a payload on a known arm: mass, centre of mass and inertia from one recording.

The payload is a body fixed to the last link. The measured torques less those of the robot without it are linear in its
standard parameters phi: ``tau - tau_robot = W_n phi``, with W_n the last link's columns of the standard regressor. The
estimate is physically consistent (14.9). Friction may have changed since the arm was identified, with temperature and
load; corrections of viscous friction, Coulomb friction and offset are therefore estimated with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError, InputError
from rrrgen.derive.parameters.physical_links import Prior
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.estimate.identifiability import structure_of
from rrrgen.lab.estimate.linear import solve
from rrrgen.lab.estimate.regression import Estimate, correlated_covariance, weighted_least_squares
from rrrgen.lab.estimate.statistics import correlation_lags, residual_whiteness
from rrrgen.lab.identify.bandwidth import Tuning, tune
from rrrgen.lab.identify.consistency import ConsistentEstimate, consistent_estimate
from rrrgen.lab.identify.observations import Recording, RowMaker
from rrrgen.lab.identify.parameters import Column, DriveTerms
from rrrgen.lab.identify.regressor import assembly_mask
from rrrgen.lab.identify.rows import body_columns, deviations, factors_and_blocks, inertial, slow_samples
from rrrgen.lab.identify.scores import UNEXPLAINED, WORSE, not_explained
from rrrgen.lab.identify.validation import robot_model
from rrrgen.robot.spec import STANDARD, RobotSpec, link_of, standard_parameters
from rrrgen.runtime.regressor_columns import drive_columns

NAMES = ("mass", "com_x", "com_y", "com_z", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
UNITS = ("kg", "m", "m", "m", *["kg m^2"] * 6)
PRIOR_RADIUS = 0.1  # m, radius of gyration of the prior, which determines what the motion does not
CERTAIN = 0.5  # relative standard deviation of the mass above which there is no estimate
LOOSE = 1e-4  # share of a value in combinations that the torques do not contain, above which these leave it open
SIGNIFICANT = 4.0  # deviations below 0 at which the mass of the unconstrained estimate counts as negative
NOTICEABLE = 1.1  # ratio of torque errors above which the motion tells that mass, and not the choice among equal ones
SHARE = 1e-4  # of the RMS torque: a payload with smaller torques counts as none


@dataclass(frozen=True, eq=False)
class Payload:
    """Estimated payload in the frame of the last link, not that of the tool, with standard deviations.

    ``values``, ``std`` (10,): mass, centre of mass, inertia tensor about it, in the order of :data:`NAMES`; ``phi``
    (10,): standard parameters. ``undetermined``: names of the values that the motion does not determine; they are those
    of a small sphere. ``error_without``, ``error_with``: relative torque errors of the robot file alone and with the
    payload. ``friction``: corrections of friction parameters by name. ``notes``: sentences on what is left out and on
    what no motion of this arm can determine. ``tuning``: the filters.
    """

    values: Array
    std: Array
    phi: Array
    undetermined: tuple[str, ...]
    error_without: float
    error_with: float
    friction: dict[str, float]
    notes: tuple[str, ...]
    tuning: Tuning

    def lines(self) -> list[str]:
        """A table of the values with their deviations, and the errors, as text."""
        lines = [
            f"{'payload':>8} {'unit':<7} {'value':>12} {'std':>9}   in the frame of the last link, before the tool"
        ]
        for name, unit, value, std in zip(NAMES, UNITS, self.values, self.std, strict=True):
            mark = "   assumed: not determined by this recording" if name in self.undetermined else ""
            lines.append(f"{name:>8} {unit:<7} {value:12.6g} {std:9.2e}{mark}")
        lines.append("Ixx..Iyz: tensor about the centre of mass, Ixy = -int xy dm")
        lines += [f"correction of friction: {name} = {value:.3g}" for name, value in self.friction.items()]
        before, after = 100 * self.error_without, 100 * self.error_with
        lines.append(f"relative torque error: {before:.3g} % without the payload, {after:.3g} % with it")
        return [*lines, *(f"note: {note}" for note in self.notes)]

    def to_json(self) -> dict[str, Any]:
        """The payload, errors and notes as plain data for JSON."""
        return {
            "values": dict(zip(NAMES, self.values, strict=True)),
            "std": dict(zip(NAMES, self.std, strict=True)),
            "undetermined": list(self.undetermined),
            "standard_parameters": dict(zip(STANDARD, self.phi, strict=True)),
            "frame": "last link, before the tool",
            "relative_error_without": self.error_without,
            "relative_error": self.error_with,
            "friction_corrections": self.friction,
            "notes": list(self.notes),
            "bandwidth": self.tuning.to_json(),
        }

    def carried_by(self, spec: RobotSpec) -> RobotSpec:
        """Copy of the robot ``spec`` with the payload added to its last link."""
        assert spec.links is not None
        i = spec.tip_row
        last = np.array([float(value) for value in standard_parameters(spec.links[i])]) + self.phi
        description = f"{spec.description or spec.name}, with a payload of {self.values[0]:.4g} kg"
        return replace(spec, links=(*spec.links[:i], link_of(last), *spec.links[i + 1 :]), description=description)


@dataclass(frozen=True)
class _Body:
    """Model of a single rigid body whose base parameters are its standard parameters.

    It lets the physically consistent estimation, which expects a robot model, estimate a payload.
    """

    n: int = 1
    spec: Any = None
    base_parameter_names: tuple[str, ...] = STANDARD

    @property
    def base_projection(self) -> Array:
        return np.eye(len(STANDARD))


def identify_payload(
    model: Any, recordings: Sequence[Recording], processing: Processing, correct_friction: bool = True
) -> Payload:
    """Estimate the payload of the compiled robot ``model``, whose file states its links, from ``recordings``.

    ``correct_friction`` also estimates corrections of friction. Raises InputError for a robot without links and for
    recordings that do not fit it, DerivationError if no payload explains the torques or the motion does not determine
    its mass.
    """
    if model.spec.links is None:
        raise InputError("the robot file has no links: a payload needs a known arm")
    n = model.n
    for recording in recordings:
        if len(recording.joints) != n:
            raise InputError(f"a recording of {len(recording.joints)} joints for a robot with {n}")
    tuning = tune(processing, recordings)
    slow = slow_samples(model, recordings, tuning.processing)
    torque = robot_model(model)
    kinds: tuple[Any, ...] = ("viscous", "coulomb", "offset") if correct_friction else ()
    corrections = DriveTerms.everywhere(n, *kinds).columns(n)
    columns = [*(Column(name, "rigid") for name in STANDARD), *(replace(c, kind="offset") for c in corrections)]

    def regressor(q: Array, dq: Array, ddq: Array, s: Array | None = None) -> Array:
        friction = drive_columns(corrections, np.asarray(dq, float), np.asarray(ddq, float))
        known = torque(q, dq, ddq, s)[..., None]
        return np.concatenate([body_columns(model, q, dq, ddq), friction, known], axis=-1)

    p = len(columns)
    maker = RowMaker(regressor, tuning.processing, p + 1, sliding=torque.sliding, slow=slow.speeds)
    factors, blocks = factors_and_blocks(recordings, maker)
    free = factors.select_columns(range(p), {p: 1.0}).without_round_off()
    names = [column.name for column in columns]
    estimate = weighted_least_squares(free, names)
    to_all, known = np.eye(p + 1)[:, :p], np.eye(p + 1)[p]

    def expand(x: Array) -> Array:
        return np.asarray(to_all @ x + known)

    total = float(np.sum(factors.torque_squares))
    if not total > 0.0:
        raise DerivationError("all torques of the recordings are zero, or none of them is valid")

    def error_of(x: Array) -> float:
        return float(np.sqrt(np.sum(factors.residual_squares(x)) / total))

    if (least := error_of(expand(estimate.x))) > UNEXPLAINED:
        raise DerivationError(not_explained("no payload explains the torques", [least]))
    white = residual_whiteness(blocks, expand(estimate.x))
    if estimate.relative_error > 1e-9:
        lags = max(correlation_lags(w) for w in white)
        estimate = replace(estimate, covariance=correlated_covariance(blocks, estimate, lags, expand, to_all))
    size = float(np.sqrt(np.sum(factors.torque_squares) / np.sum(factors.counts)))
    body: Any = _Body()
    optimum = consistent_estimate(body, free, columns, estimate.weights, _prior(estimate, size), reference=estimate)
    R = free.stack(estimate.weights)[:-1, :-1]
    phi = optimum.theta[: len(STANDARD)]
    values, std = inertial(phi), deviations(inertial, phi, _covariance(optimum, estimate, R))
    alone_std = _deviations_of_the_data(phi, estimate, R)
    assumed = ~(alone_std <= _largest_deviations(values))
    undetermined = tuple(name for name, prior in zip(NAMES, assumed, strict=True) if prior)
    error, alone = error_of(expand(optimum.theta)), error_of(known)
    _refuse_impossible_payload(float(estimate.x[0]), float(estimate.std[0]), least, error, alone)
    if assumed[0] or values[0] * 9.81 * PRIOR_RADIUS < SHARE * size:
        known_to = (
            f"{values[0]:.3g} +- {alone_std[0]:.2g} kg"
            if np.isfinite(alone_std[0])
            else "the torques tell it only together with the centre of mass and inertia"
        )
        raise DerivationError(
            f"the mass of the payload is not determined: {known_to}, and the torque error {100 * alone:.3g} % without "
            f"a payload is {100 * error:.3g} % with it; is there one, and do joints move "
            + "; ".join(("that carry its weight?", *slow.sentences()))
        )
    structure = structure_of(lambda *motion: body_columns(model, *motion), STANDARD, n, possible=assembly_mask(model))
    moving = factors.counts > 0
    corrected = zip(corrections, optimum.theta[len(STANDARD) :], strict=True)
    friction = {column.name: float(value) for column, value in corrected if moving @ np.abs(column.direction)}
    never = (f"payload: {sentence}, whatever the motion of this arm" for sentence in structure.in_words())
    notes = (*slow.sentences(), *never)
    return Payload(values, std, phi, undetermined, alone, error, friction, notes, tuning)


def _refuse_impossible_payload(mass: float, std: float, least: float, error: float, alone: float) -> None:
    """Raise DerivationError where parameters that no body has explain the torques, and those of bodies do not.

    ``mass`` (kg) with its deviation ``std`` is that of the unconstrained estimate. The relative torque errors are
    ``least`` with it, ``error`` with the physically consistent estimate, ``alone`` without a payload.
    """
    negative = mass < -SIGNIFICANT * std and error > NOTICEABLE * least
    left, there = np.sqrt(max(error**2 - least**2, 0.0)), np.sqrt(max(alone**2 - least**2, 0.0))
    if negative or (error > WORSE * least and left > UNEXPLAINED * there):
        raise DerivationError(
            f"no payload explains the torques: {100 * error:.3g} % of them are left with the best one, and "
            f"{100 * least:.3g} % with parameters that no body has, among them a mass of {mass:.3g} +- {std:.2g} kg. "
            "Was the robot identified with a load that is not on now, and is all of the load on the last link?"
        )


def _prior(estimate: Estimate, torque: float) -> Prior:
    """Prior of the payload: a sphere at the origin of the link frame with the mass of the unconstrained estimate.

    That mass is raised to a thousandth of the mass whose weight, 1 m from an axis, causes the RMS ``torque`` (N m).
    """
    mass = max(float(estimate.x[0]), 1e-3 * torque / 9.81, 1e-6)
    return Prior(mass * np.diag([PRIOR_RADIUS**2] * 3 + [1.0])[None])


def _covariance(optimum: ConsistentEstimate, estimate: Estimate, R: Array) -> Array:
    """Covariance (10, 10) of the payload's standard parameters, with that of the prior and correlated residuals.

    ``R`` is the triangular factor of the weighted rows.
    """
    assert optimum.near is not None
    information = R.T @ R
    scores = information @ estimate.covariance @ information
    body = slice(len(STANDARD))
    return optimum.near.covariance(optimum.near.directions, scores, estimate.variance)[body, body]


def _deviations_of_the_data(phi: Array, estimate: Estimate, R: Array) -> Array:
    """Standard deviations (10,) that the torques alone leave to the values of the body ``phi`` (10,).

    They are infinite for values with a share in combinations of parameters that the rows, with the triangular factor
    ``R``, do not contain. The curvature of the prior does not tell: it grows without bound towards bodies that cannot
    be, which pins a value that the torques leave open, as if it were measured.
    """
    body = slice(len(STANDARD))
    size = np.linalg.norm(R, axis=0)
    size = np.where(size > 0.0, size, np.max(size))
    unseen = (solve(R / size, np.zeros(len(R))).weak / size)[:, body].T
    loose = deviations(inertial, phi, unseen @ unseen.T)
    whole = deviations(inertial, phi, np.diag(size[body] ** -2.0))
    return np.where(loose > LOOSE * whole, np.inf, deviations(inertial, phi, estimate.covariance[body, body]))


def _largest_deviations(values: Array) -> Array:
    """Deviations (10,) of the data above which the prior, rather than the data, determines the ``values`` (10,).

    For the centre of mass this is the size of the prior, for moments of inertia the value itself, and for products the
    largest that a body with these moments can have.
    """
    moments = values[4:7]
    products = np.sqrt([moments[i] * moments[k] for i, k in ((0, 1), (0, 2), (1, 2))])
    return np.concatenate([[CERTAIN * values[0]], [PRIOR_RADIUS] * 3, moments, products])
