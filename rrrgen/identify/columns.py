"""The regressor that is identified: rigid-body columns of the compiled model, and linear terms of the drives.

Every drive term acts along a direction ``w`` of joint space: with ``s = w q`` it contributes the generalised force
``w f``, where f is ``dds`` (drive inertia), ``ds`` (viscous), ``sgn ds`` (Coulomb) or 1 (offset). A drive on one joint
has the unit vector as direction; a drive that turns with several joints, as the last motor of a coupled wrist, has
the row of the coupling matrix.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from rrrgen.errors import InputError

Array = NDArray[np.floating[Any]]
Kind = Literal["rigid", "inertia", "viscous", "coulomb", "offset"]

DRIVE_KINDS: tuple[Kind, ...] = ("inertia", "viscous", "coulomb", "offset")
SYMBOLS = {"inertia": "Ia", "viscous": "fv", "coulomb": "fc", "offset": "off"}
STANDSTILL = 1e-7
"""Speed (rad/s, m/s) below which a joint stands still: the round-off of a reconstruction has no sign."""
STANDARD = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
"""Standard parameters of one link, in their order: first moments and inertia tensor about the origin of the frame."""


class RigidModel(Protocol):
    """What identification needs of a compiled robot (:class:`rrrgen.runtime.Model` has it)."""

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
class Column:
    """One column: its name, its kind and, for a drive term, its direction ``w`` (n,)."""

    name: str
    kind: Kind
    direction: tuple[float, ...] = ()


@dataclass(frozen=True)
class CoupledDrive:
    """A drive that turns with ``s = w q``: adds the given terms along ``w``, named ``Ia_<name>``, ``fv_<name>``, ..."""

    name: str
    direction: tuple[float, ...]
    terms: tuple[Kind, ...] = ("inertia", "viscous", "coulomb")


@dataclass(frozen=True)
class DriveTerms:
    """Which joints (counted from 0) have which linear drive terms, and the coupled drives."""

    inertia: tuple[int, ...] = ()
    viscous: tuple[int, ...] = ()
    coulomb: tuple[int, ...] = ()
    offset: tuple[int, ...] = ()
    coupled: tuple[CoupledDrive, ...] = ()

    @classmethod
    def everywhere(cls, n: int, *kinds: Kind, coupled: Sequence[CoupledDrive] = ()) -> DriveTerms:
        """The terms ``kinds`` at all ``n`` joints."""
        return cls(**{kind: tuple(range(n)) for kind in kinds}, coupled=tuple(coupled))

    @classmethod
    def of_spec(cls, spec: Any, coupled: Sequence[CoupledDrive] = ()) -> DriveTerms:
        """The terms that the robot file names: ``drive.inertia`` and ``friction.viscous``, ``coulomb``, ``offset``."""

        def joints(part: str, key: str) -> tuple[int, ...]:
            owners = enumerate(getattr(joint, part) for joint in spec.joints)
            return tuple(i for i, owner in owners if owner is not None and getattr(owner, key) is not None)

        return cls(
            inertia=joints("drive", "inertia"),
            viscous=joints("friction", "viscous"),
            coulomb=joints("friction", "coulomb"),
            offset=joints("friction", "offset"),
            coupled=tuple(coupled),
        )

    def without(self, *kinds: Kind) -> DriveTerms:
        """The same without the per-joint terms of these kinds."""
        parts = {kind: () if kind in kinds else getattr(self, kind) for kind in DRIVE_KINDS}
        return DriveTerms(**parts, coupled=self.coupled)

    def columns(self, n: int) -> tuple[Column, ...]:
        """The columns, kind by kind, then the coupled drives."""
        found = []
        for kind in DRIVE_KINDS:
            for joint in getattr(self, kind):
                if not 0 <= joint < n:
                    raise InputError(f"a drive term at joint {joint + 1} of a robot with {n} joints")
                unit = tuple(float(i == joint) for i in range(n))
                found.append(Column(f"{SYMBOLS[kind]}{joint + 1}", kind, unit))
        for drive in self.coupled:
            if len(drive.direction) != n or not any(drive.direction):
                raise InputError(f"the coupled drive '{drive.name}' needs a direction of {n} weights, not all zero")
            found += [Column(f"{SYMBOLS[kind]}_{drive.name}", kind, drive.direction) for kind in drive.terms]
        return tuple(found)


def drive_columns(columns: Sequence[Column], dq: Array, ddq: Array) -> Array:
    """The columns (N, n, len(columns)) of drive terms: ``w f(w dq, w ddq)``; ``sgn ds = 0`` at a standstill."""
    W = np.zeros((*dq.shape, len(columns)))
    for k, column in enumerate(columns):
        w = np.asarray(column.direction)
        force = _force(column.kind, dq @ w, ddq @ w)
        for joint in np.flatnonzero(w):
            W[..., joint, k] = w[joint] * force
    return W


def _force(kind: Kind, speed: Array, acceleration: Array) -> Array | float:
    if kind == "inertia":
        return acceleration
    if kind == "viscous":
        return speed
    if kind == "coulomb":
        return np.sign(speed) * (np.abs(speed) > STANDSTILL)
    return 1.0


@dataclass(frozen=True)
class FullRegressor:
    """``W(q, dq, ddq)`` (N, n, p): the base columns of the model and the drive columns, side by side (14.10),
    (14.11).
    """

    model: RigidModel
    terms: DriveTerms

    @property
    def columns(self) -> tuple[Column, ...]:
        """All columns in order."""
        rigid = tuple(Column(name, "rigid") for name in self.model.base_parameter_names)
        return rigid + self.terms.columns(self.model.n)

    @property
    def names(self) -> tuple[str, ...]:
        """The parameter of every column."""
        return tuple(column.name for column in self.columns)

    def __reduce__(self) -> tuple[Any, ...]:
        """A compiled model holds code of this machine: another process compiles the robot itself."""
        from rrrgen.runtime.model import Model

        if isinstance(self.model, Model):
            return _compiled_regressor, (self.model.spec, self.terms)
        return FullRegressor, (self.model, self.terms)

    def __call__(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Evaluate at N instants; ``q``, ``dq``, ``ddq`` are (N, n)."""
        drives = drive_columns(self.terms.columns(self.model.n), np.asarray(dq, float), np.asarray(ddq, float))
        return np.concatenate([np.asarray(self.model.regressor(q, dq, ddq)), drives], axis=-1)


_COMPILED: dict[bytes, RigidModel] = {}


def _compiled_regressor(spec: Any, terms: DriveTerms) -> FullRegressor:
    """The regressor of ``spec`` in this process, which compiles every robot once."""
    import pickle

    import rrrgen

    key = pickle.dumps(spec)
    if key not in _COMPILED:
        _COMPILED[key] = rrrgen.compile(spec)
    return FullRegressor(_COMPILED[key], terms)


def standard_names(n: int) -> tuple[str, ...]:
    """Names of the 10 n standard parameters: ``m1, mx1, ..., Izz1, m2, ...``."""
    return tuple(f"{name}{link + 1}" for link in range(n) for name in STANDARD)
