"""Estimates unknown drive gains from two recordings, without and with a known payload.

The recorded torque or current I_j of joint j is its torque divided by an unknown gain: ``g_j I_j = W_j beta + b l_j``,
where l_j is the torque that the payload causes and b is 1 in the recording with it, 0 without. All parameters of the
arm are estimated together with the gains; only the payload sets the scale. The noise e_j is that of the currents, so
``I_j = (W_j beta + b l_j) / g_j + e_j`` is fitted by Gauss-Newton. A linear least-squares fit would have the noisy
currents among its columns and be biased.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

import numpy as np

from rrrgen.arrays import Array
from rrrgen.errors import DerivationError, InputError
from rrrgen.identify.estimation.full_regressor import FullRegressor
from rrrgen.identify.estimation.observations import Recording, RowMaker
from rrrgen.identify.estimation.statistics import residual_whiteness
from rrrgen.identify.estimation.structure import structure_of
from rrrgen.identify.estimation.tsqr import JointFactors, Rows
from rrrgen.identify.loads.rows import body_columns, factored
from rrrgen.identify.scoring.bandwidth import Tuning, tune
from rrrgen.model.estimated_terms import DriveTerms
from rrrgen.signals.processing import Processing

PASSES = 50
SETTLED = 1e-10  # relative change of the gains at which the iteration ends
LARGEST_STEP = 3.0  # factor by which a gain may change in one pass
CERTAIN = 0.2  # relative standard deviation above which a gain is not determined


@dataclass(frozen=True, eq=False)
class DriveGains:
    """Estimated drive gains of n joints: true divided by recorded torque, with standard deviations ``std`` (n,).

    ``relative_error`` is that of the model with these gains on the recorded torques, ``fallen_from`` that with all
    gains 1. ``tuning`` describes the filters.
    """

    joints: tuple[str, ...]
    gain: Array
    std: Array
    relative_error: float
    fallen_from: float
    tuning: Tuning

    def lines(self) -> list[str]:
        """The gains with their deviations as text."""
        lines = [
            f"{joint}: true torque = {gain:.5g} +- {std:.2g} times the recorded one"
            for joint, gain, std in zip(self.joints, self.gain, self.std, strict=True)
        ]
        before, after = 100 * self.fallen_from, 100 * self.relative_error
        lines.append(f"relative torque error: {after:.3g} % with these gains, {before:.3g} % with all gains 1")
        return [*lines, "in the mapping file, multiply the torque constant (or the unit) of each joint by its gain"]

    def to_json(self) -> dict[str, Any]:
        """The gains, errors and filters as plain data for JSON."""
        return {
            "gain": dict(zip(self.joints, self.gain, strict=True)),
            "std": dict(zip(self.joints, self.std, strict=True)),
            "relative_error": self.relative_error,
            "relative_error_with_gains_of_1": self.fallen_from,
            "bandwidth": self.tuning.to_json(),
        }


def identify_gains(
    model: Any, empty: Sequence[Recording], loaded: Sequence[Recording], payload: Array, processing: Processing
) -> DriveGains:
    """Estimate the drive gains of ``model`` from recordings without (``empty``) and with the payload (``loaded``).

    ``payload`` (10,) are its standard parameters in the frame of the last link. Raises InputError for recordings that
    do not fit the robot, DerivationError if the payload hardly loads a joint.
    """
    n = model.n
    every = [*empty, *loaded]
    for recording in every:
        if len(recording.joints) != n:
            raise InputError(f"a recording of {len(recording.joints)} joints for a robot with {n}")
    tuning = tune(processing, every)
    stated = DriveTerms.of_spec(model.spec)
    every_joint = tuple(range(n))
    terms = replace(stated, viscous=every_joint, coulomb=every_joint, offset=every_joint)
    full = FullRegressor(model, terms)
    structure = structure_of(full, full.names, n)
    kept = list(structure.kept)
    parts, blocks = [], []
    for recordings, here in ((empty, 0.0), (loaded, 1.0)):

        def regressor(q: Array, dq: Array, ddq: Array, here: float = here) -> Array:
            load = body_columns(model, q, dq, ddq) @ payload
            return np.concatenate([full(q, dq, ddq)[..., kept], here * load[..., None]], axis=-1)

        found, rows = factored(recordings, RowMaker(regressor, tuning.processing, len(kept) + 1))
        parts.append(found)
        blocks.append(rows)
    return _fitted(parts[0].merged(parts[1]), chain(*blocks), every[0].joints, tuning)


def _fitted(factors: JointFactors, blocks: Iterable[Rows], joints: Sequence[str], tuning: Tuning) -> DriveGains:
    """Fit the parameters beta (p,) and the inverse gains h (n,) by Gauss-Newton: ``I_j = h_j (W_j beta + l_j)``.

    ``factors`` are the triangular factors of the rows, ``blocks`` the rows for the tests of the residuals.
    """
    R, n = factors.R, len(factors.R)
    p = factors.parameters - 1
    W, load, current = R[..., :p], R[..., p], R[..., p + 1]
    idle = [name for name, row, own in zip(joints, load, current, strict=True) if not _matters(row, own)]
    if len(idle) == n:
        raise DerivationError("the payload loads no joint: its mass is 0, or no joint that moves carries it")
    scale = np.maximum(np.linalg.norm(W.reshape(-1, p), axis=0), np.finfo(float).tiny)
    weights = 1.0 / np.maximum(np.linalg.norm(current, axis=1), np.finfo(float).tiny)
    h = np.ones(n)
    beta = np.zeros(p)
    alone = 0.0
    inverse = np.eye(p + n)
    for k in range(PASSES):
        # parameters for these gains, then both together
        A = np.concatenate([w * hj * Wj for w, hj, Wj in zip(weights, h, W, strict=True)]) / scale
        y = np.concatenate([w * (cj - hj * lj) for w, cj, hj, lj in zip(weights, current, h, load, strict=True)])
        beta = np.linalg.lstsq(A, y, rcond=1e-10)[0] / scale
        model = W @ beta + load
        residual = current - h[:, None] * model
        if k == 0:
            alone = float(np.sqrt(np.sum(residual**2) / np.sum(current**2)))
        weights = np.sqrt(np.maximum(factors.counts, 1)) / np.maximum(
            np.linalg.norm(residual, axis=1), 1e-9 * np.linalg.norm(current, axis=1)
        )
        J = np.zeros((n, R.shape[1], p + n))
        for j in range(n):
            J[j, :, :p] = weights[j] * h[j] * W[j] / scale
            J[j, :, p + j] = weights[j] * model[j]
        stacked = J.reshape(-1, p + n)
        size = np.maximum(np.linalg.norm(stacked, axis=0), np.finfo(float).tiny)
        U, singular, Vt = np.linalg.svd(stacked / size, full_matrices=False)
        inverse = Vt.T / np.maximum(singular, np.finfo(float).eps * singular[0]) / size[:, None]
        step = inverse @ (U.T @ (weights[:, None] * residual).ravel())
        h = np.clip(h + step[p:], h / LARGEST_STEP, h * LARGEST_STEP)
        if np.max(np.abs(step[p:] / h)) < SETTLED:
            break
    freedom = max(1.0, float(np.sum(factors.counts)) - p - n)
    variance = float(np.sum((weights[:, None] * residual) ** 2)) / freedom
    white = residual_whiteness((replace(r, W=r.W * h[:, None]) for r in blocks), np.append(beta, 1.0))
    inflation = max((each.inflation for each in white), default=1.0)  # correlated residuals count for fewer
    spread = np.linalg.norm(inverse[p:], axis=1) * np.sqrt(variance * inflation)
    gain, std = 1.0 / h, spread / h**2
    each = zip(joints, gain, std, strict=True)
    poor = [f"{joint} ({value:.3g} +- {own:.2g})" for joint, value, own in each if not own <= CERTAIN * value]
    if poor:
        raise DerivationError(
            f"the gain of {', '.join(poor)} is not determined: the payload must load the joint, by its weight or by "
            "acceleration, and a heavier one or a livelier motion does so more; a torque of the wrong sign has no gain"
        )
    error = float(np.sqrt(np.sum(residual**2) / np.sum(current**2)))
    return DriveGains(tuple(joints), gain, std, error, alone, tuning)


def _matters(load: Array, current: Array) -> bool:
    """Whether the payload torque ``load`` of a joint is more than round-off, compared with its ``current``."""
    return bool(np.linalg.norm(load) > 1e-6 * np.linalg.norm(current))
