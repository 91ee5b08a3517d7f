"""The regressor of the estimation: base columns of the compiled model and columns of the drives, (14.10), (14.11)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from rrrgen.base.arrays import Array
from rrrgen.base.errors import InputError
from rrrgen.lab.data.kalman import KalmanSmoother
from rrrgen.lab.data.preprocessing import KALMAN, Processing, reconstruction_reach
from rrrgen.lab.data.reconstruction import Reconstruction
from rrrgen.lab.estimate.identifiability import (
    RELATIVE_TOLERANCE,
    Restriction,
    Structure,
    fix_standard,
    structure_of,
)
from rrrgen.lab.estimate.tsqr import JointFactors
from rrrgen.lab.identify.friction_columns import FrictionSurface, Sliding, law_columns
from rrrgen.lab.identify.parameters import Column, DriveTerms, nominal_drives
from rrrgen.robot.spec import standard_parameters
from rrrgen.runtime.regressor_columns import drive_columns


class RigidModel(Protocol):
    """Interface of the compiled robot that identification needs; :class:`rrrgen.runtime.model.Model` implements it."""

    @property
    def n(self) -> int: ...  # noqa: D102
    @property
    def spec(self) -> Any: ...  # noqa: D102
    @property
    def base_parameter_names(self) -> Sequence[str]: ...  # noqa: D102
    @property
    def base_projection(self) -> Array: ...  # noqa: D102

    def regressor(self, q: Array, dq: Array, ddq: Array) -> Array: ...  # noqa: D102
    def standard_regressor(self, q: Array, dq: Array, ddq: Array) -> Array: ...  # noqa: D102


@dataclass(frozen=True)
class FullRegressor:
    """Regressor W (N, n, p) of a robot with drives and friction: ``tau = W(q, dq, ddq) theta``.

    theta (p,) holds the base parameters of ``model``, the parameters of the drive ``terms``, and the linear parameters
    of the friction laws of ``surfaces`` (joints and motors). For laws that depend on the load, ``load`` (p,) holds the
    parameters from which the load torques are computed, with zeros for friction; if it is empty, the load is zero.
    Source: (14.10), (14.11).
    """

    model: RigidModel
    terms: DriveTerms
    surfaces: tuple[FrictionSurface, ...] = ()
    load: tuple[float, ...] = ()

    @property
    def columns(self) -> tuple[Column, ...]:
        """Descriptions of the p columns of W, in order."""
        rigid = tuple(Column(name, "rigid") for name in self.model.base_parameter_names)
        laws = tuple(column for surface in self.surfaces for column in surface.columns())
        return rigid + self.terms.columns(self.model.n) + laws

    @property
    def names(self) -> tuple[str, ...]:
        """The name of the parameter of every column."""
        return tuple(column.name for column in self.columns)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the robot file instead of the compiled model, which holds machine code; the receiver compiles it."""
        from rrrgen.runtime.model import Model

        if isinstance(self.model, Model):
            return _compiled_regressor, (self.model.spec, self.terms, self.surfaces, self.load)
        return FullRegressor, (self.model, self.terms, self.surfaces, self.load)

    @property
    def sliding(self) -> Sliding | None:
        """The object that computes the states of the friction laws along a motion; None if no law has a state."""
        return Sliding.of(self.surfaces)

    def __call__(self, q: Array, dq: Array, ddq: Array, s: Array | None = None) -> Array:
        """Evaluate W (N, n, p) at N points in time; ``q``, ``dq``, ``ddq`` are (N, n), in rad (m) and seconds.

        ``s`` (N, m) are the directions (-1 to 1) of the m friction laws with a state; None for steady sliding.
        """
        drives = drive_columns(self.terms.columns(self.model.n), np.asarray(dq, float), np.asarray(ddq, float))
        rigid = np.asarray(self.model.regressor(q, dq, ddq))
        if not self.surfaces:
            return np.concatenate([rigid, drives], axis=-1)
        columns = np.concatenate([rigid, drives], axis=-1)
        load = columns @ np.array(self.load) if self.load else None
        return np.concatenate([columns, law_columns(self.surfaces, np.asarray(dq, float), s, load)], axis=-1)

    def law_torque(self, theta: Array, motion: Reconstruction) -> Array:
        """Torque (N, n) of the friction laws of ``surfaces`` along one stretch of ``motion``, with ``theta`` (p,)."""
        count = sum(len(surface.columns()) for surface in self.surfaces)
        s = None if self.sliding is None else self.sliding.states(motion.q, motion.dq, self.sliding.start())
        if self.load:
            W = self(motion.q, motion.dq, motion.ddq, s)[..., len(theta) - count :]
        else:
            W = law_columns(self.surfaces, motion.dq, s)
        return np.asarray(W @ theta[len(theta) - count :])


STICKING = 3.0
"""Speed up to which a joint may stand, in standard deviations of the reconstructed speed."""


