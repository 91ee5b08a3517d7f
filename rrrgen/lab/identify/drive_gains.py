"""Estimates unknown drive gains from two recordings, without and with a known payload.

The recorded torque or current I_j of joint j is its torque divided by an unknown gain: ``g_j I_j = W_j beta + b l_j``,
where l_j is the torque that the payload causes and b is 1 in the recording with it, 0 without. All parameters of the
arm are estimated together with the gains, and friction in each of the two recordings, since it grows with the load of
a gear and with temperature; only the payload sets the scale. The noise e_j is that of the currents, so
``I_j = (W_j beta + b l_j) / g_j + e_j`` is fitted by a damped search. The linear fit of ``g_j I_j - W_j beta = b l_j``
has the noisy currents among its columns and is biased, but it tells where to start, and with which sign.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import DerivationError, InputError, option_name
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.estimate.identifiability import structure_of
from rrrgen.lab.estimate.linear import solve
from rrrgen.lab.estimate.search import search
from rrrgen.lab.estimate.statistics import residual_whiteness
from rrrgen.lab.estimate.tsqr import JointFactors, Rows
from rrrgen.lab.identify.bandwidth import Tuning, tune
from rrrgen.lab.identify.observations import Recording, RowMaker
from rrrgen.lab.identify.parameters import DriveTerms
from rrrgen.lab.identify.regressor import FullRegressor, assembly_mask
from rrrgen.lab.identify.rows import body_columns, factors_and_blocks, slow_samples
from rrrgen.lab.identify.scores import UNEXPLAINED, not_explained

PASSES = 50
SETTLED = 1e-14  # relative decrease of the weighted squares at which the search ends
LARGEST_STEP = 3.0  # factor by which a gain may change in one step; it keeps its sign
CERTAIN = 0.2  # relative standard deviation above which a gain is not determined
UNDETERMINED = 1e-11  # singular value, relative, of a combination that the recordings do not determine
LARGEST_WEAK_PART = 1e-4  # part of a gain in such combinations above which it is not determined either
COLLAPSED = 1e-4  # inverse gain below which the recorded torque does not change with the payload
FAINT = 1e-6  # gain of the linear fit below which it does not tell where to start
FRICTION = ("viscous", "coulomb")  # kinds of columns that may differ between the recordings


@dataclass(frozen=True, eq=False)
class DriveGains:
    """Estimated drive gains of n joints: true divided by recorded torque, with standard deviations ``std`` (n,).

    ``determined`` (n,) is False for gains that the payload does not determine. ``relative_error`` is that of the
    model with these gains on the recorded torques, ``fallen_from`` that with all gains 1. ``tuning`` describes the
    filters, ``notes`` are sentences on what is left out.
    """

    joints: tuple[str, ...]
    gain: Array
    std: Array
    determined: NDArray[np.bool_]
    relative_error: float
    fallen_from: float
    tuning: Tuning
    notes: tuple[str, ...] = ()

    @property
    def undetermined(self) -> tuple[str, ...]:
        """The joints whose gain the payload does not determine."""
        return tuple(joint for joint, known in zip(self.joints, self.determined, strict=True) if not known)

    def lines(self) -> list[str]:
        """The gains with their deviations as text."""
        lines = [
            f"{joint}: true torque = {gain:.5g} +- {std:.2g} times the recorded one"
            if known
            else f"{joint}: not determined"
            for joint, gain, std, known in zip(self.joints, self.gain, self.std, self.determined, strict=True)
        ]
        before, after = 100 * self.fallen_from, 100 * self.relative_error
        lines.append(f"relative torque error: {after:.3g} % with these gains, {before:.3g} % with all gains 1")
        lines.append("in the mapping file, multiply the torque constant (or the unit) of each joint by its gain")
        return [*lines, *(f"note: {note}" for note in self.notes)]

    def to_json(self) -> dict[str, Any]:
        """The gains, errors and filters as plain data for JSON; None for a gain that is not determined."""
        rows = zip(self.joints, self.gain, self.std, self.determined, strict=True)
        values = {joint: (gain, std) if known else (None, None) for joint, gain, std, known in rows}
        return {
            "gain": {joint: gain for joint, (gain, _) in values.items()},
            "std": {joint: std for joint, (_, std) in values.items()},
            "undetermined": list(self.undetermined),
            "notes": list(self.notes),
            "relative_error": self.relative_error,
            "relative_error_with_gains_of_1": self.fallen_from,
            "bandwidth": self.tuning.to_json(),
        }


def identify_gains(
    model: Any, empty: Sequence[Recording], loaded: Sequence[Recording], payload: Array, processing: Processing
) -> DriveGains:
    """Estimate the drive gains of ``model`` from recordings without (``empty``) and with the payload (``loaded``).

    ``payload`` (10,) are its standard parameters in the frame of the last link. Raises InputError for recordings that
    do not fit the robot, DerivationError if no gains explain the torques or the payload tells none of them.
    """
    n = model.n
    every = [*empty, *loaded]
    for recording in every:
        if len(recording.joints) != n:
            raise InputError(f"a recording of {len(recording.joints)} joints for a robot with {n}")
    tuning = tune(processing, every)
    slow = slow_samples(model, every, tuning.processing)
    every_joint = tuple(range(n))
    stated = DriveTerms.of_spec(model.spec)
    full = FullRegressor(model, replace(stated, viscous=every_joint, coulomb=every_joint, offset=every_joint))
    kept = structure_of(full, full.names, n, possible=assembly_mask(model)).kept
    changing = [i for i in kept if full.columns[i].kind in FRICTION]
    lasting = [i for i in kept if i not in changing]
    parts, blocks = [], []
    for recordings, here in ((empty, 0.0), (loaded, 1.0)):

        def regressor(q: Array, dq: Array, ddq: Array, here: float = here) -> Array:
            W, load = full(q, dq, ddq), body_columns(model, q, dq, ddq) @ payload
            friction = W[..., changing]
            columns = [W[..., lasting], (1.0 - here) * friction, here * friction, here * load[..., None]]
            return np.concatenate(columns, axis=-1)

        width = len(kept) + len(changing) + 1
        factors, rows = factors_and_blocks(recordings, RowMaker(regressor, tuning.processing, width, slow=slow.speeds))
        parts.append(factors)
        blocks.append(rows)
    fitted = _fit_gains(parts[0].merge(parts[1]), chain(*blocks), every[0].joints, tuning)
    return replace(fitted, notes=(*slow.sentences(), *fitted.notes))


def _fit_gains(factors: JointFactors, blocks: Iterable[Rows], joints: Sequence[str], tuning: Tuning) -> DriveGains:
    """Fit the parameters beta (p,) and the inverse gains h (n,): ``I_j = h_j (W_j beta + l_j)``.

    ``factors`` are the triangular factors of the rows, ``blocks`` the rows for the tests of the residuals.
    """
    R, n = factors.R, len(factors.R)
    p = factors.parameters - 1
    W, load, current = R[..., :p], R[..., p], R[..., p + 1]
    idle = [
        name for name, row, joint_current in zip(joints, load, current, strict=True) if not _matters(row, joint_current)
    ]
    if len(idle) == n:
        raise DerivationError("the payload loads no joint: its mass is 0, or no joint that moves carries it")
    floor = np.maximum(1e-9 * np.linalg.norm(current, axis=1), np.finfo(float).tiny)
    weights = 1.0 / np.maximum(np.linalg.norm(current, axis=1), np.finfo(float).tiny)

    def torque(x: Array) -> Array:
        return np.asarray(W @ x[:p] + load)

    def residual_of(x: Array) -> Array:
        return np.asarray(current - x[p:, None] * torque(x))

    def renew(x: Array) -> None:
        weights[:] = np.sqrt(factors.counts) / np.maximum(np.linalg.norm(residual_of(x), axis=1), floor)

    def linearise(x: Array) -> tuple[Array, Array]:
        J = np.zeros((n, W.shape[1], p + n))
        J[..., :p] = -x[p:, None, None] * W
        J[np.arange(n), :, p + np.arange(n)] = -torque(x)
        return (weights[:, None] * residual_of(x)).ravel(), (weights[:, None, None] * J).reshape(-1, p + n)

    def with_parameters(h: Array) -> Array:
        """Unknowns with the gains ``h``, and the parameters that fit best with them."""
        A = (weights * h)[:, None, None] * W
        return np.append(solve(A.reshape(-1, p), (weights[:, None] * (current - h[:, None] * load)).ravel()).x, h)

    def apply_step(x: Array, step: Array) -> Array:
        """The unknowns after a step; a gain keeps its sign and changes by LARGEST_STEP at most."""
        return with_parameters(x[p:] * np.clip(1.0 + step[p:] / x[p:], 1.0 / LARGEST_STEP, LARGEST_STEP))

    start = with_parameters(_start(W, load, current, weights))
    renew(start)
    minimum = search(start, linearise, moved=apply_step, after=renew, steps=PASSES, small_gain=SETTLED)
    beta, h, residual = minimum.state[:p], minimum.state[p:], residual_of(minimum.state)
    both = solve(minimum.J, minimum.r, UNDETERMINED)
    inverse, weak = both.inverse[p:], np.linalg.norm(both.weak[:, p:], axis=0) > LARGEST_WEAK_PART
    freedom = max(1.0, float(np.sum(factors.counts)) - p - n)
    variance = float(np.sum((weights[:, None] * residual) ** 2)) / freedom
    white = residual_whiteness((replace(r, W=r.W * h[:, None]) for r in blocks), np.append(beta, 1.0))
    inflation = max((whiteness.inflation for whiteness in white), default=1.0)  # correlated residuals count for fewer
    spread = np.linalg.norm(inverse, axis=1) * np.sqrt(variance * inflation)
    gain, std = 1.0 / h, spread / h**2
    absent = np.abs(h) < COLLAPSED
    determined = (std <= CERTAIN * np.abs(gain)) & ~weak & ~absent
    notes = _notes(joints, gain, std, absent, ~determined & ~absent & (factors.counts > 0))
    if np.any(determined) and np.all(gain[determined] < 0.0):
        notes = (
            *notes,
            f"no joint carries the payload in the recording {option_name('loaded')}: are the recordings exchanged?",
        )
        determined[:] = False
    total = float(np.sum(current**2))
    error = float(np.sqrt(np.sum(residual**2) / total))
    if error > UNEXPLAINED:
        raise DerivationError(not_explained("no gains explain the torques", [error]))
    if not np.any(determined):
        raise DerivationError("; ".join(notes))
    plain = solve(W.reshape(-1, p), (current - load).ravel()).x
    alone = float(np.sqrt(np.sum((current - load - W @ plain) ** 2) / total))
    return DriveGains(tuple(joints), gain, std, determined, error, alone, tuning, notes)


def _start(W: Array, load: Array, current: Array, weights: Array) -> Array:
    """Inverse gains (n,) of the linear fit ``g_j I_j - W_j beta = l_j``; 1 where it tells nothing.

    ``W`` (n, k, p), ``load`` and ``current`` (n, k) are the rows of the joints, with ``weights`` (n,).
    """
    n, _, p = W.shape
    A = np.concatenate([-W, np.zeros((n, W.shape[1], n))], axis=-1)
    for j in range(n):
        A[j, :, p + j] = current[j] * weights[j]
    g = solve((A * weights[:, None, None]).reshape(-1, p + n), (load * weights[:, None]).ravel()).x[p:] * weights
    return np.divide(1.0, g, out=np.ones(n), where=np.abs(g) > FAINT)


def _notes(
    joints: Sequence[str], gain: Array, std: Array, absent: NDArray[np.bool_], poor: NDArray[np.bool_]
) -> tuple[str, ...]:
    """Sentences on joints in whose torque the payload is ``absent``, and on those whose gain is hardly determined."""
    notes = []
    wrong = [joint for j, joint in enumerate(joints) if gain[j] < 0.0 and not (absent[j] or poor[j])]
    if wrong:
        notes.append(f"{', '.join(wrong)}: the sign of the recorded torque is wrong")
    if np.any(absent):
        names = ", ".join(joint for joint, none in zip(joints, absent, strict=True) if none)
        notes.append(f"{names}: the recorded torque is the same with the payload: do both recordings have it, or none?")
    if np.any(poor):
        poorly = [f"{joint} ({gain[j]:.3g} +- {std[j]:.2g})" for j, joint in enumerate(joints) if poor[j]]
        notes.append(
            f"the gain of {', '.join(poorly)} is not determined: the payload must load the joint, by its weight or by "
            "acceleration; a heavier one or a livelier motion does so more"
        )
    return tuple(notes)


def _matters(load: Array, current: Array) -> bool:
    """Whether the payload torque ``load`` of a joint is more than round-off, compared with its ``current``."""
    return bool(np.linalg.norm(load) > 1e-6 * np.linalg.norm(current))
