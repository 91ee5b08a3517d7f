"""Rows of the estimation problem with the columns of a body fixed to the last link."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from rrrgen.arrays import Array
from rrrgen.errors import InputError
from rrrgen.identify.estimation.factoring import FittedRows, factor_recordings, fits_in_memory, rows_of_recordings
from rrrgen.identify.estimation.full_regressor import RigidModel
from rrrgen.identify.estimation.observations import Observations, Recording, RowMaker
from rrrgen.identify.estimation.tsqr import JointFactors, Rows
from rrrgen.identify.scoring.split import Split
from rrrgen.model.standard_parameters import STANDARD


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


def factored(recordings: Sequence[Recording], maker: RowMaker) -> tuple[JointFactors, Iterable[Rows]]:
    """Triangular factors and blocks of all rows. Raises InputError if none is left."""
    for recording in recordings:
        if len(recording) == 0:
            raise InputError("a recording holds no samples")
    observations = Observations(tuple(recordings), maker)
    blocks: Iterable[Rows]
    if fits_in_memory(observations):
        factors, blocks, _ = rows_of_recordings(observations, Split())
    else:
        factors, blocks = factor_recordings(observations), FittedRows(observations, Split())
    if int(np.sum(factors.fit.counts)) == 0:
        raise InputError("no row is left to fit: check the lowest speed of the processing")
    return factors.fit, blocks


def deviations(function: Callable[[Array], Array], x: Array, covariance: Array) -> Array:
    """Standard deviations of ``function(x)`` by the delta method with central differences."""
    steps = 1e-6 * np.maximum(np.abs(x), 1e-3 * float(np.max(np.abs(x))))
    pairs = zip(steps, np.eye(len(x)), strict=True)
    moved = [(function(x + step * e) - function(x - step * e)) / (2 * step) for step, e in pairs]
    J = np.stack(moved, axis=-1)
    return np.asarray(np.sqrt(np.maximum(np.diag(J @ covariance @ J.T), 0.0)))