class Standstill(NamedTuple):
    """Samples to leave out: slower than ``speeds`` (n,), rad/s (m/s), or within ``around`` samples of such a one."""

    speeds: tuple[float, ...] = ()
    around: int = 0


def standstill(regressor: FullRegressor, processing: Processing, period: float) -> Standstill:
    """The samples to leave out because a joint with Coulomb friction may stand there; none for a joint without.

    A joint that stands carries any torque up to its Coulomb friction, and around a reversal the sign of the
    reconstructed speed is not known, over as many samples as the reconstruction spreads the reversal. No sample is left
    out where a law with a state describes the reversal, where one with shapes needs the low speeds, or with methods of
    reconstruction that state no uncertainty. ``period`` is that of the sampling, s.
    """
    method = processing.reconstructor() if processing.method in KALMAN else None
    if not isinstance(method, KalmanSmoother):
        return Standstill()
    n = regressor.model.n
    signs = [column.direction for column in regressor.terms.columns(n) if column.kind == "coulomb"]
    deviations = np.zeros(n)
    for direction in signs:
        if np.count_nonzero(direction) == 1:
            deviations[np.flatnonzero(direction)] = STICKING
    if not np.any(deviations):
        return Standstill()
    speeds = deviations * method.speed_deviations(period)
    return Standstill(tuple(speeds.tolist()), reconstruction_reach(processing, period))


_COMPILED: dict[bytes, RigidModel] = {}


def _compiled_regressor(
    spec: Any, terms: DriveTerms, surfaces: tuple[FrictionSurface, ...], load: tuple[float, ...]
) -> FullRegressor:
    """Rebuild the regressor of the robot ``spec`` when it is unpickled; each robot is compiled once per process."""
    import pickle

    from rrrgen.runtime.load import compile

    key = pickle.dumps(spec)
    if key not in _COMPILED:
        _COMPILED[key] = compile(spec)
    return FullRegressor(_COMPILED[key], terms, surfaces, load)


# ------------------------------------------------------------------------------------------------------------------
# The parameters to estimate: identifiable combinations of the columns after known parameters are fixed.
# ------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Parametrisation:
    """Map between the identifiable parameters x (r,) and the parameters theta (p,) of all columns.

    ``theta = T x + known`` with T (p, r), and ``x = G theta[free]`` with G from ``structure``, which also names x;
    ``free`` are the columns without a known value. ``unexcited`` are the names of those that :func:`hold_unexcited`
    keeps, ``notes`` sentences on them.
    """

    structure: Structure
    T: Array
    known: Array
    free: tuple[int, ...]
    unexcited: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def transform(self, factors: JointFactors) -> JointFactors:
        """Convert triangular factors of the rows for the parameters theta to those for the parameters x."""
        return factors.substitute(self.T, self.known)

    def expand(self, x: Array) -> Array:
        """The parameters theta (p,) of all columns for identifiable parameters ``x`` (r,)."""
        return np.asarray(self.T @ x + self.known)

    def held_from(self, first: int) -> tuple[int, ...]:
        """Indices of the columns from number ``first`` on that have a known value."""
        return tuple(i for i in range(first, len(self.known)) if i not in self.free)

    def contract(self, theta: Array) -> Array:
        """Identifiable parameters x (r,) of ``theta`` (p,); a matrix (p, k) is mapped column by column."""
        return np.asarray(self.structure.G @ theta[list(self.free)])


def hold_unexcited(
    chosen: Parametrisation,
    regressor: FullRegressor,
    factors: JointFactors,
    fixed: Mapping[str, float],
    fixed_standard: Mapping[str, float],
    seed: int = 0,
    measured: NDArray[np.bool_] | None = None,
    bodies: bool = True,
) -> Parametrisation:
    """Keep parameters that the rows of ``factors`` do not excite at all at the values of the robot file.

    The columns of a joint that stands, or whose rows are left out, are zero or round-off of the reconstructed motion:
    no torque tells their parameters, and nothing but a sign bounds those of drives and friction. These are kept at 0
    where the robot file has no value. Base parameters are kept if it has links, and not without ``bodies``; otherwise
    the prior determines them. ``chosen`` is the parametrisation by the other arguments, those of :func:`parametrise`;
    it is returned if all parameters are excited.
    """
    size = np.sqrt(np.sum(factors.R[:, :, :-1] ** 2, axis=(0, 1)))
    absent = size <= RELATIVE_TOLERANCE * np.max(size, initial=0.0)
    if not absent.any():
        return chosen
    stated = _nominal_values(regressor.model)
    free = set(chosen.structure.all_names)
    still = [
        column
        for column, gone in zip(regressor.columns, absent, strict=True)
        if gone and column.name in free and (column.kind != "rigid" or (bodies and column.name in stated))
    ]
    least = {column.name: 0.0 if column.is_non_negative else -np.inf for column in still}
    values = {name: max(stated.get(name, 0.0), bound) for name, bound in least.items()}
    effective = dict(zip(chosen.structure.all_names, np.any(chosen.structure.G, axis=0), strict=True))
    notes = []
    for name, value in values.items():
        seen = f"this motion does not excite {name} at all"
        reason = seen if effective[name] else f"{name} has no effect on any joint torque"
        source = "as in the robot file" if name in stated else "which the robot file leaves open"
        notes.append(f"{reason}: it stays at {value:.6g}, {source}")
    held = parametrise(regressor, values | dict(fixed), fixed_standard, seed, measured)
    return replace(held, unexcited=tuple(values), notes=tuple(notes))


