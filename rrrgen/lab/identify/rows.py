"""Rows of the estimation problem with the columns of a body fixed to the last link."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.derive.parameters.physical_links import link_lengths
from rrrgen.lab.data.kalman import JITTER
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.estimate.tsqr import JointFactors, Rows
from rrrgen.lab.identify.factoring import FittedRows, factor_recordings, fits_in_memory, rows_of_recordings
from rrrgen.lab.identify.held_out_data import Split
from rrrgen.lab.identify.observations import Observations, Recording, RowMaker, reconstruct
from rrrgen.lab.identify.regressor import RigidModel
from rrrgen.robot.spec import STANDARD

SLOW = 0.05
"""Speed below which a sample is left out, as a share of the largest speed of its joint."""
STILL = 0.02
"""The same, as a share of the largest speed of all joints; those of prismatic joints over the length of a link."""

FEWEST = 20
"""Rows of a joint below which there is no estimate: some two cycles of the fastest part of the motion."""


@dataclass(frozen=True)
class SlowSamples:
    """Samples to leave out because friction near rest may have any value up to break-away.

    ``speeds`` (n,) are the lowest speeds of the joints whose samples count, rad/s (m/s); ``standing`` names the joints
    that are never faster.
    """

    speeds: tuple[float, ...]
    standing: tuple[str, ...]

    def sentences(self) -> tuple[str, ...]:
        """A sentence about the joints that stand, if there are any."""
        return standing_sentences(self.standing)


def standing_sentences(joints: Sequence[str]) -> tuple[str, ...]:
    """A sentence about the ``joints`` whose rows are left out because they stand; none without such joints."""
    if not joints:
        return ()
    names = ", ".join(joints)
    return (f"{names}: standing or hardly moving; friction there can have any value, so the torque is left out",)


def slow_samples(model: Any, recordings: Sequence[Recording], processing: Processing) -> SlowSamples:
    """Find the lowest speeds of ``recordings`` that count as sliding, unless ``processing`` states them.

    Presliding and the Stribeck effect reach up to some percent of the largest speed of a joint. A joint of ``model``
    that stands is still moved a little by the others. Raises InputError if none moves.
    """
    peak, steps, spread = np.zeros((3, len(recordings[0].joints)))
    for window in Observations(tuple(recordings), RowMaker(_no_columns, processing, 1)).windows():
        speed = reconstruct(window.part, processing).dq[window.start : window.stop]
        peak = np.maximum(peak, np.max(np.abs(speed), axis=0))
        steps = np.maximum(steps, np.std(np.diff(window.part.q, axis=0), axis=0))
        spread = np.maximum(spread, np.std(window.part.q, axis=0))
    if np.all(steps >= JITTER * spread):
        raise InputError("no joint moves in the recording: its positions are constant but for noise")
    sliding = [joint.type == "prismatic" for joint in model.spec.joints]
    scale = np.where(sliding, np.max(link_lengths(model.spec)), 1.0)
    lowest = np.maximum(SLOW * peak, STILL * scale * np.max(peak / scale))
    if processing.low_speed:
        lowest = np.asarray(processing.low_speed)
    standing = tuple(name for name, most, least in zip(recordings[0].joints, peak, lowest, strict=True) if most < least)
    return SlowSamples(tuple(float(v) for v in lowest), standing)


def _no_columns(q: Array, dq: Array, ddq: Array) -> Array:
    return np.zeros((*np.shape(q), 0))


def body_columns(model: RigidModel, q: Array, dq: Array, ddq: Array) -> Array:
    """Columns (N, n, 10) of the standard parameters of a body fixed to the last link, in the frame of that link."""
    return np.asarray(model.standard_regressor(q, dq, ddq))[..., -len(STANDARD) :]


def inertial(phi: Array) -> Array:
    """Mass, centre of mass (3) and inertia tensor about it (xx, yy, zz, xy, xz, yz), as (10,), of a body.

    ``phi`` (10,) are its standard parameters.
    """
    m, first = phi[0], phi[1:4]
    c = first / m
    Ixx, Ixy, Iyy, Ixz, Iyz, Izz = phi[4:]
    about_origin = np.array([[Ixx, Ixy, Ixz], [Ixy, Iyy, Iyz], [Ixz, Iyz, Izz]])
    tensor = about_origin - m * (c @ c * np.eye(3) - np.outer(c, c))
    return np.concatenate([[m], c, np.diag(tensor), [tensor[0, 1], tensor[0, 2], tensor[1, 2]]])


def standard_of(mass: float, com: Array, inertia: Array) -> Array:
    """Standard parameters (10,) of a body from its mass, centre of mass (3,) and tensor (6,) about it."""
    c = np.asarray(com, float)
    xx, yy, zz, xy, xz, yz = np.asarray(inertia, float)
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) + mass * (c @ c * np.eye(3) - np.outer(c, c))
    order = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))
    return np.array([mass, *(mass * c), *(tensor[place] for place in order)])


def factors_and_blocks(recordings: Sequence[Recording], maker: RowMaker) -> tuple[JointFactors, Iterable[Rows]]:
    """Triangular factors and blocks of all rows. Raises InputError if there are too few."""
    for recording in recordings:
        if len(recording) == 0:
            raise InputError("a recording holds no samples")
    observations = Observations(tuple(recordings), maker)
    blocks: Iterable[Rows]
    if fits_in_memory(observations):
        factors, blocks, _ = rows_of_recordings(observations, Split())
    else:
        factors, blocks = factor_recordings(observations), FittedRows(observations, Split())
    most = int(np.max(factors.fit.counts))
    if most < FEWEST:
        raise InputError(
            f"too little data: {most} rows of a joint are left after filtering, fewer than {FEWEST}; record longer, or "
            "check low_speed and decimate"
        )
    return factors.fit, blocks


def deviations(function: Callable[[Array], Array], x: Array, covariance: Array) -> Array:
    """Standard deviations of ``function(x)`` by the delta method with central differences."""
    steps = 1e-6 * np.maximum(np.abs(x), 1e-3 * float(np.max(np.abs(x))))
    pairs = zip(steps, np.eye(len(x)), strict=True)
    moved = [(function(x + step * e) - function(x - step * e)) / (2 * step) for step, e in pairs]
    J = np.stack(moved, axis=-1)
    return np.asarray(np.sqrt(np.maximum(np.diag(J @ covariance @ J.T), 0.0)))