def _nominal_values(model: RigidModel) -> dict[str, float]:
    """The base, drive and friction parameters (SI) by name that the robot file of ``model`` states."""
    spec, K = model.spec, np.asarray(model.base_projection)
    if spec is None:
        return {}
    phi = np.array([standard_parameters(link) for link in spec.links or ()], float).ravel()
    base = zip(model.base_parameter_names, K @ phi, strict=True) if phi.size == K.shape[1] else ()
    return {name: float(value) for name, value in base} | nominal_drives(spec)


LEAST_SINE = 0.2
"""Sine between the bars of closed loops at random positions: nearer to a dead point, its terms outweigh all others."""


def loop_status(model: RigidModel, least: float = 0.0) -> Callable[[Array], NDArray[np.int64]] | None:
    """A function that gives the status of the closed loops of ``model`` at positions (N, n); None without loops.

    It is that of the function ``closed_loops``, and 1 also where a sine between bars is below ``least``.
    """
    if model.spec is None or not model.spec.loops:
        return None
    closed_loops: Callable[..., Any] = getattr(model, "closed_loops")  # noqa: B009 (only robots with loops have it)

    def status(q: Array) -> NDArray[np.int64]:
        loops, code = closed_loops(q, with_status=True)
        near = np.min(loops.sine, axis=-1) < least
        return np.where(near & (code == 0), 1, code)

    return status


def assembly_mask(model: RigidModel) -> Callable[[Array], NDArray[np.bool_]] | None:
    """A mask (N,) of positions (N, n) at which the closed loops of ``model`` are assembled; None without loops."""
    status = loop_status(model, LEAST_SINE)
    return None if status is None else lambda q: status(q) == 0


def parametrise(
    regressor: FullRegressor,
    fixed: Mapping[str, float],
    fixed_standard: Mapping[str, float],
    seed: int = 0,
    measured: NDArray[np.bool_] | None = None,
) -> Parametrisation:
    """Find the identifiable parameters of ``regressor`` after known parameters are fixed.

    ``fixed`` maps column names to known values, ``fixed_standard`` standard parameters; ``seed`` is that of the random
    motions from which the rank is taken, ``measured`` (n,) the joints whose torques are, all if None. Raises
    :class:`InputError` for a name that does not exist, a negative value of a parameter that cannot be, or a column that
    already follows from the fixed standard parameters.
    """
    names = regressor.names
    unknown = [name for name in fixed if name not in names]
    if unknown:
        raise InputError(f"no parameter '{unknown[0]}'; there are {', '.join(names)}")
    for column in regressor.columns:
        if column.is_non_negative and fixed.get(column.name, 0.0) < 0.0:
            raise InputError(f"the known value of '{column.name}' is {fixed[column.name]:g}; it must not be negative")
    b = len(regressor.model.base_parameter_names)
    rigid = (
        fix_standard(np.asarray(regressor.model.base_projection), fixed_standard)
        if fixed_standard
        else Restriction(tuple(range(b)), np.eye(b), np.zeros(b))
    )
    p = len(names)
    T = np.zeros((p, len(rigid.kept) + p - b))
    T[:b, : len(rigid.kept)] = rigid.B
    T[b:, len(rigid.kept) :] = np.eye(p - b)
    z_names = [names[i] for i in rigid.kept] + list(names[b:])
    known = np.concatenate([rigid.beta_0, np.zeros(p - b)])
    free = []
    for i, name in enumerate(z_names):
        if name in fixed:
            known = known + T[:, i] * fixed[name]
        else:
            free.append(i)
    for name in fixed:
        if name not in z_names:
            raise InputError(
                f"'{name}' follows from the standard parameters that are fixed; it cannot be fixed as well"
            )
    T = T[:, free]
    columns = [*rigid.kept, *range(b, p)]

    moved = sum(surface.has_state for surface in regressor.surfaces)

    def restricted_regressor(q: Array, dq: Array, ddq: Array) -> Array:
        # away from steady sliding, where bristles do not move and their damping has no effect
        s = np.random.default_rng(seed).uniform(-1, 1, (len(q), moved))
        W = regressor(q, dq, ddq, s if moved else None)
        return np.asarray((W if measured is None else W[:, measured]) @ T)

    possible = assembly_mask(regressor.model)
    structure = structure_of(
        restricted_regressor, [z_names[i] for i in free], regressor.model.n, seed, possible=possible
    )
    return Parametrisation(structure, T[:, list(structure.kept)], known, tuple(columns[i] for i in free))
